"""The velocity at which an acceleration of the user's own acts: w = without + N a(x, w, t) dt is solved for a particle.

Newton's method with one Jacobian, by a change as large as the velocity, ends at once where a is linear in w, and soon
where it nearly is. Where its steps do not halve what is missing, as of a stiff or sharp drag, w is sought anew from
`without` on, with a Jacobian of each place by small changes. A step that goes too far changes the sign of what is
missing on its way: it is cut down to there, so that no drag makes a step unstable. Where a jumps, as that of dry
friction, w comes no nearer than the jump: it stays there, and a is what keeps it there.
"""

import math
from collections.abc import Callable

from hpcpic.core.simd.compile import njit

MOST_CHORDS = 20  # steps with one Jacobian
MOST_TANGENTS = 60  # steps with a Jacobian of each place
MOST_HALVES = 60  # of the way of one of those steps
SETTLED = 1e-12  # of a velocity: what the last step changes
NEAR = 1e-6  # of a velocity: what is missing then; far off, a steep acceleration makes any step small
SMALL_CHANGE = 1e-7  # of a velocity, for the Jacobian of a place
STALLED = 0.99  # of what was missing: more than this of it is left by a step that a jump cuts down
MOST_STALLS = 2  # steps that were cut down so


@njit(cache=False)
def turned(m, v):
    return (
        m[0, 0] * v[0] + m[0, 1] * v[1] + m[0, 2] * v[2],
        m[1, 0] * v[0] + m[1, 1] * v[1] + m[1, 2] * v[2],
        m[2, 0] * v[0] + m[2, 1] * v[1] + m[2, 2] * v[2],
    )


@njit(cache=False)
def cross(p, q):
    return p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]


@njit(cache=False)
def dot(p, q):
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@njit(cache=False)
def size(v):
    return abs(v[0]) + abs(v[1]) + abs(v[2])


@njit(cache=False)
def beyond(v, a, dt):
    return v[0] + a[0] * dt, v[1] + a[1] * dt, v[2] + a[2] * dt


@njit(cache=False)
def inverse(p, q, r):
    """Rows of the inverse of a matrix of these columns, times its determinant, and the determinant."""
    qr = cross(q, r)
    return qr, cross(r, p), cross(p, q), dot(p, qr)


def own_acceleration(of: Callable, components: int) -> Callable:
    """The function of (x, without, N, t, dt, back) that gives a(x, w, t) at the w sought.

    of: a compiled acceleration a(x, v, t). components: how many of the three a velocity has.
    """

    @njit(cache=False)
    def held(w, without, share, dt):
        """The acceleration that keeps w: a(x, w, t) is less exact where it is steep, and anything where it jumps."""
        p = share[0, 0], share[1, 0], share[2, 0]
        q = (share[0, 1], share[1, 1], share[2, 1]) if components > 1 else (0.0, 1.0, 0.0)
        r = (share[0, 2], share[1, 2], share[2, 2]) if components > 2 else (0.0, 0.0, 1.0)
        qr, rp, pq, volume = inverse(p, q, r)
        by = beyond(w, without, -1.0)
        return dot(by, qr) / (volume * dt), dot(by, rp) / (volume * dt), dot(by, pq) / (volume * dt)

    @njit(cache=False)
    def column(x, w, a, t, h, axis, share, dt):
        """A column of the derivative by w of w - N a(x, w, t) dt, by a finite change h of w along an axis."""
        unit = (1.0 * (axis == 0), 1.0 * (axis == 1), 1.0 * (axis == 2))
        if axis >= components:
            return unit
        there = of(x, beyond(w, unit, h), t)
        return beyond(unit, turned(share, (there[0] - a[0], there[1] - a[1], there[2] - a[2])), -dt / h)

    @njit(cache=False)
    def derivative(x, w, a, t, h, share, dt):
        """The inverse of that derivative, as `inverse` gives it."""
        p, q = column(x, w, a, t, h, 0, share, dt), column(x, w, a, t, h, 1, share, dt)
        return inverse(p, q, column(x, w, a, t, h, 2, share, dt))

    @njit(cache=False)
    def missing(w, a, without, share, dt):
        return beyond(beyond(without, turned(share, a), dt), w, -1.0)

    @njit(cache=False)
    def sought(x, without, first, share, t, dt):
        """By a Jacobian of each place, from w = without on, where a is `first`."""
        w, a, misses, stalls = without, first, missing(without, first, without, share, dt), 0
        for _ in range(MOST_TANGENTS):
            h = SMALL_CHANGE * (size(w) if size(w) > 0.0 else size(misses))
            qr, rp, pq, volume = derivative(x, w, a, t, h, share, dt)
            way = dot(misses, qr) / volume, dot(misses, rp) / volume, dot(misses, pq) / volume
            least = SETTLED * (size(w) + size(without))
            if size(way) <= least:
                return held(w, without, share, dt)
            if not size(way) < math.inf:
                break
            sign = 1.0 if dot(misses, way) > 0.0 else -1.0
            part, low, high, halved, left = 1.0, 0.0, 1.0, False, misses
            for _ in range(MOST_HALVES):
                v = beyond(w, way, part)
                a_v = of(x, v, t)
                misses_v = missing(v, a_v, without, share, dt)
                halved = size(misses_v) <= 0.5 * size(misses)
                if halved or sign * dot(misses_v, way) > 0.0:
                    low, a, left = part, a_v, misses_v
                else:
                    high = part
                if halved or low == 1.0 or (high - low) * size(way) <= least:
                    break
                part = 0.5 * (low + high)
            w = beyond(w, way, low)
            stalls += not halved and low < 1.0 and size(left) > STALLED * size(misses)
            if stalls == MOST_STALLS:
                return held(w, without, share, dt)
            misses = left
        return a

    @njit(cache=False)
    def settled(x, without, share, t, dt, back):
        """a(x, w, t). back: of an impulse back in time, which no w may solve where a is a strong drag: that of
        `without` then, which is of second order too, as a run has one such impulse.
        """
        first = of(x, without, t)
        w = beyond(without, turned(share, first), dt)
        a = of(x, w, t)
        h = size(w) + abs(dt) * size(a)
        if a[0] == first[0] and a[1] == first[1] and a[2] == first[2]:
            return a
        if h == 0.0:
            return first if back else sought(x, without, first, share, t, dt)
        qr, rp, pq, volume = derivative(x, w, a, t, h, share, dt)
        missed = 0.0
        for chord in range(MOST_CHORDS):
            misses = missing(w, a, without, share, dt)
            if chord > 0 and not size(misses) <= 0.5 * missed:
                break
            missed = size(misses)
            change = dot(misses, qr), dot(misses, rp), dot(misses, pq)
            w = beyond(w, change, 1.0 / volume)
            if size(change) <= SETTLED * abs(volume) * size(w) and size(misses) <= NEAR * size(w):
                return a
            a = of(x, w, t)
        return first if back else sought(x, without, first, share, t, dt)

    return settled
