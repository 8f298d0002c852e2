"""The push of linear shapes (CIC) by vectors: same results, bit for bit, as kernels.plain.

Per tile part, the field becomes a line of coefficients per cell (2D: a, b, c, d of E_x, then of E_y), and the charge
is added up in a line of corner sums per cell. A page is gone through twice, in short loops: gather, Boris and drift;
then deposit, where lanes that left the part count in a cell that has no node. Scalar code takes them out after the
last page, from a list without branches: a branch on who leaves is a mispredicted one.
"""

import numpy as np

from hpcpic.core.simd.jit import njit
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
    prefetch_to_write,
    select,
    splat,
    store_at,
)
from hpcpic.plasma.kernels.lanes import address, bits_of, mask_of, store_lines
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
PAGES_AHEAD = 2
BATCH = 15 if SIZE == 4 else 1 << 60  # pages whose charge the corner sums of one cell can hold


@njit
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


@njit
def coefficients(at, width, scale):
    """a, b, c, d of eight cells whose lower left nodes start at an address: E = a + b f + (c + d f) g."""
    e00, e10 = load_at(E8, at, 8) * scale, load_at(E8, at + 8, 8) * scale
    e01, e11 = load_at(E8, at + width, 8) * scale, load_at(E8, at + width + 8, 8) * scale
    b, c = e10 - e00, e01 - e00
    return convert(R8, e00), convert(R8, b), convert(R8, c), convert(R8, (e11 - e10) - c)


@njit
def zero_sums(sums):
    for c in range(0, (CELLS + 8) * SUM, 64):
        store_at(sums + c, splat(I, 0), 64)


@njit
def add_to(at, share):
    store_at(at, load_at(WIDE, at, 8) + convert(WIDE, share), 8)


@njit
def gather_sums(part, corner, parts, sums, patch, group):
    """Add the corner sums of the part's cells to the nodes of the patch, and zero them."""
    zero_parked(sums)
    row, column = parts[part, 1] - corner[0], parts[part, 2] - corner[1]
    base, width = address(patch) + group * patch.shape[1] * patch.shape[2] * 8, patch.shape[2] * 8
    for r in range(parts[part, 3], parts[part, 4]):
        for c in range(parts[part, 5], parts[part, 6], 8):
            corners = gather_lines(P8, CORNERS, sums + (r * TILE + c) * SUM, lane_numbers(WIDE) * SUM)
            at = base + (row + r) * width + (column + c) * 8
            add_to(at, corners[0])
            add_to(at + 8, corners[1])
            if DIM == 2:
                add_to(at + width, corners[2])
                add_to(at + width + 8, corners[3])
    zero_sums(sums)


@njit
def zero_parked(sums):
    for c in range(CELLS * SUM, (CELLS + 8) * SUM, 64):
        store_at(sums + c, splat(I, 0), 64)


@njit
def push_pack(at, lines, m, low_x, high_x, low_y, high_y):
    """Gather, Boris, drift of one pack; bits of the lanes that stay in their part."""
    x, vx = load_at(F, at, 64), load_at(F, at + 64 * DIM, 64)
    y = vy = vz = splat(F, 0.0)
    if VELOCITIES > 1:
        vy = load_at(F, at + 64 * (DIM + 1), 64)
    if VELOCITIES > 2:
        vz = load_at(F, at + 64 * (DIM + 2), 64)
    i = floor(x)
    f = x - i
    if DIM == 2:
        y = load_at(F, at + 64, 64)
        j = floor(y)
        g = y - j
        u = gather_lines(F, 8, lines, convert(I, fma(j, REAL(TILE), i)) * LINE)
        ex = fma(g, fma(f, u[3], u[2]), fma(f, u[1], u[0]))
        ey = fma(g, fma(f, u[7], u[6]), fma(f, u[5], u[4]))
    else:
        u = gather_lines(F, 2, lines, convert(I, i) * LINE)
        ex = fma(f, u[1], u[0])
        ey = y
    vx, vy, vz = boris(vx, vy, vz, ex, ey, m)
    x = x + vx
    store_at(at, x, 64)
    store_at(at + 64 * DIM, vx, 64)
    inside = (x >= low_x) & (x < high_x)
    if DIM == 2:
        y = y + vy
        store_at(at + 64, y, 64)
        inside = inside & (y >= low_y) & (y < high_y)
    if VELOCITIES > 1:
        store_at(at + 64 * (DIM + 1), vy, 64)
    if VELOCITIES > 2:
        store_at(at + 64 * (DIM + 2), vz, 64)
    return bitmask(inside)


@njit
def deposit_pack(at, sums, unit, biased_unit, stay):
    """Charge of one pack's lanes that stay to the corner sums, the others' to a cell that has no node.

    biased_unit = unit + MAGIC_BITS saves the subtraction of the bias.
    """
    x = load_at(F, at, 64)
    i = floor(x)
    f = x - i
    along = bits_of(fma(f, unit, MAGIC))
    inside = mask_of(stay, x)
    if DIM == 2:
        y = load_at(F, at + 64, 64)
        j = floor(y)
        g = y - j
        across, both = bits_of(fma(g, unit, MAGIC)), bits_of(fma(f, g * unit, MAGIC))
        corners = ((biased_unit - along) - (across - both), along - both, across - both, both - MAGIC_BITS)
        cell = select(inside, fma(j, REAL(TILE), i), splat(F, REAL(CELLS)))
        add_lines(sums, convert(I, cell) * SUM, corners)
    else:
        cell = select(inside, i, splat(F, REAL(CELLS)))
        add_lines(sums, convert(I, cell) * SUM, (biased_unit - along, along - MAGIC_BITS))


@njit
def park(pool, page, used):
    """The last pack's lanes without a particle: at rest behind the last cell, where is no field and no node."""
    for place in range(used, (used + LANES - 1) // LANES * LANES):
        pack, lane = place // LANES, place % LANES
        for c in range(COMPONENTS):
            pool[page, pack, c, lane] = 0
        pool[page, pack, DIM - 1, lane] = TILE


@njit
def next_page(page, slot, end, head, chain):
    """The page after `page` in the order of the push, and its slot; -1 after the last one."""
    page = np.int64(chain[page]) if page >= 0 else page
    while page < 0 and slot + 1 < end:
        slot += 1
        page = np.int64(head[slot])
    return page, slot


@njit
def push(block, first, last, n_species, points, origin, corner, row_part, column_part, column_stride, parts, e_x, e_y,
         scale, mover, charge, pool, ids, chain, head, count, free, holes, moving, moving_id, moving_slot, link, lists,
         counters, patch, lines, sums):  # fmt: skip
    """x^n, v^(n-1/2) -> x^(n+1), v^(n+1/2) (5.18), (5.19); those who stay leave their charge, the others depart."""
    free, holes, moving, moving_id = free[block], holes[block], moving[block], moving_id[block]
    moving_slot, link, lists, counters = moving_slot[block], link[block], lists[block], counters[block]
    lists[0, :] = -1
    lists[1, :] = 0
    counters[1] = 0
    patch[:] = 0
    base, to_lines, to_sums = address(pool), address(lines), address(sums)
    stays = np.empty(PAGE // LANES, np.int64)  # by pack of a page, bits of the lanes that stay
    zero_sums(to_sums)
    scout, scout_slot = np.int64(-1), first * n_species - 1  # runs PAGES_AHEAD pages ahead and asks for their lines
    for _ in range(PAGES_AHEAD + 1):
        scout, scout_slot = next_page(scout, scout_slot, last * n_species, head, chain)
    for part in range(first, last):
        spread_field(part, origin, parts, e_x, e_y, scale, to_lines)
        low_x, high_x = splat(F, REAL(parts[part, 5])), splat(F, REAL(parts[part, 6]))
        low_y, high_y = splat(F, REAL(parts[part, 3])), splat(F, REAL(parts[part, 4]))
        batch = 0
        for slot in range(part * n_species, (part + 1) * n_species):
            species = slot % n_species
            row = mover[species]
            m = (row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9])
            unit = splat(F, REAL(charge[species, 1]))
            biased_unit = splat(I, PART(charge[species, 1] + MAGIC_BITS))
            page, used, n_holes = np.int64(head[slot]), (count[slot] - 1) % PAGE + 1, 0
            if page >= 0:
                park(pool, page, used)
            while page >= 0:
                at, packs = base + page * PAGE_BYTES, (used + LANES - 1) // LANES
                ahead = base + max(scout, 0) * PAGE_BYTES
                scout, scout_slot = next_page(scout, scout_slot, last * n_species, head, chain)
                lanes = ALL >> (packs * LANES - used)  # that hold a particle
                for pack in range(packs - 1, -1, -1):
                    for c in range(COMPONENTS):
                        prefetch_to_write(ahead + pack * PACK_BYTES + 64 * c)
                    stays[pack] = push_pack(at + pack * PACK_BYTES, to_lines, m, low_x, high_x, low_y, high_y) & lanes
                    gone, lanes = lanes ^ stays[pack], ALL
                    holes[n_holes] = hole(page, pack, gone)
                    n_holes += gone != 0
                for pack in range(packs):
                    deposit_pack(at + pack * PACK_BYTES, to_sums, unit, biased_unit, stays[pack])
                batch += 1
                if batch == BATCH:
                    gather_sums(part, corner, parts, to_sums, patch, charge[species, 0])
                    batch = 0
                page, used = np.int64(chain[page]), PAGE
            if depart(slot, n_holes, holes, n_species, points, row_part, column_part, column_stride, parts, pool, ids,
                      chain, head, count, free, moving, moving_id, moving_slot, link, lists,
                      counters) != GOOD:  # fmt: skip
                return DIVERGED
            if species + 1 == n_species or charge[species + 1, 0] != charge[species, 0]:
                gather_sums(part, corner, parts, to_sums, patch, charge[species, 0])
                batch = 0
    return GOOD
