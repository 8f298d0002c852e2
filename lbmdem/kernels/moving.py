"""Links of grains that move, found anew at every step; compiled.

Each window of a grain is looked at once, and for each direction its links are listed (`kernels.listing`) and done a
vector at a time (`bounce`). All terms of the sums are rounded to integers, so that the sums do not depend on their
order.
"""

import numpy as np

from hpcpic.core.simd.compile import njit
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
from lbmdem.kernels.gather_scatter import gather, scatter
from lbmdem.kernels.grain_rasters import span
from lbmdem.kernels.link_lists import (
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
from lbmdem.kernels.links import FALLBACKS, LINKS, LOST, second_behind
from lbmdem.physics.wall_rules import REACH, applicable, halfway, returned

GAINS = 7
N = lanes(np.float64)
F, L, H = Vec(N, np.float64), Vec(N, np.int64), Vec(N, np.int32)


@njit
def windows(centres, radii, grain, offset, ends, cuts, image, first, after):
    """Planes first[k] .. after[k] of image[k] in which links start, PLANES at most, share by share: those of the planes
    ends[s] .. ends[s + 1] are cuts[s] .. cuts[s + 1]. They are stored if there is room for all cuts[-1] of them."""
    number = np.zeros(ends.size - 1, np.int64)
    for storing in range(2):
        for m in range(grain.size):
            a, b = span(centres[grain[m], 2], radii[grain[m]] + 1.0, offset[m, 2], ends[0], ends[-1])
            s = np.searchsorted(ends, a, side="right") - 1
            while a < b:
                end = min(b, ends[s + 1], a + PLANES)
                if storing:
                    k = cuts[s] + number[s]
                    image[k], first[k], after[k] = m, a, end
                number[s] += 1
                s, a = s + (end == ends[s + 1]), end
        if not storing:
            cuts[0], cuts[1:], number[:] = 0, np.cumsum(number), 0
            if cuts[-1] > image.size:
                break


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
    """Links of the windows cuts[share] .. cuts[share + 1]: bounce back; what they give to parts[n, 7].

    These are int64 of 1 / scale[7]: force, torque and the mass that the fluid gains. motion[n, 6]: velocity and angular
    velocity; e[q, 3], w6[q] = 6 w; solid: flat, of shape[3] with inner[3, 2]; box[3, 2]: nodes behind that count;
    strides, slots, shifts: `kernels.layout`. open_mass: 1 to count the fluid that the wall sweeps over as momentum (Wen
    et al., JCP 266 (2014) 161: Galilean invariant on the mean), 0 where covered and uncovered nodes are counted
    themselves.
    """
    table, listed, size = room(radii)
    work, sums = np.empty(size, np.int32), np.empty(GAINS * N, np.int64)
    counters[:] = 0
    further = np.empty((2, listed if REACH[rule] == 2 else 0))
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
    now = (first, 0, 0, 0)
    for i in range(1, opposite.size + 1):
        ahead = (first, 0, 0, 0)
        if i < opposite.size:
            lists, to = first + 3 * listed * (i % 2), e[i, 2] * (rows + 2) + e[i, 1]
            n, n_free = along(work, table, listed, planes, rows + 2, e[i, 0], to, i % 2 == 1, lists)
            ahead = (lists, n, slots[parity, i] * strides[0], slots[parity, opposite[i]] * strides[0])
            counters[LINKS] += n
            counters[FALLBACKS] += n - n_free if REACH[rule] else 0
            if any_lost:
                counters[LOST] += lost_along(work, table, planes, rows + 2, e[i, 0], to)
        if now[1] == 0:
            fetch(f, ahead, 0, ahead[1], work, listed)
        else:
            i -= 1
            if REACH[rule] == 2:
                counters[FALLBACKS] += look_further(
                    f, strides, slots, shifts, parity, solid, shape, inner, e[i], i, opposite[i], here, work,
                    now[0] + 2 * listed, now[1], further,
                )  # fmt: skip
            bounce(
                f, now, ahead, work, listed, further, e[i], w6[i], rule, open_mass, here, offset, centre, radius,
                motion, scale, sums,
            )  # fmt: skip
        now = ahead


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
    f, now, ahead, work, listed, further, e, weight, rule, open_mass, here, offset, centre, radius, motion, scale,
    sums,
):  # fmt: skip
    """The links of the list `now` along e: the wall rule, and 7 sums of N lanes each.

    now, ahead: as `listing.fetch` wants them; the memory of those ahead is fetched meanwhile.
    """
    lists, n, slot_i, slot_j = now
    way, radius_sq, zero = (float(e[0]), float(e[1]), float(e[2])), radius * radius, splat(F, 0.0)
    first = (float(here[0] - offset[0]), float(here[1] - offset[1]), float(here[2] - offset[2]))
    middle, speed = (centre[0], centre[1], centre[2]), (motion[0], motion[1], motion[2])
    turn, nears, codes = (motion[3], motion[4], motion[5]), lists + listed, lists + 2 * listed
    for at in (lists, nears, codes):  # the last vector is filled up, see above
        store(work, at + n, splat(H, work[at + n - 1]))
    for k in range(0, n, N):
        fetch(f, ahead, k, k + N, work, listed)
        code = load(H, work, codes + k)
        q, arm = crossing(code, first, middle, way, radius_sq)
        wall = swept_by(arm, speed, turn)
        push = along_way(wall, way) * weight
        out, outwards = gather(F, f, slot_i, work, lists + k), gather(F, f, slot_j, work, nears + k)
        behind = gather(F, f, slot_i, work, nears + k)
        v = returned(applicable(rule, 1), q, out, behind, outwards, zero, zero, push)
        v = select((code >> FREE) > 0, v, halfway(out, push))  # of what is behind no free node it may be no number
        if REACH[rule] == 2:
            third, fourth = load(F, further[0], k), load(F, further[1], k)
            both = returned(rule, q, out, behind, outwards, third, fourth, push)
            v = select((code & np.int32(1 << FURTHER)) > 0, both, v)
        scatter(f, slot_j, work, lists + k, v)
        linked = lane_numbers(L) < n - k
        out, v = select(linked, out, zero), select(linked, v, zero)
        for a, term in enumerate(given(out + v, out - v, open_mass, way, wall, arm)):
            store(sums, a * N, load(L, sums, a * N) + to_fixed(term, scale[a]))
    fetch(f, ahead, (n + N - 1) // N * N, ahead[1], work, listed)


@njit(inline="always")
def along_way(a, way):
    """Dot product."""
    return fma(a[0], way[0], fma(a[1], way[1], a[2] * way[2]))


@njit(inline="always")
def crossing(code, first, middle, way, radius_sq):
    """q of links by their codes, and the crossings from the middle of the grain. first: node of the code 0."""
    dx = (convert(F, code & np.int32(63)) + first[0]) - middle[0]
    dy = (convert(F, (code >> ROW) & np.int32(4095)) + first[1]) - middle[1]
    dz = (convert(F, (code >> PLANE) & np.int32(15)) + first[2]) - middle[2]
    d_sq = fma(dx, dx, fma(dy, dy, dz * dz)) - radius_sq
    b, e_sq = along_way((dx, dy, dz), way), way[0] * way[0] + way[1] * way[1] + way[2] * way[2]
    q = (b + sqrt(maximum(fma(b, b, -d_sq * e_sq), 0.0))) * (-1.0 / e_sq)
    q = minimum(maximum(q, 0.0), 1.0)
    return q, (fma(q, way[0], dx), fma(q, way[1], dy), fma(q, way[2], dz))


@njit(inline="always")
def swept_by(arm, speed, turn):
    """Velocity of the wall."""
    (x, y, z), (wx, wy, wz) = arm, turn
    return (
        fma(z, wy, fma(y, -wz, speed[0])),
        fma(x, wz, fma(z, -wx, speed[1])),
        fma(y, wx, fma(x, -wy, speed[2])),
    )


@njit(inline="always")
def given(give, keep, open_mass, way, wall, arm):
    """Force, torque and mass that a grain gains, the mass with the sign of the fluid's."""
    (x, y, z), swept = arm, keep * open_mass
    fx = fma(give, way[0], -(swept * wall[0]))
    fy = fma(give, way[1], -(swept * wall[1]))
    fz = fma(give, way[2], -(swept * wall[2]))
    return fx, fy, fz, fma(y, fz, -(z * fy)), fma(z, fx, -(x * fz)), fma(x, fy, -(y * fx)), -keep
