"""The box, its grid and the cuts that share its rows among ranks; arithmetic only."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpcpic.core.space.cuts import block_ranges, even_cuts

__all__ = ["Domain", "balanced_cuts", "better_cuts", "block_ranges", "even_cuts", "fullest", "wrap"]

HALVINGS = 40  # by which the least cost of the fullest rank is found, to 1e-12 of all
MAX_IMBALANCE = 1.03  # cost of the fullest rank over what it can be, beyond which cuts are made again


def balanced_cuts(cost_per_row: ArrayLike, ranks: int, minimum: int = 0) -> tuple[int, ...]:
    """Cuts by which the fullest rank has the least that it can have, each as near to k/ranks of the cost as that lets.

    Every slab has at least `minimum` rows; where that is more than one, the fullest may have a little more.
    """
    cost = np.asarray(cost_per_row)
    rows = len(cost)
    if rows < minimum * ranks:
        raise ValueError(f"{rows} rows do not give {ranks} ranks {minimum} rows each")
    prefix = np.concatenate(([0], np.cumsum(cost)))
    if prefix[-1] <= 0:
        return even_cuts(rows, ranks)
    most = _least_maximum(prefix, ranks, minimum)
    from_end = _farthest(prefix[-1] - prefix[::-1], ranks, minimum, most)
    cuts = [0]
    for k in range(1, ranks):
        target = prefix[-1] * (k / ranks)
        above = int(np.searchsorted(prefix, target))
        nearest = above - 1 if above > 0 and target - prefix[above - 1] <= prefix[above] - target else above
        first = max(rows - from_end[ranks - k], cuts[-1] + minimum)
        last = min(_reached(prefix, cuts[-1], most), rows - (ranks - k) * minimum)
        cuts.append(max(min(nearest, last), first))
    return (*cuts, rows)


def _least_maximum(prefix: NDArray, ranks: int, minimum: int) -> float:
    """The cost of the fullest of so many slabs, as low as it can be; prefix: sums of the costs of rows from 0 on."""
    low, high = float(max(prefix[-1] / ranks, np.diff(prefix).max())), float(prefix[-1])
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        enough = _farthest(prefix, ranks, minimum, middle)[-1] == len(prefix) - 1
        low, high = (low, middle) if enough else (middle, high)
    return high


def _farthest(prefix: NDArray, ranks: int, minimum: int, most: float) -> list[int]:
    """The rows that each number of slabs, from none on, reaches where none costs more than `most`."""
    cuts, rows = [0], len(prefix) - 1
    for k in range(1, ranks + 1):
        reached = max(_reached(prefix, cuts[-1], most), cuts[-1] + minimum)
        cuts.append(min(reached, rows - (ranks - k) * minimum))
    return cuts


def _reached(prefix: NDArray, cut: int, most: float) -> int:
    """How far a slab that begins at a cut goes without costing more."""
    return int(np.searchsorted(prefix, prefix[cut] + most, side="right")) - 1


def fullest(cost_per_row: ArrayLike, cuts: Sequence[int]) -> float:
    """Cost of the rank that has most to do."""
    prefix = np.concatenate(([0], np.cumsum(cost_per_row)))
    return float(np.diff(prefix[list(cuts)]).max())


def better_cuts(cost_per_row: ArrayLike, cuts: Sequence[int], minimum: int = 0) -> tuple[int, ...] | None:
    """Cuts by `balanced_cuts`, if the fullest rank has more than MAX_IMBALANCE of what it would have with them."""
    made = balanced_cuts(cost_per_row, len(cuts) - 1, minimum)
    return made if fullest(cost_per_row, cuts) > MAX_IMBALANCE * fullest(cost_per_row, made) else None


def wrap(x: ArrayLike, length: float) -> NDArray:
    """x modulo length, in [0, length): what rounds up to length (as -1e-20 does) becomes 0."""
    x = np.asarray(x)
    if np.all((x >= 0) & (x < length)):
        return (x + 0 * length)[()]  # the same, much faster
    y = np.mod(x, length)
    return np.where(y < length, y, y.dtype.type(0))[()]


@dataclass(frozen=True, slots=True)
class Domain:
    """Box, grid and slabs in storage order (slab axis first): rank r owns rows cuts[r] to cuts[r + 1] - 1.

    offset: of the first point from the corner of the box, in spacings; 0.5 puts points at the centres of cells.
    """

    lengths: tuple[float, ...]
    points: tuple[int, ...]
    periodic: tuple[bool, ...]
    cuts: tuple[int, ...]
    offset: float = 0.0

    def __post_init__(self) -> None:
        if not len(self.lengths) == len(self.points) == len(self.periodic):
            raise ValueError(f"axes differ: {self.lengths}, {self.points}, {self.periodic}")
        if self.cuts[0] != 0 or self.cuts[-1] != self.points[0] or list(self.cuts) != sorted(self.cuts):
            raise ValueError(f"cuts {self.cuts} do not share {self.points[0]} rows")

    @property
    def ndim(self) -> int:
        return len(self.points)

    @property
    def ranks(self) -> int:
        return len(self.cuts) - 1

    @property
    def spacing(self) -> tuple[float, ...]:
        return tuple(length / points for length, points in zip(self.lengths, self.points))

    def row_range(self, rank: int) -> tuple[int, int]:
        """First row of the rank and first row after it."""
        return self.cuts[rank], self.cuts[rank + 1]

    def shape(self, rank: int) -> tuple[int, ...]:
        """Points of the rank, without ghosts."""
        return (self.cuts[rank + 1] - self.cuts[rank], *self.points[1:])

    def owner(self, rows: ArrayLike) -> NDArray[np.int64] | int:
        """The rank that owns each row (0 <= row < points[0]); never a rank with an empty slab."""
        ranks = np.searchsorted(self.cuts[1:], rows, side="right")
        return int(ranks) if np.ndim(rows) == 0 else ranks

    def with_cuts(self, cuts: Sequence[int]) -> "Domain":
        return replace(self, cuts=tuple(int(cut) for cut in cuts))


def ring_neighbours(cuts: Sequence[int], rank: int) -> tuple[int, ...]:
    """The previous and the next rank with rows on the ring of slabs, each once, and never `rank` itself.

    Empty for a rank without rows: then nobody counts it as a neighbour either.
    """
    full = [r for r in range(len(cuts) - 1) if cuts[r + 1] > cuts[r]]
    if rank not in full:
        return ()
    at = full.index(rank)
    return tuple(sorted({full[at - 1], full[(at + 1) % len(full)]} - {rank}))
