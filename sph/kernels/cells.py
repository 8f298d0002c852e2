"""Bodies (own particles and ghosts) into slots in the order layer, row, fine cell, key.

A layer is a slice of thickness `edge` across the slab axis, a row a bar of edge^2 in it along the last axis (in 2D the
layer itself), a fine cell 1/FINE of an edge of a row. Tables exist for the occupied rows of the layers of a rank:

rows[l] = (first row, number of rows, place of the first in row_table) of layer l
row_table[k] = (slot of the first body, first fine cell, number of fine cells, place in fine_start, first and end of the
    fine cells, counted from the first, between which there is fluid only, as many as can be; first and end of the
    slots between which all its fluid and rigid bodies are)
fine_start[place + c] = slot of the first body of fine cell c or later; one more entry closes the row

Slots of a layer begin at base[l], with room for two vectors after the last: loads and stores may overrun.
"""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import (
    Vec,
    bits,
    convert,
    floor,
    lanes,
    largest_lane,
    load,
    maximum,
    minimum,
    select,
    smallest_lane,
    splat,
    store,
)  # fmt: skip
from sph.kernels.marks import FLOWS, FLUID, NO_DENSITY, OWN, PLAIN, SOLIDS

DIM = 3

AXIS = DIM - 1  # of the fine cells
FINE = 8
GAP = 16  # slots between layers: a vector may overrun
FAR = 2**24  # fine cells from the corner: what is farther counts to the last one
N = lanes(np.float64)
F, I = Vec(N, np.float64), Vec(N, np.int32)
LOST = 1


@njit
def cell_numbers(x, b, scale, pads, n):
    """Layers or rows of the N bodies from b on, n in all; those beyond the first or last are counted to it."""
    at = floor(load(F, x, b) * scale) + pads
    return convert(I, minimum(maximum(at, 0.0), n - 1.0))


@njit
def place(chunk, chunks, wanted, flags, x, scale, shape, layer, row, fine, span):
    """Find layer, row and fine cell (each [slots], of the whole domain) of the bodies of a chunk that have a flag
    `wanted`; the layer of others is -1. x[d, slots] m; scale[d]: layers, rows, fine cells per m; span[chunk] = lowest
    and highest layer.
    """
    pads, layers, n_rows = 1.0 * shape[0], 1.0 * shape[1], 1.0 * shape[4]
    lowest, highest = splat(I, FAR), splat(I, -1)
    for b in range(chunks[chunk], chunks[chunk + 1], N):
        there = load(I, flags, b) & wanted != 0
        l = select(there, cell_numbers(x[0], b, scale[0], pads, layers), -1)
        lowest, highest = minimum(lowest, select(there, l, FAR)), maximum(highest, l)
        store(layer, b, l)
        f = floor(load(F, x[AXIS], b) * scale[AXIS])
        store(fine, b, convert(I, minimum(maximum(f, -1.0 * FAR), 1.0 * FAR)))
        store(row, b, cell_numbers(x[1], b, scale[1], pads, n_rows) if DIM == 3 else splat(I, 0))
    span[chunk, 0], span[chunk, 1] = smallest_lane(lowest), largest_lane(highest)


@njit
def tally(chunk, chunks, shape, layer, row, count, low, high):
    """Count the bodies of a chunk by layers, which are numbered from the first one here from now on: count[chunk, l],
    with their lowest and highest row.

    shape = (pads, layers, first layer here, layers here, rows, bodies).
    """
    first, here, n_rows = shape[2], shape[3], shape[4]
    for l in range(here):
        count[chunk, l], low[chunk, l], high[chunk, l] = 0, n_rows, -1
    code = 0
    for b in range(np.uint64(chunks[chunk]), np.uint64(chunks[chunk + 1])):
        if layer[b] < 0:
            continue
        l = np.int64(layer[b]) - first
        if l < 0 or l >= here:
            l = 0
            code = LOST
        layer[b] = l
        at = np.uint64(l)
        count[chunk, at] += 1
        low[chunk, at] = min(low[chunk, at], row[b])
        high[chunk, at] = max(high[chunk, at], row[b])
    return code


@njit
def divide(first, here, count, low, high, start, begin, base, rows, layers, sweeps, inner):
    """From what parts have counted in the layers here find where these begin, their rows, and blocks of layers of about
    equal load: `layers` of a launch, `sweeps` of pairs of an even layer and the next, `inner` without the ends.
    """
    parts, n_rows, last = count.shape[0], 0, here - 1
    begin[0], base[0] = 0, 0
    for l in range(here):
        begin[l + 1], lowest, highest = begin[l], low[0, l], high[0, l]
        for part in range(parts):
            start[part, l] = begin[l + 1]
            lowest, highest = min(lowest, low[part, l]), max(highest, high[part, l])
            begin[l + 1] += count[part, l]
        base[l + 1] = base[l] + (begin[l + 1] - begin[l] + 2 * GAP - 1) // GAP * GAP
        rows[l, 0], rows[l, 1], rows[l, 2] = lowest, max(highest - lowest + 1, 0), n_rows
        n_rows += rows[l, 1]
    layers[0], layers[parts], sweeps[:], sweeps[0], pairs, l = 0, here, last, 0, 0, 0
    for part in range(1, parts):
        while begin[l] < begin[here] * part / parts:
            l += 1
        layers[part], pair = l, min(l + (l + first) % 2, last)
        if pairs == 0 or pair > sweeps[pairs]:
            pairs += 1
            sweeps[pairs] = pair
    for part in range(parts + 1):
        inner[part] = min(max(layers[part], 1), last)
    return n_rows


@njit
def scatter(chunk, chunks, layer, start, bucket):
    """Put the slots of the bodies of a chunk into bucket[slots], layer by layer: those of layer l go where
    start[chunk, l] says.
    """
    for b in range(np.uint64(chunks[chunk]), np.uint64(chunks[chunk + 1])):
        if layer[b] >= 0:
            l = np.uint64(layer[b])
            bucket[np.uint64(start[chunk, l])] = b
            start[chunk, l] += 1


@njit
def extents(block, blocks, begin, bucket, row, fine, table):
    """Count bodies and fine cells of each row of the layers of a block."""
    rows, row_table = table.rows, table.row_table
    for l in range(blocks[block], blocks[block + 1]):
        first, n_rows, at = rows[l, 0], rows[l, 1], rows[l, 2]
        for k in range(at, at + n_rows):
            row_table[k, 0], row_table[k, 1], row_table[k, 2] = 0, FAR, -FAR
        for k in range(np.uint64(begin[l]), np.uint64(begin[l + 1])):
            b = np.uint32(bucket[k])
            entry = row_table[np.uint64(at + row[b] - first)]
            entry[0] += 1
            entry[1] = min(entry[1], fine[b])
            entry[2] = max(entry[2], fine[b])
        cells = np.int64(0)
        for k in range(at, at + n_rows):
            row_table[k, 2] = max(row_table[k, 2] - row_table[k, 1] + 1, 0)
            cells += row_table[k, 2] + 1
        table.fine_total[l] = cells


@njit
def arrange(block, blocks, begin, base, bucket, row, fine, key, flags, table, body, kind):
    """Order the bodies of a block's layers: body[slot] = slot where it is now, kind[slot] = its flags; and fill the
    tables of their rows. fine_total[l] = place of the cells of layer l in fine_start; fine[body] becomes that of its
    own.
    """
    rows, row_table, fine_start = table.rows, table.row_table, table.fine_start
    for l in range(blocks[block], blocks[block + 1]):
        first, n_rows, at = rows[l, 0], rows[l, 1], rows[l, 2]
        slot, place = base[l], table.fine_total[l]
        for k in range(at, at + n_rows):
            entry = row_table[k]
            entry[3] = place
            fine_start[place : place + entry[2] + 1] = 0
            bodies = entry[0]
            entry[0] = slot
            slot += bodies
            place += entry[2] + 1
        for k in range(np.uint64(begin[l]), np.uint64(begin[l + 1])):
            b = np.uint32(bucket[k])
            entry = row_table[np.uint64(at + row[b] - first)]
            fine[b] += entry[3] - entry[1]
            fine_start[np.uint64(fine[b])] += 1
        for k in range(at, at + n_rows):
            entry = row_table[k]
            slot = entry[0]
            for c in range(np.uint64(entry[3]), np.uint64(entry[3] + entry[2] + 1)):
                slot += fine_start[c]
                fine_start[c] = slot  # end of the cell; becomes its start while bodies are put in
        for k in range(begin[l + 1] - 1, begin[l] - 1, -1):
            b = np.uint32(bucket[np.uint64(k)])
            c = np.uint64(fine[b])
            fine_start[c] -= 1
            body[np.uint32(fine_start[c])] = np.int32(b)
        order_by_key(body, key, fine, base[l], base[l] + begin[l + 1] - begin[l])
        for s in range(np.uint64(base[l]), np.uint64(base[l] + begin[l + 1] - begin[l])):
            kind[s] = flags[np.uint32(body[s])] & ~PLAIN
        for k in range(at, at + n_rows):
            cells_with_fluid_only(row_table[k], fine_start, kind)
            slots_with_partners(row_table[k], fine_start, kind)


@njit
def find_places(block, blocks, begin, base, body, kind, bucket, flags):
    """Invert the order, bucket[body] = its slot, and put the flags into the slots; between layers nobody is."""
    for l in range(blocks[block], blocks[block + 1]):
        end = base[l] + begin[l + 1] - begin[l]
        for s in range(np.uint64(base[l]), np.uint64(end)):
            bucket[np.uint32(body[s])] = s
            flags[s] = kind[s]
        flags[end : base[l + 1]] = 0


@njit
def gather(block, blocks, begin, base, body, k, state, moved):
    """Copy line k of the state into moved[slots] in the order of slots."""
    line = state[k]
    for l in range(blocks[block], blocks[block + 1]):
        for s in range(np.uint64(base[l]), np.uint64(base[l] + begin[l + 1] - begin[l])):
            moved[s] = line[np.uint32(body[s])]


@njit
def put_back(block, blocks, begin, base, k, state, moved, flags, bits_sorted):
    """Copy the moved line back into the state, while it is in the cache. bits_sorted[block, k] = sum of the bits of own
    bodies, modulo 2^64; of densities, those that evolve.
    """
    line, found = state[k], np.int64(0)
    kinds = OWN | NO_DENSITY if k == 2 * DIM else OWN
    for l in range(blocks[block], blocks[block + 1]):
        for s in range(np.uint64(base[l]), np.uint64(base[l] + begin[l + 1] - begin[l])):
            line[s] = moved[s]
            found += bits(moved[s]) if flags[s] & kinds == OWN else 0
    bits_sorted[block, k] = found


@njit
def cells_with_fluid_only(entry, fine_start, kind):
    """Find the longest stretch of fine cells of a row where all bodies have FLOWS."""
    entry[4], entry[5] = 0, 0
    place, c, since = np.int64(entry[3]), np.int64(0), np.int64(0)
    end = np.uint64(fine_start[place + entry[2]])
    for s in range(np.uint64(entry[0]), end):
        if kind[s] & FLOWS == 0:
            while fine_start[place + c + 1] <= s:
                c += 1
            if c - since > entry[5] - entry[4]:
                entry[4], entry[5] = since, c
            since = c + 1
    if entry[2] - since > entry[5] - entry[4]:
        entry[4], entry[5] = since, entry[2]


@njit
def slots_with_partners(entry, fine_start, kind):
    """Find the slots from the first to the last of a row that is fluid or of a rigid body: whom walls meet."""
    first, end = entry[0], fine_start[entry[3] + entry[2]]
    while first < end and kind[first] & (FLUID | SOLIDS) == 0:
        first += 1
    while first < end and kind[end - 1] & (FLUID | SOLIDS) == 0:
        end -= 1
    entry[6], entry[7] = first, end


@njit
def order_by_key(body, key, cell, first, end):
    """Sort the few bodies of each cell by key, by insertion: most are in order from the last time."""
    for s in range(np.uint64(first + 1), np.uint64(end)):
        b, before = np.uint32(body[s]), np.uint32(body[s - np.uint64(1)])
        if (cell[before] == cell[b]) & (key[before] > key[b]):
            t = np.int64(s)
            while t > first and cell[body[t - 1]] == cell[b] and key[body[t - 1]] > key[b]:
                body[t] = body[t - 1]
                t -= 1
            body[t] = np.int32(b)
