"""Nodes that grains cover and uncover: what is lost with them and what they are filled with; compiled."""

import numpy as np

from hpcpic.core.simd.jit import njit
from hpcpic.core.simd.vector import address_of, prefetch
from lbmdem.kernels.layout import arrival
from lbmdem.kernels.runs import FLUID

AVERAGE, LOCAL, NON_EQUILIBRIUM = 0, 1, 2
AHEAD = 2  # nodes by which memory is fetched before it is needed


@njit
def local_node(k, shape, inner):
    """(x, row, plane) among the own nodes of a flat place in the padded array of nodes."""
    x = k % shape[0] - inner[0, 0]
    return x, k // shape[0] % shape[1] - inner[1, 0], k // (shape[0] * shape[1]) - inner[2, 0]


@njit
def populations(f, strides, slots, shifts, parity, steps, sizes, edge, x, r, p, h):
    """h[q] of a node of this slab, or of the planes below and above it; around the other axes if beyond.

    edge[2, q, rows, nx]: the planes below and above, of other ranks; empty when this rank has all planes. steps[q]:
    `offsets`.
    """
    if 0 <= x < sizes[0] and 0 < r < sizes[1] - 1 and 0 <= p < sizes[2] - 1:
        start = p * strides[1] + r * strides[2] + strides[3] + x
        for i in range(h.size):
            h[i] = f[np.uint64(start + steps[i])]
        return
    x, r = x % sizes[0], r % sizes[1]
    if edge.size > 0 and (p < 0 or p >= sizes[2]):
        side = 0 if p < 0 else 1
        for i in range(h.size):
            h[i] = edge[side, i, r, x]
        return
    p %= sizes[2]
    for i in range(h.size):
        h[i] = f[arrival(strides, slots, shifts, parity, p, r, x, i)]


@njit
def copy_plane(f, strides, slots, shifts, parity, p, plane):
    """plane[q, 1, rows, nx]: the populations of an own plane."""
    for i in range(plane.shape[0]):
        for r in range(plane.shape[2]):
            for x in range(plane.shape[3]):
                plane[i, 0, r, x] = f[arrival(strides, slots, shifts, parity, p, r, x, i)]


@njit
def offsets(strides, slots, shifts, parity):
    """Elements from the place of a node in slot 0 to its arrivals, away from the ends of planes and rows."""
    steps = np.empty(slots.shape[1], np.int64)
    for i in range(steps.size):
        there = shifts[i, 0] * strides[1] + shifts[i, 1] * strides[2] + shifts[i, 2]
        steps[i] = slots[parity, i] * strides[0] + there
    return steps


@njit
def moments(h, e):
    """Density less one, and momentum (three components)."""
    density, jx, jy, jz = 0.0, 0.0, 0.0, 0.0
    for i in range(h.size):
        density += h[i]
        jx += e[i, 0] * h[i]
        jy += e[i, 1] * h[i]
        jz += e[i, 2] * h[i]
    return density, jx, jy, jz


@njit
def add_equilibrium(h, e, w, sign, density, ux, uy, uz):
    """h[q] += sign * equilibrium of the density 1 + density, without the weights."""
    square = 1.5 * (ux * ux + uy * uy + uz * uz)
    for i in range(h.size):
        along = 3.0 * (e[i, 0] * ux + e[i, 1] * uy + e[i, 2] * uz)
        h[i] += sign * w[i] * (density + (1.0 + density) * (along + 0.5 * along * along - square))


@njit
def outside(place, inner, box):
    """Whether a node (x, row, plane) of this slab, or beside it, is beyond a face of the box (box[3, 2], padded)."""
    for a in range(3):
        at = place[a] + inner[a, 0]
        if at < box[a, 0] or at >= box[a, 1]:
            return True
    return False


@njit
def neighbours(
    f, strides, slots, shifts, parity, steps, solid, shape, inner, box, sizes, edge, e, k, around
):  # fmt: skip
    """around[n, q]: the populations of the fluid neighbours of node k, in the order of directions; how many."""
    x, r, p = local_node(k, shape, inner)
    found = 0
    for i in range(1, e.shape[0]):
        if solid[k + (e[i, 2] * shape[1] + e[i, 1]) * shape[0] + e[i, 0]] == FLUID:
            place = (x + e[i, 0], r + e[i, 1], p + e[i, 2])
            if not outside(place, inner, box):
                populations(f, strides, slots, shifts, parity, steps, sizes, edge, *place, around[found])
                found += 1
    return found


@njit
def inner_neighbours(f, strides, steps, solid, shape, inner, e, k, around):
    """As `neighbours`, of a node that `is_inner`."""
    x, r, p = local_node(k, shape, inner)
    start = p * strides[1] + r * strides[2] + strides[3] + x
    found = 0
    for i in range(1, e.shape[0]):
        if solid[k + (e[i, 2] * shape[1] + e[i, 1]) * shape[0] + e[i, 0]] == FLUID:
            there = start + e[i, 2] * strides[1] + e[i, 1] * strides[2] + e[i, 0]
            for n in range(steps.size):
                around[found, n] = f[np.uint64(there + steps[n])]
            found += 1
    return found


@njit
def mean(around, found, e, w, mode, total):
    """Mean of the density less one over neighbours; total[q]: mean of their non-equilibrium."""
    total[:] = 0.0
    density = 0.0
    if mode == LOCAL:
        for n in range(w.size):
            of_slot = 0.0
            for c in range(found):
                of_slot += around[c, n]
            density += of_slot
    else:
        for c in range(found):
            other = around[c]
            extra, jx, jy, jz = moments(other, e)
            density += extra
            rho = 1.0 + extra
            add_equilibrium(other, e, w, -1.0, extra, jx / rho, jy / rho, jz / rho)
            for n in range(w.size):
                total[n] += other[n]
    if found > 0:
        total /= found
        density /= found
    return density


@njit
def is_inner(k, shape, inner, sizes):
    """Whether a node is so far from the ends of the slab that `arrival` of its neighbours goes around none."""
    x, r, p = local_node(k, shape, inner)
    return 0 < x < sizes[0] - 1 and 1 < r < sizes[1] - 2 and 0 < p < sizes[2] - 2


@njit
def fetch_neighbours(f, strides, steps, solid, shape, inner, e, k):
    """Get the memory of the rows of fluid around an inner node k on its way."""
    x, r, p = local_node(k, shape, inner)
    start = p * strides[1] + r * strides[2] + strides[3] + x
    for i in range(steps.size):
        row = k + (e[i, 2] * shape[1] + e[i, 1]) * shape[0]
        if e[i, 0] == 0 and (solid[row - 1] == FLUID or solid[row] == FLUID or solid[row + 1] == FLUID):
            there = start + e[i, 2] * strides[1] + e[i, 1] * strides[2]
            for n in range(steps.size):
                prefetch(address_of(f, there + steps[n]))


@njit
def refill(
    f, strides, slots, shifts, parity, solid, shape, inner, box, sizes, edge, e, w, mode,
    nodes, speed, values,
):  # fmt: skip
    """values[n, q] for uncovered nodes[n]: equilibrium with speed[n, 3] and, by mode, the density of the neighbours.

    The mean density is the reference one, 1. Neighbours that are being uncovered too are not asked.
    """
    around, total, steps = np.empty((w.size, w.size)), np.zeros(w.size), offsets(strides, slots, shifts, parity)
    for n in range(nodes.size):
        density = 0.0
        if mode != AVERAGE:
            if n + AHEAD < nodes.size and is_inner(nodes[n + AHEAD], shape, inner, sizes):
                fetch_neighbours(f, strides, steps, solid, shape, inner, e, nodes[n + AHEAD])
            if is_inner(nodes[n], shape, inner, sizes):
                found = inner_neighbours(f, strides, steps, solid, shape, inner, e, nodes[n], around)
            else:
                found = neighbours(
                    f, strides, slots, shifts, parity, steps, solid, shape, inner, box, sizes, edge, e, nodes[n], around
                )  # fmt: skip
            density = mean(around, found, e, w, mode, total)
        values[n, :] = total
        add_equilibrium(values[n], e, w, 1.0, density, speed[n, 0], speed[n, 1], speed[n, 2])


@njit
def write(f, strides, slots, shifts, parity, shape, inner, nodes, values):
    """Put values[n, q] where nodes[n] will read them."""
    for n in range(nodes.size):
        x, r, p = local_node(nodes[n], shape, inner)
        for i in range(values.shape[1]):
            f[arrival(strides, slots, shifts, parity, p, r, x, i)] = values[n, i]


@njit
def read(f, strides, slots, shifts, parity, shape, inner, nodes, values):
    """values[n, q]: the populations of nodes[n]."""
    for n in range(nodes.size):
        x, r, p = local_node(nodes[n], shape, inner)
        for i in range(values.shape[1]):
            values[n, i] = f[arrival(strides, slots, shifts, parity, p, r, x, i)]


@njit
def add_to_rest(f, strides, solid, inner, low, high, extra):
    """Add to the rest population of the fluid nodes of the padded planes [low, high); its slot is 0 at any parity."""
    for p in range(low, high):
        for r in range(inner[1, 0], inner[1, 1]):
            base = (p - inner[2, 0]) * strides[1] + (r - inner[1, 0]) * strides[2] + strides[3] - inner[0, 0]
            for x in range(inner[0, 0], inner[0, 1]):
                if solid[p, r, x] == FLUID:
                    f[base + x] += extra
