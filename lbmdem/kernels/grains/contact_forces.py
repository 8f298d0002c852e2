"""Contact forces, eight pairs at a time.

Every pair has a slot; slot s holds its force in line s of `lines` (float64[slots, 8]): force on the first of the two
(3 values), power turned into heat, torque per arm n x T (3 values), half the overlap. The first is the one with the
smaller id, so a pair has the same bits on every rank that sees it. Lines of pairs that do not touch are zero, so sums
over a grain's lines do not depend on which pairs beyond touch happen to be listed.

The law is [1] of Mansouri et al. 2011 with a dashpot that dissipates. Its force jumps when a contact begins or ends
inside a step. How many steps ago or ahead that is, s, is found from the overlap and its rate, and the force of the two
instants next to it is multiplied by 3 s / 2 (s < 1) and 2 - s / 2 (s < 2): together the time in contact, 1/2 + s steps
for s < 1, and continuous in s. That makes the impulse of a collision second order in the step.
"""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import (
    Vec,
    address_of,
    bitmask,
    convert,
    fma,
    gather_lines,
    load,
    maximum,
    minimum,
    rint,
    select,
    splat,
    sqrt,
    store,
    store_at,
    store_lines,
)
from lbmdem.kernels.grains.films import resistance, shear_resistance

LANES = 8
ROW = 16  # values of a grain: x y z radius, v and inverse mass, omega and inverse inertia, orientation
ROW_BYTES, LINE_BYTES = 8 * ROW, 64
F, I, H = Vec(LANES, np.float64), Vec(LANES, np.int64), Vec(LANES, np.int32)


@njit
def nearest(d, length, inverse):
    """Difference to the nearest image; odd in d. `inverse` is 0 on an axis that is not periodic."""
    return fma(rint(d * inverse), -length, d)


@njit
def clear(lines_at, busy, block):
    """Zero the lines of a block that does not touch any more."""
    if busy[block]:
        for k in range(LANES):
            store_at(lines_at + k * LINE_BYTES, splat(F, 0.0), 64)
        busy[block] = 0


@njit
def grain_pairs(first, last, low, high, damping, rows, lengths, inverses, law, dt, lines, springs, busy):
    """Lines and springs of the slots first..last (multiples of 8) between grains low[slot] and high[slot]."""
    base, out = address_of(rows, 0), address_of(lines, 0)
    for p in range(first, last, LANES):
        at_i, at_j = convert(I, load(H, low, p)) * ROW_BYTES, convert(I, load(H, high, p)) * ROW_BYTES
        a, b = gather_lines(F, 4, base, at_i), gather_lines(F, 4, base, at_j)
        dx = nearest(b[0] - a[0], lengths[0], inverses[0])
        dy = nearest(b[1] - a[1], lengths[1], inverses[1])
        dz = nearest(b[2] - a[2], lengths[2], inverses[2])
        reach = a[3] + b[3]
        square = fma(dz, dz, fma(dy, dy, dx * dx))
        touch, near = square < reach * reach, square < (reach + law[5]) * (reach + law[5])
        if bitmask(near) == 0:
            clear(out + p * LINE_BYTES, busy, p // LANES)
            forget(springs, p, law)
            continue
        busy[p // LANES] = 1
        distance = sqrt(square)
        inverse = 1.0 / distance
        overlap = maximum(reach - distance, splat(F, 0.0))
        v, w = gather_lines(F, 4, base + 32, at_i), gather_lines(F, 4, base + 64, at_i)
        s, t = gather_lines(F, 4, base + 32, at_j), gather_lines(F, 4, base + 64, at_j)
        film, shear = splat(F, 0.0), splat(F, 0.0)
        if law[5] > 0.0:
            product = a[3] * b[3]
            film = resistance(distance - reach, product / reach, v[3] + s[3], law, dt)
            size = product * fma(reach, 2.0 * reach, -3.0 * product) / (reach * reach * reach)
            mobility = fma(a[3] * a[3], w[3], fma(b[3] * b[3], t[3], v[3] + s[3]))
            shear = shear_resistance(distance - reach, product / reach, size, mobility, law, dt)
        half = 0.5 * overlap
        arm_i, arm_j = a[3] - half, b[3] - half
        spin = fma(arm_j, t[0], arm_i * w[0]), fma(arm_j, t[1], arm_i * w[1]), fma(arm_j, t[2], arm_i * w[2])
        pair_law(p, touch, near, film, shear, (dx * inverse, dy * inverse, dz * inverse), overlap,
                 (s[0] - v[0], s[1] - v[1], s[2] - v[2]), spin, load(F, damping, p), law, dt,
                 out + p * LINE_BYTES, springs, 1.0)  # fmt: skip


@njit
def wall_pairs(first, last, low, high, damping, rows, walls, law, dt, lines, springs, busy):
    """The same for grain low[slot] and plane high[slot]: walls[w, 16] = point, 0, velocity, 0, inward normal, 0 ..."""
    base, planes, out = address_of(rows, 0), address_of(walls, 0), address_of(lines, 0)
    for p in range(first, last, LANES):
        at_i, at_j = convert(I, load(H, low, p)) * ROW_BYTES, convert(I, load(H, high, p)) * ROW_BYTES
        a, b = gather_lines(F, 4, base, at_i), gather_lines(F, 4, planes, at_j)
        n = gather_lines(F, 4, planes + 64, at_j)
        gap = fma(a[2] - b[2], n[2], fma(a[1] - b[1], n[1], (a[0] - b[0]) * n[0])) - a[3]
        touch, near = gap < 0.0, gap < law[5]
        if bitmask(near) == 0:
            clear(out + p * LINE_BYTES, busy, p // LANES)
            forget(springs, p, law)
            continue
        busy[p // LANES] = 1
        v, w = gather_lines(F, 4, base + 32, at_i), gather_lines(F, 4, base + 64, at_i)
        s = gather_lines(F, 4, planes + 32, at_j)
        overlap, film, shear = maximum(-gap, splat(F, 0.0)), splat(F, 0.0), splat(F, 0.0)
        if law[5] > 0.0:
            film = resistance(gap, a[3], v[3], law, dt)
            shear = shear_resistance(gap, a[3], 2.0 * a[3], fma(a[3] * a[3], w[3], v[3]), law, dt)
        arm = fma(overlap, -0.5, a[3])
        pair_law(p, touch, near, film, shear, (-n[0], -n[1], -n[2]), overlap, (s[0] - v[0], s[1] - v[1], s[2] - v[2]),
                 (arm * w[0], arm * w[1], arm * w[2]), load(F, damping, p), law, dt,
                 out + p * LINE_BYTES, springs, 2.0)  # fmt: skip


@njit
def forget(springs, p, law):
    """No tangential springs where nothing touches."""
    if law[3] > 0.0:
        size = springs.size // 3
        for k in range(3):
            store(springs, k * size + p, splat(F, 0.0))


@njit(inline="always")
def squeezed(n, overlap, u, damping, stiffness, pulls, dt):
    """Spring and dashpot: rate of the gap, what it makes in a step, steps of contact; force and loss of power."""
    opening = fma(u[2], n[2], fma(u[1], n[1], u[0] * n[0]))
    travel = abs(opening) * dt
    depth = overlap / travel  # steps since the contact began, or until it ends
    share = minimum(1.5 * depth, maximum(fma(depth, -0.5, splat(F, 2.0)), splat(F, 1.0)))
    share = select(travel > 0.0, share, splat(F, 1.0))
    if pulls == 0.0:
        share = select(opening < 0.0, share, splat(F, 1.0))  # such a contact ends without a jump
    dashpot = share * damping * opening
    normal = fma(overlap, stiffness, -dashpot)
    if pulls == 0.0:
        dashpot = select(normal < 0.0, stiffness * overlap, dashpot)
        normal = maximum(normal, splat(F, 0.0))
    return opening, travel, depth, normal, dashpot * opening


@njit
def pair_law(p, touch, near, film, shear_film, n, overlap, u, spin, damping, law, dt, out, springs, heat):
    """Spring, dashpot, friction; or a film's forces. u: velocity of the second less that of the first.

    law: stiffness, friction, tangential viscosity, tangential stiffness, 1 if a contact may pull at its end; cut-off
    gap of films (0: none), factor of their resistance, 1 for discs.
    heat: 2 when all the heat is the first one's.
    """
    stiffness, friction, viscosity, shear, pulls = law[0], law[1], law[2], law[3], law[4]
    zero = splat(F, 0.0)
    opening, travel, depth, normal, loss = squeezed(n, overlap, u, damping, stiffness, pulls, dt)
    # velocity of the surfaces along the contact: u - n (u n) - spin x n
    tx = fma(-opening, n[0], u[0]) - fma(spin[1], n[2], -(spin[2] * n[1]))
    ty = fma(-opening, n[1], u[1]) - fma(spin[2], n[0], -(spin[0] * n[2]))
    tz = fma(-opening, n[2], u[2]) - fma(spin[0], n[1], -(spin[1] * n[0]))
    limit = friction * abs(normal)
    if shear > 0.0:
        begins = (overlap < travel) & (opening < 0.0)
        lead = select(begins, depth, splat(F, 0.5)) * dt
        fx, fy, fz, more = spring_slider(p, touch, n, tx, ty, tz, limit, viscosity, shear, lead, dt, springs)
    else:
        fx, fy, fz, more = regularised(tx, ty, tz, limit, viscosity)
    loss = loss + more
    normal = select(touch, normal, -film * opening)
    gx, gy, gz, sheared = zero, zero, zero, zero
    if law[5] > 0.0:
        gx, gy, gz = shear_film * tx, shear_film * ty, shear_film * tz
        sheared = fma(gz, tz, fma(gy, ty, gx * tx))
    loss = select(touch, loss, fma(film * opening, opening, sheared)) * heat
    fx, fy, fz = select(touch, fx, gx), select(touch, fy, gy), select(touch, fz, gz)
    store_lines(out, (
        select(near, fma(-normal, n[0], fx), zero), select(near, fma(-normal, n[1], fy), zero),
        select(near, fma(-normal, n[2], fz), zero), select(near, loss, zero),
        select(near, fma(n[1], fz, -(n[2] * fy)), zero), select(near, fma(n[2], fx, -(n[0] * fz)), zero),
        select(near, fma(n[0], fy, -(n[1] * fx)), zero), select(touch, 0.5 * overlap, zero),
    ))  # fmt: skip


@njit
def regularised(tx, ty, tz, limit, viscosity):
    """Friction min(beta v, limit) against the slip, as in the paper; heat per time."""
    slip = sqrt(fma(tz, tz, fma(ty, ty, tx * tx)))
    factor = minimum(limit / slip, splat(F, viscosity))
    factor = select(slip > 0.0, factor, splat(F, 0.0))  # 0 / 0 at rest
    return factor * tx, factor * ty, factor * tz, factor * slip * slip


@njit
def spring_slider(p, touch, n, tx, ty, tz, limit, viscosity, shear, lead, dt, springs):
    """Friction of a tangential spring and dashpot in parallel, each at most the limit of Coulomb; heat per time.

    The spring is kept half a step ahead of the step's end, so that its length there, after `lead` (s), half a step or
    since the contact began, is a trapezoidal sum; its energy is counted as it is kept.
    """
    zero, size = splat(F, 0.0), springs.size // 3
    half = 0.5 * dt
    sx, sy, sz = load(F, springs, p), load(F, springs, size + p), load(F, springs, 2 * size + p)
    ox, oy, oz = sx, sy, sz
    before = fma(sz, sz, fma(sy, sy, sx * sx))
    along = fma(sz, n[2], fma(sy, n[1], sx * n[0]))  # the contact plane turns, and the spring with it
    sx, sy, sz = fma(-along, n[0], sx), fma(-along, n[1], sy), fma(-along, n[2], sz)
    after = fma(sz, sz, fma(sy, sy, sx * sx))
    stretch = select(after > 0.0, sqrt(before / after), splat(F, 1.0))
    sx, sy, sz = fma(tx, lead, stretch * sx), fma(ty, lead, stretch * sy), fma(tz, lead, stretch * sz)
    held = shear * sqrt(fma(sz, sz, fma(sy, sy, sx * sx)))
    slips = select(held > limit, limit / held, splat(F, 1.0))
    ex, ey, ez = slips * sx, slips * sy, slips * sz
    fx, fy, fz = fma(ex, shear, viscosity * tx), fma(ey, shear, viscosity * ty), fma(ez, shear, viscosity * tz)
    whole = sqrt(fma(fz, fz, fma(fy, fy, fx * fx)))
    cut = select(whole > limit, limit / whole, splat(F, 1.0))
    fx, fy, fz = fx * cut, fy * cut, fz * cut
    ex, ey, ez = fma(tx, half, ex), fma(ty, half, ey), fma(tz, half, ez)
    store(springs, p, select(touch, ex, zero))
    store(springs, size + p, select(touch, ey, zero))
    store(springs, 2 * size + p, select(touch, ez, zero))
    work = fma(fz, tz, fma(fy, ty, fx * tx)) * dt
    stored = fma(ez, ez, fma(ey, ey, ex * ex)) - fma(oz, oz, fma(oy, oy, ox * ox))
    return fx, fy, fz, select(splat(F, dt) > 0.0, (work - 0.5 * shear * stored) / dt, zero)
