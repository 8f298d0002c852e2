"""Contact forces, eight pairs at a time; the law is in `hpcpic.core.physics.contact_law`.

Every pair has a slot; slot s holds its force in line s of `lines` (float64[slots, 8]): force on the first of the two
(3 values), power turned into heat, torque per arm n x T (3 values), half the overlap; where there are films line s of
`couples` has what the torques per arm have more on the first and less on the second. The first is the one with the
smaller id, so a pair has the same bits on every rank that sees it. Lines of pairs that do not touch are zero, so sums
over a grain's lines do not depend on which pairs beyond touch happen to be listed.
"""

from typing import Any, NamedTuple

from hpcpic.core.physics.contact_law import (
    dot,
    normal_force,
    regularised_friction,
    slip_velocity,
    spring_friction,
)
from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import (
    Vec,
    address_of,
    bitmask,
    convert,
    fma,
    gather_lines,
    lane_values,
    load,
    load_at,
    maximum,
    prefetch,
    rint,
    select,
    splat,
    sqrt,
    store_at,
    store_lines,
)
from lbmdem.kernels.grains.films import pumped, resistance, shear_resistance
from lbmdem.physics.lubrication import sheared
from lbmdem.sizes import LANES, ROW

ROW_BYTES, LINE_BYTES = 8 * ROW, 64
SLOTS_AHEAD = 2 * LANES  # rows of second grains are prefetched: first ones follow each other, these lie anywhere
F, I, H = Vec(LANES, "float64"), Vec(LANES, "int64"), Vec(LANES, "int32")


class Masks(NamedTuple):
    """Which of eight pairs touch, and which are as near as a film reaches."""

    touch: Any
    near: Any


class Motion(NamedTuple):
    """How eight pairs lie and move: normal n from the first to the second, overlap (m), velocity u of the second less
    that of the first (m/s), spin, the sum of arm x angular velocity (m/s), and turn, that of the second less that of
    the first; d: difference of the radii over their sum.
    """

    n: Any
    overlap: Any
    u: Any
    spin: Any
    turn: Any
    d: Any


class Resistances(NamedTuple):
    """Force over velocity (N s/m) of the films of eight pairs, along the normal and along the surfaces."""

    squeezing: Any
    shearing: Any


@njit
def nearest(d, length, inverse):
    """Difference to the nearest image; odd in d. `inverse` is 0 on an axis that is not periodic."""
    return fma(rint(d * inverse), -length, d)


@njit
def clear(contacts, p, law, film):
    """Zero lines, couples and springs of the slots from p on, none of which touches."""
    block = p // LANES
    if contacts.busy[block]:
        at = p * LINE_BYTES
        for k in range(LANES):
            store_at(address_of(contacts.lines, 0) + at + k * LINE_BYTES, splat(F, 0.0), 64)
            if film.cut_off > 0.0:
                store_at(address_of(contacts.couples, 0) + at + k * LINE_BYTES, splat(F, 0.0), 64)
        contacts.busy[block] = 0
    if law.shear > 0.0:
        zero = splat(F, 0.0)
        store_springs(contacts.springs, p, (zero, zero, zero))


@njit(forceinline=True)
def load_springs(springs, p):
    """Tangential springs of eight slots from p on."""
    at, row = address_of(springs, 0) + 8 * p, 8 * springs.shape[1]
    return load_at(F, at, 8), load_at(F, at + row, 8), load_at(F, at + 2 * row, 8)


@njit(forceinline=True)
def store_springs(springs, p, values):
    at, row = address_of(springs, 0) + 8 * p, 8 * springs.shape[1]
    store_at(at, values[0], 8)
    store_at(at + row, values[1], 8)
    store_at(at + 2 * row, values[2], 8)


@njit
def grain_pairs(part, pair_cuts, contacts, rows, box, law, film, dt):
    """Lines and springs of the slots of this part between grains low[slot] and high[slot]."""
    base, end = address_of(rows, 0), pair_cuts[part + 1]
    for p in range(pair_cuts[part], end, LANES):
        for at in lane_values(convert(I, load(H, contacts.high, min(p + SLOTS_AHEAD, end - LANES))) * ROW_BYTES):
            prefetch(base + at)
            prefetch(base + at + 64)
        at_i, at_j = convert(I, load(H, contacts.low, p)) * ROW_BYTES, convert(I, load(H, contacts.high, p)) * ROW_BYTES
        a, b = gather_lines(F, 4, base, at_i), gather_lines(F, 4, base, at_j)
        dx = nearest(b[0] - a[0], box.lengths[0], box.inverses[0])
        dy = nearest(b[1] - a[1], box.lengths[1], box.inverses[1])
        dz = nearest(b[2] - a[2], box.lengths[2], box.inverses[2])
        reach = a[3] + b[3]
        square = fma(dz, dz, fma(dy, dy, dx * dx))
        touch, near = square < reach * reach, square < (reach + film.cut_off) * (reach + film.cut_off)
        if bitmask(near) == 0:
            clear(contacts, p, law, film)
            continue
        contacts.busy[p // LANES] = 1
        distance = sqrt(square)
        inverse = 1.0 / distance
        overlap = maximum(reach - distance, splat(F, 0.0))
        v, w = gather_lines(F, 4, base + 32, at_i), gather_lines(F, 4, base + 64, at_i)
        s, t = gather_lines(F, 4, base + 32, at_j), gather_lines(F, 4, base + 64, at_j)
        squeezing, shearing, d = splat(F, 0.0), splat(F, 0.0), splat(F, 0.0)
        if film.cut_off > 0.0:
            gap, reduced, free, d = distance - reach, a[3] * b[3] / reach, v[3] + s[3], (b[3] - a[3]) / reach
            squeezing = resistance(gap, reduced, free, film, dt)
            turning = fma(a[3] * a[3], w[3], b[3] * b[3] * t[3])
            shearing = shear_resistance(gap, reduced, d, free, turning, film, dt)
        half = 0.5 * overlap
        arm_i, arm_j = a[3] - half, b[3] - half
        wx, wy, wz = arm_i * w[0], arm_i * w[1], arm_i * w[2]
        spin = fma(arm_j, t[0], wx), fma(arm_j, t[1], wy), fma(arm_j, t[2], wz)
        turn = fma(arm_j, t[0], -wx), fma(arm_j, t[1], -wy), fma(arm_j, t[2], -wz)
        n, u = (dx * inverse, dy * inverse, dz * inverse), (s[0] - v[0], s[1] - v[1], s[2] - v[2])
        motion, resistances = Motion(n, overlap, u, spin, turn, d), Resistances(squeezing, shearing)
        contact(p, Masks(touch, near), motion, resistances, contacts, law, film, dt, False)


@njit
def wall_pairs(part, wall_cuts, contacts, rows, walls, law, film, dt):
    """Lines and springs of the slots of this part between grain low[slot] and plane high[slot]."""
    base, planes = address_of(rows, 0), address_of(walls, 0)
    for p in range(wall_cuts[part], wall_cuts[part + 1], LANES):
        at_i, at_j = convert(I, load(H, contacts.low, p)) * ROW_BYTES, convert(I, load(H, contacts.high, p)) * ROW_BYTES
        a, b = gather_lines(F, 4, base, at_i), gather_lines(F, 4, planes, at_j)
        n = gather_lines(F, 4, planes + 64, at_j)
        gap = fma(a[2] - b[2], n[2], fma(a[1] - b[1], n[1], (a[0] - b[0]) * n[0])) - a[3]
        touch, near = gap < 0.0, gap < film.cut_off * (1.0 - b[3])
        if bitmask(near) == 0:
            clear(contacts, p, law, film)
            continue
        contacts.busy[p // LANES] = 1
        v, w = gather_lines(F, 4, base + 32, at_i), gather_lines(F, 4, base + 64, at_i)
        s = gather_lines(F, 4, planes + 32, at_j)
        overlap, squeezing, shearing = maximum(-gap, splat(F, 0.0)), splat(F, 0.0), splat(F, 0.0)
        if film.cut_off > 0.0:
            squeezing = resistance(gap, a[3], v[3], film, dt)
            turning = a[3] * a[3] * w[3]
            shearing = shear_resistance(gap, a[3], splat(F, 1.0), v[3], turning, film, dt) * (1.0 - b[3])
        arm = fma(overlap, -0.5, a[3])
        inwards, u = (-n[0], -n[1], -n[2]), (s[0] - v[0], s[1] - v[1], s[2] - v[2])
        spin, turn = (arm * w[0], arm * w[1], arm * w[2]), (-arm * w[0], -arm * w[1], -arm * w[2])
        motion = Motion(inwards, overlap, u, spin, turn, splat(F, 1.0))
        resistances = Resistances(squeezing, shearing)
        contact(p, Masks(touch, near), motion, resistances, contacts, law, film, dt, True)


@njit(forceinline=True)
def contact(p, masks, motion, resistances, contacts, law, film, dt, at_plane):
    """Write the lines of the slots from p on: spring, dashpot and friction where they touch, and a film's forces, of
    which its shear acts while they touch too, with the gap of the roughness.

    at_plane: the second is a plane, and all the heat is the first one's.
    """
    touch, near, n, overlap, zero = masks.touch, masks.near, motion.n, motion.overlap, splat(F, 0.0)
    squeezing = resistances.squeezing
    opening = dot(motion.u, n)
    pressed = normal_force(overlap, opening, load(F, contacts.damping, p), law, dt)
    t = slip_velocity(motion.u, motion.spin, n, opening)
    limit = law.friction * abs(pressed.force)
    if law.shear > 0.0:
        begins = (overlap < pressed.travel) & (opening < 0.0)
        lead = select(begins, pressed.steps, splat(F, 0.5)) * dt
        f, heated, s = spring_friction(load_springs(contacts.springs, p), n, t, limit, law, lead, dt)
        kept = select(touch, s[0], zero), select(touch, s[1], zero), select(touch, s[2], zero)
        store_springs(contacts.springs, p, kept)
    else:
        f, heated = regularised_friction(t, limit, law.viscosity)
    normal = select(touch, pressed.force, -squeezing * opening)
    loss = select(touch, pressed.loss + heated, squeezing * opening * opening)
    f = select(touch, f[0], zero), select(touch, f[1], zero), select(touch, f[2], zero)
    g = f
    if film.cut_off > 0.0:
        along = motion.d * motion.u[0], motion.d * motion.u[1], motion.d * motion.u[2]
        both = slip_velocity(along, motion.turn, n, motion.d * opening)
        push, lever, couple, heat = sheared(resistances.shearing, pumped(film), motion.d, t, both)
        f = f[0] + push[0], f[1] + push[1], f[2] + push[2]
        g = g[0] + lever[0], g[1] + lever[1], g[2] + lever[2]
        loss = loss + heat
        cx, cy, cz = couple
        store_lines(address_of(contacts.couples, 0) + p * LINE_BYTES, (
            zero, zero, zero, zero, select(near, fma(n[2], cy, -(n[1] * cz)), zero),
            select(near, fma(n[0], cz, -(n[2] * cx)), zero), select(near, fma(n[1], cx, -(n[0] * cy)), zero), zero,
        ))  # fmt: skip
    if at_plane:
        loss = loss * 2.0
    store_lines(address_of(contacts.lines, 0) + p * LINE_BYTES, (
        select(near, fma(-normal, n[0], f[0]), zero), select(near, fma(-normal, n[1], f[1]), zero),
        select(near, fma(-normal, n[2], f[2]), zero), select(near, loss, zero),
        select(near, fma(n[1], g[2], -(n[2] * g[1])), zero), select(near, fma(n[2], g[0], -(n[0] * g[2])), zero),
        select(near, fma(n[0], g[1], -(n[1] * g[0])), zero), select(touch, 0.5 * overlap, zero),
    ))  # fmt: skip
