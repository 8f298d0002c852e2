"""Particles of a slot (tile part, species) in a chain of pages, and the boxes of those that change their slot.

A page holds PAGE particles as packs of lanes, `pool[page, pack, component, lane]` (components x, y, z, vx, vy, vz
as far as the scene has them; positions in cells from the anchor of the tile, velocities in cells per step), and their
numbers `ids[page, particle]`. `head[slot]` is the youngest page, the only one not full; `chain[page]` the next older
one. A block takes pages from and gives them to its own stack `free[: counters[0]]`.

A box holds particles under way, of sizes.record_numbers: the components `moving[k, :COMPONENTS]`, and in the same
memory the last three of `words[k]`: SLOT, where to, NUMBER, and LINK. Its lists, one per block of this rank and a last
one for other ranks, start at `lists[0, block]` and go on by LINK; -1 ends; `lists[1, block]` is their length.
`counters[1]` counts a box's particles. To other ranks, SLOT is global: tile number x species + species.
"""

import numpy as np

from hpcpic.core.simd.vector import prefetch_to_write
from hpcpic.plasma.kernels.groups import BoxArrays, PageArrays
from hpcpic.plasma.kernels.lanes import address, called_from_python, inlined, kernel, last_bit
from hpcpic.plasma.sizes import record_numbers

DIM = 2  # axes of the grid
COMPONENTS = 4  # of a particle: positions and velocities
REAL = np.float64  # precision of a particle
LANES = 8  # of a pack: one cache line

PAGE = 128
TILE = (256, 16, 8)[DIM - 1]  # cells of a tile along an axis; in 1D one row
GOOD, NO_PAGE, DIVERGED = 0, 2, 4
LANE_BITS = 16
LEAVERS_AHEAD = 16  # packs whose lines are asked for before they are needed
RECORD_BYTES = record_numbers(COMPONENTS, np.dtype(REAL).itemsize) * np.dtype(REAL).itemsize
SLOT, NUMBER, LINK = -3, -2, -1
FARTHEST = 2.0**31  # cells in one step; beyond it, or not a number, is no motion


@inlined
def pages_of(block, pages):
    """The pages with the stack of free ones and the counters of one block."""
    return PageArrays(pages.pool, pages.ids, pages.chain, pages.head, pages.count, pages.settled, pages.free[block],
                      pages.counters[block])  # fmt: skip


@inlined
def box_of(block, boxes):
    """One of the boxes."""
    return BoxArrays(boxes.moving[block], boxes.words[block], boxes.lists[block], boxes.counters[block],
                     boxes.crossings[block])  # fmt: skip


@inlined
def place_of(pool, page, pack, lane):
    """Position of a particle; zero along axes that the scene does not have."""
    y = z = REAL(0)
    if DIM > 1:
        y = pool[page, pack, 1, lane]
    if DIM == 3:
        z = pool[page, pack, 2, lane]
    return pool[page, pack, 0, lane], y, z


@inlined
def append(slot, pages):
    """Page and place for one more particle of the slot; (-1, 0) when the block has no free page."""
    head, counters = pages.head, pages.counters
    place = pages.count[slot] % PAGE
    page = np.int64(head[slot])
    if place == 0:
        if counters[0] == 0:
            return np.int64(-1), place
        counters[0] -= 1
        page = np.int64(pages.free[counters[0]])
        pages.chain[page] = head[slot]
        head[slot] = page
    pages.count[slot] += 1
    return page, place


@inlined
def settle(x, anchor, n):
    """Global cell and position from its tile's anchor of a particle at `x` from `anchor` on a ring of n cells.

    The fraction is carried over, so that a position inside the tile keeps its bits; what rounds up to the next
    cell is in the next cell, so that no position ever equals the end of its tile.
    """
    k = np.floor(x)
    cell = anchor + np.int64(k)
    fraction = x - k
    if fraction >= 1:
        cell, fraction = cell + 1, fraction * 0
    if cell < 0 or cell >= n:
        cell %= n
    position = REAL((cell & (TILE - 1)) + fraction)
    if position >= (cell & (TILE - 1)) + 1:
        cell = cell + 1 if cell + 1 < n else 0 * cell
        position = REAL(cell & (TILE - 1))
    return cell, position


@inlined
def count_crossing(crossed, x, anchor, cell, position, n):
    """crossed[0] += how often a particle at `x` from `anchor` had to go round a ring of n cells to (see settle) be in a
    cell at a position.
    """
    if cell != anchor + np.int64(np.floor(x)):
        crossed[0] += np.int64(np.rint((anchor - (cell - (cell & (TILE - 1))) + np.float64(x) - position) / n))


@inlined
def settle_along(axis, leaver, record, crossed, anchor, n):
    """The cell in which a particle is along an axis (see settle); its place goes into the record."""
    cell, position = settle(leaver[axis], anchor, n)
    count_crossing(crossed[axis : axis + 1], leaver[axis], anchor, cell, position, n)
    record[axis] = position
    return cell


@inlined
def tiles_along(axis, points):
    """Tiles across the grid along an axis of `points`: 0 rows, 1 columns."""
    return (points[axis] + TILE - 1) // TILE


@inlined
def tiles_of_layer(points):
    """Tiles of the whole grid that are one tile thick along the axis of the slabs."""
    if DIM == 1:
        return 1
    return tiles_along(1, points) if DIM == 2 else tiles_along(1, points) * tiles_along(0, points)


@inlined
def destination(row, column, plane, species, grid, lists):
    """Slot and list of a global cell: of this rank, or the global slot in the last list."""
    row_part, column_part = np.int64(grid.row_part[row]), grid.column_part[column]
    if DIM == 3:
        plane_part = grid.row_part[grid.points[0] + plane]
        row_part = row_part + plane_part if plane_part >= 0 else np.int64(-1)
    if row_part >= 0 and column_part >= 0:
        part = np.int64(column_part) + row_part * np.int64(grid.column_stride[column])
        return part * grid.n_species + species, grid.parts[part, 7]
    tile = column // TILE
    if DIM > 1:
        tile += (row // TILE) * tiles_along(1, grid.points)
    if DIM == 3:
        tile += (plane // TILE) * tiles_of_layer(grid.points)
    return tile * grid.n_species + species, np.int64(lists.shape[1] - 1)


@inlined
def append_to_list(k, slot, number, target, words, lists):
    """Enter particle k of the box, bound for `slot`, in list `target`."""
    word = words[k]
    word[SLOT] = slot
    word[NUMBER] = np.int32(number)
    word[LINK] = lists[0, target]
    lists[0, target] = k
    lists[1, target] += 1


@inlined
def leaver_mask(page, pack, lanes):
    """The particles of one pack that leave, by the bits of their lanes and the pack's place, as one number."""
    return (page * PAGE + pack * LANES) << LANE_BITS | lanes


@inlined
def prefetch_pack(first, pool, ids):
    """Prefetch, to write them, the cache lines of the pack whose first particle is place `first` of all pages."""
    for c in range(COMPONENTS):
        prefetch_to_write(address(pool) + first // LANES * (64 * COMPONENTS) + 64 * c)
    prefetch_to_write(address(ids) + first * 4)


@inlined
def close_up(slot, to, place, pages):
    """The last particle of the slot takes a place of the page `to`; a page that is empty then is free."""
    pool, ids, head, count, counters = pages.pool, pages.ids, pages.head, pages.count, pages.counters
    count[slot] -= 1
    last, page = count[slot] % PAGE, np.int64(head[slot])
    for c in range(COMPONENTS):
        pool[to, place // LANES, c, place % LANES] = pool[page, last // LANES, c, last % LANES]
    ids[to, place] = ids[page, last]
    if last == 0:
        head[slot] = pages.chain[page]
        pages.free[counters[0]] = page
        counters[0] += 1


@kernel
def depart(slot, n, leavers, grid, pages, box):
    """The particles of `leavers[:n]` (see leaver_mask; last place first) go into the box, bound for where they belong.

    The last particles of the slot take their places. Returns DIVERGED for a position that is no motion's.
    """
    points, parts, pool, ids = grid.points, grid.parts, pages.pool, pages.ids
    moving, counters = box.moving, box.counters
    part = slot // grid.n_species
    species = slot - part * grid.n_species
    row = plane = np.int64(0)
    for i in range(min(n, LEAVERS_AHEAD)):
        prefetch_pack(leavers[i] >> LANE_BITS, pool, ids)
    for i in range(n):
        prefetch_pack(leavers[min(i + LEAVERS_AHEAD, n - 1)] >> LANE_BITS, pool, ids)
        first, lanes = leavers[i] >> LANE_BITS, leavers[i] & ((1 << LANE_BITS) - 1)
        to, at = first // PAGE, first % PAGE
        while lanes != 0:
            lane = last_bit(lanes)
            lanes ^= 1 << lane
            k = counters[1]
            counters[1] += 1
            record = moving[k]
            leaver = pool[to, at // LANES, :, lane]
            for d in range(DIM):
                if not abs(leaver[d]) < FARTHEST:
                    return DIVERGED
            column = settle_along(0, leaver, record, box.crossings[species], parts[part, 2], points[1])
            if DIM > 1:
                row = settle_along(1, leaver, record, box.crossings[species], parts[part, 1], points[0])
            if DIM == 3:
                plane = settle_along(2, leaver, record, box.crossings[species], parts[part, 8], points[2])
            for c in range(DIM, COMPONENTS):
                record[c] = leaver[c]
            target_slot, target = destination(row, column, plane, species, grid, box.lists)
            append_to_list(k, target_slot, ids[to, at + lane], target, box.words, box.lists)
            close_up(slot, to, at + lane, pages)
    return GOOD


@called_from_python
def place(x, v, numbers, species, grid, box):
    """Put new particles into the box: x[n, DIM] in cells of the grid, v[n, COMPONENTS - DIM], numbers[n].

    Returns DIVERGED for a position that is not finite.
    """
    points, moving, counters = grid.points, box.moving, box.counters
    for p in range(x.shape[0]):
        for d in range(DIM):
            if not abs(x[p, d]) < FARTHEST:
                return DIVERGED
        column, position_x = settle(x[p, 0], np.int64(0), points[1])
        row = plane = np.int64(0)
        position_y = position_z = REAL(0)
        if DIM > 1:
            row, position_y = settle(x[p, 1], np.int64(0), points[0])
        if DIM == 3:
            plane, position_z = settle(x[p, 2], np.int64(0), points[2])
        slot, target = destination(row, column, plane, species, grid, box.lists)
        k = counters[1]
        counters[1] += 1
        append_to_list(k, slot, numbers[p], target, box.words, box.lists)
        moving[k, 0] = position_x
        if DIM > 1:
            moving[k, 1] = position_y
        if DIM == 3:
            moving[k, 2] = position_z
        for c in range(v.shape[1]):
            moving[k, DIM + c] = v[p, c]
    return GOOD


@inlined
def global_row(tile, layer, record):
    """Row of the grid (1D: column, 3D: plane) of a particle in a tile; `layer` see tiles_of_layer."""
    return np.int64(tile) // layer * TILE + np.int64(record[DIM - 1])


@inlined
def write_record(records, n, record, word):
    """Record n, see pack, of a particle under way."""
    for c in range(COMPONENTS):
        records.real[n, c] = record[c]
    records.whole[n, records.whole.shape[1] - 2] = word[SLOT]
    records.whole[n, records.whole.shape[1] - 1] = word[NUMBER]


@kernel
def pack(records, ends, owner, grid, boxes):
    """Records of all boxes' particles bound for other ranks, rank after rank up to ends[rank]; their lists are empty
    then.

    A record is the components, the global slot and the number; there is room for all. `owner[row]` (1D: column, 3D:
    plane) is the rank.
    """
    moving, words, lists = boxes.moving, boxes.words, boxes.lists
    layer, outside = tiles_of_layer(grid.points), lists.shape[2] - 1
    ends[:] = 0
    for counted in range(2):
        for box in range(lists.shape[0]):
            k = np.int64(lists[box, 0, outside])
            while k >= 0:
                record, word = moving[box, k], words[box, k]
                rank = owner[global_row(word[SLOT] // grid.n_species, layer, record)]
                if counted:
                    write_record(records, ends[rank], record, word)
                ends[rank] += 1
                k = np.int64(word[LINK])
        if not counted:
            start = 0
            for rank in range(ends.size):
                start, ends[rank] = start + ends[rank], start
    lists[:, 0, outside] = -1
    lists[:, 1, outside] = 0


@kernel
def pack_near(records, filled, peer, owner, grid, boxes):
    """Records of the boxes' particles bound for the rank `peer`, as many as there is room for: filled[0].

    The others stay. See pack.
    """
    moving, words, lists = boxes.moving, boxes.words, boxes.lists
    layer, outside, n = tiles_of_layer(grid.points), lists.shape[2] - 1, 0
    for box in range(lists.shape[0]):
        k, kept, n_kept = np.int64(lists[box, 0, outside]), np.int64(-1), 0
        while k >= 0:
            record, word = moving[box, k], words[box, k]
            following = np.int64(word[LINK])
            if owner[global_row(word[SLOT] // grid.n_species, layer, record)] == peer and n < records.real.shape[0]:
                write_record(records, n, record, word)
                n += 1
            else:
                word[LINK] = kept
                kept, n_kept = k, n_kept + 1
            k = following
        lists[box, 0, outside], lists[box, 1, outside] = kept, n_kept
    filled[0] = n


@kernel
def any_left(lists, wants):
    """wants[0] = 1 while particles bound for other ranks are in the boxes, else 0."""
    wants[0] = lists[:, 1, lists.shape[2] - 1].sum() > 0


@kernel
def lacks_pages(slots, lists, counters, short):
    """short[0] = 1 where a block's stack has fewer pages than its arrivals may need, else 0. slots[block]."""
    short[0] = 0
    for block in range(slots.size):
        arrivals = lists[:, 1, block].sum()
        short[0] |= counters[block, 0] < arrivals // PAGE + min(arrivals, slots[block])


@kernel
def empty(slots, count, lists, counters, most):
    """Nothing is in any box. most[0] = particles of the block that has most; slots[block] = its slots."""
    lists[:, 0], lists[:, 1], counters[:, 1] = -1, 0, 0
    most[0] = first = 0
    for n in slots:
        most[0] = max(most[0], count[first : first + n].sum())
        first += n


@kernel
def unpack(records, n, grid, boxes):
    """Put the particles of the first n[0] records into the last box."""
    records_real, records_int, n_species = records.real, records.whole, grid.n_species
    layer, box = tiles_of_layer(grid.points), box_of(boxes.lists.shape[0] - 1, boxes)
    counters = box.counters
    for p in range(n[0]):
        tile, species = divmod(np.int64(records_int[p, records_int.shape[1] - 2]), n_species)
        column, row, plane = tile, np.int64(0), np.int64(0)
        if DIM == 3:
            plane, tile = tile // layer * TILE + np.int64(records_real[p, 2]), tile % layer
        if DIM > 1:
            row = tile // tiles_along(1, grid.points) * TILE + np.int64(records_real[p, 1])
            column = tile % tiles_along(1, grid.points)
        column = column * TILE + np.int64(records_real[p, 0])
        slot, target = destination(row, column, plane, species, grid, box.lists)
        k = counters[1]
        counters[1] += 1
        append_to_list(k, slot, records_int[p, records_int.shape[1] - 1], target, box.words, box.lists)
        for c in range(COMPONENTS):
            box.moving[k, c] = records_real[p, c]


@called_from_python
def export(species, grid, pages, cursor, numbers, tiles, components):
    """The next particles of a species, whole pages of them: numbers[m], tiles[m], components[m, COMPONENTS].

    cursor = (part, page) to go on with, page -1 for the first one; (0, -1) to begin. Returns how many; 0 at the end.
    """
    parts, pool, ids, head, count = grid.parts, pages.pool, pages.ids, pages.head, pages.count
    n, part, page = 0, cursor[0], cursor[1]
    while part < parts.shape[0]:
        slot = part * grid.n_species + species
        if page < 0:
            page = np.int64(head[slot])
        while page >= 0:
            used = (count[slot] - 1) % PAGE + 1 if page == head[slot] else PAGE
            if n + used > numbers.size:
                cursor[0], cursor[1] = part, page
                return n
            for place in range(used):
                numbers[n], tiles[n] = ids[page, place], parts[part, 0]
                for c in range(COMPONENTS):
                    components[n, c] = pool[page, place // LANES, c, place % LANES]
                n += 1
            page = np.int64(pages.chain[page])
        part += 1
    cursor[0], cursor[1] = part, -1
    return n
