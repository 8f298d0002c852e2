"""Lists of the links of a grain that moves, from words with a bit for each column of its rows; compiled.

A grain is seen through a view of planes, rows and columns of nodes. Every row of it has words of 32 bits: nodes that
the grain has, nodes of the fluid. The links along e are the bits of the fluid that meet the grain's bits of the row
that e points to, moved back by e. Rows with links wait in a queue: each gives one link when its turn comes, a vector
of rows at a time, and goes to the end of the queue if it has more. All is held in one line of int32, `work`: tables of
rows, columns of the queue, lists of links.
"""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import (
    Vec,
    address_of,
    bitmask,
    convert,
    count_bits,
    floor,
    lane_numbers,
    lanes,
    load,
    maximum,
    minimum,
    prefetch,
    select,
    splat,
    sqrt,
    store,
    to_fixed,
)
from lbmdem.kernels.gather_scatter import first_bits, store_side_by_side
from lbmdem.kernels.layout import place
from lbmdem.kernels.link_arrays import FLUID

PLANES, COLUMNS = 12, 28  # of a view at most, without the nodes beside it
N, M = lanes(np.float64), lanes(np.int32)
F, L, H, I = Vec(N, np.float64), Vec(N, np.int64), Vec(N, np.int32), Vec(M, np.int32)
PAD = 2 * M  # words before and after a table
STARTS, FLUIDS, MINE, LOSTS, HERE, CODES, TABLES = range(7)  # of rows, see `fill_tables`
LINKS, BEHIND, OUTS, NEARS, WHICH, LISTS = range(6)  # columns of the queue, and the first of two times three lists
ROW, PLANE, FURTHER, FREE = 6, 18, 29, 30  # bits of the code of a link: column, row, plane; are z, y fluid?


@njit
def scratch_sizes(radii):
    """Words of a table, of a list, and of all of `work`, enough for views of grains of these radii."""
    height = 0
    for g in range(radii.size):
        height = max(height, np.int64(2.0 * radii[g]) + 7)
    table, listed = (PLANES + 2) * height + 2 * PAD, PLANES * height * COLUMNS + 2 * M
    return table, listed, TABLES * table + (LISTS + 6) * listed


@njit
def fill_tables(nodes, strides, view, grain, scratch):
    """Fill the tables of the rows r - 1 .. of the planes p - 1 .. of a view; bit b is the column x - 1 + b.

    STARTS: nodes where links start; FLUIDS: of the fluid; MINE: the grain's; LOSTS: within it, but of others; HERE:
    element of column 0; CODES: as those of links. Returns whether there are any of others.
    """
    solid, shape, inner, box = nodes
    p0, planes, r0, rows, x, columns = view
    centre, radius, number, _, offset = grain
    work, table = scratch.work, scratch.table
    inside, low, high = ((1 << columns) - 1) << 1, max(box[0, 0] - (x - 1), 0), min(box[0, 1] - (x - 1), columns + 2)
    in_box = ((1 << high) - 1) & ~((1 << low) - 1)
    any_lost, at, width = splat(I, np.int32(0)), PAD, rows + 2
    for c in range(planes + 2):
        p = p0 - 1 + c
        dz = (p - offset[2]) - centre[2]
        of_plane = radius * radius - dz * dz
        chords(of_plane, centre, offset, x - 1, columns + 1, r0 - 1, width, work, LOSTS * table + at)
        nodes_of(solid, shape, p, r0 - 1, width, x - 1, columns + 2, number, work, table, at)
        places(strides, p - inner[2, 0], r0 - 1 - inner[1, 0], width, x - 1 - inner[0, 0], work, HERE * table + at)
        start_bits, fluid_bits = inside * (1 <= c <= planes), in_box * (box[2, 0] <= p < box[2, 1])
        first, after = max(box[1, 0] - (r0 - 1), 0), min(box[1, 1] - (r0 - 1), width)
        for r in range(0, width, M):
            row = lane_numbers(I) + np.int32(r)
            ball, wet = load(I, work, LOSTS * table + at + r), load(I, work, FLUIDS * table + at + r)
            own = load(I, work, MINE * table + at + r)
            lost = ball & ~own
            any_lost = any_lost | select(row < np.int32(width), lost, np.int32(0))
            middle = (row > np.int32(0)) & (row <= np.int32(rows))
            store(work, STARTS * table + at + r, select(middle, wet & np.int32(start_bits), np.int32(0)))
            in_rows = (row >= np.int32(first)) & (row < np.int32(after))
            store(work, FLUIDS * table + at + r, select(in_rows, wet & np.int32(fluid_bits), np.int32(0)))
            store(work, MINE * table + at + r, own & ball)
            store(work, LOSTS * table + at + r, lost)
            store(work, CODES * table + at + r, (row << ROW) | np.int32(c << PLANE))
        at += width
    for k in range(0, PAD, M):
        store(work, STARTS * table + at + k, splat(I, np.int32(0)))
    return bitmask(any_lost != np.int32(0)) != 0


@njit(forceinline=True)
def places(strides, plane, row, rows, x, work, at):
    """Elements of the column x of rows from a row on; see `layout.place`."""
    first, step = place(strides, plane, 0) + x, strides[2]
    for r in range(0, rows, M):
        store(work, at + r, (lane_numbers(I) + np.int32(row + r)) * np.int32(step) + np.int32(first))
    if row < 0:
        work[at] = place(strides, plane, row) + x
    if row + rows > strides[5]:
        work[at + rows - 1] = place(strides, plane, row + rows - 1) + x


@njit(forceinline=True)
def nodes_of(solid, shape, plane, row, rows, x, columns, number, work, table, at):
    """FLUIDS and MINE of rows from x on: all nodes that are; bits beyond the columns mean nothing.

    Rows outside the array have none.
    """
    for r in range(rows):
        wet, own = 0, 0
        node = (plane * shape[1] + row + r) * shape[0] + x
        if not 0 <= row + r < shape[1]:
            pass
        elif node + 64 <= solid.size:
            for b in range(0, columns, M):
                ids = load(I, solid, node + b)
                wet |= bitmask(ids == FLUID) << b
                own |= bitmask(ids == number) << b
        else:
            for b in range(columns):
                wet |= np.int64(solid[node + b] == FLUID) << b
                own |= np.int64(solid[node + b] == number) << b
        work[np.uint64(FLUIDS * table + at + r)], work[np.uint64(MINE * table + at + r)] = wet, own


@njit(forceinline=True)
def chords(of_plane, centre, offset, x0, last, r0, rows, work, at):
    """Words of rows from r0 on with the bits 0 .. last of the columns from x0 on that are within the grain.

    of_plane: radius^2 less the square of the plane's distance. They are those that `grain_rasters.chord` finds.
    """
    x, shift = splat(F, centre[0]), float(offset[0] - x0)
    for r in range(0, rows, N):
        dy = (convert(F, lane_numbers(H)) + float(r0 - offset[1] + r)) - centre[1]
        h_sq = of_plane - dy * dy
        h = sqrt(maximum(h_sq, 0.0))
        a = minimum(maximum(shift - floor(h - x), 0.0), float(last + 1))
        b = minimum(maximum(shift + floor(x + h), -1.0), float(last))
        bits = (splat(L, 1) << to_fixed(b + 1.0, 1.0)) - (splat(L, 1) << to_fixed(a, 1.0))
        store(work, at + r, convert(H, select((h_sq >= 0.0) & (a <= b), bits, splat(L, 0))))


@njit
def list_links(work, table, listed, planes, width, ex, to, upwards, lists):
    """List the links along an e of a view whose planes have `width` rows: see `empty_queue`.

    to: rows from a node's to that which e points to; upwards: e points to larger storage indices.
    """
    left, right = np.int32(ex < 0), np.int32(ex > 0)
    starts, mine, fluids = STARTS * table, MINE * table + to, FLUIDS * table - to
    out, shift_out = HERE * table, np.int32(0)
    if upwards:
        out, shift_out = out + to, np.int32(ex)
    near, shift_near = out - to, shift_out - np.int32(ex)
    begin = TABLES * table
    end = begin
    for at in range(PAD + width, PAD + (planes + 1) * width, M):
        links = load(I, work, starts + at) & ((load(I, work, mine + at) << left) >> right)
        linked = links != np.int32(0)
        found = bitmask(linked)
        if found:
            behind = (load(I, work, fluids + at) << right) >> left
            store_side_by_side(work, end, links, linked)
            store_side_by_side(work, end + BEHIND * listed, behind, linked)
            store_side_by_side(work, end + OUTS * listed, load(I, work, out + at) + shift_out, linked)
            store_side_by_side(work, end + NEARS * listed, load(I, work, near + at) + shift_near, linked)
            store_side_by_side(work, end + WHICH * listed, load(I, work, CODES * table + at), linked)
            end += count_bits(found)
    return empty_queue(work, begin, end, listed, lists)


@njit(forceinline=True)
def empty_queue(work, k, end, listed, lists):
    """List a link of each row in the queue from k to the end, until there are none.

    Three lists: the elements in a slot of what goes out and of what is behind, and codes. How many links, and how many
    of them have a fluid node behind.
    """
    n, n_free = lists, 0
    while k < end:
        taken = min(end - k, M)
        links = select(lane_numbers(I) < np.int32(taken), load(I, work, k), splat(I, np.int32(0)))
        bit = links & -links
        column, rest = first_bits(links), links ^ bit
        behind, code = load(I, work, k + BEHIND * listed), load(I, work, k + WHICH * listed)
        out, near = load(I, work, k + OUTS * listed), load(I, work, k + NEARS * listed)
        free = (behind & bit) != np.int32(0)
        store(work, n, out + column)
        store(work, n + listed, near + column)
        store(work, n + 2 * listed, select(free, code | np.int32(1 << FREE), code) | column)
        n_free += count_bits(bitmask(free))
        n += taken
        k += taken
        more = rest != np.int32(0)
        again = count_bits(bitmask(more))
        if again:
            store_side_by_side(work, end, rest, more)
            store_side_by_side(work, end + BEHIND * listed, behind, more)
            store_side_by_side(work, end + OUTS * listed, out, more)
            store_side_by_side(work, end + NEARS * listed, near, more)
            store_side_by_side(work, end + WHICH * listed, code, more)
            end += again
    return n - lists, n_free


@njit(forceinline=True)
def prefetch_links(f, ahead, k, after, work, listed):
    """Prefetch the populations of the links k to `after` of a list. ahead: the list, how many, slots of i and of j."""
    lists, n, slot_i, slot_j = ahead
    size, to_i, to_j = f.itemsize, address_of(f, slot_i), address_of(f, slot_j)
    for m in range(lists + k, lists + min(after, n)):
        out, near = size * np.int64(work[np.uint64(m)]), size * np.int64(work[np.uint64(m + listed)])
        prefetch(to_j + out)
        prefetch(to_i + out)
        prefetch(to_j + near)
        prefetch(to_i + near)


@njit
def count_lost(work, table, planes, width, ex, to):
    """Number of links along e that end at nodes within the grain that other grains have."""
    left, right, count = np.int32(ex < 0), np.int32(ex > 0), 0
    for at in range(PAD + width, PAD + (planes + 1) * width, M):
        met = (load(I, work, LOSTS * table + at + to) << left) >> right
        if bitmask((load(I, work, STARTS * table + at) & met) != np.int32(0)):  # most often there are none
            for k in range(at, at + M):
                lost = (np.int64(work[LOSTS * table + k + to]) << (ex < 0)) >> (ex > 0)
                count += count_bits(np.int64(work[STARTS * table + k]) & lost)
    return count
