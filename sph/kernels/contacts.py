"""Rigid bodies that touch each other and walls or hang on lines, forward by short steps of their own.

Velocity Verlet, with velocities predicted for the dashpots: that of the grains of lbmdem, whose contact law this is.
All vectors have three components, in physical axes; what leaves the plane of a scene in 2D is 0.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.physics import contact_law
from hpcpic.core.physics.contact_law import SHEAR_RATIO, ContactLaw, dot, normal_force, slip_velocity, spring_friction
from hpcpic.core.simd.compile import formulas, njit
from hpcpic.core.simd.scratch import empty
from sph.physics import lines

formulas(contact_law, lines)
Reals = NDArray[np.float64]
Numbers = NDArray[np.int64]


class Solids(NamedTuple):
    """Bodies and walls by number n of the wall: place[n, 3] m of a point O of the body, its centre or hinge; rotation
    turn[n, 4] from t = 0, velocity[n, 3] of O in m/s, spin[n, 3] 1/s, momentum[n, 3] of the spin; what forces at O and
    torques about it give: inverse_mass[n, 3] and inverse[n, 3, 3], in the frame of t = 0 where `tumbles` (else it stays
    as it is); pull[n, 3] m/s2 and twist[n, 3] by all else: a torque where the body tumbles, else an acceleration.
    """

    place: Reals
    turn: Reals
    velocity: Reals
    spin: Reals
    momentum: Reals
    inverse_mass: Reals
    inverse: Reals
    tumbles: NDArray[np.bool_]
    pull: Reals
    twist: Reals


class Touches(NamedTuple):
    """Spheres c of one solid near a tangent plane of another: numbers of both; the place arm[c, 3] of the sphere from O
    of the first, and its `radius`, m; a point foot[c, 3] and the normal[c, 3] of the plane, from O of the second, all
    in the frames of t = 0; shift[c, 3]: of the second, through periodic sides; springs[c, 3] m of friction. Those of
    pair p are c = cuts[p] .. cuts[p + 1], of laws[p] = stiffness of one, damping, friction.
    """

    first: Numbers
    second: Numbers
    arm: Reals
    foot: Reals
    normal: Reals
    shift: Reals
    radius: Reals
    springs: Reals
    cuts: Numbers
    laws: Reals


class Lines(NamedTuple):
    """Lines m from arm[m, 3] of a body, from its O in the frame of t = 0, to anchor[m, 3]; laws[m] = stiffness, length,
    damping, 1 if it pushes too.
    """

    body: Numbers
    arm: Reals
    anchor: Reals
    laws: Reals


class Loads(NamedTuple):
    """By solid n: force[n, 3] N and torque[n, 3] N m about O of contacts and lines, force contact[n, 3] of contacts
    alone, and the integrals over time impulse[n, 6] of contacts and of both, N s.
    """

    force: Reals
    torque: Reals
    contact: Reals
    impulse: Reals


@njit
def turned(q, v):
    """v rotated by the unit quaternion q (w, x, y, z)."""
    x, y, z = 2 * (q[2] * v[2] - q[3] * v[1]), 2 * (q[3] * v[0] - q[1] * v[2]), 2 * (q[1] * v[1] - q[2] * v[0])
    return (v[0] + q[0] * x + q[2] * z - q[3] * y, v[1] + q[0] * y + q[3] * x - q[1] * z,
            v[2] + q[0] * z + q[1] * y - q[2] * x)  # fmt: skip


@njit
def cross(a, b):
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit
def times(m, v):
    """m[3, 3] v."""
    return dot(m[0], v), dot(m[1], v), dot(m[2], v)


@njit
def answer(solids, n, torque):
    """The angular acceleration that a torque gives, or the spin that an angular momentum is."""
    if not solids.tumbles[n]:
        return times(solids.inverse[n], torque)
    q = solids.turn[n]
    back = q[0], -q[1], -q[2], -q[3]
    return turned(q, times(solids.inverse[n], turned(back, torque)))


@njit
def rotate(q, way, target):
    """target[4] = q turned on by the rotation vector `way`, to third order in its length; of length 1."""
    x, y, z = 0.25 * way[0], 0.25 * way[1], 0.25 * way[2]
    w = 1.0 - (x * x + y * y + z * z)
    x, y, z = 2 * x, 2 * y, 2 * z
    a, b, c, d = q[0], q[1], q[2], q[3]
    p = (w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c, w * c + y * a + z * b - x * d,
         w * d + z * a + x * c - y * b)  # fmt: skip
    size = np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3])
    for k in range(4):
        target[k] = p[k] / size


@njit
def place_of(solids, touches, c):
    """The normal of a contact from the second to the first, the overlap, and the middle of the overlap."""
    a, b = touches.first[c], touches.second[c]
    at, foot = turned(solids.turn[a], touches.arm[c]), turned(solids.turn[b], touches.foot[c])
    n = turned(solids.turn[b], touches.normal[c])
    x = solids.place[a, 0] + at[0], solids.place[a, 1] + at[1], solids.place[a, 2] + at[2]
    apart = (x[0] - solids.place[b, 0] - touches.shift[c, 0] - foot[0],
             x[1] - solids.place[b, 1] - touches.shift[c, 1] - foot[1],
             x[2] - solids.place[b, 2] - touches.shift[c, 2] - foot[2])  # fmt: skip
    overlap = touches.radius[c] - dot(apart, n)
    back = touches.radius[c] - 0.5 * overlap
    return n, overlap, (x[0] - back * n[0], x[1] - back * n[1], x[2] - back * n[2])


@njit
def arms(solids, touches, c, x):
    """From O of the first and of the second solid of a contact to x."""
    a, b, shift = solids.place[touches.first[c]], solids.place[touches.second[c]], touches.shift[c]
    return ((x[0] - a[0], x[1] - a[1], x[2] - a[2]),
            (x[0] - b[0] - shift[0], x[1] - b[1] - shift[1], x[2] - b[2] - shift[2]))  # fmt: skip


@njit
def lightness(solids, n, arm, along):
    """1 / mass that a force at an arm meets along a unit vector."""
    m, lever = solids.inverse_mass[n], cross(arm, along)
    straight = m[0] * along[0] * along[0] + m[1] * along[1] * along[1] + m[2] * along[2] * along[2]
    return straight + dot(lever, answer(solids, n, lever))


@njit
def push(loads, n, arm, f, sign, contact):
    """Add a force at an arm to the loads of a solid."""
    torque = cross(arm, f)
    for k in range(3):
        loads.force[n, k] += sign * f[k]
        loads.torque[n, k] += sign * torque[k]
        if contact:
            loads.contact[n, k] += sign * f[k]


@njit
def touch_pair(solids, touches, p, loads, h, lead):
    """Forces of the contacts of a pair, which has its springs and dashpots in parallel: together they have the damping
    of the law for the mass that meets at the middle of the contacts.
    """
    count, weight, mx, my, mz = 0, 0.0, 0.0, 0.0, 0.0
    for c in range(touches.cuts[p], touches.cuts[p + 1]):
        n, overlap, x = place_of(solids, touches, c)
        if overlap > 0.0:
            count, weight = count + 1, weight + overlap
            mx, my, mz = mx + overlap * x[0], my + overlap * x[1], mz + overlap * x[2]
    stiffness, alpha, friction = touches.laws[p, 0], touches.laws[p, 1], touches.laws[p, 2]
    for c in range(touches.cuts[p], touches.cuts[p + 1]):
        n, overlap, x = place_of(solids, touches, c)
        if not overlap > 0.0:
            for k in range(3):
                touches.springs[c, k] = 0.0
            continue
        a, b = touches.first[c], touches.second[c]
        near, far = arms(solids, touches, c, (mx / weight, my / weight, mz / weight))
        light = lightness(solids, a, near, n) + lightness(solids, b, far, n)
        mass = 1.0 / light if light > 0.0 else 0.0
        near, far = arms(solids, touches, c, x)
        v, u = cross(solids.spin[a], near), cross(solids.spin[b], far)
        va, vb = solids.velocity[a], solids.velocity[b]
        relative = vb[0] + u[0] - va[0] - v[0], vb[1] + u[1] - va[1] - v[1], vb[2] + u[2] - va[2] - v[2]
        inwards, rest = (-n[0], -n[1], -n[2]), (0.0, 0.0, 0.0)
        opening = dot(relative, inwards)
        damping = 2.0 * alpha * np.sqrt(mass * stiffness / count)
        shear = SHEAR_RATIO * stiffness
        law = ContactLaw(stiffness, alpha, friction, 2.0 * alpha * np.sqrt(mass * shear / count), shear, False)
        pressed = normal_force(overlap, opening, damping, law, h)
        slip = slip_velocity(relative, rest, inwards, opening)
        s = touches.springs[c]
        spring = s[0], s[1], s[2]
        begins = lead > 0.0 and overlap < pressed.travel and opening < 0.0  # in this step
        since = pressed.steps * h if begins else lead
        f, _, kept = spring_friction(spring, inwards, slip, friction * pressed.force, law, since, h)
        s[0], s[1], s[2] = kept
        normal = pressed.force
        whole = f[0] + normal * n[0], f[1] + normal * n[1], f[2] + normal * n[2]
        push(loads, a, near, whole, 1.0, True)
        push(loads, b, far, whole, -1.0, True)


@njit
def pull_line(solids, moorings, m, loads):
    """The force of a line on its body."""
    n, law = moorings.body[m], moorings.laws[m]
    arm = turned(solids.turn[n], moorings.arm[m])
    ways, spin = solids.place[n], cross(solids.spin[n], arm)
    to = (moorings.anchor[m, 0] - ways[0] - arm[0], moorings.anchor[m, 1] - ways[1] - arm[1],
          moorings.anchor[m, 2] - ways[2] - arm[2])  # fmt: skip
    v = solids.velocity[n]
    speed = v[0] + spin[0], v[1] + spin[1], v[2] + spin[2]
    long = np.sqrt(dot(to, to))
    if long > 0.0:
        growth = -dot(to, speed) / long
        pulls = lines.tension(long, growth, law[0], law[1], law[2], law[3]) / long
        push(loads, n, arm, (pulls * to[0], pulls * to[1], pulls * to[2]), 1.0, False)


@njit
def copy(values, to):
    """to[n, 3] = values. A loop compiles in a tenth of the time of numba's own, which formats what it might say."""
    for n in range(values.shape[0]):
        for k in range(3):
            to[n, k] = values[n, k]


@njit
def load(solids, touches, moorings, loads, h, lead):
    """Forces of contacts and lines on all solids, for steps of h s, `lead` s after the time of the friction springs."""
    loads.force[:], loads.torque[:], loads.contact[:] = 0.0, 0.0, 0.0
    for p in range(touches.cuts.size - 1):
        touch_pair(solids, touches, p, loads, h, lead)
    for m in range(moorings.body.size):
        pull_line(solids, moorings, m, loads)


@njit
def start(solids, n, loads, h):
    """First half of a short step of a solid: its place at the end, and velocities predicted there."""
    half, place, v, w = 0.5 * h, solids.place[n], solids.velocity[n], solids.spin[n]
    for k in range(3):
        rate = solids.pull[n, k] + solids.inverse_mass[n, k] * loads.force[n, k]
        place[k] += h * (v[k] + half * rate)
        v[k] += h * rate
    if solids.tumbles[n]:
        twist, torque, momentum, turn = solids.twist[n], loads.torque[n], solids.momentum[n], solids.turn[n]
        x, y, z = twist[0] + torque[0], twist[1] + torque[1], twist[2] + torque[2]
        middle = momentum[0] + half * x, momentum[1] + half * y, momentum[2] + half * z
        momentum[0] += h * x
        momentum[1] += h * y
        momentum[2] += h * z
        q = turn[0], turn[1], turn[2], turn[3]
        spin = answer(solids, n, middle)
        rotate(q, (half * spin[0], half * spin[1], half * spin[2]), turn)
        spin = answer(solids, n, middle)
        rotate(q, (h * spin[0], h * spin[1], h * spin[2]), turn)
        w[0], w[1], w[2] = answer(solids, n, (momentum[0], momentum[1], momentum[2]))
    else:
        more = times(solids.inverse[n], loads.torque[n])
        x, y, z = solids.twist[n, 0] + more[0], solids.twist[n, 1] + more[1], solids.twist[n, 2] + more[2]
        way = h * (w[0] + half * x), h * (w[1] + half * y), h * (w[2] + half * z)
        rotate(solids.turn[n], way, solids.turn[n])
        w[0] += h * x
        w[1] += h * y
        w[2] += h * z


@njit
def finish(solids, n, loads, before, h):
    """Second half: add half the change of the loads since `before` to the velocities."""
    half, v, w = 0.5 * h, solids.velocity[n], solids.spin[n]
    torque = empty(3, np.float64)
    for k in range(3):
        v[k] += half * solids.inverse_mass[n, k] * (loads.force[n, k] - before.force[n, k])
        torque[k] = half * (loads.torque[n, k] - before.torque[n, k])
        loads.impulse[n, k] += half * (loads.contact[n, k] + before.contact[n, k])
        loads.impulse[n, 3 + k] += half * (loads.force[n, k] + before.force[n, k])
    if solids.tumbles[n]:
        for k in range(3):
            solids.momentum[n, k] += torque[k]
        w[0], w[1], w[2] = answer(solids, n, solids.momentum[n])
    else:
        more = times(solids.inverse[n], torque)
        for k in range(3):
            w[k] += more[k]


@njit
def advance(steps, h, solids, touches, moorings, loads, before):
    """Move all solids by so many short steps of h s. Friction springs are kept half a step ahead of the end."""
    springs = touches.springs.copy()
    load(solids, touches, moorings, loads, h, -0.5 * h)
    copy(springs, touches.springs)
    for _ in range(steps):
        copy(loads.force, before.force)
        copy(loads.torque, before.torque)
        copy(loads.contact, before.contact)
        for n in range(solids.place.shape[0]):
            start(solids, n, loads, h)
        load(solids, touches, moorings, loads, h, 0.5 * h)
        for n in range(solids.place.shape[0]):
            finish(solids, n, loads, before, h)
