"""What the six (four) faces of the box are: periodic, walls at rest or moving, given pressure or velocity."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound
from lbmdem.fluid.sparse import SparseLayout
from lbmdem.kernels.layout import WALL, storage_order
from lbmdem.kernels.open_faces import LayerNodes, find_places, push_walls, zou_he
from lbmdem.layout import Layout, addresses

KINDS = ("periodic", "wall", "pressure", "velocity")


@dataclass(frozen=True)
class Face:
    """One face, lattice units: density of a pressure face (p = density/3), velocity in physical order (x, y, z).

    A wall is half-way between the last node and the first one outside; pressure and velocity hold at the last nodes.
    A pressure face takes the velocity along the face from `velocity`, a wall the whole of it.
    """

    kind: str
    density: Any = 1.0
    velocity: Any = (0.0, 0.0, 0.0)


def face_names(dimensions: int) -> list[str]:
    return [axis + side for axis in "xyz"[:dimensions] for side in "-+"]


def complete(faces: Mapping[str, Face], dimensions: int, periodic: tuple[bool, ...]) -> dict[str, Face]:
    """All faces by name; an axis is periodic (storage order) if and only if both its faces are. ValueError else."""
    names = face_names(dimensions)
    if unknown := set(faces) - set(names):
        raise ValueError(f"no such face: {', '.join(sorted(unknown))}")
    whole: dict[str, Face] = {}
    for name in names:
        wraps = periodic[axis_of(name, dimensions)]
        face = whole[name] = faces.get(name, Face("periodic" if wraps else "wall"))
        if face.kind not in KINDS:
            raise ValueError(f"face {name} is {face.kind}, not one of {', '.join(KINDS)}")
        if (face.kind == "periodic") != wraps:
            raise ValueError(f"face {name} is {face.kind}, but its axis is {'' if wraps else 'not '}periodic")
    return whole


def axis_of(name: str, dimensions: int) -> int:
    """Storage axis of a face."""
    return dimensions - 1 - "xyz".index(name[0])


def wall_ends(
    faces: Mapping[str, Face], layout: Layout | SparseLayout, touches: tuple[bool, bool]
) -> NDArray[np.int64]:
    """[first, last + 1) node of each of the axes (plane, row, x) of this rank that is not beyond a wall."""
    far, flat = 1 << 40, layout.lattice.dimensions == 2
    ends = np.array([[-far, far]] * 3, np.int64)
    for name, face in faces.items():
        axis, upper = {"x": 2, "y": 0 if flat else 1, "z": 0}[name[0]], name[1] == "+"
        if face.kind == "wall" and (axis or touches[upper]):
            ends[axis, int(upper)] = (layout.planes, layout.rows, layout.nx)[axis] if upper else 0
    return ends


@dataclass(frozen=True)
class Slab:
    """What a layer works on: a layout, whether the slab touches the lower and the upper end of the box, and an arena of
    populations `f`, ids `solid` of nodes with ghosts, ends of walls `others` (`wall_ends`), and shift[3], the part of
    the force in the momentum (storage order).
    """

    layout: Layout | SparseLayout
    touches: tuple[bool, bool]
    arena: Arena


class Layer:
    """The last nodes inside one face, on this rank, and the tasks that give them what arrives from outside.

    values[plane, row, x, 4] = density - 1 and velocity in storage order, of the nodes; they may change between steps.
    """

    def __init__(self, slab: Slab, name: str, face: Face) -> None:
        layout, lattice = slab.layout, slab.layout.lattice
        dimensions = lattice.dimensions
        self.face, self.name, self._dimensions = face, name, dimensions
        self.axis = axis_of(name, dimensions) + (dimensions == 2 and name[0] == "x")  # of (plane, row, x)
        self.side = 1 if name[1] == "+" else -1
        extent = (layout.planes, layout.rows, layout.nx)
        self.low, self.high = np.zeros(3, np.int64), np.array(extent, np.int64)
        at = extent[self.axis] - 1 if self.side > 0 else 0
        self.low[self.axis], self.high[self.axis] = at, at + 1
        if self.axis == 0 and not slab.touches[self.side > 0]:
            self.high[0] = self.low[0] = 0
        self.values = np.zeros((*np.maximum(self.high - self.low, 0), 4), slab.arena["f"].dtype)
        self.set(face.density, face.velocity)
        kernel = push_walls if face.kind == "wall" else zou_he
        e = np.array([storage_order(lattice, i) for i in range(lattice.q)], np.int64)
        self._places = np.zeros((2, *self.values.shape[:3], lattice.q), np.int64)
        for parity, places in enumerate(self._places):
            find_places(addresses(layout), parity, self.low, self.high, places)
        given = {} if face.kind == "wall" else {"given": int(face.kind == "velocity")}
        arena, ghosts, weights = slab.arena, int(dimensions == 3), lattice.w

        def bound(places: NDArray, low: NDArray, high: NDArray, values: NDArray) -> Bound:
            nodes = LayerNodes(arena["solid"], ghosts, places, e, weights, low, high, self.axis, self.side)
            return arena.bind(kernel, layer=nodes, values=values, **given)

        self._bind = bound
        self.tasks = [self.of_planes(parity, 0, layout.planes) for parity in range(2)]

    def of_planes(self, parity: int, low: int, high: int) -> list[Bound]:
        """The task on the arrivals at a parity of the layer's nodes in some planes; none without nodes."""
        first, last = max(low, int(self.low[0])), min(high, int(self.high[0]))
        if first >= last or not self.values.size:
            return []
        ends = self.low.copy(), self.high.copy()
        ends[0][0], ends[1][0] = first, last
        planes = slice(first - self.low[0], last - self.low[0])
        return [self._bind(self._places[parity, planes], *ends, self.values[planes])]

    def set(self, density: Any = None, velocity: Any = None) -> None:
        """Numbers, or arrays of the layer's own nodes [storage order without the face's axis] (velocity [..., d])."""
        if density is not None:
            self.values[..., 0] = self._spread(np.asarray(density, float)) - 1.0
        if velocity is not None:
            for k, component in enumerate(np.moveaxis(np.asarray(velocity, float), -1, 0)[: self._dimensions]):
                self.values[..., 1 + (2, 1 if self._dimensions == 3 else 0, 0)[k]] = self._spread(component)

    def _spread(self, numbers: NDArray) -> NDArray:
        if numbers.ndim == 0:
            return numbers
        shape = [n for axis, n in enumerate(self.values.shape[:3]) if axis != self.axis]
        flat = numbers.reshape(shape)
        return np.expand_dims(flat, self.axis)


def wall_ghosts(solid: NDArray[np.int32], faces: Mapping[str, Face], touches: tuple[bool, bool]) -> None:
    """Ghost nodes beyond walls are WALL, beyond other faces of the box what Fill left there (fluid)."""
    dimensions = solid.ndim
    for name, face in faces.items():
        axis, side = axis_of(name, dimensions), name[1] == "+"
        if face.kind == "wall" and (axis or touches[side]):
            layer = [slice(None)] * dimensions
            layer[axis] = slice(-1, None) if side else slice(0, 1)
            solid[tuple(layer)] = WALL
