"""Links that stay: walls of any form and grains that do not move; found once, with the weights of their rule.

For each fluid node with a solid node in direction i the wall is crossed at the fraction q of the link; the rules are in
`lbmdem.physics.wall_rules`.
"""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import ConfigError
from hpcpic.core.space.domain import block_ranges
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound, Pool
from lbmdem.fluid import arrays
from lbmdem.fluid.solid_nodes import Window, kernel_axes
from lbmdem.fluid.sparse import SparseLayout
from lbmdem.fluid.surfaces import NODES, Bodies, Surfaces, ids_at
from lbmdem.kernels import links as kernels
from lbmdem.kernels.layout import FLUID, Layout
from lbmdem.layout import place_type
from lbmdem.physics.velocity_sets import Lattice
from lbmdem.physics.wall_rules import RULES, WallRule


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


class FixedLinks:
    """Links of a slab in the order (plane, direction, node), with what the kernels need of each.

    The arrays of `arena` are those of `fluid.arrays.fixed_links`. planes[p]: first segment of the own plane p.
    fallbacks: links without the fluid nodes that their rule reads. f: the populations; blocks: of tasks, at most.
    """

    def __init__(
        self,
        window: Window,
        layout: Layout | SparseLayout,
        f: NDArray,
        solid: NDArray[np.int32],
        bodies: Bodies,
        rule: str = "cli",
        blocks: int = 1,
    ) -> None:
        self.directions = Directions(layout.lattice)
        self.bodies = bodies
        self._rule = rule_in(window, rule)
        self._window, self._layout = window, layout
        self._sparse = isinstance(layout, SparseLayout)
        self._real, self._place = f.dtype.name, place_type(layout.slot_stride)
        self._solid = solid.reshape(tuple(window.shape[::-1]))
        self._surfaces = Surfaces(window, self._solid, bodies, self.directions.e, layout.lattice.dimensions)
        fluid = self._inner(self._solid) == FLUID
        self._sizes = np.array(fluid.shape[::-1])
        step = max(1, NODES // max(1, fluid[:1].size))
        parts = [self._part(fluid, low, low + step) for low in range(0, max(1, len(fluid)), step)]
        self.fallbacks = sum(int(part.pop("fallbacks")) for part in parts)
        self._join(parts, blocks)
        self.arena.set(f=f)
        self._tasks = [self._bind(parity) for parity in range(2)]

    def _part(self, fluid: NDArray[np.bool_], low: int, high: int) -> dict[str, NDArray]:
        """Arrays of the links of the planes low .. high - 1, by name; plane: of each segment."""
        nodes = np.argwhere(fluid[low:high])[:, ::-1].copy()  # (x, row, plane), in the order of memory
        nodes[:, 2] += low
        local, way, body, q, arm, speed = self._surfaces.crossings(nodes)
        order = np.lexsort((local[:, 0], local[:, 1], way, local[:, 2]))
        local, way, q, speed = local[order], way[order], q[order], speed[order]
        part: dict[str, NDArray] = {"body": body[order].astype(np.int32), "arm": arm[order], "speed": speed}
        return part | self._segments(local, way) | self._weigh(local, way, q, speed)

    def _join(self, parts: list[dict[str, NDArray]], blocks: int) -> None:
        """One after the other; what no link needs is left out. An array at a time, as each is there twice meanwhile."""
        layout, moved = self._layout, any(part["speed"].any() for part in parts)
        ends = np.cumsum([0, *(part["start"][-1] for part in parts)])
        segments = sum(len(part["plane"]) for part in parts)
        self._shares = [share for share in block_ranges(segments, blocks) if share[1] > share[0]]
        self.arena = arena = Arena(
            arrays.fixed_links(self._rule, self._real, self._place, sparse=self._sparse, moved=moved),
            links=int(ends[-1]), segments=segments, ends=segments + 1,
            bodies=len(self.bodies), shares=len(self._shares),
        )  # fmt: skip
        own = np.arange(layout.planes + 1)
        self.planes = np.searchsorted(np.concatenate([part.pop("plane") for part in parts]), own).astype(np.int64)
        arena["start"][-1] = ends[-1]
        np.concatenate([part.pop("start")[:-1] + end for part, end in zip(parts, ends)], out=arena["start"][:-1])
        for name in list(parts[0]):
            values, target = [part.pop(name) for part in parts], arena[name]
            if target.size:
                np.concatenate(values, axis=1 if name in ("offsets", "far") else 0, out=target, casting="unsafe")
        arena["way"][...] = self.directions.e[arena["direction"]]

    @property
    def count(self) -> int:
        return int(self.arena.sizes["links"])

    @property
    def arm(self) -> NDArray[np.float64]:
        """Vectors [n, 3] from the centres of the bodies to the crossings, nodes."""
        return self.arena["arm"]

    @property
    def reads_further(self) -> bool:
        """Whether the rule reads two nodes behind a link, which cannot be done plane by plane."""
        return self._rule.reach == 2

    @property
    def simple(self) -> bool:
        """Whether the sweep of fluid nodes alone can do them (kernels.sparse)."""
        return self._rule.numbers <= 1 and not self.arena["wall"].size

    @property
    def quiet(self) -> bool:
        """Whether the sweep has bounced all back: half-way, from what is at rest."""
        return not self._rule.numbers and not self.arena["wall"].size

    def _links(self, parity: int) -> dict[str, NDArray | str]:
        """Arguments of the kernels at a parity: what came from the node behind is at the node itself if the step was
        odd, and where fluid nodes alone are held still at the one behind if it was even.
        """
        behind = "behind" if self._sparse else "node"
        return {
            "offsets": self.arena["offsets"][parity],
            "node_b": behind if parity else "node",
            "node_c": "node" if parity else behind,
        }

    def _bind(self, parity: int) -> list[list[Bound]]:
        """Tasks on all links: terms from further behind, bounce back, sums of momentum."""
        bind, kept, links = self.arena.bind, self.arena["kept"][parity], self._links(parity)
        far, bounced, summed = [], [], []
        for sums, (low, high) in zip(self.arena["sums"], self._shares):
            part = {"low": low, "high": high}
            if self.reads_further:
                far.append(bind(kernels.far_terms, far=self.arena["far"][parity], **part))
            wall = "wall_now" if self.reads_further else "wall"
            bounced.append(bind(kernels.fixed_links, kept=kept, wall=wall, **links, **part))
            summed.append(bind(kernels.momentum, kept=kept, sums=sums, **part))
        return [far, bounced, summed]

    def of_planes(self, parity: int, low: int, high: int, keep: bool) -> list[Bound]:
        """The task that bounces back at own planes from, to; not for the quadratic rule. keep: for `gains`."""
        first, last = int(self.planes[low]), int(self.planes[high])
        if last == first or (self.quiet and not keep):
            return []
        kept = self.arena["kept"][parity] if keep else np.zeros((0, 2))
        return [self.arena.bind(kernels.fixed_links, low=first, high=last, kept=kept, **self._links(parity))]

    def hand_over(self, tables: Arena, low: int, high: int) -> None:
        """Let the sweep with these tables (fluid.sparse) apply the rule in own planes from, to; `simple` ones."""
        a, b = self.planes[low], self.planes[high]
        start, weights = self.arena["start"], self.arena["weights"]
        links = slice(start[a], start[b] if weights.shape[1] else start[a])
        vector, lane = np.divmod(self.arena["node"][links].astype(np.int64), self._layout.lanes)
        way = np.repeat(self.arena["direction"][a:b], np.diff(start[a : b + 1]))[: len(lane)] - 1
        ruled = np.zeros(tables["masks"].shape[:2], tables["masks"].dtype)
        np.bitwise_or.at(ruled, (vector, way), (1 << lane).astype(ruled.dtype))
        order = np.lexsort((lane, way, vector))
        kappa = np.append(weights[links].reshape(-1)[order], 0).astype(tables["kappa"].dtype)
        linked = np.searchsorted(vector[order], np.arange(len(ruled) + 1)).astype(np.int64)
        tables.set(ruled=ruled, kappa=kappa, linked=linked)

    def finish(self, parity: int, low: int, high: int, parts: int) -> list[Bound]:
        """Tasks that complete what the sweep has left open in these planes, for arrivals at `parity`."""
        links = self._links(parity)
        del links["node_c"]
        a, b = int(self.planes[low]), int(self.planes[high])
        shares = block_ranges(b - a if self._rule.numbers else 0, parts)
        kernel, bind = kernels.finish_links, self.arena.bind
        return [bind(kernel, low=a + first, high=a + last, **links) for first, last in shares if last > first]

    def run(self, pool: Pool, parity: int) -> None:
        """Bounce back; arrivals are at `parity`."""
        far, bounced, _ = self._tasks[parity]
        pool.each(far)
        pool.each(bounced)

    def gains(self, pool: Pool, parity: int, scale: NDArray[np.float64]) -> NDArray[np.int64]:
        """Gains of links last kept at this parity: force, torque, mass that the fluid gains, [bodies, 7] of 1 /
        scale[7].
        """
        sums = self.arena["sums"]
        self.arena["scale"][:], sums[...] = scale, 0
        pool.each(self._tasks[parity][2])
        return sums.sum(axis=0)

    def _inner(self, values: NDArray) -> NDArray:
        return values[tuple(slice(*self._window.inner[a]) for a in (2, 1, 0))]

    def _id_at(self, local: NDArray[np.int64]) -> NDArray[np.int32]:
        return ids_at(self._window, self._solid, local)

    def _segments(self, local: NDArray, way: NDArray) -> dict[str, NDArray]:
        """Where the plane, the direction or the distance to the paired node changes, a segment starts."""
        up = np.where(way % 2 == 1, 1, -1)[:, None] * self.directions.e[way]
        node = self._layout.places(local)
        there = np.zeros_like(node) if self._sparse else self._layout.places(local + up) - node
        changes = np.diff(local[:, 2]) | np.diff(way) | np.diff(there)
        first = np.flatnonzero(np.concatenate(([len(way) > 0], changes != 0))[: len(way)])
        i, j = way[first], self.directions.opposite[way[first]]
        out = np.where(i % 2 == 1, there[first], 0)
        others = there[first] - out
        slots = self._layout.slots * self._layout.slot_stride
        places = [slots[:, j] + out, slots[:, i] + others, slots[:, j] + others]
        behind = node[:0]
        if self._sparse:
            behind = self._layout.places(local - self.directions.e[way])
            behind = np.where(behind < 0, node, behind)
            places[0] = slots[[0, 0]][:, j]
        return {
            "node": node.astype(self._place), "behind": behind.astype(self._place),
            "plane": local[first, 2], "direction": i, "start": np.append(first, len(way)),
            "offsets": np.stack(places, axis=-1),
        }  # fmt: skip

    def _weigh(self, local: NDArray, way: NDArray, q: NDArray, speed: NDArray) -> dict[str, NDArray]:
        """The weights of the rule, or of the lower one for which there are enough fluid nodes."""
        e, reach = self.directions.e[way], self._rule.reach
        part: dict[str, NDArray] = {}
        box = self._window.box - self._window.inner[:, :1]
        inside = np.all((local - e >= box[:, 0]) & (local - e < box[:, 1]), axis=1)
        behind = ((self._id_at(local - e) == FLUID) & inside).astype(np.int64)
        if self.reads_further:
            y = np.mod(local - e, self._sizes)
            behind[(behind == 1) & (self._id_at(y - e) == FLUID)] = 2
            z = np.mod(y - e, self._sizes)
            arrivals = (self._arrival(y, way), self._arrival(z, self.directions.opposite[way]))
            part["far"] = np.stack(arrivals, axis=-1)
        behind = np.minimum(behind, reach)
        table = np.empty((len(q), 6))
        if len(q):  # else it would be compiled for nothing
            kernels.weigh(self._rule.number, q, behind, table)
        columns = (slice(0), slice(1, 2), None, slice(3))[self._rule.numbers]
        return part | {
            "fallbacks": np.array(np.count_nonzero(behind < reach)),
            "weights": (table[:, :3] - np.array([1.0, 0.0, 0.0]))[:, columns],
            "far_weights": table[:, 3:5],
            "wall": table[:, 5] * self.directions.w6[way] * np.sum(e * speed, axis=1),
        }

    def _arrival(self, local: NDArray[np.int64], way: NDArray[np.int64]) -> NDArray[np.int64]:
        """[parity, n]: elements of the array where directions arrive at own nodes."""
        shift = np.where(way % 2 == 1, 0, 1)[:, None] * self.directions.e[self.directions.opposite[way]]
        return self._layout.slots[:, way] * self._layout.slot_stride + self._layout.places(local + shift)
