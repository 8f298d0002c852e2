"""Nodes that grains cover and uncover: what is lost with them and what they are filled with; compiled."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import empty, zeros
from lbmdem.kernels.grain_rasters import GRAINS, UNCOVERED, row_of
from lbmdem.kernels.layout import place
from lbmdem.kernels.link_arrays import FLUID, arrival

LOCAL, NON_EQUILIBRIUM = 0, 1
CHUNK = 128  # nodes


class Source(NamedTuple):
    """What nodes are filled from: sizes[3] of the slab (x, row, plane), edge as `populations_of` wants it, e[q, 3] and
    w[q] of the lattice, the mode, and frame[3], the acceleration of a shaken frame: grains have the velocity of half a
    step later (`Immersed.start`), and populations are half a step before their own.
    """

    sizes: NDArray[np.int64]
    edge: NDArray[np.float64]
    e: NDArray[np.int64]
    w: NDArray[np.float64]
    mode: int
    frame: NDArray[np.float64]


@njit
def local_node(k, nodes):
    """(x, row, plane) among the own nodes of a flat place in the padded array of nodes."""
    shape, inner = nodes.shape, nodes.inner
    x = k % shape[0] - inner[0, 0]
    return x, k // shape[0] % shape[1] - inner[1, 0], k // (shape[0] * shape[1]) - inner[2, 0]


@njit
def populations_of(populations, parity, sizes, edge, x, r, p, h):
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
        h[i] = populations.f[arrival(populations, parity, p, r, x, i)]


@njit
def copy_plane(populations, parity, p, plane):
    """plane[q, 1, rows, nx]: the populations of an own plane."""
    for i in range(plane.shape[0]):
        for r in range(plane.shape[2]):
            for x in range(plane.shape[3]):
                plane[i, 0, r, x] = populations.f[arrival(populations, parity, p, r, x, i)]


@njit
def offsets(strides, slots, shifts, parity):
    """Elements from the place of a node in slot 0 to its arrivals, away from the ends of planes and rows."""
    steps = empty(slots.shape[1], np.int64)
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
def outside(node, nodes):
    """True for a node (x, row, plane) of this slab, or beside it, that is beyond a face of the box."""
    for a in range(3):
        at = node[a] + nodes.inner[a, 0]
        if at < nodes.box[a, 0] or at >= nodes.box[a, 1]:
            return True
    return False


@njit
def mean(populations, parity, nodes, sizes, edge, e, w, mode, k, total):
    """Mean of the density less one over the fluid neighbours of node k; total[q]: mean of their non-equilibrium."""
    x, r, p = local_node(k, nodes)
    shape, found, density, h = nodes.shape, 0, 0.0, empty(w.size, np.float64)
    total[:] = 0.0
    for i in range(1, e.shape[0]):
        at = (x + e[i, 0], r + e[i, 1], p + e[i, 2])
        there = k + (e[i, 2] * shape[1] + e[i, 1]) * shape[0] + e[i, 0]
        if nodes.solid[there] == FLUID and not outside(at, nodes):
            populations_of(populations, parity, sizes, edge, *at, h)
            extra, jx, jy, jz = moments(h, e)
            density += extra
            found += 1
            if mode == NON_EQUILIBRIUM:
                rho = 1.0 + extra
                add_equilibrium(h, e, w, -1.0, extra, jx / rho, jy / rho, jz / rho)
                for j in range(h.size):
                    total[j] += h[j]
    for j in range(total.size):
        total[j] /= max(found, 1)
    return density / max(found, 1)


@njit
def beside_others(p, sizes, edge):
    """True where nodes beside a plane are other ranks'."""
    return edge.size > 0 and (p == 0 or p == sizes[2] - 1)


@njit(forceinline=True)
def around(at, size):
    """A place on a periodic axis of so many."""
    return at + size if at < 0 else at - size if at >= size else at


@njit(forceinline=True)
def kind_of(p, r, sizes):
    """Which of six kinds of rows it is: those that `offsets` tells apart."""
    return 3 * (p == sizes[2] - 1) + (0 if r == 0 else 2 if r == sizes[1] - 1 else 1)


@njit
def offsets_of_kinds(populations, parity, sizes):
    """steps[kind, q]: elements from the place of a node in slot 0 to its arrivals."""
    strides, q = populations.strides, populations.slots.shape[1]
    steps = empty((6, q), np.int64)
    for p in range(max(sizes[2] - 2, 0), sizes[2]):
        for r in (0, min(1, sizes[1] - 1), sizes[1] - 1):
            for i in range(q):
                there = arrival(populations, parity, p, r, 0, i)
                steps[kind_of(p, r, sizes), i] = there - place(strides, p, r)
    return steps


@njit
def fluid_neighbours(strides, nodes, sizes, edge, e, uncovered, where, kinds, after):
    """Find the populations of the fluid neighbours of nodes, but of nodes beside other ranks: elements of slot 0.

    kinds: of their rows; after[n]: the end of those of uncovered[n]. Returns how many.
    """
    count, q, solid, shape = 0, e.shape[0], nodes.solid, nodes.shape
    near, to = empty(q, np.int64), empty(q, np.int64)
    for i in range(q):
        near[i] = (e[i, 2] * shape[1] + e[i, 1]) * shape[0] + e[i, 0]
        to[i] = e[i, 2] * strides[1] + e[i, 1] * strides[2] + e[i, 0]
    for n in range(uncovered.size):
        k = uncovered[n]
        x, r, p = local_node(k, nodes)
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
                count += (solid[k + near[i]] == FLUID) & (not outside(at, nodes))
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
def fill(share, shares, own, own_by, lengths, table, window, populations, parity, nodes, source):
    """Give a share of the uncovered nodes own[0] the equilibrium with the velocity of the grain own_by[0] and the
    density of their fluid neighbours and, by mode, the non-equilibrium of these.

    Neighbours that are being uncovered too are not asked.
    """
    sizes, edge, e, w, mode, frame = source
    h, steps = zeros(w.size, np.float64), offsets_of_kinds(populations, parity, sizes)
    where, kinds = empty(CHUNK * w.size, np.int64), empty(CHUNK * w.size, np.int64)
    sums, after = empty(CHUNK * w.size, np.float64), empty(CHUNK, np.int64)
    end = (share + 1) * lengths[UNCOVERED] // shares
    for first in range(share * lengths[UNCOVERED] // shares, end, CHUNK):
        chunk = own[0, first : min(first + CHUNK, end)]
        if mode == LOCAL:  # where all is comes first, so that memory is asked for many nodes at a time
            count = fluid_neighbours(populations.strides, nodes, sizes, edge, e, chunk, where, kinds, after)
            densities(populations.f, steps, where, kinds, count, sums)
        begin = 0
        for n in range(chunk.size):
            _, _, p = local_node(chunk[n], nodes)
            density = 0.0
            if mode == LOCAL and not beside_others(p, sizes, edge):
                for m in range(begin, after[n]):
                    density += sums[m]
                density /= max(after[n] - begin, 1)
                begin = after[n]
            else:
                density = mean(populations, parity, nodes, sizes, edge, e, w, mode, chunk[n], h)
            v = grain_velocity(chunk[n], own_by[0, first + n], table, lengths[GRAINS], window)
            add_equilibrium(h, e, w, 1.0, density, v[0] + frame[0], v[1] + frame[1], v[2] + frame[2])
            put(populations, parity, nodes, chunk[n], h)


@njit
def fill_average(share, shares, own, own_by, lengths, table, window, populations, parity, nodes, source, density):
    """Give a share of the uncovered nodes own[0] the equilibrium with the velocity of the grain own_by[0] and the mean
    density of the fluid, 1 + density.
    """
    h, frame = zeros(source.w.size, np.float64), source.frame
    for n in range(share * lengths[UNCOVERED] // shares, (share + 1) * lengths[UNCOVERED] // shares):
        v = grain_velocity(own[0, n], own_by[0, n], table, lengths[GRAINS], window)
        add_equilibrium(h, source.e, source.w, 1.0, density, v[0] + frame[0], v[1] + frame[1], v[2] + frame[2])
        put(populations, parity, nodes, own[0, n], h)


@njit(forceinline=True)
def put(populations, parity, nodes, k, h):
    """Make h[q] the populations of the node at the flat place k; h is zero then."""
    x, r, p = local_node(k, nodes)
    for i in range(h.size):
        populations.f[arrival(populations, parity, p, r, x, i)] = h[i]
    h[:] = 0.0


@njit
def grain_velocity(k, number, table, n_grains, window):
    """Velocity of the grain of this number, where it is now, at the flat place k; 0 if it is no longer in the table."""
    shape, g = window.shape, row_of(table.ids, n_grains, np.int64(number))
    if g < 0:
        return 0.0, 0.0, 0.0
    x = _arm(k % shape[0], table.centres[g], window, 0)
    y = _arm(k // shape[0] % shape[1], table.centres[g], window, 1)
    z = _arm(k // (shape[0] * shape[1]), table.centres[g], window, 2)
    v, omega = table.motion[g, :3], table.motion[g, 3:]
    return (
        v[0] + (omega[1] * z - omega[2] * y),
        v[1] + (omega[2] * x - omega[0] * z),
        v[2] + (omega[0] * y - omega[1] * x),
    )


@njit(forceinline=True)
def _arm(local, centre, window, a):
    """Along the axis a, from the nearest image of a centre to a local place."""
    at, points = local + window.origin[a], window.points[a]
    turns = np.int64(np.rint((at - centre[a]) / points)) if window.periodic[a] else 0
    return (at - turns * points) - centre[a]


@njit
def read(populations, parity, nodes, places, values):
    """values[n, q]: the populations of the nodes at flat places[n]."""
    for n in range(places.size):
        x, r, p = local_node(places[n], nodes)
        for i in range(values.shape[1]):
            values[n, i] = populations.f[arrival(populations, parity, p, r, x, i)]


@njit
def add_to_rest(f, strides, solid, inner, low, high, extra):
    """Add to the rest population of the fluid nodes of the padded planes [low, high); its slot is 0 at any parity."""
    for p in range(low, high):
        for r in range(inner[1, 0], inner[1, 1]):
            base = (p - inner[2, 0]) * strides[1] + (r - inner[1, 0]) * strides[2] + strides[3] - inner[0, 0]
            for x in range(inner[0, 0], inner[0, 1]):
                if solid[p, r, x] == FLUID:
                    f[base + x] += extra
