"""Links of grains that move, found anew at every step; compiled.

Each window of a grain is looked at once, and for each direction its links are listed (`kernels.listing`) and done a
vector at a time (`bounce`). All terms of the sums are rounded to integers, so that the sums do not depend on their
order.
"""

import numpy as np

from hpcpic.core.simd.jit import njit
from hpcpic.core.simd.vector import (
    Vec,
    convert,
    fma,
    lane_numbers,
    lanes,
    load,
    maximum,
    minimum,
    select,
    splat,
    sqrt,
    store,
    to_fixed,
)
from lbmdem.kernels.links import CLI, FALLBACKS, HALFWAY, LINKS, LOST, QUADRATIC, second_behind
from lbmdem.kernels.listing import (
    COLUMNS,
    FREE,
    FURTHER,
    LISTS,
    PLANE,
    PLANES,
    ROW,
    TABLES,
    along,
    fetch,
    look,
    lost_along,
    room,
)
from lbmdem.kernels.runs import span
from lbmdem.kernels.spread import gather, scatter

GAINS = 7
N = lanes(np.float64)
F, L, H = Vec(N, np.float64), Vec(N, np.int64), Vec(N, np.int32)


@njit
def windows(centres, radii, grain, offset, low, high, image, first, after):
    """Planes first[k] .. after[k] of image[k] in which links start, PLANES at most, in [low, high). How many.

    They are stored if there is room.
    """
    count = 0
    for m in range(grain.size):
        a, b = span(centres[grain[m], 2], radii[grain[m]] + 1.0, offset[m, 2], low, high)
        for p in range(a, b, PLANES):
            if count < image.size:
                image[count], first[count], after[count] = m, p, min(p + PLANES, b)
            count += 1
    return count


@njit
def add_up(image, grain, count, parts, sums):
    """sums[grain] of parts[:count]."""
    sums[:] = 0
    for k in range(count):
        for a in range(GAINS):
            sums[grain[image[k]], a] += parts[k, a]


@njit
def moving_links(
    f, strides, slots, shifts, parity, e, opposite, w6, rule, open_mass, solid, shape, inner, box,
    share, counters, cuts, scale, centres, radii, ids, motion, grain, offset, image, first, after, parts,
):  # fmt: skip
    """Links of the parts cuts[share] .. cuts[share + 1]: bounce back; what they give to parts[n, 7].

    These are int64 of 1 / scale[7]: force, torque and the mass that the fluid gains. motion[n, 6]: velocity and angular
    velocity; e[q, 3], w6[q] = 6 w; solid: flat, of shape[3] with inner[3, 2]; box[3, 2]: nodes behind that count;
    strides, slots, shifts: `kernels.layout`. open_mass: 1 to count the fluid that the wall sweeps over as momentum (Wen
    et al., JCP 266 (2014) 161: Galilean invariant on the mean), 0 where covered and uncovered nodes are counted
    themselves.
    """
    table, listed, size = room(radii)
    work, sums = np.zeros(size, np.int32), np.empty(GAINS * N, np.int64)
    further = np.zeros((2, listed if rule == QUADRATIC else 0))
    for k in range(cuts[share], cuts[share + 1]):
        m = image[k]
        g = grain[m]
        r0, r1 = span(centres[g, 1], radii[g] + 1.0, offset[m, 1], inner[1, 0], inner[1, 1])
        x0, x1 = span(centres[g, 0], radii[g] + 1.0, offset[m, 0], inner[0, 0], inner[0, 1])
        sums[:] = 0
        for x in range(x0, x1, COLUMNS):
            window(
                f, strides, slots, shifts, parity, e, opposite, w6, rule, open_mass, solid, shape, inner, box,
                first[k], after[k] - first[k], r0, max(r1 - r0, 0), x, min(x1 - x, COLUMNS),
                centres[g], radii[g], np.int32(ids[g]), motion[g], offset[m], work, table, listed, further,
                scale, sums, counters,
            )  # fmt: skip
        for a in range(GAINS):
            parts[k, a] = sums[a * N : (a + 1) * N].sum()


@njit
def window(
    f, strides, slots, shifts, parity, e, opposite, w6, rule, open_mass, solid, shape, inner, box,
    p, planes, r, rows, x, columns, centre, radius, number, motion, offset, work, table, listed, further,
    scale, sums, counters,
):  # fmt: skip
    """The links of a window that start at the node x, r, p or after it.

    While those of a direction are done, the memory of the next one is on its way.
    """
    any_lost = look(
        solid, shape, inner, box, strides, p, planes, r, rows, x, columns, centre, radius, number, offset, work, table
    )  # fmt: skip
    here, first = (x - 1, r - 1, p - 1), TABLES * table + LISTS * listed
    n = 0
    for i in range(1, opposite.size + 1):
        lists, n_next = first + 3 * listed * (i % 2), 0
        if i < opposite.size:
            j, to = opposite[i], e[i, 2] * (rows + 2) + e[i, 1]
            n_next, n_free = along(work, table, listed, planes, rows + 2, e[i, 0], to, i % 2 == 1, lists)
            fetch(f, slots[parity, i] * strides[0], slots[parity, j] * strides[0], work, lists, listed, n_next)
            counters[LINKS] += n_next
            counters[FALLBACKS] += n_next - n_free if rule != HALFWAY else 0
            if any_lost:
                counters[LOST] += lost_along(work, table, planes, rows + 2, e[i, 0], to)
        if n > 0:
            i, j = i - 1, opposite[i - 1]
            lists = first + 3 * listed * (i % 2)
            if rule == QUADRATIC:
                counters[FALLBACKS] += look_further(
                    f, strides, slots, shifts, parity, solid, shape, inner, e[i], i, j, here, work, lists + 2 * listed,
                    n, further,
                )  # fmt: skip
            bounce(
                f, slots[parity, i] * strides[0], slots[parity, j] * strides[0], work, lists, listed, n, further,
                e[i], w6[i], rule, open_mass, here, offset, centre, radius, motion, scale, sums,
            )  # fmt: skip
        n = n_next


@njit
def look_further(
    f, strides, slots, shifts, parity, solid, shape, inner, e, i, j, here, work, codes, n, further
):  # fmt: skip
    """Mark the links with two fluid nodes behind them, and get g_i(z) and g_j(y). How many have one only."""
    short = 0
    x0, r0, p0 = here
    for k in range(n):
        further[0, k], further[1, k] = 0.0, 0.0
        which = work[codes + k]
        if which >> FREE:
            p, r, x = p0 + ((which >> PLANE) & 15), r0 + ((which >> ROW) & 4095), x0 + (which & 63)
            found, further[0, k], further[1, k] = second_behind(
                f, strides, slots, shifts, parity, solid, shape, inner, p, r, x, e[0], e[1], e[2], i, j
            )
            work[codes + k] = which | np.int32(found) << FURTHER
            short += not found
    further[:, n : n + N] = further[:, n - 1 : n]  # the last vector is filled up with the last link
    return short


@njit
def bounce(
    f, slot_i, slot_j, work, lists, listed, n, further, e, weight, rule, open_mass, here, offset, centre, radius,
    motion, scale, sums,
):  # fmt: skip
    """n links along e: the rule of `kernels.links`, and 7 sums of N lanes each."""
    ex, ey, ez = float(e[0]), float(e[1]), float(e[2])
    x0, r0, p0 = float(here[0] - offset[0]), float(here[1] - offset[1]), float(here[2] - offset[2])
    cx, cy, cz = centre[0], centre[1], centre[2]
    ux, uy, uz, wx, wy, wz = motion[0], motion[1], motion[2], motion[3], motion[4], motion[5]
    e_sq = ex * ex + ey * ey + ez * ez
    inverse, r_sq, zero = 1.0 / e_sq, radius * radius, splat(F, 0.0)
    nears, codes = lists + listed, lists + 2 * listed
    for at in (lists, nears, codes):  # the last vector is filled up, see above
        store(work, at + n, splat(H, work[at + n - 1]))
    force, torque, mass = scale[0], scale[3], scale[6]
    sx, sy, sz, tx = load(L, sums, 0), load(L, sums, N), load(L, sums, 2 * N), load(L, sums, 3 * N)
    ty, tz, gain = load(L, sums, 4 * N), load(L, sums, 5 * N), load(L, sums, 6 * N)
    for k in range(0, n, N):
        word = load(H, work, codes + k)
        dx = (convert(F, word & np.int32(63)) + x0) - cx
        dy = (convert(F, (word >> ROW) & np.int32(4095)) + r0) - cy
        dz = (convert(F, (word >> PLANE) & np.int32(15)) + p0) - cz
        free = (word >> FREE) > 0
        d_sq = fma(dx, dx, fma(dy, dy, dz * dz)) - r_sq
        way = fma(dx, ex, fma(dy, ey, dz * ez))
        q = -(way + sqrt(maximum(fma(way, way, -d_sq * e_sq), 0.0))) * inverse
        q = minimum(maximum(q, 0.0), 1.0)
        px, py, pz = fma(q, ex, dx), fma(q, ey, dy), fma(q, ez, dz)
        vx, vy, vz = fma(pz, wy, fma(py, -wz, ux)), fma(px, wz, fma(pz, -wx, uy)), fma(py, wx, fma(px, -wy, uz))
        push = fma(vx, ex, fma(vy, ey, vz * ez)) * weight
        out, outwards = gather(F, f, slot_j, work, lists + k), gather(F, f, slot_j, work, nears + k)
        behind = gather(F, f, slot_i, work, nears + k)
        v = returned(rule, q, free, out, behind, outwards, push, zero)
        if rule == QUADRATIC:
            third, fourth = load(F, further[0], k), load(F, further[1], k)
            v = select((word & np.int32(1 << FURTHER)) > 0, quadratic(q, out, behind, outwards, third, fourth, push), v)
        scatter(f, slot_j, work, lists + k, v)
        linked = lane_numbers(L) < n - k
        out, v = select(linked, out, zero), select(linked, v, zero)
        give, keep = out + v, out - v
        swept = keep * open_mass
        fx, fy, fz = fma(give, ex, -(swept * vx)), fma(give, ey, -(swept * vy)), fma(give, ez, -(swept * vz))
        sx += to_fixed(fx, force)
        sy += to_fixed(fy, force)
        sz += to_fixed(fz, force)
        tx += to_fixed(fma(py, fz, -(pz * fy)), torque)
        ty += to_fixed(fma(pz, fx, -(px * fz)), torque)
        tz += to_fixed(fma(px, fy, -(py * fx)), torque)
        gain -= to_fixed(keep, mass)
    store(sums, 0, sx)
    store(sums, N, sy)
    store(sums, 2 * N, sz)
    store(sums, 3 * N, tx)
    store(sums, 4 * N, ty)
    store(sums, 5 * N, tz)
    store(sums, 6 * N, gain)


@njit(inline="always")
def returned(rule, q, free, out, second, outwards, push, zero):
    """What comes back, of links with one fluid node behind (free) or none."""
    if rule == CLI:
        kappa = select(free, (1.0 - 2.0 * q) / (1.0 + 2.0 * q), zero)
        return (out - (1.0 + kappa) * push) + kappa * (second - outwards)
    if rule == HALFWAY:
        return out - push
    twice = 2.0 * q
    near = (twice * out + (1.0 - twice) * second) - push
    inverse = 1.0 / twice
    far = inverse * (out - push) + (1.0 - inverse) * outwards
    return select(free, select(q <= 0.5, near, far), out - push)


@njit(inline="always")
def quadratic(q, out, second, outwards, third, fourth, push):
    """What comes back, of links with two fluid nodes behind."""
    twice = 2.0 * q
    near = (q * (twice + 1.0) * out + (1.0 - twice * twice) * second - q * (1.0 - twice) * third) - push
    first = 1.0 / (q * (twice + 1.0))
    far = first * (out - push) + (twice - 1.0) / q * outwards - (twice - 1.0) / (twice + 1.0) * fourth
    return select(q <= 0.5, near, far)
