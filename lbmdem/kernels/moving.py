"""Links of grains that move, found anew at every step; compiled.

A grain is seen through windows of planes, rows and columns of nodes. Every row of a window has words with a bit for
each column: nodes that the grain has, nodes of the fluid. The links along e are the bits of the fluid that meet the
grain's bits of the row that e points to, moved back by e. Their places are put side by side (`along`), while the memory
that they need is fetched, and done a vector at a time (`bounce`). All terms of the sums are rounded to integers, so
that the sums do not depend on their order.
"""

import numpy as np

from hpcpic.core.simd.jit import njit
from hpcpic.core.simd.masks import mask_of_bits
from hpcpic.core.simd.vector import (
    Vec,
    address_of,
    bitmask,
    convert,
    count_bits,
    first_bit,
    lane_numbers,
    lanes,
    load,
    maximum,
    minimum,
    prefetch,
    prefetch_to_write,
    select,
    splat,
    sqrt,
    store,
    to_fixed,
)
from lbmdem.kernels.links import CLI, FALLBACKS, HALFWAY, LINKS, LOST, QUADRATIC, place, second_behind
from lbmdem.kernels.runs import FLUID, run, span
from lbmdem.kernels.spread import gather, scatter, side_by_side

PLANES, COLUMNS = 12, 60  # of a window at most, without the nodes beside it
LISTED = 512  # links that are done at a time, about
GAINS = 7
PAD = 16  # words before and after a table
N, M = lanes(np.float64), lanes(np.int32)
F, L, H, I = Vec(N, np.float64), Vec(N, np.int64), Vec(N, np.int32), Vec(M, np.int32)
ROW, PLANE, FURTHER, BEHIND = 6, 18, 29, 30  # bits of the word of a link: column, row, plane; are z, y fluid?


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
    height = 0
    for g in range(radii.size):
        height = max(height, np.int64(2.0 * radii[g]) + 7)
    size = (PLANES + 2) * height + 2 * PAD
    starts, fluid, mine = np.zeros(size, np.int64), np.zeros(size, np.int64), np.zeros(size, np.int64)
    lost, here, words = np.zeros(size, np.int64), np.zeros(size, np.int64), np.zeros(size, np.int64)
    met, free, row = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size, np.int64)
    room = LISTED + 64 + M
    at_out, which, third, fourth = np.zeros(room, np.int32), np.zeros(room, np.int32), np.zeros(room), np.zeros(room)
    sums = np.empty(GAINS * N, np.int64)
    for k in range(cuts[share], cuts[share + 1]):
        m = image[k]
        g = grain[m]
        radius = radii[g]
        r0, r1 = span(centres[g, 1], radius + 1.0, offset[m, 1], inner[1, 0], inner[1, 1])
        x0, x1 = span(centres[g, 0], radius + 1.0, offset[m, 0], inner[0, 0], inner[0, 1])
        planes, rows = after[k] - first[k], max(r1 - r0, 0)
        sums[:] = 0
        for x in range(x0, x1, COLUMNS):
            columns = min(x1 - x, COLUMNS)
            any_lost = look(
                solid, shape, inner, box, strides, first[k], planes, r0, rows, x, columns,
                centres, radius, np.int32(ids[g]), g, offset, m, starts, fluid, mine, lost, here, words,
            )  # fmt: skip
            for i in range(1, opposite.size):
                along(
                    f, strides, slots, shifts, parity, i, opposite[i], e[i, 0], e[i, 1], e[i, 2], w6[i], rule,
                    open_mass, solid, shape, inner, planes, rows, columns, x - 1, r0 - 1, first[k] - 1, any_lost,
                    starts, fluid, mine, lost, here, words, met, free, row, at_out, which, third, fourth,
                    centres, radius, motion, g, offset, m, scale, sums, counters,
                )  # fmt: skip
        for a in range(GAINS):
            parts[k, a] = sums[a * N : (a + 1) * N].sum()


@njit
def look(
    solid, shape, inner, box, strides, p0, planes, r0, rows, x, columns, centres, radius, number, g, offset, m,
    starts, fluid, mine, lost, here, words,
):  # fmt: skip
    """Fill the words of the rows r0 - 1 .. of the planes p0 - 1 .. of a window; bit b is the column x - 1 + b.

    starts: nodes where links start; lost: within the grain, but of others; here: element of column 0; words: as those
    of links. Whether there are any of others.
    """
    whole, inside = (1 << (columns + 2)) - 1, ((1 << columns) - 1) << 1
    low, high = max(box[0, 0] - (x - 1), 0), min(box[0, 1] - (x - 1), columns + 2)
    in_box = ((1 << high) - 1) & ~((1 << low) - 1)
    any_lost, at = 0, PAD
    for c in range(planes + 2):
        p = p0 - 1 + c
        dz = (p - offset[m, 2]) - centres[g, 2]
        for r in range(rows + 2):
            row = r0 - 1 + r
            starts[at], fluid[at], mine[at], lost[at] = 0, 0, 0, 0
            words[at] = (c << PLANE) | (r << ROW)
            if 0 <= row < shape[1]:
                dy = (row - offset[m, 1]) - centres[g, 1]
                here[at] = place(strides, p - inner[2, 0], row - inner[1, 0]) - inner[0, 0] + x - 1
                node = (p * shape[1] + row) * shape[0] + x - 1
                wet, own = nodes_of(solid, node, columns + 2, number)
                ball = chord(centres[g, 0], radius * radius - dz * dz - dy * dy, offset[m, 0] - (x - 1), columns + 1)
                mine[at] = own & ball
                lost[at] = ball & ~own
                any_lost |= lost[at]
                if box[1, 0] <= row < box[1, 1] and box[2, 0] <= p < box[2, 1]:
                    fluid[at] = wet & whole & in_box
                if 1 <= c <= planes and 1 <= r <= rows:
                    starts[at] = wet & inside
            at += 1
    starts[at : at + PAD] = 0
    return any_lost != 0


@njit(inline="always")
def nodes_of(solid, node, columns, number):
    """Bits of the nodes of the fluid and of a grain from a node on; those beyond the columns mean nothing."""
    wet, own = 0, 0
    if node + 64 <= solid.size:
        for b in range(0, columns, M):
            ids = load(I, solid, node + b)
            wet |= bitmask(ids == FLUID) << b
            own |= bitmask(ids == number) << b
    else:
        for b in range(columns):
            wet |= np.int64(solid[node + b] == FLUID) << b
            own |= np.int64(solid[node + b] == number) << b
    return wet, own


@njit(inline="always")
def chord(x, h_sq, shift, last):
    """Bits 0 .. last of the columns within sqrt(h_sq) of x, where column 0 is the node -shift."""
    a, b = run(x, h_sq)
    a, b = max(a + shift, 0), min(b + shift, last)
    return ((1 << (b - a + 1)) - 1) << a if a <= b else 0


@njit
def along(
    f, strides, slots, shifts, parity, i, j, ex, ey, ez, weight, rule, open_mass,
    solid, shape, inner, planes, rows, columns, x0, r0, p0, any_lost,
    starts, fluid, mine, lost, here, words, met, free, row, at_out, which, third, fourth,
    centres, radius, motion, g, offset, m, scale, sums, counters,
):  # fmt: skip
    """Links along e[i], opposite to e[j], of the window at x0, r0, p0: LISTED at a time."""
    slot_i, slot_j = slots[parity, i] * strides[0], slots[parity, j] * strides[0]
    upwards = i % 2 == 1  # e points to larger storage indices
    width = rows + 2
    left, right = np.int64(ex < 0), np.int64(ex > 0)
    to = ez * width + ey
    first, after = PAD + width, PAD + (planes + 1) * width
    n_rows = 0
    for at in range(first, after, N):  # rows with links
        links = load(L, starts, at) & ((load(L, mine, at + to) << left) >> right)
        some = links != 0
        store(met, n_rows, side_by_side(links, some))
        store(free, n_rows, side_by_side(links & ((load(L, fluid, at - to) << right) >> left), some))
        store(row, n_rows, side_by_side(lane_numbers(L) + at, some))
        n_rows += count_bits(bitmask(some))
    step_out, step = (to, -to) if upwards else (0, -to)
    x_out, step_x = (ex, -ex) if upwards else (0, -ex)
    n_links, n_free, k = 0, 0, 0
    while k < n_rows:
        n, distance = 0, 0
        while k < n_rows and n <= LISTED:
            at = row[np.uint64(k)]
            out = here[np.uint64(at + step_out)] + x_out
            now = here[np.uint64(at + step_out + step)] + x_out + step_x - out
            if n == 0:
                distance = now
            elif now != distance:  # around a seam
                break
            links, behind = met[np.uint64(k)], free[np.uint64(k)]
            n_free += count_bits(behind)
            for spot in (out + first_bit(links), out + columns):
                prefetch_to_write(address_of(f, slot_j + spot))
                prefetch(address_of(f, slot_i + distance + spot))
                prefetch(address_of(f, slot_j + distance + spot))
            begin, word = np.int32(out), np.int32(words[np.uint64(at)])
            for b in range(0, columns + 2, M):
                column = lane_numbers(I) + np.int32(b)
                marked = select(mask_of_bits(I, behind >> b), column | np.int32(1 << BEHIND), column)
                packed = side_by_side(marked, mask_of_bits(I, links >> b))
                store(which, n, packed | word)
                store(at_out, n, (packed & np.int32(63)) + begin)
                n += count_bits((links >> b) & ((1 << M) - 1))
            k += 1
        n_links += n
        if rule == QUADRATIC:
            n_free -= look_further(
                f, strides, slots, shifts, parity, solid, shape, inner, ex, ey, ez, i, j, x0, r0, p0,
                which, n, third, fourth,
            )  # fmt: skip
        bounce(
            f, slot_i + distance, slot_j, distance, at_out, which, third, fourth, n, float(ex), float(ey), float(ez),
            weight, rule, open_mass, float(x0 - offset[m, 0]), float(r0 - offset[m, 1]), float(p0 - offset[m, 2]),
            centres, radius, motion, g, scale, sums,
        )  # fmt: skip
    counters[LINKS] += n_links
    if rule != HALFWAY:
        counters[FALLBACKS] += n_links - n_free
    if any_lost:
        for at in range(first, after):
            counters[LOST] += count_bits(starts[at] & ((lost[at + to] << left) >> right))


@njit
def look_further(
    f, strides, slots, shifts, parity, solid, shape, inner, ex, ey, ez, i, j, x0, r0, p0, which, n, third, fourth
):  # fmt: skip
    """Mark the links with two fluid nodes behind them, and get g_i(z) and g_j(y). How many have one only."""
    short = 0
    for k in range(n):
        third[k], fourth[k] = 0.0, 0.0
        if which[k] >> BEHIND:
            p, r, x = p0 + ((which[k] >> PLANE) & 15), r0 + ((which[k] >> ROW) & 4095), x0 + (which[k] & 63)
            found, third[k], fourth[k] = second_behind(
                f, strides, slots, shifts, parity, solid, shape, inner, p, r, x, ex, ey, ez, i, j
            )
            which[k] |= np.int32(found) << FURTHER
            short += not found
    return short


@njit
def bounce(
    f, second, slot_j, distance, at_out, which, third, fourth, n, ex, ey, ez, weight, rule, open_mass, x0, r0, p0,
    centres, radius, motion, g, scale, sums,
):  # fmt: skip
    """n links along e: the rule of `kernels.links`, and 7 sums of N lanes each."""
    cx, cy, cz = centres[g, 0], centres[g, 1], centres[g, 2]
    ux, uy, uz, wx, wy, wz = motion[g, 0], motion[g, 1], motion[g, 2], motion[g, 3], motion[g, 4], motion[g, 5]
    e_sq = ex * ex + ey * ey + ez * ez
    inverse, r_sq, zero = 1.0 / e_sq, radius * radius, convert(F, lane_numbers(H)) * 0.0
    store(which, n, splat(H, which[n - 1]))  # the last vector is filled up with the last link
    store(at_out, n, splat(H, at_out[n - 1]))
    store(third, n, splat(F, third[n - 1]))
    store(fourth, n, splat(F, fourth[n - 1]))
    force, torque, mass = scale[0], scale[3], scale[6]
    sx, sy, sz, tx = load(L, sums, 0), load(L, sums, N), load(L, sums, 2 * N), load(L, sums, 3 * N)
    ty, tz, gain = load(L, sums, 4 * N), load(L, sums, 5 * N), load(L, sums, 6 * N)
    for k in range(0, n, N):
        word = load(H, which, k)
        dx = (convert(F, word & np.int32(63)) + x0) - cx
        dy = (convert(F, (word >> ROW) & np.int32(4095)) + r0) - cy
        dz = (convert(F, (word >> PLANE) & np.int32(15)) + p0) - cz
        free = (word >> BEHIND) > 0
        d_sq = dx * dx + dy * dy + dz * dz - r_sq
        way = dx * ex + dy * ey + dz * ez
        q = -(way + sqrt(maximum(way * way - d_sq * e_sq, 0.0))) * inverse
        q = minimum(maximum(q, 0.0), 1.0)
        px, py, pz = dx + q * ex, dy + q * ey, dz + q * ez
        vx, vy, vz = (pz * wy - py * wz) + ux, (px * wz - pz * wx) + uy, (py * wx - px * wy) + uz
        push = (vx * ex + vy * ey + vz * ez) * weight
        out, outwards = gather(F, f, slot_j, at_out, k), gather(F, f, slot_j + distance, at_out, k)
        behind = gather(F, f, second, at_out, k)
        v = returned(rule, q, free, out, behind, outwards, push, zero)
        if rule == QUADRATIC:
            further = (word & np.int32(1 << FURTHER)) > 0
            v = select(further, quadratic(q, out, behind, outwards, load(F, third, k), load(F, fourth, k), push), v)
        scatter(f, slot_j, at_out, k, v)
        linked = lane_numbers(L) < n - k
        out, v = select(linked, out, zero), select(linked, v, zero)
        give, keep = out + v, out - v
        swept = keep * open_mass
        fx, fy, fz = give * ex - swept * vx, give * ey - swept * vy, give * ez - swept * vz
        sx += to_fixed(fx, force)
        sy += to_fixed(fy, force)
        sz += to_fixed(fz, force)
        tx += to_fixed(py * fz - pz * fy, torque)
        ty += to_fixed(pz * fx - px * fz, torque)
        tz += to_fixed(px * fy - py * fx, torque)
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
