"""What the ranks hand to the writers: every rank its part, with the place of that part in the whole."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

PARTICLE_UNITS = {"charge": "C", "mass": "kg", "weighting": "1"}


@dataclass(frozen=True, slots=True)
class Shard:
    """Rows [offset, offset + len(local)) of a global array of `total` rows; the first axis is the cut one."""

    local: NDArray
    offset: int
    total: int


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
    one here stands for "weighting".
    """

    ids: NDArray[np.int64]
    position: NDArray
    columns: Mapping[str, NDArray] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    time_offsets: Mapping[str, float] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)


def spatial(vectors: NDArray) -> NDArray:
    """Vectors of one or two components, [..., d], with three; longer ones as they are."""
    d = vectors.shape[-1]
    if d >= 3:
        return vectors
    padded = np.zeros((*vectors.shape[:-1], 3), vectors.dtype)
    padded[..., :d] = vectors
    return padded
