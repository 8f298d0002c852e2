"""The push of linear shapes (CIC) by vectors: same results, bit for bit, as kernels.plain.

Per tile part, the field becomes a line of coefficients per cell (2D: a, b, c, d of E_x, then of E_y), and the charge
is added up in a line of sums per cell: of parts, times f, times g, times f g (f, g: place in the cell), from which the
corners' charge follows. A page is gone through in three short loops: where the lines of the cells are; gather, Boris
and drift; then deposit, where lanes that left the part count in a cell that has no node. So no load waits for a store
just made. Scalar code takes those who left out after the last page, from a list without branches: a branch on who
leaves is a mispredicted one. Sums of single precision are 32 bits without sign, emptied before they can overflow.
"""

import numpy as np

from hpcpic.core.simd.vector import (
    Vec,
    add_lines,
    bitmask,
    convert,
    floor,
    fma,
    gather_lines,
    lane_numbers,
    load_at,
    prefetch,
    prefetch_to_write,
    select,
    splat,
    store_at,
    store_lines,
)
from hpcpic.plasma.kernels.cells import add_last, add_sums, gather_field, load_sums, opaque, shifted_up, whole_at
from hpcpic.plasma.kernels.lanes import address, bits_of, inlined, kernel
from hpcpic.plasma.kernels.pages import COMPONENTS, DIVERGED, GOOD, LANES, PAGE, TILE, depart, hole
from hpcpic.plasma.kernels.plain import MAGIC, boris

DIM = 2  # axes of the grid
REAL = np.float64  # precision of a particle
VELOCITIES = 2  # components

SIZE = np.dtype(REAL).itemsize
PART = np.int64 if SIZE == 8 else np.int32  # of the corner sums of a cell
F, I, WIDE = Vec(LANES, REAL), Vec(LANES, PART), Vec(8, np.int64)
E8, R8, P8 = Vec(8, np.float64), Vec(8, REAL), Vec(8, PART)
CORNERS = 4 if DIM == 2 else 2
CELLS = 256
ALL = (1 << LANES) - 1
LINE, SUM = 2 * CORNERS * SIZE // (3 - DIM), CORNERS * SIZE  # bytes of a cell's coefficients and corner sums
PACK_BYTES, PAGE_BYTES = 64 * COMPONENTS, PAGE * SIZE * COMPONENTS
MAGIC_BITS = int(np.array(MAGIC).view(PART))
PARKED = MAGIC_BITS + CELLS * SUM
PAGES_AHEAD = 2
UNSIGNED = 2**32 - 1 if SIZE == 4 else -1  # bits of a sum
BATCH = 31 if SIZE == 4 else 1 << 60  # pages whose charge the sums of one cell can hold


@kernel
def spread_field(part, origin, parts, e_x, e_y, scale, lines):
    """Coefficients of the cells of a tile part, and zero ones for parked lanes behind them."""
    row, column = parts[part, 1] - origin[0], parts[part, 2] - origin[1]
    width = e_x.shape[1] * 8
    for r in range(parts[part, 3], parts[part, 4]):
        for c in range(parts[part, 5], parts[part, 6], 8):
            at = (row + r) * width + (column + c) * 8
            to = lines + (r * TILE + c) * LINE
            if DIM == 1:
                left = load_at(E8, address(e_x) + at, 8) * scale
                right = load_at(E8, address(e_x) + at + 8, 8) * scale
                store_lines(to, (convert(R8, left), convert(R8, right - left)))
            else:
                store_lines(to, (*coefficients(address(e_x) + at, width, scale),
                                 *coefficients(address(e_y) + at, width, scale)))  # fmt: skip
    for c in range(CELLS * LINE, (CELLS + 8) * LINE, 64):
        store_at(lines + c, splat(F, 0.0), 64)


@kernel
def coefficients(at, width, scale):
    """a, b, c, d of eight cells whose lower left nodes start at an address: E = a + b f + (c + d f) g."""
    e00, e10 = load_at(E8, at, 8) * scale, load_at(E8, at + 8, 8) * scale
    e01, e11 = load_at(E8, at + width, 8) * scale, load_at(E8, at + width + 8, 8) * scale
    b, c = e10 - e00, e01 - e00
    return convert(R8, e00), convert(R8, b), convert(R8, c), convert(R8, (e11 - e10) - c)


@kernel
def look_ahead(part, origin, corner, parts, e_x, e_y, patch):
    """Ask for the lines of field and charge of a part that comes next: it finds them far away where tiles are poor."""
    row, column = parts[part, 1] + parts[part, 3], parts[part, 2] + parts[part, 5]
    e_width, width = e_x.shape[1] * 8, patch.shape[2] * 8
    to_e = (row - origin[0]) * e_width + (column - origin[1]) * 8
    to_patch = address(patch) + (row - corner[0]) * width + (column - corner[1]) * 8
    for _ in range(parts[part, 4] - parts[part, 3] + DIM - 1):
        for c in range(0, (parts[part, 6] - parts[part, 5]) * 8 + 64, 64):
            prefetch(address(e_x) + to_e + c)
            if DIM == 2:
                prefetch(address(e_y) + to_e + c)
            prefetch_to_write(to_patch + c)
        to_e += e_width
        to_patch += width


@kernel
def zero_sums(sums):
    for c in range(0, (CELLS + 8) * SUM, 64):
        store_at(sums + c, splat(I, 0), 64)


@inlined
def corners_of(at):
    """Charge at the corners of eight cells from their sums, which are zeroed."""
    if DIM == 1:
        whole, along = gather_lines(P8, 2, at, lane_numbers(WIDE) * SUM)
        across = both = splat(P8, 0)
    else:
        whole, along, across, both = load_sums(P8, at)
    for c in range(CORNERS):
        store_at(at + 8 * SIZE * c, splat(P8, 0), SUM)
    whole, along = convert(WIDE, whole) & UNSIGNED, convert(WIDE, along) & UNSIGNED
    across, both = convert(WIDE, across) & UNSIGNED, convert(WIDE, both) & UNSIGNED
    return (whole - along) - (across - both), along - both, across - both, both


@inlined
def add_nodes(at, left, right):
    """Add to nine nodes what eight cells between them have for the left and for the right one."""
    store_at(at, load_at(WIDE, at, 8) + left + shifted_up(right), 8)
    add_last(at + 64, right)


@kernel
def gather_sums(part, corner, parts, sums, patch, group, sign):
    """Add the corner sums of the part's cells, times sign, to the nodes of the patch, and zero them."""
    zero_parked(sums)
    row, column = parts[part, 1] - corner[0] + parts[part, 3], parts[part, 2] - corner[1]
    base, width = address(patch) + group * patch.shape[1] * patch.shape[2] * 8, patch.shape[2] * 8
    zero = splat(WIDE, 0)
    for c in range(parts[part, 5], parts[part, 6], 8):
        at, left, right = base + row * width + (column + c) * 8, zero, zero  # of the cells in the row below
        for r in range(parts[part, 3], parts[part, 4]):
            corners = corners_of(sums + (r * TILE + c) * SUM)
            add_nodes(at, (left + corners[0]) * sign, (right + corners[1]) * sign)
            left, right = corners[2], corners[3]
            at += width
        if DIM == 2:
            add_nodes(at, left * sign, right * sign)


@kernel
def zero_parked(sums):
    for c in range(CELLS * SUM, (CELLS + 8) * SUM, 64):
        store_at(sums + c, splat(I, 0), 64)


@inlined
def find_cells(at, cells):
    """Where the lines of one pack's cells are, MAGIC_BITS too far."""
    i = floor(load_at(F, at, 64))
    if DIM == 2:
        store_at(cells, bits_of(fma(floor(load_at(F, at + 64, 64)), REAL(TILE * LINE), fma(i, REAL(LINE), MAGIC))), 64)
    else:
        store_at(cells, bits_of(fma(i, REAL(LINE), MAGIC)), 64)


@inlined
def push_pack(at, cells, lines, m, low_x, high_x, low_y, high_y):
    """Gather, Boris, drift of one pack; bits of the lanes that stay in their part.

    `cells` where find_cells wrote; the cells for the deposit take their place, of lanes that leave one without a node.
    """
    x, vx = load_at(F, at, 64), load_at(F, at + 64 * DIM, 64)
    y = vy = vz = splat(F, 0.0)
    if VELOCITIES > 1:
        vy = load_at(F, at + 64 * (DIM + 1), 64)
    if VELOCITIES > 2:
        vz = load_at(F, at + 64 * (DIM + 2), 64)
    f = x - floor(x)
    if DIM == 2:
        y = load_at(F, at + 64, 64)
        g = y - floor(y)
        u = gather_field(F, lines, cells)
        ex = fma(g, fma(f, u[3], u[2]), fma(f, u[1], u[0]))
        ey = fma(g, fma(f, u[7], u[6]), fma(f, u[5], u[4]))
    else:
        u = gather_lines(F, 2, lines, load_at(I, cells, 64))
        ex = fma(f, u[1], u[0])
        ey = y
    vx, vy, vz = boris(vx, vy, vz, ex, ey, m)
    x = x + vx
    store_at(at, x, 64)
    store_at(at + 64 * DIM, vx, 64)
    inside = (x >= low_x) & (x < high_x)
    cell = fma(floor(x), REAL(SUM), MAGIC)
    if DIM == 2:
        y = y + vy
        store_at(at + 64, y, 64)
        inside = inside & (y >= low_y) & (y < high_y)
        cell = fma(floor(y), REAL(TILE * SUM), cell)
    if VELOCITIES > 1:
        store_at(at + 64 * (DIM + 1), vy, 64)
    if VELOCITIES > 2:
        store_at(at + 64 * (DIM + 2), vz, 64)
    store_at(cells, select(inside, bits_of(cell), splat(I, PARKED)), 64)
    return bitmask(inside)


@inlined
def deposit_pack(at, cells, sums, unit, whole):
    """Charge of one pack to the sums of the cells that push_pack found: of parts, times f, times g, times f g."""
    x = load_at(F, at, 64)
    f = x - floor(x)
    along = bits_of(fma(f, unit, MAGIC)) - MAGIC_BITS
    if DIM == 2:
        y = load_at(F, at + 64, 64)
        g = y - floor(y)
        across, both = bits_of(fma(g, unit, MAGIC)), bits_of(fma(f, g * unit, MAGIC))
        add_sums(sums, cells, (whole, along, across - MAGIC_BITS, both - MAGIC_BITS))
    else:
        add_lines(sums, load_at(I, cells, 64), (whole, along))


@kernel
def park(pool, page, used):
    """The last pack's lanes without a particle: at rest behind the last cell, where is no field and no node."""
    for place in range(used, (used + LANES - 1) // LANES * LANES):
        pack, lane = place // LANES, place % LANES
        for c in range(COMPONENTS):
            pool[page, pack, c, lane] = 0
        pool[page, pack, DIM - 1, lane] = TILE


@inlined
def same(a, b):
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


@kernel
def push(block, first, last, n_species, points, origin, corner, row_part, column_part, column_stride, parts, e_x, e_y,
         scale, mover, charge, pool, ids, chain, head, count, free, holes, moving, words, lists,
         counters, patch, lines, sums, cells):  # fmt: skip
    """x^n, v^(n-1/2) -> x^(n+1), v^(n+1/2) (5.18), (5.19); those who stay leave their charge, the others depart."""
    free, holes, moving, words = free[block], holes[block], moving[block], words[block]
    lists, counters = lists[block], counters[block]
    lists[0, :] = -1
    lists[1, :] = 0
    counters[1] = 0
    patch[:] = 0
    base, to_lines, to_sums = address(pool), address(lines), address(sums)
    heads, chains = address(head), address(chain)
    to_cells, lines_of, sums_of = address(cells), to_lines - MAGIC_BITS, to_sums - MAGIC_BITS
    zero_sums(to_sums)
    scout, scout_slot = np.int64(-1), first * n_species - 1  # runs PAGES_AHEAD pages ahead and asks for their lines
    for _ in range(PAGES_AHEAD + 1):
        scout, scout_slot = next_page(scout, scout_slot, last * n_species, heads, chains)
    for part in range(first, last):
        spread_field(part, origin, parts, e_x, e_y, scale, to_lines)
        look_ahead(min(part + 1, last - 1), origin, corner, parts, e_x, e_y, patch)
        low_x, high_x = splat(F, REAL(parts[part, 5])), splat(F, REAL(parts[part, 6]))
        low_y, high_y = splat(F, REAL(parts[part, 3])), splat(F, REAL(parts[part, 4]))
        batch = 0
        for slot in range(part * n_species, (part + 1) * n_species):
            species = slot % n_species
            row = mover[species]
            m = (row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9])
            sign = 1 if charge[species, 1] > 0 else -1
            unit, whole = splat(F, REAL(charge[species, 1] * sign)), splat(I, PART(charge[species, 1] * sign))
            page, used, n_holes = np.int64(head[slot]), (count[slot] - 1) % PAGE + 1, 0
            if page >= 0:
                park(pool, page, used)
            while page >= 0:
                at, packs = base + page * PAGE_BYTES, (used + LANES - 1) // LANES
                ahead = base + max(scout, 0) * PAGE_BYTES
                scout, scout_slot = next_page(scout, scout_slot, last * n_species, heads, chains)
                lanes = ALL >> (packs * LANES - used)  # that hold a particle
                for pack in range(packs):
                    find_cells(opaque(at + pack * PACK_BYTES), opaque(to_cells + pack * 64))
                for pack in range(packs - 1, -1, -1):
                    asked = opaque(ahead + pack * PACK_BYTES)
                    for c in range(COMPONENTS):
                        prefetch_to_write(asked + 64 * c)
                    stay = push_pack(opaque(at + pack * PACK_BYTES), opaque(to_cells + pack * 64), lines_of, m,
                                     low_x, high_x, low_y, high_y) & lanes  # fmt: skip
                    gone, lanes = lanes ^ stay, ALL
                    holes[np.uint64(n_holes)] = hole(page, pack, gone)
                    n_holes += gone != 0
                for pack in range(packs):
                    deposit_pack(opaque(at + pack * PACK_BYTES), opaque(to_cells + pack * 64), sums_of, unit, whole)
                batch += 1
                if batch == BATCH:
                    gather_sums(part, corner, parts, to_sums, patch, charge[species, 0], sign)
                    batch = 0
                page, used = whole_at(chains, page), PAGE
            if depart(slot, n_holes, holes, n_species, points, row_part, column_part, column_stride, parts, pool, ids,
                      chain, head, count, free, moving, words, lists, counters) != GOOD:  # fmt: skip
                return DIVERGED
            if species + 1 == n_species or not same(charge[species + 1], charge[species]):
                gather_sums(part, corner, parts, to_sums, patch, charge[species, 0], sign)
                batch = 0
    return GOOD
