"""Links that stay: walls of any form and grains that do not move; found once, with the weights of their rule.

For each fluid node with a solid node in direction i the wall is crossed at the fraction q of the link; the rules are in
`lbmdem.physics.wall_rules`.
"""

from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import ConfigError
from hpcpic.core.space.domain import block_ranges
from hpcpic.core.tasks.graph import Bound, Pool, bind
from lbmdem.fluid.solid_nodes import Window, kernel_axes
from lbmdem.fluid.sparse import SparseLayout, Tables
from lbmdem.fluid.surfaces import NODES, Bodies, Surfaces, ids_at
from lbmdem.kernels import links as kernels
from lbmdem.kernels.layout import FLUID, Layout
from lbmdem.physics.velocity_sets import Lattice
from lbmdem.physics.wall_rules import RULES, WallRule

GAINS = 7  # of a body from its links: force, torque, and the mass that the fluid gains


def rule_in(window: Window, name: str) -> WallRule:
    """The wall rule of this name, when the slab has all the nodes that it reads."""
    rule = RULES[name]
    if rule.reach > 1 and not window.whole:
        raise ConfigError(f"the {name} rule reads two nodes beyond a slab: it works on one rank only")
    return rule


class Directions:
    """A lattice in the order of axes of the kernels: e[q, 3] (x, row, plane), 6 w, opposite."""

    def __init__(self, lattice: Lattice) -> None:
        self.e = np.rint(kernel_axes(lattice.e)).astype(np.int64)
        self.opposite = lattice.opposite
        self.w6 = 6.0 * lattice.w


class _Part(SimpleNamespace):
    """Arrays of `FixedLinks` of some planes; plane: of each segment."""


class FixedLinks:
    """Links of a slab in the order (plane, direction, node), with what the kernels need of each.

    nodes[parity] (elements in a slot of the three that a link reads), body, weights[n, 0, 1 or 3], wall (term taken
    off), arm[n, 3] from the centre of the body to the crossing, speed[n, 3] of the wall there; wall and speed have no
    length when nothing moves. Segments: start, offsets[parity, segment, 3], direction and way[segment, 3]; planes[p]:
    first segment of the own plane p. fallbacks: links without the fluid nodes that their rule reads.
    """

    def __init__(
        self,
        window: Window,
        layout: Layout | SparseLayout,
        solid: NDArray[np.int32],
        bodies: Bodies,
        rule: str = "cli",
    ) -> None:
        self.directions = Directions(layout.lattice)
        self.bodies = bodies
        self._rule = rule_in(window, rule)
        self._window, self._layout = window, layout
        self._solid = solid.reshape(tuple(window.shape[::-1]))
        self._surfaces = Surfaces(window, self._solid, bodies, self.directions.e, layout.lattice.dimensions)
        fluid = self._inner(self._solid) == FLUID
        self._sizes = np.array(fluid.shape[::-1])
        step = max(1, NODES // max(1, fluid[:1].size))
        self._join([self._part(fluid, low, low + step) for low in range(0, max(1, len(fluid)), step)])

    def _part(self, fluid: NDArray[np.bool_], low: int, high: int) -> "_Part":
        """Links of the planes low .. high - 1."""
        nodes = np.argwhere(fluid[low:high])[:, ::-1].copy()  # (x, row, plane), in the order of memory
        nodes[:, 2] += low
        local, way, body, q, arm, speed = self._surfaces.crossings(nodes)
        order = np.lexsort((local[:, 0], local[:, 1], way, local[:, 2]))
        local, way, q, speed = local[order], way[order], q[order], speed[order]
        part = _Part(body=body[order].astype(np.int32), arm=arm[order], speed=speed)
        self._segments(part, local, way)
        self._weigh(part, local, way, q)
        return part

    def _join(self, parts: list["_Part"]) -> None:
        """One after the other; what no link needs is left out. An array at a time, as each is there twice meanwhile."""
        still = not any(part.speed.any() for part in parts)

        def joined(name: str, axis: int = 0, keep: bool = True) -> NDArray:
            values = [getattr(part, name)[: None if keep else 0] for part in parts]
            for part in parts:
                delattr(part, name)
            return np.ascontiguousarray(np.concatenate(values, axis=axis))

        self.fallbacks = sum(part.fallbacks for part in parts)
        self.far = self.far_weights = None
        if self._rule.reach == 2:
            self.far, self.far_weights = joined("far", 1), joined("far_weights")
        self.wall = joined("wall", keep=not still or self.far is not None)
        self.speed, self.arm = joined("speed", keep=not still), joined("arm")
        self.weights, self.body, node = joined("weights"), joined("body"), joined("node")
        self.nodes = [[node] * 3] * 2
        if isinstance(self._layout, SparseLayout):  # what came from y is at x if the step was odd; else still at y
            behind = joined("behind")
            self.nodes = [[node, node, behind], [node, behind, node]]
        self.offsets, self.direction = joined("offsets", 1), joined("direction")
        self.way = self.directions.e[self.direction].astype(np.float64)
        ends = np.cumsum([0, *(part.start[-1] for part in parts)])
        starts = [part.start[:-1] + end for part, end in zip(parts, ends)]
        self.start = np.concatenate((*starts, ends[-1:])).astype(np.int64)
        own = np.arange(self._layout.planes + 1)
        self.planes = np.searchsorted(joined("plane"), own).astype(np.int64)

    @property
    def count(self) -> int:
        return int(self.start[-1])

    @property
    def simple(self) -> bool:
        """Whether the sweep of fluid nodes alone can do them (kernels.sparse)."""
        return self._rule.numbers <= 1 and not self.wall.size

    @property
    def quiet(self) -> bool:
        """Whether the sweep has bounced all back: half-way, from what is at rest."""
        return not self.weights.shape[1] and not self.wall.size

    def bind(self, f: NDArray, blocks: int) -> None:
        """Make the tasks on the populations, `blocks` of them at most."""
        self._f = f
        shares = [share for share in block_ranges(len(self.way), blocks) if share[1] > share[0]]
        self._sums = np.zeros((len(shares), len(self.bodies), GAINS), np.int64)
        self._scale = np.ones(GAINS)
        wall = self.wall if self.far is None else np.zeros(self.count)
        self._kept = np.zeros((2, self.count, 2))
        self._tasks: list[list[list[Bound]]] = []
        for parity in range(2):
            links = (f, self.offsets[parity], self.start, *self.nodes[parity], self.weights, wall)
            body = (self.way, self.body, self.arm, self.speed)
            kept, far, bounced, summed = self._kept[parity], [], [], []
            for sums, share in zip(self._sums, shares):
                if self.far is not None:
                    there = (self.far[parity], self.far_weights, self.wall)
                    far.append(bind(kernels.far_terms, f, self.start, *there, *share, wall))
                bounced.append(bind(kernels.fixed_links, *links, *share, kept))
                summed.append(bind(kernels.momentum, kept, self.start, *body, *share, sums, self._scale))
            self._tasks.append([far, bounced, summed])

    def of_planes(self, parity: int, low: int, high: int, keep: bool) -> list[Bound]:
        """The task that bounces back at own planes from, to; not for the quadratic rule. keep: for `gains`."""
        first, last = int(self.planes[low]), int(self.planes[high])
        if last == first or (self.quiet and not keep):
            return []
        links = (self.offsets[parity], self.start, *self.nodes[parity], self.weights, self.wall)
        kept = self._kept[parity] if keep else np.zeros((0, 2))
        return [bind(kernels.fixed_links, self._f, *links, first, last, kept)]

    def hand_over(self, tables: Tables, low: int, high: int) -> None:
        """Let the sweep apply the rule in own planes from, to; `simple` ones."""
        a, b = self.planes[low], self.planes[high]
        links = slice(self.start[a], self.start[b] if self.weights.shape[1] else self.start[a])
        vector, lane = np.divmod(self.nodes[0][0][links].astype(np.int64), self._layout.lanes)
        way = np.repeat(self.direction[a:b], np.diff(self.start[a : b + 1]))[: len(lane)] - 1
        ruled = np.zeros(tables.masks.shape[:2], tables.masks.dtype)
        np.bitwise_or.at(ruled, (vector, way), (1 << lane).astype(ruled.dtype))
        order = np.lexsort((lane, way, vector))
        kappa = np.append(self.weights[links].reshape(-1)[order], 0).astype(self.weights.dtype)
        tables.link_with(ruled, kappa, np.searchsorted(vector[order], np.arange(len(ruled) + 1)).astype(np.int64))

    def finish(self, parity: int, low: int, high: int, parts: int) -> list[Bound]:
        """Tasks that complete what the sweep has left open in these planes, for arrivals at `parity`."""
        links = (self._f, self.offsets[parity], self.start, *self.nodes[parity][:2], self.weights)
        a, b = int(self.planes[low]), int(self.planes[high])
        shares = block_ranges(b - a if self.weights.shape[1] else 0, parts)
        return [bind(kernels.finish_links, *links, a + first, a + last) for first, last in shares if last > first]

    def run(self, pool: Pool, parity: int) -> None:
        """Bounce back; arrivals are at `parity`."""
        far, bounced, _ = self._tasks[parity]
        for tasks in (far, bounced):
            if tasks:
                pool.each(tasks)

    def gains(self, pool: Pool, parity: int, scale: NDArray[np.float64]) -> NDArray[np.int64]:
        """Gains of links last kept at this parity: force, torque, mass that the fluid gains, [bodies, 7] of 1 /
        scale[7].
        """
        self._scale[:] = scale
        self._sums[...] = 0
        summed = self._tasks[parity][2]
        if summed:
            pool.each(summed)
        return self._sums.sum(axis=0)

    def _inner(self, values: NDArray) -> NDArray:
        return values[tuple(slice(*self._window.inner[a]) for a in (2, 1, 0))]

    def _id_at(self, local: NDArray[np.int64]) -> NDArray[np.int32]:
        return ids_at(self._window, self._solid, local)

    def _segments(self, part: "_Part", local: NDArray, way: NDArray) -> None:
        """Where the plane, the direction or the distance to the paired node changes, a segment starts."""
        up = np.where(way % 2 == 1, 1, -1)[:, None] * self.directions.e[way]
        sparse, narrow = isinstance(self._layout, SparseLayout), self._layout.slot_stride < 1 << 31
        node = self._layout.places(local)
        there = np.zeros_like(node) if sparse else self._layout.places(local + up) - node
        part.node = node.astype(np.int32 if narrow else np.int64)
        changes = np.diff(local[:, 2]) | np.diff(way) | np.diff(there)
        first = np.flatnonzero(np.concatenate(([len(way) > 0], changes != 0))[: len(way)])
        part.start = np.append(first, len(way)).astype(np.int64)
        i, j = way[first], self.directions.opposite[way[first]]
        out = np.where(i % 2 == 1, there[first], 0)
        others = there[first] - out
        slots = self._layout.slots * self._layout.slot_stride
        places = [slots[:, j] + out, slots[:, i] + others, slots[:, j] + others]
        if sparse:
            behind = self._layout.places(local - self.directions.e[way])
            part.behind = np.where(behind < 0, node, behind).astype(part.node.dtype)
            places[0] = slots[[0, 0]][:, j]
        part.offsets = np.array(np.stack(places, axis=-1), order="C")
        part.direction, part.plane = i, local[first, 2]

    def _weigh(self, part: "_Part", local: NDArray, way: NDArray, q: NDArray) -> None:
        """The weights of the rule, or of the lower one for which there are enough fluid nodes."""
        e, reach = self.directions.e[way], self._rule.reach
        box = self._window.box - self._window.inner[:, :1]
        inside = np.all((local - e >= box[:, 0]) & (local - e < box[:, 1]), axis=1)
        behind = ((self._id_at(local - e) == FLUID) & inside).astype(np.int64)
        if reach == 2:
            y = np.mod(local - e, self._sizes)
            behind[(behind == 1) & (self._id_at(y - e) == FLUID)] = 2
            z = np.mod(y - e, self._sizes)
            arrivals = (self._arrival(y, way), self._arrival(z, self.directions.opposite[way]))
            part.far = np.array(np.stack(arrivals, axis=-1), order="C")
        behind = np.minimum(behind, reach)
        part.fallbacks = int(np.count_nonzero(behind < reach))
        table = np.empty((len(q), 6))
        kernels.weigh(self._rule.number, q, behind, table)
        columns = (slice(0), slice(1, 2), None, slice(3))[self._rule.numbers]
        part.weights = (table[:, :3] - np.array([1.0, 0.0, 0.0]))[:, columns].copy()
        if self._rule.numbers == 1 and self._layout.itemsize == 4:  # as the sweep computes with them
            part.weights = part.weights.astype(np.float32)
        part.far_weights = table[:, 3:5].copy()
        part.wall = table[:, 5] * self.directions.w6[way] * np.sum(e * part.speed, axis=1)

    def _arrival(self, local: NDArray[np.int64], way: NDArray[np.int64]) -> NDArray[np.int64]:
        """[parity, n]: elements of the array where directions arrive at own nodes."""
        shift = np.where(way % 2 == 1, 0, 1)[:, None] * self.directions.e[self.directions.opposite[way]]
        return self._layout.slots[:, way] * self._layout.slot_stride + self._layout.places(local + shift)
