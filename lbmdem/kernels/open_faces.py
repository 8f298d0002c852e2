"""Faces of the box on their last layer of nodes: moving walls, and pressure or velocity after Zou & He (1997)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import zeros
from lbmdem.kernels.layout import FLUID, element


class LayerNodes(NamedTuple):
    """The layer of nodes low..high at the face on `side` (+1, -1) of storage axis `axis`, in the order of storage.

    solid: ids with ghosts, `ghosts` rows of them outside; places[plane, row, x, q]: elements of populations; e[q, 3]
    and weights[q] of the lattice.
    """

    solid: NDArray[np.int32]
    ghosts: int
    places: NDArray[np.int64]
    e: NDArray[np.int64]
    weights: NDArray[np.float64]
    low: NDArray[np.int64]
    high: NDArray[np.int64]
    axis: int
    side: int


@njit
def find_places(addresses, parity, low, high, places):
    """places[plane, row, x, i] = the element of f_i at the nodes low..high; 0 at those without one."""
    strides, slots, shifts, positions = addresses
    for z in range(low[0], high[0]):
        for y in range(low[1], high[1]):
            for x in range(low[2], high[2]):
                if positions.shape[0] == 0 or positions[z + 1, y + strides[1], x + 1] >= 0:
                    for i in range(places.shape[3]):
                        place = element(strides, slots, shifts, positions, parity, z, y, x, i)
                        places[z - low[0], y - low[1], x - low[2], i] = place


@njit
def push_walls(f, layer, others, values):
    """Half-way walls that move (Ladd 1994): 6 w (e.u) less arrives from a population that went to the wall.

    others[3, 2]: where the box ends in walls, whose corners stay at rest; values[plane, row, x, 1:] the layer's
    velocity. Density 1, so that a sliding wall adds exactly no mass.
    """
    solid, ghosts, places, e, weights, low, high, axis, side = layer
    for z in range(low[0], high[0]):
        for y in range(low[1], high[1]):
            for x in range(low[2], high[2]):
                if solid[z + 1, y + ghosts, x + 1] != FLUID:
                    continue
                u = values[z - low[0], y - low[1], x - low[2], 1:]
                for i in range(1, weights.size):
                    if e[i, axis] != side:
                        continue
                    node = (z + e[i, 0], y + e[i, 1], x + e[i, 2])
                    alone = True
                    for a in range(3):
                        if a != axis and (node[a] < others[a, 0] or node[a] >= others[a, 1]):
                            alone = False
                    if alone:
                        j = i + 1 if i % 2 else i - 1
                        along = e[i, 0] * u[0] + e[i, 1] * u[1] + e[i, 2] * u[2]
                        f[places[z - low[0], y - low[1], x - low[2], j]] -= 6.0 * weights[i] * along


@njit
def zou_he(f, layer, shift, given, values):
    """What arrives from beyond a layer so that it has a density or a velocity (Zou & He; 3D: Hecht & Harting 2010).

    values[plane, row, x, 4]: density - 1 and velocity (storage order) of the layer's nodes; given 0: the density counts
    and the velocity along the face, 1: the velocity counts. shift[3]: the part of the force in the momentum. Unknown
    are the populations against `side`; the opposite ones are reflected, and corrected along the face.
    """
    solid, ghosts, places, e, weights, low, high, axis, side = layer
    h, momentum = zeros(weights.size, np.float64), zeros(3, np.float64)
    for z in range(low[0], high[0]):
        for y in range(low[1], high[1]):
            for x in range(low[2], high[2]):
                if solid[z + 1, y + ghosts, x + 1] == FLUID:
                    here = values[z - low[0], y - low[1], x - low[2]]
                    place = places[z - low[0], y - low[1], x - low[2]]
                    open_node(f, place, here, e, weights, axis, side, shift, given, h, momentum)


@njit
def open_node(f, place, here, e, weights, axis, side, shift, given, h, momentum):
    """One node of `zou_he`, with room for its populations h[q] and its momentum[3]."""
    leaving, tangent_0, tangent_1 = 0.0, 0.0, 0.0
    a, b = (axis + 1) % 3, (axis + 2) % 3
    for i in range(h.size):
        h[i] = f[place[i]]
        if e[i, axis] == 0:
            leaving += h[i]
            tangent_0 += e[i, a] * h[i]
            tangent_1 += e[i, b] * h[i]
        elif e[i, axis] == side:
            leaving += 2.0 * h[i]
    if given == 0:
        excess = here[0]
    else:
        wanted = -side * here[1 + axis]
        half = -side * shift[axis]
        excess = (1.0 + leaving - half) / (1.0 - wanted) - 1.0
    rho = 1.0 + excess
    momentum[axis] = -side * (excess - leaving)
    momentum[a] = rho * here[1 + a] - shift[a]
    momentum[b] = rho * here[1 + b] - shift[b]
    fix_a = 0.5 * (momentum[a] * (2.0 / 3.0) - tangent_0)
    fix_b = 0.5 * (momentum[b] * (2.0 / 3.0) - tangent_1)
    for i in range(1, h.size):
        if e[i, axis] == -side:
            j = i + 1 if i % 2 else i - 1
            along = e[i, 0] * momentum[0] + e[i, 1] * momentum[1] + e[i, 2] * momentum[2]
            new = h[j] + 6.0 * weights[i] * along + e[i, a] * fix_a + e[i, b] * fix_b
            f[place[i]] = new
