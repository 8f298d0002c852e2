"""The push by vectors: same results, bit for bit, as kernels.plain.

Per tile part, the field becomes a line of coefficients per cell, and the charge is added up in a line of sums per cell
(see kernels.cell_lines and the shapes: linear here, in whose place another may stand). A page is gone through in five
short loops: where the lines of the cells are; gather; Boris and drift; where the sums of the cells are; then deposit,
where lanes that left the part count in a cell that has no node. So no load waits for a store just made, and the
processor sees several packs ahead, as it does not in a loop of as many instructions as it holds at a time. Scalar code
takes those who left out after the last page, from a list without branches: a branch on who leaves is a mispredicted
one. Sums of single precision are 32 bits without sign, emptied before they can overflow.
"""

import numpy as np

from hpcpic.core.simd.vector import (
    bitmask,
    fma,
    lane_numbers,
    load_at,
    prefetch,
    prefetch_to_write,
    select,
    splat,
    store_at,
)
from hpcpic.plasma.kernels.cell_lines import opaque, whole_at
from hpcpic.plasma.kernels.lanes import address, bits_of, inlined, kernel
from hpcpic.plasma.kernels.linear import (
    CELLS,
    EDGE,
    LAYER,
    LINE,
    PITCH,
    REACH,
    SUM,
    SUM_BYTES,
    add_charge,
    cell_of,
    field_at,
    gather_sums,
    spread_field,
)
from hpcpic.plasma.kernels.plain import deposit_from, push_slot, take_in
from hpcpic.plasma.kernels.simd_base import (
    HALF_F,
    HALF_I,
    MAGIC_BITS,
    PART,
    ROW,
    SIZE,
    F,
    I,
    planes_of,
    position_at,
    zero_bytes,
)
from hpcpic.plasma.kernels.storage import COMPONENTS, DIVERGED, GOOD, LANES, PAGE, box_of, depart, leaver_mask, pages_of
from hpcpic.plasma.kernels.weights import MAGIC, anchor_in
from hpcpic.plasma.physics.boris import boris

DIM = 2  # axes of the grid
REAL = np.float64  # precision of a particle
ROTATION = 0  # kind of rotation, see physics.boris
VELOCITIES = 2  # components

ALL = (1 << LANES) - 1
PACK_BYTES, PAGE_BYTES = 64 * COMPONENTS, PAGE * SIZE * COMPONENTS
PARKED = MAGIC_BITS + CELLS * SUM
PAGES_AHEAD = 2
EARLY = COMPONENTS // 2  # components that are prefetched with the gather, the others with the deposit
MIN_FOR_VECTORS = 40  # particles: fewer are done one by one, which costs less than to spread or gather all cells
BATCH = 31 if SIZE == 4 else 1 << 60  # pages whose charge the sums of one cell can hold


@kernel
def prefetch_part(part, grid, field, patch):
    """Prefetch the cache lines of field and charge of a part that comes next: they are far where tiles are poor."""
    parts, nodes, e_width, width = grid.parts, patch.nodes, field.e.shape[2] * 8, patch.nodes.shape[2] * 8
    in_field, in_patch = anchor_in(part, grid, field.origin), anchor_in(part, grid, patch.corner)
    low, high = planes_of(part, parts)
    for p in range(low - REACH * (DIM // 3), high + (1 + REACH) * (DIM // 3)):
        row, column = p * in_field[2] + parts[part, 3] - (DIM > 1) * REACH, parts[part, 5] - REACH
        to_e = address(field.e) + (in_field[0] + row) * e_width + (in_field[1] + column) * 8
        to_patch = address(nodes) + (in_patch[0] + row) * width + (in_patch[1] + column) * 8
        for _ in range(parts[part, 4] - parts[part, 3] + (DIM > 1) * (1 + 2 * REACH)):
            for c in range(0, (parts[part, 6] - parts[part, 5]) * 8 + 64, 64):
                for axis in range(DIM):
                    prefetch(to_e + axis * field.e.shape[1] * e_width + c)
                prefetch_to_write(to_patch + c)
            to_e += e_width
            to_patch += width


@inlined
def lines_at(x):
    """Where the lines of the cells at x are, MAGIC_BITS too far."""
    return places_at(x, LINE)


@inlined
def sums_at(x):
    """Where the sums of the cells at x are, MAGIC_BITS too far."""
    return places_at(x, SUM)


@inlined
def places_at(x, size):
    """Where the cells at x have things of so many bytes, MAGIC_BITS too far."""
    cell = fma(cell_of(x[0]), REAL(size), MAGIC)
    if DIM > 1:
        cell = fma(cell_of(x[1]), REAL(PITCH * size), cell)
    if DIM == 3:
        cell = fma(cell_of(x[2]), REAL(LAYER * size), cell)
    return bits_of(cell)


@inlined
def place_in_cell(x):
    """Where the particles of a pack are in their cells, along each axis."""
    return x[0] - cell_of(x[0]), x[1] - cell_of(x[1]), x[2] - cell_of(x[2])


@inlined
def find_lines(at, cells):
    """Store lines_at of a pack to `cells`, and ROW behind that the place in the cell along x."""
    x = position_at(F, at)
    store_at(cells, lines_at(x), 64)
    store_at(cells + ROW, x[0] - cell_of(x[0]), 64)


@inlined
def gather_pack(at, cells, lines):
    """Store E of a pack ROW behind `cells`, component after component; see find_lines."""
    e = field_at(lines, cells, place_in_cell(position_at(F, at)))
    store_at(cells + ROW, e[0], 64)
    if DIM > 1:
        store_at(cells + 2 * ROW, e[1], 64)
    if DIM == 3:
        store_at(cells + 3 * ROW, e[2], 64)


@inlined
def move_pack(at, e, m):
    """Boris and drift of a pack, with what gather_pack stored at `e`."""
    ex = load_at(F, e, 64)
    ey, ez = ex, ex
    vx = load_at(F, at + 64 * DIM, 64)
    vy = vz = splat(F, 0.0)
    if DIM > 1:
        ey = load_at(F, e + ROW, 64)
    if DIM == 3:
        ez = load_at(F, e + 2 * ROW, 64)
    if VELOCITIES > 1:
        vy = load_at(F, at + 64 * (DIM + 1), 64)
    if VELOCITIES > 2:
        vz = load_at(F, at + 64 * (DIM + 2), 64)
    vx, vy, vz = boris(vx, vy, vz, ex, ey, ez, m, DIM, ROTATION)
    store_at(at, load_at(F, at, 64) + vx, 64)
    store_at(at + 64 * DIM, vx, 64)
    if DIM > 1:
        store_at(at + 64, load_at(F, at + 64, 64) + vy, 64)
    if DIM == 3:
        store_at(at + 128, load_at(F, at + 128, 64) + vz, 64)
    if VELOCITIES > 1:
        store_at(at + 64 * (DIM + 1), vy, 64)
    if VELOCITIES > 2:
        store_at(at + 64 * (DIM + 2), vz, 64)


@inlined
def find_sums(at, cells, bounds):
    """Store sums_at of half a pack to `cells`, of lanes that left their part those of a cell without a node.

    Returns the bits of those that stay, x, y and z within `bounds`. Halves, as masks of more lanes than a register of
    AVX2 has are packed and unpacked there.
    """
    x, y, z = position_at(HALF_F, at)
    inside = (x >= bounds[0]) & (x < bounds[1])
    if DIM > 1:
        inside = inside & (y >= bounds[2]) & (y < bounds[3])
    if DIM == 3:
        inside = inside & (z >= bounds[4]) & (z < bounds[5])
    store_at(cells, select(inside, sums_at((x, y, z)), splat(HALF_I, PARKED)), 32)
    return opaque(bitmask(inside))


@inlined
def deposit_pack(at, cells, sums, unit):
    """Charge of one pack to the sums of the cells that find_sums found; unit: see unit_of."""
    add_charge(sums, cells, place_in_cell(position_at(F, at)), unit[0], unit[1])


@kernel
def park(pool, page, used):
    """Fill the last pack's lanes without a particle: at rest behind the last cell, where no field and no node is."""
    for place in range(used, (used + LANES - 1) // LANES * LANES):
        pack, lane = place // LANES, place % LANES
        for c in range(COMPONENTS):
            pool[page, pack, c, lane] = 0
        pool[page, pack, DIM - 1, lane] = EDGE


@inlined
def same(a, b):
    """Two rows of the table of charges are alike."""
    return a[0] == b[0] and a[1] == b[1]


@inlined
def next_page(page, slot, end, heads, chains):
    """The page after `page` in the order of the push, and its slot; -1 after the last one. Addresses of the arrays."""
    if page >= 0:
        page = whole_at(chains, page)
    while page < 0 and slot + 1 < end:
        slot += 1
        page = whole_at(heads, slot)
    return page, slot


@inlined
def unit_of(charge):
    """Parts of a particle, as a pair of vectors of numbers and of whole numbers, and their sign.

    charge = (group, parts with sign).
    """
    sign = 1 if charge[1] > 0 else -1
    return (splat(F, REAL(charge[1] * sign)), splat(I, PART(charge[1] * sign))), sign


@inlined
def push_page(at, ahead, page, packs, lanes, m, bounds, unit, room, leavers, n):
    """Push `packs` packs of the page at an address, and prefetch those of the page `ahead`, in two loops: a processor
    waits where it has asked for too many lines at a time.

    lanes: bits of the last pack's particles; unit: see unit_of; room: addresses of lines, sums and cells. Those who
    leave follow the n that are in `leavers`; returns how many there are then.
    """
    to_lines, to_sums, to_cells = room
    for pack in range(packs):
        find_lines(opaque(at + pack * PACK_BYTES), opaque(to_cells + pack * 64))
    for pack in range(packs):
        asked = opaque(ahead + pack * PACK_BYTES)
        for c in range(EARLY):
            prefetch_to_write(asked + 64 * c)
        gather_pack(opaque(at + pack * PACK_BYTES), opaque(to_cells + pack * 64), to_lines - MAGIC_BITS)
    for pack in range(packs):
        move_pack(opaque(at + pack * PACK_BYTES), opaque(to_cells + pack * 64) + ROW, m)
    for pack in range(packs - 1, -1, -1):
        here, cells = opaque(at + pack * PACK_BYTES), opaque(to_cells + pack * 64)
        stay = find_sums(here, cells, bounds) | find_sums(here + 32, cells + 32, bounds) << LANES // 2
        stay &= lanes
        gone, lanes = lanes ^ stay, ALL
        leavers[np.uint64(n)] = leaver_mask(page, pack, gone)
        n += gone != 0
    for pack in range(packs):
        asked = opaque(ahead + pack * PACK_BYTES + 64 * EARLY)
        for c in range(COMPONENTS - EARLY):
            prefetch_to_write(asked + 64 * c)
        deposit_pack(opaque(at + pack * PACK_BYTES), opaque(to_cells + pack * 64), to_sums - MAGIC_BITS, unit)
    return n


@inlined
def push_pages(slot, end, grid, species, pages, leavers, patch, room, scout, batch):
    """kernels.plain.push_slot for many particles, whose charge is in the sums then.

    room: addresses of lines, sums and cells. scout = (page, slot) runs ahead up to the slot `end`; batch: pages since
    the sums were emptied. Returns n, and scout and batch as they are then.
    """
    pool, charge = pages.pool, species.charge
    heads, chains = address(pages.head), address(pages.chain)
    part, kind = slot // grid.n_species, slot % grid.n_species
    ends, planes = grid.parts[part], planes_of(part, grid.parts)
    bounds = (splat(HALF_F, REAL(ends[5])), splat(HALF_F, REAL(ends[6])), splat(HALF_F, REAL(ends[3])),
              splat(HALF_F, REAL(ends[4])), splat(HALF_F, REAL(planes[0])), splat(HALF_F, REAL(planes[1])))  # fmt: skip
    row = species.mover[kind]
    m = (row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11], row[12],
         row[13], row[14], row[15])  # fmt: skip
    unit, sign = unit_of(charge[kind])
    page, used, n = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1, np.int64(0)
    if page >= 0:
        park(pool, page, used)
    while page >= 0:
        at, ahead = address(pool) + page * PAGE_BYTES, address(pool) + max(scout[0], 0) * PAGE_BYTES
        scout = next_page(scout[0], scout[1], end, heads, chains)
        packs = (used + LANES - 1) // LANES
        n = push_page(at, ahead, page, packs, ALL >> (packs * LANES - used), m, bounds, unit, room, leavers, n)
        batch += 1
        if batch == BATCH:
            gather_sums(part, grid, room[1], patch, charge[kind, 0], sign)
            batch = 0
        page, used = whole_at(chains, page), PAGE
    return n, scout, batch


@kernel
def push(block, first, last, grid, field, species, pages, boxes, leavers, patch, scratch):
    """x^n, v^(n-1/2) -> x^(n+1), v^(n+1/2) (5.18), (5.19); those who stay leave their charge, the others depart."""
    pages, box, leavers = pages_of(block, pages), box_of(block, boxes), leavers[block]
    n_species, charge, head = grid.n_species, species.charge, pages.head
    box.lists[0, :], box.lists[1, :], box.counters[1] = -1, 0, 0
    patch.nodes[:] = 0
    room = (address(scratch.lines[block]), address(scratch.sums[block]), address(scratch.cells[block]))
    zero_bytes(room[1], room[1] + SUM_BYTES)
    end = last * n_species
    scout = (np.int64(-1), first * n_species - 1)  # runs PAGES_AHEAD pages ahead and prefetches their lines
    for _ in range(PAGES_AHEAD + 1):
        scout = next_page(scout[0], scout[1], end, address(head), address(pages.chain))
    for part in range(first, last):
        many, batch = pages.count[part * n_species : (part + 1) * n_species].sum() >= MIN_FOR_VECTORS, np.int64(0)
        if many:
            spread_field(part, grid, field, room[0])
            prefetch_part(min(part + 1, last - 1), grid, field, patch)
        for slot in range(part * n_species, (part + 1) * n_species):
            kind = slot % n_species
            if many:
                n, scout, batch = push_pages(slot, end, grid, species, pages, leavers, patch, room, scout, batch)
            else:
                n = push_slot(slot, grid, field, species, pages, leavers, patch)
                if head[slot] >= 0:
                    scout = next_page(scout[0], scout[1], end, address(head), address(pages.chain))
            if depart(slot, n, leavers, grid, pages, box) != GOOD:
                return DIVERGED
            if many and (kind + 1 == n_species or not same(charge[kind + 1], charge[kind])):
                gather_sums(part, grid, room[1], patch, charge[kind, 0], unit_of(charge[kind])[1])
                batch = 0
    return GOOD


@kernel
def deposit_new(low, slot, grid, species, pages, patch, to_sums, to_cells):
    """kernels.plain.deposit_from for many particles; the sums of the cells are zero before and after."""
    charge, base = species.charge, address(pages.pool)
    part, kind = slot // grid.n_species, slot % grid.n_species
    unit, sign = unit_of(charge[kind])
    page, end, batch = np.int64(pages.head[slot]), pages.count[slot], 0
    while end > low:
        begin = max((end - 1) // PAGE * PAGE, low)
        first, last = begin % PAGE, (end - 1) % PAGE  # in the page
        for pack in range(first // LANES, last // LANES + 1):
            at = base + page * PAGE_BYTES + pack * PACK_BYTES
            number = lane_numbers(I) + PART(pack * LANES)
            new = (number >= PART(first)) & (number <= PART(last))
            store_at(to_cells, select(new, sums_at(position_at(F, at)), splat(I, PARKED)), 64)
            deposit_pack(at, to_cells, to_sums - MAGIC_BITS, unit)
        batch += 1
        if batch == BATCH:
            gather_sums(part, grid, to_sums, patch, charge[kind, 0], sign)
            batch = 0
        page, end = np.int64(pages.chain[page]), begin
    gather_sums(part, grid, to_sums, patch, charge[kind, 0], sign)


@kernel
def deliver(block, first, last, grid, species, pages, boxes, patch, scratch):
    """Take the particles that all boxes have for this block into their slots, with their charge."""
    code = take_in(block, first, last, grid, pages, boxes)
    to_sums, to_cells = address(scratch.sums[block]), address(scratch.cells[block])
    zero_bytes(to_sums, to_sums + SUM_BYTES)
    for slot in range(first * grid.n_species, last * grid.n_species):
        settled = pages.settled[slot]
        if pages.count[slot] - settled >= MIN_FOR_VECTORS:
            deposit_new(settled, slot, grid, species, pages, patch, to_sums, to_cells)
        else:
            deposit_from(settled, slot, grid, species, pages, patch)
    return code
