"""What is seen of the populations: density and velocity, sums of rows, and the populations themselves."""

import numpy as np

from hpcpic.core.simd.jit import njit
from lbmdem.kernels.layout import FLUID, arrival


@njit
def gather(f, strides, slots, shifts, e, parity, z, y, lines):
    """lines[0] = sum of h, lines[1 + c] = momentum without force along physical axis c, of a row's nodes."""
    lines[:] = 0.0
    nx = lines.shape[1]
    for i in range(e.shape[0]):
        start = arrival(strides, slots, shifts, parity, z, y, 0, i)
        h, mass = f[start : start + nx], lines[0]
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
def moments(f, ids, ghosts, strides, slots, shifts, e, half, parity, low, high, rho, u):
    """rho[planes, rows, nx] and u[..., d] of planes low..; half[c]: half the force. Solid nodes have 1 and 0."""
    d = e.shape[1]
    lines = np.empty((1 + d, rho.shape[2]))
    for z in range(low, high):
        for y in range(rho.shape[1]):
            gather(f, strides, slots, shifts, e, parity, z, y, lines)
            solid, density, velocity = ids[z + 1, y + ghosts], rho[z, y], u[z, y]
            for x in range(density.size):
                fluid = solid[x + 1] == FLUID
                density[x] = 1.0 + lines[0, x] if fluid else 1.0
                for c in range(d):
                    velocity[x, c] = (lines[1 + c, x] + half[c]) / density[x] if fluid else 0.0


@njit
def row_sums(f, ids, ghosts, strides, slots, shifts, e, half, parity, low, high, sums, fastest):
    """sums[plane, row] = fluid nodes, their sum of h, momentum (with half the force), rho u^2, last component of u; and
    fastest[plane, row] = largest u^2. A row is summed in the order of its nodes, so that no decomposition shows."""
    d = e.shape[1]
    lines = np.empty((1 + d, strides[2]))[:, : ids.shape[2] - 2]
    for z in range(low, high):
        for y in range(sums.shape[1]):
            gather(f, strides, slots, shifts, e, parity, z, y, lines)
            solid, row = ids[z + 1, y + ghosts], sums[z, y]
            row[:] = 0.0
            largest = 0.0
            for x in range(lines.shape[1]):
                if solid[x + 1] != FLUID:
                    continue
                rho, square, momentum = 1.0 + lines[0, x], 0.0, 0.0
                row[0] += 1.0
                row[1] += lines[0, x]
                for c in range(d):
                    momentum = lines[1 + c, x] + half[c]
                    row[2 + c] += momentum
                    square += momentum * momentum
                row[2 + d] += square / rho
                row[3 + d] += momentum / rho
                largest = max(largest, square / (rho * rho)) if square == square else np.inf
            fastest[z, y] = largest


@njit
def excesses(f, strides, slots, shifts, parity, nodes, excess):
    """excess[m] = rho - 1 at nodes[m, 3] (plane, row, x)."""
    for k in range(excess.size):
        total = 0.0
        for i in range(shifts.shape[0]):
            total += f[arrival(strides, slots, shifts, parity, nodes[k, 0], nodes[k, 1], nodes[k, 2], i)]
        excess[k] = total


@njit
def read(f, ids, ghosts, strides, slots, shifts, parity, low, high, h):
    """h[plane, row, x, i] of planes low..; 0 in solid nodes."""
    for z in range(low, high):
        for y in range(h.shape[1]):
            solid, target = ids[z + 1, y + ghosts], h[z, y]
            for i in range(h.shape[3]):
                start = arrival(strides, slots, shifts, parity, z, y, 0, i)
                for x in range(h.shape[2]):
                    target[x, i] = f[start + x] if solid[x + 1] == FLUID else 0


@njit
def write(f, strides, slots, shifts, parity, low, high, h):
    """The inverse of `read`."""
    for z in range(low, high):
        for y in range(h.shape[1]):
            for i in range(h.shape[3]):
                start = arrival(strides, slots, shifts, parity, z, y, 0, i)
                for x in range(h.shape[2]):
                    f[start + x] = h[z, y, x, i]
