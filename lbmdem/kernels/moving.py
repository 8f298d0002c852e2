"""Links of grains that move, found anew at every step; compiled.

Each view of a grain is looked at once, and for each direction its links are listed (`kernels.link_lists`) and done a
vector at a time (`bounce`). All terms of the sums are rounded to integers, so that the sums do not depend on their
order.
"""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import empty, zeros
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
from lbmdem.kernels.grain_rasters import IMAGES, span
from lbmdem.kernels.link_arrays import Grain, Scratch, View
from lbmdem.kernels.link_lists import (
    COLUMNS,
    FREE,
    FURTHER,
    LISTS,
    PLANE,
    PLANES,
    ROW,
    TABLES,
    count_lost,
    fill_tables,
    list_links,
    prefetch_links,
    scratch_sizes,
)
from lbmdem.kernels.links import FALLBACKS, LINKS, LOST, second_behind
from lbmdem.physics.wall_rules import REACH, applicable, halfway, returned
from lbmdem.sizes import GAINS

N = lanes(np.float64)
F, L, H = Vec(N, np.float64), Vec(N, np.int64), Vec(N, np.int32)


@njit
def find_parts(table, images, lengths, ends, cuts, parts):
    """Parts of images in which links start, PLANES planes at most, share by share: those of the planes
    ends[s] .. ends[s + 1] are cuts[s] .. cuts[s + 1]. They are stored if there is room for all cuts[-1] of them."""
    number = zeros(ends.size - 1, np.int64)
    for storing in range(2):
        for m in range(lengths[IMAGES]):
            g = images.grain[m]
            a, b = span(table.centres[g, 2], table.radii[g] + 1.0, images.offset[m, 2], ends[0], ends[-1])
            s = 0
            while a < b and ends[s + 1] <= a:
                s += 1
            while a < b:
                end = min(b, ends[s + 1], a + PLANES)
                if storing:
                    k = cuts[s] + number[s]
                    parts.image[k], parts.first[k], parts.after[k] = m, a, end
                number[s] += 1
                s, a = s + (end == ends[s + 1]), end
        if not storing:
            cuts[0] = 0
            for s in range(number.size):
                cuts[s + 1], number[s] = cuts[s] + number[s], 0
            if cuts[-1] > parts.image.size:
                break


@njit
def add_up(parts, grain, cuts, sums):
    """sums[grain] of the gains of all parts; grain: of each image."""
    sums[:] = 0
    for k in range(cuts[-1]):
        for a in range(GAINS):
            sums[grain[parts.image[k]], a] += parts.gains[k, a]


@njit
def moving_links(
    share, cuts, populations, parity, nodes, directions, bounce_back, table, images, parts, scale, counters
):  # fmt: skip
    """Links of the parts cuts[share] .. cuts[share + 1]: bounce back; what they give to parts.gains.

    These are int64 of 1 / scale[7]: force, torque and the mass that the fluid gains.
    """
    inner, reach = nodes.inner, REACH[bounce_back.rule]
    words, listed, size = scratch_sizes(table.radii)
    further = empty((2, listed if reach == 2 else 0), np.float64)
    scratch = Scratch(empty(size, np.int32), words, listed, further, empty(GAINS * N, np.int64))
    counters[share] = 0
    for k in range(cuts[share], cuts[share + 1]):
        m = parts.image[k]
        g, offset = images.grain[m], images.offset[m]
        centre, radius = table.centres[g], table.radii[g]
        grain = Grain(centre, radius, np.int32(table.ids[g]), table.motion[g], offset)
        r0, r1 = span(centre[1], radius + 1.0, offset[1], inner[1, 0], inner[1, 1])
        x0, x1 = span(centre[0], radius + 1.0, offset[0], inner[0, 0], inner[0, 1])
        first, planes = parts.first[k], parts.after[k] - parts.first[k]
        scratch.sums[:] = 0
        for x in range(x0, x1, COLUMNS):
            view = View(first, planes, r0, max(r1 - r0, 0), x, min(x1 - x, COLUMNS))
            links_of(populations, parity, nodes, directions, bounce_back, view, grain, scratch, scale, counters[share])
        for a in range(GAINS):
            parts.gains[k, a] = 0
            for lane in range(a * N, (a + 1) * N):
                parts.gains[k, a] += scratch.sums[lane]


@njit(_nrt=False)
def links_of(populations, parity, nodes, directions, bounce_back, view, grain, scratch, scale, counters):
    """The links that start at the nodes of a view.

    While those of a direction are done, the memory of the next one is on its way.
    """
    f, strides, slots, _ = populations
    e, opposite, w6 = directions
    work, words, listed, _, _ = scratch
    planes, width, reach = view.planes, view.rows + 2, REACH[bounce_back.rule]
    any_lost = fill_tables(nodes, strides, view, grain, scratch)
    corner, first = (view.x - 1, view.r - 1, view.p - 1), TABLES * words + LISTS * listed
    none = (first, np.int64(0), np.int64(0), np.int64(0))  # of one type with all lists, so that all is compiled once
    now = none
    for i in range(1, opposite.size + 1):
        ahead = none
        if i < opposite.size:
            lists, to = first + 3 * listed * (i % 2), e[i, 2] * width + e[i, 1]
            n, n_free = list_links(work, words, listed, planes, width, e[i, 0], to, i % 2 == 1, lists)
            ahead = (lists, n, slots[parity, i] * strides[0], slots[parity, opposite[i]] * strides[0])
            counters[LINKS] += n
            counters[FALLBACKS] += n - n_free if reach else 0
            if any_lost:
                counters[LOST] += count_lost(work, words, planes, width, e[i, 0], to)
        if now[1] == 0:
            prefetch_links(f, ahead, 0, ahead[1], work, listed)
        else:
            i -= 1
            if reach == 2:
                counters[FALLBACKS] += look_further(
                    populations, parity, nodes, e[i], i, opposite[i], corner, scratch, now[0] + 2 * listed, now[1]
                )
            bounce(f, now, ahead, e[i], w6[i], bounce_back, corner, grain, scratch, scale)
        now = ahead


@njit
def look_further(populations, parity, nodes, e, i, j, corner, scratch, codes, n):
    """Mark the links with two fluid nodes behind them, and get g_i(z) and g_j(y). How many have one only."""
    short, work, further = 0, scratch.work, scratch.further
    x0, r0, p0 = corner
    for k in range(n):
        further[0, k], further[1, k] = 0.0, 0.0
        code = work[codes + k]
        if code >> FREE:
            node = (x0 + (code & 63), r0 + ((code >> ROW) & 4095), p0 + ((code >> PLANE) & 15))
            way = (e[0], e[1], e[2])
            found, further[0, k], further[1, k] = second_behind(populations, parity, nodes, node, way, i, j)
            work[codes + k] = code | np.int32(found) << FURTHER
            short += not found
    for k in range(n, n + N):  # the last vector is filled up with the last link
        further[0, k], further[1, k] = further[0, n - 1], further[1, n - 1]
    return short


@njit(_nrt=False)  # nothing is allocated, so no references are counted: a tenth of the time of small grains
def bounce(f, now, ahead, e, weight, bounce_back, corner, grain, scratch, scale):
    """The links of the list `now` along e: the wall rule, and 7 sums of N lanes each.

    now, ahead: as `link_lists.fetch` wants them; the memory of those ahead is fetched meanwhile. corner: the node of
    the code 0.
    """
    lists, n, slot_i, slot_j = now
    centre, radius, _, motion, offset = grain
    work, _, listed, further, sums = scratch
    rule, open_mass = bounce_back
    way, radius_sq, zero = (float(e[0]), float(e[1]), float(e[2])), radius * radius, splat(F, 0.0)
    first = (float(corner[0] - offset[0]), float(corner[1] - offset[1]), float(corner[2] - offset[2]))
    middle, speed = (centre[0], centre[1], centre[2]), (motion[0], motion[1], motion[2])
    turn, nears, codes = (motion[3], motion[4], motion[5]), lists + listed, lists + 2 * listed
    for at in (lists, nears, codes):  # the last vector is filled up, see above
        store(work, at + n, splat(H, work[at + n - 1]))
    for k in range(0, n, N):
        prefetch_links(f, ahead, k, k + N, work, listed)
        code = load(H, work, codes + k)
        q, arm = crossing(code, first, middle, way, radius_sq)
        wall = wall_velocity(arm, speed, turn)
        push = dot(wall, way) * weight
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
        for a, term in enumerate(gains_of(out + v, out - v, open_mass, way, wall, arm)):
            store(sums, a * N, load(L, sums, a * N) + to_fixed(term, scale[a]))
    prefetch_links(f, ahead, (n + N - 1) // N * N, ahead[1], work, listed)


@njit(forceinline=True)
def dot(a, way):
    """Scalar product of three components."""
    return fma(a[0], way[0], fma(a[1], way[1], a[2] * way[2]))


@njit(forceinline=True)
def crossing(code, first, middle, way, radius_sq):
    """q of links by their codes, and the crossings from the middle of the grain. first: node of the code 0."""
    dx = (convert(F, code & np.int32(63)) + first[0]) - middle[0]
    dy = (convert(F, (code >> ROW) & np.int32(4095)) + first[1]) - middle[1]
    dz = (convert(F, (code >> PLANE) & np.int32(15)) + first[2]) - middle[2]
    d_sq = fma(dx, dx, fma(dy, dy, dz * dz)) - radius_sq
    b, e_sq = dot((dx, dy, dz), way), way[0] * way[0] + way[1] * way[1] + way[2] * way[2]
    q = (b + sqrt(maximum(fma(b, b, -d_sq * e_sq), 0.0))) * (-1.0 / e_sq)
    q = minimum(maximum(q, 0.0), 1.0)
    return q, (fma(q, way[0], dx), fma(q, way[1], dy), fma(q, way[2], dz))


@njit(forceinline=True)
def wall_velocity(arm, speed, turn):
    """Velocity of the wall at the arm from the middle of the grain; turn: angular velocity."""
    (x, y, z), (wx, wy, wz) = arm, turn
    return (
        fma(z, wy, fma(y, -wz, speed[0])),
        fma(x, wz, fma(z, -wx, speed[1])),
        fma(y, wx, fma(x, -wy, speed[2])),
    )


@njit(forceinline=True)
def gains_of(give, keep, open_mass, way, wall, arm):
    """Force, torque and mass that a grain gains, the mass with the sign of the fluid's."""
    (x, y, z), swept = arm, keep * open_mass
    fx = fma(give, way[0], -(swept * wall[0]))
    fy = fma(give, way[1], -(swept * wall[1]))
    fz = fma(give, way[2], -(swept * wall[2]))
    return fx, fy, fz, fma(y, fz, -(z * fy)), fma(z, fx, -(x * fz)), fma(x, fy, -(y * fx)), -keep
