"""The particle kernels of one block, one particle after the other: the reference, for every shape and dimension.

Every kernel works on the tile parts `parts[first:last]` = (tile, anchor row, anchor column, rows from and to,
columns from and to relative to the anchor, block), and takes its arrays in groups (see kernels.groups). Fields carry
the ghosts the shape needs; `scale` is a power of two that brings them to numbers near one. Charge goes to the block's
patch in integer parts of a particle. In 1D there is one row.
"""

import numpy as np

from hpcpic.core.simd.vector import fma, prefetch
from hpcpic.plasma.kernels.lanes import address, inlined, kernel
from hpcpic.plasma.kernels.storage import (
    COMPONENTS,
    DIVERGED,
    GOOD,
    LANES,
    LINK,
    NO_PAGE,
    NUMBER,
    PAGE,
    RECORD_BYTES,
    SLOT,
    append,
    box_of,
    depart,
    leaver_mask,
    pages_of,
    prefetch_pack,
)
from hpcpic.plasma.physics.boris import boris

DIM = 2  # axes of the grid
NODES = 2  # of the shape along an axis: 1 NGP, 2 CIC, 3 TSC
VELOCITIES = 2  # components
ROTATION = 0  # 0 no magnetic field, 1 along z, 2 any direction
REAL = np.float64  # precision of a particle

AHEAD = 16  # particles
ZERO, HALF, ONE = REAL(0), REAL(0.5), REAL(1)
MAGIC = REAL(1.5 * 2.0 ** np.finfo(REAL).nmant)  # adding it rounds to a whole number


@inlined
def cell_and_place(x):
    """The cell of x and the place in it, from 0 to 1 (CIC); else the nearest node, and from -1/2 to 1/2."""
    cell = np.floor(x) if NODES == 2 else np.floor(x + HALF)
    return np.int64(cell), x - cell


@inlined
def tsc_outer_weights(d):
    """Weights of the nodes before and after the nearest one of TSC, at d from it."""
    before, after = HALF - d, HALF + d
    return HALF * (before * before), HALF * (after * after)


@inlined
def parabola(before, here, after):
    """Coefficients of 1, d, d^2 of what TSC makes of the values on three nodes."""
    both = before + after
    return fma(both, 0.125, here * 0.75), (after - before) * 0.5, fma(both, 0.5, -here)


@inlined
def along_row_of(e, row, i, scale):
    """Coefficients (see parabola) about node i of a row."""
    return parabola(e[row, i - 1] * scale, e[row, i] * scale, e[row, i + 1] * scale)


@inlined
def quadratic(k, d):
    """k[0] + k[1] d + k[2] d^2."""
    return fma(d, fma(d, REAL(k[2]), REAL(k[1])), REAL(k[0]))


@inlined
def gather(e, row, column, x, y, scale):
    """E at the particle (5.14); (row, column) of the tile's anchor in e. CIC in the form a + b f + (c + d f) g."""
    i, f = cell_and_place(x)
    i += column
    if DIM == 1 and NODES == 1:
        return REAL(e[row, i] * scale)
    if DIM == 1 and NODES == 2:
        left, right = e[row, i] * scale, e[row, i + 1] * scale
        return fma(f, REAL(right - left), REAL(left))
    if DIM == 1:
        return quadratic(along_row_of(e, row, i, scale), f)
    j, g = cell_and_place(y)
    j += row
    if NODES == 1:
        return REAL(e[j, i] * scale)
    if NODES == 2:
        e00, e10, e01, e11 = e[j, i] * scale, e[j, i + 1] * scale, e[j + 1, i] * scale, e[j + 1, i + 1] * scale
        a, b, c, d = REAL(e00), REAL(e10 - e00), REAL(e01 - e00), REAL((e11 - e10) - (e01 - e00))
        return fma(g, fma(f, d, c), fma(f, b, a))
    low, mid, high = (along_row_of(e, j - 1, i, scale), along_row_of(e, j, i, scale), along_row_of(e, j + 1, i, scale))
    a, b, c = parabola(low[0], mid[0], high[0]), parabola(low[1], mid[1], high[1]), parabola(low[2], mid[2], high[2])
    line = quadratic((a[2], b[2], c[2]), f)
    line = fma(g, line, quadratic((a[1], b[1], c[1]), f))
    return fma(g, line, quadratic((a[0], b[0], c[0]), f))


@inlined
def parts_of(a, b):
    """The product of a share and a number of parts, as a whole number."""
    return np.int64(fma(a, b, MAGIC) - MAGIC)


@inlined
def deposit(patch, group, unit, row, column, x, y):
    """Charge of one particle (5.1), `unit` parts in all, exactly; (row, column) of the tile's anchor in the patch."""
    whole = REAL(unit)
    i, f = cell_and_place(x)
    j, g = (np.int64(0), ZERO) if DIM == 1 else cell_and_place(y)
    i, j = i + column, j + row
    if NODES == 1:
        patch[group, j, i] += unit
    elif NODES == 2:
        along = parts_of(f, whole)
        if DIM == 1:
            patch[group, j, i] += unit - along
            patch[group, j, i + 1] += along
        else:
            across, both = parts_of(g, whole), parts_of(f, g * whole)
            patch[group, j, i] += unit - along - across + both
            patch[group, j, i + 1] += along - both
            patch[group, j + 1, i] += across - both
            patch[group, j + 1, i + 1] += both
    else:
        deposit_nine(patch[group], unit, j, i, f, g)


@inlined
def deposit_nine(nodes, unit, j, i, f, g):
    """Charge of one particle by TSC about node (j, i): what the node and those in line with it get are differences."""
    whole = REAL(unit)
    u = tsc_outer_weights(f)
    left, right = parts_of(u[0], whole), parts_of(u[1], whole)
    if DIM == 2:
        for w, step in zip(tsc_outer_weights(g), (-1, 1)):
            share = w * whole
            row, at_left, at_right = parts_of(share, ONE), parts_of(u[0], share), parts_of(u[1], share)
            nodes[j + step, i - 1] += at_left
            nodes[j + step, i] += row - at_left - at_right
            nodes[j + step, i + 1] += at_right
            unit, left, right = unit - row, left - at_left, right - at_right
    nodes[j, i - 1] += left
    nodes[j, i] += unit - left - right
    nodes[j, i + 1] += right


@inlined
def particle_at(pool, page, pack, lane):
    """Position and velocity of a particle; zero along axes that the scene does not have."""
    y, vy, vz = ZERO, ZERO, ZERO
    if DIM == 2:
        y = pool[page, pack, 1, lane]
    if VELOCITIES > 1:
        vy = pool[page, pack, DIM + 1, lane]
    if VELOCITIES > 2:
        vz = pool[page, pack, DIM + 2, lane]
    return pool[page, pack, 0, lane], y, pool[page, pack, DIM, lane], vy, vz


@inlined
def accelerated(x, y, vx, vy, vz, row, column, field, m):
    """The velocity of a particle after a step (5.19); (row, column) of the tile's anchor in the field."""
    ey = gather(field.e_y, row, column, x, y, field.scale) if DIM == 2 else ZERO
    return boris(vx, vy, vz, gather(field.e_x, row, column, x, y, field.scale), ey, m, DIM, ROTATION)


@inlined
def set_velocity(pool, page, pack, lane, vx, vy, vz):
    """Store as many components as the scene has."""
    pool[page, pack, DIM, lane] = vx
    if VELOCITIES > 1:
        pool[page, pack, DIM + 1, lane] = vy
    if VELOCITIES > 2:
        pool[page, pack, DIM + 2, lane] = vz


@kernel
def push_slot(slot, grid, field, species, pages, leavers, patch):
    """Push the particles of a slot; those who stay leave their charge, the others are in leavers[:n]. Returns n."""
    parts, pool, origin, corner = grid.parts, pages.pool, field.origin, patch.corner
    part, kind = slot // grid.n_species, slot % grid.n_species
    row, column = parts[part, 1], parts[part, 2]
    m, group, unit = species.mover[kind], species.charge[kind, 0], species.charge[kind, 1]
    page, used, n = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1, 0
    while page >= 0:
        for place in range(used - 1, -1, -1):
            pack, lane = place // LANES, place % LANES
            x, y, vx, vy, vz = particle_at(pool, page, pack, lane)
            vx, vy, vz = accelerated(x, y, vx, vy, vz, row - origin[0], column - origin[1], field, m)
            set_velocity(pool, page, pack, lane, vx, vy, vz)
            x += vx
            pool[page, pack, 0, lane] = x
            inside = x >= parts[part, 5] and x < parts[part, 6]
            if DIM == 2:
                y += vy
                pool[page, pack, 1, lane] = y
                inside = inside and y >= parts[part, 3] and y < parts[part, 4]
            if inside:
                deposit(patch.nodes, group, unit, row - corner[0], column - corner[1], x, y)
            else:
                leavers[n] = leaver_mask(page, pack, 1 << lane)
                n += 1
        page, used = np.int64(pages.chain[page]), PAGE
    return n


@kernel
def push(block, first, last, grid, field, species, pages, boxes, leavers, patch):
    """x^n, v^(n-1/2) -> x^(n+1), v^(n+1/2) (5.18), (5.19); those who stay leave their charge, the others depart."""
    pages, box, leavers = pages_of(block, pages), box_of(block, boxes), leavers[block]
    box.lists[0, :] = -1
    box.lists[1, :] = 0
    box.counters[1] = 0
    patch.nodes[:] = 0
    for slot in range(first * grid.n_species, last * grid.n_species):
        n = push_slot(slot, grid, field, species, pages, leavers, patch)
        if depart(slot, n, leavers, grid, pages, box) != GOOD:
            return DIVERGED
    return GOOD


@kernel
def take_in(block, first, last, grid, pages, boxes):
    """The particles that all boxes have for this block go into their slots, after the settled[slot] that are there."""
    mine, pool, ids, head, count = pages_of(block, pages), pages.pool, pages.ids, pages.head, pages.count
    lists = boxes.lists
    for slot in range(first * grid.n_species, last * grid.n_species):
        pages.settled[slot] = count[slot]
        if head[slot] >= 0:
            prefetch_pack(head[slot] * PAGE + count[slot] % PAGE // LANES * LANES, pool, ids)
    for box in range(lists.shape[0]):
        records, record_words = boxes.moving[box], boxes.words[box]
        k = np.int64(lists[box, 0, block])
        while k >= 0:
            prefetch(address(records) + (k - AHEAD) * RECORD_BYTES)  # lists mostly go on by the particle before
            word = record_words[k]
            page, place = append(np.int64(word[SLOT]), mine)
            if page < 0:
                return NO_PAGE
            pack, lane = place // LANES, place % LANES
            for c in range(COMPONENTS):
                pool[page, pack, c, lane] = records[k, c]
            ids[page, place] = np.uint32(word[NUMBER])
            if lane == 0:
                prefetch_pack(page * PAGE + (place + LANES) % PAGE, pool, ids)
            k = np.int64(word[LINK])
    return GOOD


@kernel
def deposit_from(low, slot, grid, species, pages, patch):
    """The charge (5.1) of a slot's particles from number `low` on."""
    pool, corner, nodes = pages.pool, patch.corner, patch.nodes
    part, kind = slot // grid.n_species, slot % grid.n_species
    row, column = grid.parts[part, 1] - corner[0], grid.parts[part, 2] - corner[1]
    group, unit = species.charge[kind, 0], species.charge[kind, 1]
    page, end = np.int64(pages.head[slot]), pages.count[slot]
    while end > low:
        begin = max((end - 1) // PAGE * PAGE, low)
        for number in range(begin, end):
            pack, lane = number % PAGE // LANES, number % LANES
            deposit(nodes, group, unit, row, column, pool[page, pack, 0, lane], pool[page, pack, DIM - 1, lane])
        page, end = np.int64(pages.chain[page]), begin


@kernel
def deliver(block, first, last, grid, species, pages, boxes, patch):
    """Take the particles that all boxes have for this block into their slots, with their charge."""
    code = take_in(block, first, last, grid, pages, boxes)
    for slot in range(first * grid.n_species, last * grid.n_species):
        deposit_from(pages.settled[slot], slot, grid, species, pages, patch)
    return code


@kernel
def rewind(first, last, grid, field, species, pages):
    """v^0 -> v^(-1/2): the velocity alone, with a mover of half a step backwards (9.2.1)."""
    n_species, parts, origin, pool = grid.n_species, grid.parts, field.origin, pages.pool
    for part in range(first, last):
        row, column = parts[part, 1] - origin[0], parts[part, 2] - origin[1]
        for slot in range(part * n_species, (part + 1) * n_species):
            m = species.mover[slot % n_species]
            page, used = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1
            while page >= 0:
                for place in range(used):
                    pack, lane = place // LANES, place % LANES
                    x, y, vx, vy, vz = particle_at(pool, page, pack, lane)
                    vx, vy, vz = accelerated(x, y, vx, vy, vz, row, column, field, m)
                    set_velocity(pool, page, pack, lane, vx, vy, vz)
                page, used = np.int64(pages.chain[page]), PAGE
    return GOOD


@kernel
def deposit_all(first, last, grid, species, pages, patch):
    """The charge (5.1) of all particles of a block."""
    patch.nodes[:] = 0
    for slot in range(first * grid.n_species, last * grid.n_species):
        deposit_from(np.int64(0), slot, grid, species, pages, patch)
    return GOOD
