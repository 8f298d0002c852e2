"""Arrays as the ranks hand them to the writers: every rank its part, with the place of that part in the whole."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

PARTICLE_UNITS = {"charge": "C", "mass": "kg", "weighting": "1"}


@dataclass(frozen=True, slots=True)
class Shard:
    """Rows [offset, offset + len(local)) of a global array of `total` rows; the first axis is the cut one."""

    local: NDArray
    offset: int
    total: int


class Rows(Protocol):
    """A state at a step, in a checkpoint or elsewhere, as `restore` of a model reads it, all ranks together."""

    @property
    def step(self) -> int: ...
    @property
    def time(self) -> float: ...  # s
    def read(self, name: str, lo: int = 0, hi: int | None = None) -> NDArray: ...  # rows [lo, hi) of an array


@dataclass(frozen=True, slots=True)
class Column:
    """The constraints on an array of the state: its type, its shape (None: any number of rows), and the values it can
    have: numbers from low to high whose squares are finite. low and high are numbers, or arrays of the shape of the
    whole or of a row.

    open: numbers that are not finite are values too. increasing: each row is above the one before. legal(rows): which
    of them are values, where limits cannot tell.
    """

    dtype: DTypeLike
    shape: tuple[int | None, ...]
    low: float | NDArray = -math.inf
    high: float | NDArray = math.inf
    open: bool = False
    increasing: bool = False
    legal: Callable[[NDArray], NDArray[np.bool_]] | None = None

    def fault(self, rows: NDArray, first: int) -> str:
        """The fault of the rows that begin at number `first` of the whole; "" if there is none."""
        low, high = (self._limit(limit, first, len(rows)) for limit in (self.low, self.high))
        if rows.dtype.kind == "f":
            most = math.sqrt(np.finfo(rows.dtype).max)
            low, high = np.maximum(low, -most), np.minimum(high, most)
        good = (rows >= low) & (rows <= high)
        good |= ~np.isfinite(rows) if self.open else False
        good &= True if self.open else np.isfinite(rows)
        if self.legal is not None:
            good &= self.legal(rows)
        if self.increasing:
            good[1:] &= np.diff(rows) > 0
        if good.all():
            return ""
        place = tuple(int(k) for k in np.argwhere(~good)[0])
        least, most = (np.broadcast_to(limit, rows.shape)[place] for limit in (low, high))
        span = f" from {least:g} to {most:g}" if np.isfinite([least, most]).any() else ""
        more = ", each row above the one before" if self.increasing else ""
        at = ", ".join(map(str, (first + place[0], *place[1:])))
        return f"[{at}] = {rows[place]:g}; expected{'' if self.open else ' finite'} values{span}{more}"

    def _limit(self, limit: float | NDArray, first: int, n: int) -> float | NDArray:
        if isinstance(limit, np.ndarray) and limit.ndim == len(self.shape):
            return limit[first : first + n]
        return limit


@dataclass(frozen=True, slots=True)
class FieldArray:
    """One field of this rank's slab in storage order: values[rows, ...], a vector has its components last.

    The rows are those of `domain.row_range(rank)`, without ghosts; any strides.
    """

    values: NDArray
    unit: str = ""


@dataclass(frozen=True, slots=True)
class ParticleArray:
    """Particles of one species on this rank in any order: ids[n], position[n, 3] m, columns[name][n, ...].

    time_offsets: s by which a column is of a later time than the positions, where it is. constants: what all particles
    of the species have in common, of PARTICLE_UNITS; "charge" and "mass" are those of one real particle, of which each
    one here stands for "weighting". kept_single: files hold the columns in single precision.
    """

    ids: NDArray[np.int64]
    position: NDArray
    columns: Mapping[str, NDArray] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    time_offsets: Mapping[str, float] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    kept_single: bool = False

    def as_kept(self) -> "ParticleArray":
        """The particles as files hold them."""
        if not self.kept_single:
            return self
        return replace(self, columns={name: values.astype(np.float32) for name, values in self.columns.items()})


@dataclass(frozen=True, slots=True)
class Counts:
    """Particles of all ranks counted in bins: counts[n, ...] along the axes of `edges`, axis -> [n + 1] in `units`, and
    how many lie in no bin. Each stands for `weight` real ones.
    """

    counts: NDArray[np.int64]
    beyond: int
    edges: Mapping[str, NDArray[np.float64]]
    units: Mapping[str, str]
    weight: float

    @property
    def density(self) -> float:
        """Real particles per unit of all axes, of a count of 1: times the counts the density whose integral is the
        number of real particles in the bins.
        """
        return self.weight / math.prod(float(edges[1] - edges[0]) for edges in self.edges.values())

    @property
    def unit(self) -> str:
        """Unit of the density: s/m of a velocity, s/m2 of a position and a velocity."""
        powers = {"s": sum(unit == "m/s" for unit in self.units.values()), "m": len(self.units)}
        above, below = (f"{name}{n if n > 1 else ''}" if n else "1" for name, n in powers.items())
        return f"{above}/{below}"


def spatial(vectors: NDArray) -> NDArray:
    """Vectors of one or two components, [..., d], with three; longer ones as they are."""
    d = vectors.shape[-1]
    if d >= 3:
        return vectors
    padded = np.zeros((*vectors.shape[:-1], 3), vectors.dtype)
    padded[..., :d] = vectors
    return padded
