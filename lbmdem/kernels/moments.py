"""What is seen of the populations: density and velocity, sums of rows, and the populations themselves."""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import empty, zeros
from hpcpic.core.simd.vector import (
    Vec,
    address_of,
    bitmask,
    count_bits,
    fma,
    lane_numbers,
    lanes,
    load,
    maximum,
    prefetch,
    select,
    splat,
    store,
)
from lbmdem.kernels.gather_scatter import load_wide
from lbmdem.kernels.layout import FLUID, arrival, element
from lbmdem.kernels.refill import offsets

N = lanes(np.float64)
F, H = Vec(N, np.float64), Vec(N, np.int32)
AHEAD = 8  # vectors by which populations are fetched before they are needed
COLUMNS = 8  # of a row's sums, less the count of nodes: rho - 1, momentum, rho u^2, u


@njit
def fetch(f, places, parity, z, y, i, line):
    """line[x] = f_i of a row's nodes, 0 where solid nodes have no positions. places: `layout.Addresses`."""
    strides, slots, shifts, positions = places
    if positions.shape[0] == 0:
        start = arrival(strides, slots, shifts, parity, z, y, 0, i)
        for x in range(line.size):
            line[x] = f[start + x]
        return
    row, own, other = y + strides[1], i * strides[0], slots[1, i] * strides[0]
    here = positions[z + 1, row, 1 : line.size + 1]
    if not parity:
        for x in range(line.size):
            line[x] = f[own + here[x]] if here[x] >= 0 else 0
        return
    there = positions[z + 1 + shifts[i, 0], row + shifts[i, 1], 1 + shifts[i, 2] : line.size + 1 + shifts[i, 2]]
    for x in range(line.size):  # as `element`
        line[x] = 0 if here[x] < 0 else f[other + there[x]] if there[x] >= 0 else f[own + here[x]]


@njit
def gather(f, places, e, parity, z, y, h, lines):
    """lines[0] = sum of h, lines[1 + c] = momentum without force along physical axis c, of a row's nodes.

    h[x] is room for a population.
    """
    lines[:] = 0.0
    nx = lines.shape[1]
    for i in range(e.shape[0]):
        fetch(f, places, parity, z, y, i, h)
        mass = lines[0]
        for x in range(nx):
            mass[x] += h[x]
        for c in range(e.shape[1]):
            along = lines[1 + c]
            if e[i, c] == 1:
                for x in range(nx):
                    along[x] += h[x]
            elif e[i, c] == -1:
                for x in range(nx):
                    along[x] -= h[x]


@njit
def moments(f, ids, ghosts, places, e, shift, parity, low, high, rho, u):
    """rho[planes, rows, nx] and u[..., d] of planes low..; shift[c]: the part of the force in the
    momentum. Solid nodes have 1 and 0."""
    d = e.shape[1]
    lines, h = empty((1 + d, rho.shape[2]), np.float64), empty(rho.shape[2], f.dtype)
    for z in range(low, high):
        for y in range(rho.shape[1]):
            gather(f, places, e, parity, z, y, h, lines)
            solid, density, velocity = ids[z + 1, y + ghosts], rho[z, y], u[z, y]
            for x in range(density.size):
                fluid = solid[x + 1] == FLUID
                density[x] = 1.0 + lines[0, x] if fluid else 1.0
                for c in range(d):
                    velocity[x, c] = (lines[1 + c, x] + shift[c]) / density[x] if fluid else 0.0


@njit
def row_sums(f, ids, ghosts, places, e, shift, parity, low, high, sums, fastest):
    """sums[plane, row] = fluid nodes, their sum of h, momentum (with shift[c]), rho u^2, u; and
    fastest[plane, row] = largest u^2. A row is summed in the order of its nodes, so that no decomposition shows."""
    strides, slots, shifts, positions = places
    q, d = e.shape
    starts, terms = empty(q, np.int64), empty(COLUMNS * N, np.float64)
    way, forced = zeros(3 * q, np.float64), zeros(3, np.float64)
    for i in range(q):
        for c in range(d):
            way[3 * i + c], forced[c] = e[i, c], shift[c]
    line, nx = ids.reshape(-1), ids.shape[2] - 2
    dense = positions.shape[0] == 0
    room = zeros((q, 1 if dense else nx + N), f.dtype)
    rows = f if dense else room.reshape(-1)
    steps = offsets(strides, slots, shifts, parity) if dense else starts
    for z in range(low, high):
        for y in range(sums.shape[1]):
            inside = z + 1 < sums.shape[0] and 0 < y < sums.shape[1] - 1
            for i in range(q):
                if not dense:
                    starts[i] = i * room.shape[1]
                    fetch(f, places, parity, z, y, i, room[i, :nx])
                elif inside:
                    starts[i] = z * strides[1] + y * strides[2] + strides[3] + steps[i]
                else:
                    starts[i] = arrival(strides, slots, shifts, parity, z, y, 0, i)
            node = ((z + 1) * ids.shape[1] + y + ghosts) * ids.shape[2] + 1
            row = sums[z, y]
            row[0], row[1], momentum, row[2 + d], flow, fastest[z, y] = of_row(
                rows, starts, way, forced, line, node, nx, terms
            )
            for c in range(d):
                row[2 + c], row[3 + d + c] = momentum[c], flow[c]


@njit
def of_row(f, starts, way, half, line, node, nx, terms):
    """Sums of a row's nodes: what `row_sums` tells, with vectors along three axes. terms[COLUMNS N]: room."""
    count, fastest, zero = 0, splat(F, 0.0), splat(F, 0.0)
    mass, px, py, pz, energy, ux, uy, uz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for x in range(0, nx, N):
        fluid = (load(H, line, node + x) == FLUID) & (lane_numbers(H) < np.int32(nx - x))
        bits = bitmask(fluid)
        if not bits:
            continue
        count += count_bits(bits)
        h_sum, jx, jy, jz = zero, zero, zero, zero
        for i in range(np.uint64(starts.size)):
            start = starts[i] + x
            prefetch(address_of(f, start + AHEAD * N))
            h = load_wide(F, f, start)
            h_sum += h
            c = np.uint64(3) * i
            jx, jy, jz = fma(h, way[c], jx), fma(h, way[c + np.uint64(1)], jy), fma(h, way[c + np.uint64(2)], jz)
        jx, jy, jz = jx + half[0], jy + half[1], jz + half[2]
        rho, square = 1.0 + h_sum, jx * jx + jy * jy + jz * jz
        for c, term in enumerate((h_sum, jx, jy, jz, square / rho, jx / rho, jy / rho, jz / rho)):
            store(terms, c * N, select(fluid, term, zero))
        u_sq = select(square == square, square / (rho * rho), splat(F, np.inf))
        fastest = maximum(select(fluid, u_sq, zero), fastest)
        for b in range(np.uint64(N)):
            mass, px = mass + terms[b], px + terms[b + np.uint64(N)]
            py, pz = py + terms[b + np.uint64(2 * N)], pz + terms[b + np.uint64(3 * N)]
            energy, ux = energy + terms[b + np.uint64(4 * N)], ux + terms[b + np.uint64(5 * N)]
            uy, uz = uy + terms[b + np.uint64(6 * N)], uz + terms[b + np.uint64(7 * N)]
    largest = 0.0
    store(terms, 0, fastest)
    for b in range(N):
        largest = max(largest, terms[b])
    return count, mass, (px, py, pz), energy, (ux, uy, uz), largest


@njit
def excesses(f, places, parity, nodes, excess):
    """excess[m] = rho - 1 at nodes[m, 3] (plane, row, x)."""
    strides, slots, shifts, positions = places
    for k in range(excess.size):
        total = 0.0
        for i in range(shifts.shape[0]):
            place = element(strides, slots, shifts, positions, parity, nodes[k, 0], nodes[k, 1], nodes[k, 2], i)
            total += f[place]
        excess[k] = total


@njit
def read(f, ids, ghosts, places, parity, low, high, h):
    """h[plane, row, x, i] of planes low..; 0 in solid nodes."""
    line = empty(h.shape[2], f.dtype)
    for z in range(low, high):
        for y in range(h.shape[1]):
            solid, target = ids[z + 1, y + ghosts], h[z, y]
            for i in range(h.shape[3]):
                fetch(f, places, parity, z, y, i, line)
                for x in range(h.shape[2]):
                    target[x, i] = line[x] if solid[x + 1] == FLUID else 0


@njit
def write(f, places, first, parity, low, high, h):
    """The inverse of `read`; h begins with the plane `first`."""
    strides, slots, shifts, positions = places
    for z in range(low, high):
        for y in range(h.shape[1]):
            for i in range(h.shape[3]):
                for x in range(h.shape[2]):
                    if positions.shape[0] == 0 or positions[z + 1, y + strides[1], x + 1] >= 0:
                        f[element(strides, slots, shifts, positions, parity, z, y, x, i)] = h[z - first, y, x, i]
