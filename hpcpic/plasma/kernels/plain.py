"""The particle kernels of one block, one particle after the other: the reference, for every shape and dimension.

Every kernel works on the tile parts `parts[first:last]` = (tile, anchor row, anchor column, rows from and to,
columns from and to relative to the anchor, block; in 3D anchor plane, planes from and to), and takes its arrays in
groups (see kernels.groups). Fields carry the ghosts the shape needs; `scale` is a power of two that brings them to
numbers near one. Charge goes to the block's patch in integer parts of a particle. In 1D there is one row; in 3D the
rows of a plane follow those of the one below it.
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
def nine_about(e, row, i, scale):
    """Coefficients (see parabola) of g^b f^a about node i of a row, those of f first."""
    low, mid, high = along_row_of(e, row - 1, i, scale), along_row_of(e, row, i, scale), along_row_of(e, row + 1, i, scale)
    a, b, c = parabola(low[0], mid[0], high[0]), parabola(low[1], mid[1], high[1]), parabola(low[2], mid[2], high[2])
    return a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2]


@inlined
def biquadratic(k, f, g):
    """The sum of coefficients (see nine_about) times f^a g^b."""
    line = quadratic((k[6], k[7], k[8]), f)
    line = fma(g, line, quadratic((k[3], k[4], k[5]), f))
    return fma(g, line, quadratic((k[0], k[1], k[2]), f))


@inlined
def four_about(e, row, i, scale):
    """a, b, c, d of a cell whose lower left node is i of a row: E = a + b f + (c + d f) g."""
    e00, e10, e01, e11 = e[row, i] * scale, e[row, i + 1] * scale, e[row + 1, i] * scale, e[row + 1, i + 1] * scale
    b, c = e10 - e00, e01 - e00
    return e00, b, c, (e11 - e10) - c


@inlined
def bilinear(k, f, g):
    """a + b f + (c + d f) g."""
    return fma(g, fma(f, REAL(k[3]), REAL(k[2])), fma(f, REAL(k[1]), REAL(k[0])))


@inlined
def less(p, q):
    """Four numbers less four others."""
    return p[0] - q[0], p[1] - q[1], p[2] - q[2], p[3] - q[3]


@inlined
def gather(field, axis, where, x):
    """A component of E at the particle (5.14); where = (row, column) of the tile's anchor in e, rows between planes.
    CIC in the form a + b f + (c + d f) g, in 3D of planes: P + Q h.
    """
    e, scale = field.e[axis], field.scale
    i, f = cell_and_place(x[0])
    i, j = i + where[1], where[0]
    if DIM == 1 and NODES == 1:
        return REAL(e[j, i] * scale)
    if DIM == 1 and NODES == 2:
        left, right = e[j, i] * scale, e[j, i + 1] * scale
        return fma(f, REAL(right - left), REAL(left))
    if DIM == 1:
        return quadratic(along_row_of(e, j, i, scale), f)
    along_y, g = cell_and_place(x[1])
    j += along_y
    if DIM == 2 and NODES == 1:
        return REAL(e[j, i] * scale)
    if DIM == 2 and NODES == 2:
        return bilinear(four_about(e, j, i, scale), f, g)
    if DIM == 2:
        return biquadratic(nine_about(e, j, i, scale), f, g)
    along_z, h = cell_and_place(x[2])
    pitch = where[2]
    j += along_z * pitch
    if NODES == 1:
        return REAL(e[j, i] * scale)
    if NODES == 2:
        low = four_about(e, j, i, scale)
        return fma(h, bilinear(less(four_about(e, j + pitch, i, scale), low), f, g), bilinear(low, f, g))
    low, mid, high = (nine_about(e, j - pitch, i, scale), nine_about(e, j, i, scale), nine_about(e, j + pitch, i, scale))
    k = (parabola(low[0], mid[0], high[0]), parabola(low[1], mid[1], high[1]), parabola(low[2], mid[2], high[2]),
         parabola(low[3], mid[3], high[3]), parabola(low[4], mid[4], high[4]), parabola(low[5], mid[5], high[5]),
         parabola(low[6], mid[6], high[6]), parabola(low[7], mid[7], high[7]), parabola(low[8], mid[8], high[8]))  # fmt: skip
    plane = biquadratic(of_power(k, 2), f, g)
    plane = fma(h, plane, biquadratic(of_power(k, 1), f, g))
    return fma(h, plane, biquadratic(of_power(k, 0), f, g))


@inlined
def of_power(k, n):
    """Of nine parabolas the coefficients of h^n."""
    return k[0][n], k[1][n], k[2][n], k[3][n], k[4][n], k[5][n], k[6][n], k[7][n], k[8][n]


@inlined
def parts_of(a, b):
    """The product of a share and a number of parts, as a whole number."""
    return np.int64(fma(a, b, MAGIC) - MAGIC)


@inlined
def deposit(patch, group, unit, where, x):
    """Charge of one particle (5.1), `unit` parts in all, exactly; `where` see gather, in the patch."""
    whole, nodes = REAL(unit), patch[group]
    i, f = cell_and_place(x[0])
    j, g = (np.int64(0), ZERO) if DIM == 1 else cell_and_place(x[1])
    i, j = i + where[1], j + where[0]
    if DIM == 3:
        along_z, h = cell_and_place(x[2])
        deposit_planes(nodes, unit, j + along_z * where[2], i, where[2], f, g, h)
    elif NODES == 1:
        nodes[j, i] += unit
    elif NODES == 2 and DIM == 1:
        along = parts_of(f, whole)
        nodes[j, i] += unit - along
        nodes[j, i + 1] += along
    elif NODES == 2:
        add_four(nodes, j, i, shares_of_four(unit, whole, f, g))
    else:
        deposit_nine(nodes, unit, whole, j, i, f, g, 1)


@inlined
def deposit_planes(nodes, unit, j, i, pitch, f, g, h):
    """Charge of one particle in 3D. The plane at j gets what the others, `pitch` rows away, leave of the whole."""
    whole = REAL(unit)
    if NODES == 1:
        nodes[j, i] += unit
    elif NODES == 2:
        low, high = shares_of_four(unit, whole, f, g), shares_of_four(parts_of(h, whole), h * whole, f, g)
        add_four(nodes, j, i, less(low, high))
        add_four(nodes, j + pitch, i, high)
    else:
        deposit_nine(nodes, unit, whole, j, i, f, g, 1)
        for w, step in zip(tsc_outer_weights(h), (-pitch, pitch)):
            share = w * whole
            parts = parts_of(share, ONE)
            deposit_nine(nodes, parts, share, j + step, i, f, g, 1)
            deposit_nine(nodes, parts, share, j, i, f, g, -1)


@inlined
def shares_of_four(unit, whole, f, g):
    """Parts for the corners (0, 0), (1, 0), (0, 1), (1, 1) of `unit` parts, which are `whole` before rounding."""
    along, across, both = parts_of(f, whole), parts_of(g, whole), parts_of(f, g * whole)
    return unit - along - across + both, along - both, across - both, both


@inlined
def add_four(nodes, j, i, k):
    """Add four numbers of parts to the corners of a cell whose lower left node is (j, i)."""
    nodes[j, i] += k[0]
    nodes[j, i + 1] += k[1]
    nodes[j + 1, i] += k[2]
    nodes[j + 1, i + 1] += k[3]


@inlined
def deposit_nine(nodes, unit, whole, j, i, f, g, sign):
    """Charge of one particle by TSC about node (j, i), times sign: what the node and those in line with it get are
    differences. `unit` parts in all, which are `whole` before rounding.
    """
    u = tsc_outer_weights(f)
    left, right = parts_of(u[0], whole), parts_of(u[1], whole)
    if DIM > 1:
        for w, step in zip(tsc_outer_weights(g), (-1, 1)):
            share = w * whole
            row, at_left, at_right = parts_of(share, ONE), parts_of(u[0], share), parts_of(u[1], share)
            nodes[j + step, i - 1] += sign * at_left
            nodes[j + step, i] += sign * (row - at_left - at_right)
            nodes[j + step, i + 1] += sign * at_right
            unit, left, right = unit - row, left - at_left, right - at_right
    nodes[j, i - 1] += sign * left
    nodes[j, i] += sign * (unit - left - right)
    nodes[j, i + 1] += sign * right


@inlined
def place_of(pool, page, pack, lane):
    """Position of a particle; zero along axes that the scene does not have."""
    y = z = ZERO
    if DIM > 1:
        y = pool[page, pack, 1, lane]
    if DIM == 3:
        z = pool[page, pack, 2, lane]
    return pool[page, pack, 0, lane], y, z


@inlined
def velocity_of(pool, page, pack, lane):
    """Velocity of a particle; zero along axes that the scene does not have."""
    vy = vz = ZERO
    if VELOCITIES > 1:
        vy = pool[page, pack, DIM + 1, lane]
    if VELOCITIES > 2:
        vz = pool[page, pack, DIM + 2, lane]
    return pool[page, pack, DIM, lane], vy, vz


@inlined
def anchor_in(part, grid, first):
    """Row and column of a part's anchor in an array of the slab (see groups) whose first node is `first`, and the rows
    between its planes.
    """
    row = grid.parts[part, 1] - first[0]
    if DIM == 3:
        row += (grid.parts[part, 8] - first[2]) * grid.pitch
    return row, grid.parts[part, 2] - first[1], np.int64(grid.pitch)


@inlined
def accelerated(x, v, where, field, m):
    """The velocity of a particle after a step (5.19); `where` see gather."""
    ey = gather(field, 1, where, x) if DIM > 1 else ZERO
    ez = gather(field, 2, where, x) if DIM == 3 else ZERO
    return boris(v[0], v[1], v[2], gather(field, 0, where, x), ey, ez, m, DIM, ROTATION)


@inlined
def set_velocity(pool, page, pack, lane, v):
    """Store as many components as the scene has."""
    pool[page, pack, DIM, lane] = v[0]
    if VELOCITIES > 1:
        pool[page, pack, DIM + 1, lane] = v[1]
    if VELOCITIES > 2:
        pool[page, pack, DIM + 2, lane] = v[2]


@inlined
def moved(pool, page, pack, lane, axis, x, v):
    """x + v along an axis, which is stored (5.18)."""
    after = x[axis] + v[axis]
    pool[page, pack, axis, lane] = after
    return after


@kernel
def push_slot(slot, grid, field, species, pages, leavers, patch):
    """Push the particles of a slot; those who stay leave their charge, the others are in leavers[:n]. Returns n."""
    parts, pool, part, kind = grid.parts, pages.pool, slot // grid.n_species, slot % grid.n_species
    in_field, in_patch = anchor_in(part, grid, field.origin), anchor_in(part, grid, patch.corner)
    m, group, unit = species.mover[kind], species.charge[kind, 0], species.charge[kind, 1]
    page, used, n = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1, 0
    while page >= 0:
        for place in range(used - 1, -1, -1):
            pack, lane = place // LANES, place % LANES
            before = place_of(pool, page, pack, lane)
            v = accelerated(before, velocity_of(pool, page, pack, lane), in_field, field, m)
            set_velocity(pool, page, pack, lane, v)
            x, y, z = moved(pool, page, pack, lane, 0, before, v), ZERO, ZERO
            inside = x >= parts[part, 5] and x < parts[part, 6]
            if DIM > 1:
                y = moved(pool, page, pack, lane, 1, before, v)
                inside = inside and y >= parts[part, 3] and y < parts[part, 4]
            if DIM == 3:
                z = moved(pool, page, pack, lane, 2, before, v)
                inside = inside and z >= parts[part, 9] and z < parts[part, 10]
            if inside:
                deposit(patch.nodes, group, unit, in_patch, (x, y, z))
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
    pool, nodes, kind = pages.pool, patch.nodes, slot % grid.n_species
    where = anchor_in(slot // grid.n_species, grid, patch.corner)
    group, unit = species.charge[kind, 0], species.charge[kind, 1]
    page, end = np.int64(pages.head[slot]), pages.count[slot]
    while end > low:
        begin = max((end - 1) // PAGE * PAGE, low)
        for number in range(begin, end):
            pack, lane = number % PAGE // LANES, number % LANES
            deposit(nodes, group, unit, where, place_of(pool, page, pack, lane))
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
    n_species, pool = grid.n_species, pages.pool
    for part in range(first, last):
        where = anchor_in(part, grid, field.origin)
        for slot in range(part * n_species, (part + 1) * n_species):
            m = species.mover[slot % n_species]
            page, used = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1
            while page >= 0:
                for place in range(used):
                    pack, lane = place // LANES, place % LANES
                    v = velocity_of(pool, page, pack, lane)
                    v = accelerated(place_of(pool, page, pack, lane), v, where, field, m)
                    set_velocity(pool, page, pack, lane, v)
                page, used = np.int64(pages.chain[page]), PAGE
    return GOOD


@kernel
def deposit_all(first, last, grid, species, pages, patch):
    """The charge (5.1) of all particles of a block."""
    patch.nodes[:] = 0
    for slot in range(first * grid.n_species, last * grid.n_species):
        deposit_from(np.int64(0), slot, grid, species, pages, patch)
    return GOOD
