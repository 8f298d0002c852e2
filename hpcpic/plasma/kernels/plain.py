"""The particle kernels of one block, one particle after the other: the reference, for every shape and dimension.

Every kernel works on the tile parts `parts[first:last]` = (tile, anchor row, anchor column, rows from and to,
columns from and to relative to the anchor, block; in 3D anchor plane, planes from and to), and takes its arrays in
groups (see kernels.groups). Fields carry the ghosts the shape needs; `scale` is a power of two that brings them to
numbers near one. Charge goes to the block's patch in integer parts of a particle. In 1D there is one row; in 3D the
rows of a plane follow those of the one below it.
"""

import numpy as np

from hpcpic.core.simd.vector import prefetch
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
    place_of,
    prefetch_pack,
)
from hpcpic.plasma.kernels.weights import ZERO, anchor_in, deposit, gather
from hpcpic.plasma.physics.boris import boris

DIM = 2  # axes of the grid
VELOCITIES = 2  # components
ROTATION = 0  # kind of rotation, see physics.boris
REAL = np.float64  # precision of a particle

AHEAD = 16  # particles


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
