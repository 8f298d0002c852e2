"""Nodes that grains cover and uncover: what is lost with them and what they are filled with; compiled."""

import numpy as np

from hpcpic.core.simd.compile import njit
from lbmdem.kernels.grain_rasters import FLUID
from lbmdem.kernels.layout import arrival, place

AVERAGE, LOCAL, NON_EQUILIBRIUM = 0, 1, 2
CHUNK = 128  # nodes


@njit
def local_node(k, shape, inner):
    """(x, row, plane) among the own nodes of a flat place in the padded array of nodes."""
    x = k % shape[0] - inner[0, 0]
    return x, k // shape[0] % shape[1] - inner[1, 0], k // (shape[0] * shape[1]) - inner[2, 0]


@njit
def populations(f, strides, slots, shifts, parity, sizes, edge, x, r, p, h):
    """h[q] of a node of this slab, or of the planes below and above it; around the other axes if beyond.

    edge[2, q, rows, nx]: the planes below and above, of other ranks; empty when this rank has all planes.
    """
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
def mean(f, strides, slots, shifts, parity, solid, shape, inner, box, sizes, edge, e, w, mode, k, total):
    """Mean of the density less one over the fluid neighbours of node k; total[q]: mean of their non-equilibrium."""
    x, r, p = local_node(k, shape, inner)
    found, density, h = 0, 0.0, np.empty(w.size)
    total[:] = 0.0
    for i in range(1, e.shape[0]):
        at = (x + e[i, 0], r + e[i, 1], p + e[i, 2])
        there = k + (e[i, 2] * shape[1] + e[i, 1]) * shape[0] + e[i, 0]
        if solid[there] == FLUID and not outside(at, inner, box):
            populations(f, strides, slots, shifts, parity, sizes, edge, *at, h)
            extra, jx, jy, jz = moments(h, e)
            density += extra
            found += 1
            if mode == NON_EQUILIBRIUM:
                rho = 1.0 + extra
                add_equilibrium(h, e, w, -1.0, extra, jx / rho, jy / rho, jz / rho)
                total += h
    total /= max(found, 1)
    return density / max(found, 1)


@njit
def beside_others(p, sizes, edge):
    """Whether nodes beside a plane are other ranks'."""
    return edge.size > 0 and (p == 0 or p == sizes[2] - 1)


@njit(inline="always")
def around(at, size):
    """A place on a periodic axis of so many."""
    return at + size if at < 0 else at - size if at >= size else at


@njit(inline="always")
def kind_of(p, r, sizes):
    """Which of six kinds of rows it is: those that `offsets` tells apart."""
    return 3 * (p == sizes[2] - 1) + (0 if r == 0 else 2 if r == sizes[1] - 1 else 1)


@njit
def offsets_of_kinds(strides, slots, shifts, parity, sizes):
    """steps[kind, q]: elements from the place of a node in slot 0 to its arrivals."""
    steps = np.empty((6, slots.shape[1]), np.int64)
    for p in range(max(sizes[2] - 2, 0), sizes[2]):
        for r in (0, min(1, sizes[1] - 1), sizes[1] - 1):
            for i in range(slots.shape[1]):
                there = arrival(strides, slots, shifts, parity, p, r, 0, i)
                steps[kind_of(p, r, sizes), i] = there - place(strides, p, r)
    return steps


@njit
def fluid_neighbours(strides, solid, shape, inner, box, sizes, edge, e, nodes, where, kinds, after):
    """Where the populations of the fluid neighbours of nodes are, but of nodes beside other ranks: elements of slot 0.

    kinds: of their rows; after[n]: the end of those of nodes[n]. How many.
    """
    count, q = 0, e.shape[0]
    near, to = np.empty(q, np.int64), np.empty(q, np.int64)
    for i in range(q):
        near[i] = (e[i, 2] * shape[1] + e[i, 1]) * shape[0] + e[i, 0]
        to[i] = e[i, 2] * strides[1] + e[i, 1] * strides[2] + e[i, 0]
    for n in range(nodes.size):
        k = nodes[n]
        x, r, p = local_node(k, shape, inner)
        if 0 < x < sizes[0] - 1 and 1 < r < sizes[1] - 2 and 0 < p < sizes[2] - 2:
            start = place(strides, p, r) + x
            for i in range(1, q):
                where[count], kinds[count] = start + to[i], 1
                count += solid[k + near[i]] == FLUID
        elif not beside_others(p, sizes, edge):
            for i in range(1, q):
                at = (x + e[i, 0], r + e[i, 1], p + e[i, 2])
                row, plane = around(at[1], sizes[1]), around(at[2], sizes[2])
                where[count] = place(strides, plane, row) + around(at[0], sizes[0])
                kinds[count] = kind_of(plane, row, sizes)
                count += (solid[k + near[i]] == FLUID) & (not outside(at, inner, box))
        after[n] = count
    return count


@njit
def densities(f, steps, where, kinds, count, sums):
    """sums[m]: of all populations of a node."""
    for m in range(count):
        density, of_kind = 0.0, steps[kinds[m]]
        for i in range(of_kind.size):
            density += f[np.uint64(where[m] + of_kind[i])]
        sums[m] = density


@njit
def fill(
    f, strides, slots, shifts, parity, solid, shape, inner, box, sizes, edge, e, w, mode, nodes, speed, cuts, share,
):  # fmt: skip
    """Give the uncovered nodes[n] of a share the equilibrium with speed[n, 3] and, by mode, the density of their fluid
    neighbours, and the non-equilibrium of these.

    The mean density is the reference one, 1. Neighbours that are being uncovered too are not asked.
    """
    h, steps = np.zeros(w.size), offsets_of_kinds(strides, slots, shifts, parity, sizes)
    where, kinds = np.empty(CHUNK * w.size, np.int64), np.empty(CHUNK * w.size, np.int64)
    sums, after = np.empty(CHUNK * w.size), np.empty(CHUNK, np.int64)
    for first in range(cuts[share], cuts[share + 1], CHUNK):
        chunk = nodes[first : min(first + CHUNK, cuts[share + 1])]
        if mode == LOCAL:  # where all is comes first, so that memory is asked for many nodes at a time
            count = fluid_neighbours(strides, solid, shape, inner, box, sizes, edge, e, chunk, where, kinds, after)
            densities(f, steps, where, kinds, count, sums)
        begin = 0
        for n in range(chunk.size):
            x, r, p = local_node(chunk[n], shape, inner)
            density = 0.0
            if mode == LOCAL and not beside_others(p, sizes, edge):
                for m in range(begin, after[n]):
                    density += sums[m]
                density /= max(after[n] - begin, 1)
                begin = after[n]
            elif mode != AVERAGE:
                density = mean(
                    f, strides, slots, shifts, parity, solid, shape, inner, box, sizes, edge, e, w, mode, chunk[n], h
                )  # fmt: skip
            v = speed[first + n]
            add_equilibrium(h, e, w, 1.0, density, v[0], v[1], v[2])
            for i in range(h.size):
                f[arrival(strides, slots, shifts, parity, p, r, x, i)] = h[i]
            h[:] = 0.0


@njit
def speeds(shape, origin, points, periodic, ids, centres, motion, nodes, owners, speed):
    """speed[n, 3] of the grain owners[n], at its place now, at nodes[n]; 0 where it is no longer among the ids."""
    arm = np.empty(3)
    for n in range(nodes.size):
        g = np.searchsorted(ids, owners[n])
        speed[n] = 0.0
        if g == ids.size or ids[g] != owners[n]:
            continue
        place = (nodes[n] % shape[0], nodes[n] // shape[0] % shape[1], nodes[n] // (shape[0] * shape[1]))
        for a in range(3):
            at = place[a] + origin[a]
            turns = np.int64(np.rint((at - centres[g, a]) / points[a])) if periodic[a] else 0
            arm[a] = (at - turns * points[a]) - centres[g, a]
        v, omega = motion[g, :3], motion[g, 3:]
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            speed[n, a] = v[a] + (omega[b] * arm[c] - omega[c] * arm[b])


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
