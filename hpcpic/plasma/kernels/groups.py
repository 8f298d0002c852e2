"""Arrays that kernels take together: each argument of these names is one of these groups."""

from typing import NamedTuple

from numpy.typing import NDArray


class GridArrays(NamedTuple):
    """Where cells and particles belong (see particles.tiles). points: rows, columns and, in 3D, planes of the grid.

    pitch: rows from plane to plane in the arrays of the slab, which have ghosts (3D). row_part, column_part,
    column_stride: tables from a global cell to the tile part of this rank. parts[part, 8 or, in 3D, 11].
    """

    n_species: int
    pitch: int
    points: NDArray
    row_part: NDArray
    column_part: NDArray
    column_stride: NDArray
    parts: NDArray


class FieldArrays(NamedTuple):
    """E of the slab: e[axis, rows of all planes, columns] with ghosts, row, column (and plane) of the first node, and
    what it is scaled by.
    """

    e: NDArray
    origin: NDArray
    scale: float


class PageArrays(NamedTuple):
    """Particles of the rank in chains of pages (see kernels.storage)."""

    pool: NDArray
    ids: NDArray
    chain: NDArray
    head: NDArray
    count: NDArray  # type: ignore[assignment]  # not the method of tuples
    settled: NDArray
    free: NDArray
    counters: NDArray


class BoxArrays(NamedTuple):
    """Particles under way (see kernels.storage): of all boxes, or of one. crossings[species, axis]: times that a
    particle left the box of the case at the upper end less those at the lower one.
    """

    moving: NDArray
    words: NDArray
    lists: NDArray
    counters: NDArray
    crossings: NDArray


class SpeciesArrays(NamedTuple):
    """Numbers by species: mover[species, 16] of physics.boris; charge[species] = (group, parts with sign)."""

    mover: NDArray
    charge: NDArray


class PatchArrays(NamedTuple):
    """Charge of one block: nodes[group, row of all planes, column]; corner: row, column, plane of the first."""

    nodes: NDArray
    corner: NDArray


class ScratchArrays(NamedTuple):
    """Room of each block: lines of field coefficients, sums of charge, cells of a page's particles and E there."""

    lines: NDArray
    sums: NDArray
    cells: NDArray


class NodeSumArrays(NamedTuple):
    """What kernels.moments.node_moments adds up: of the species sampled[0], of which a particle counts whole[0] parts.

    node_half_kick[species, 9]: see Scene.half_kicks; half_turn[species, 3, 3]: the rotation of half a step less
    the identity; side[3]: sides of a cell in that along x; per_scale[moment]: parts of a value of 1; fastest[block]:
    the largest component of a velocity that was met, in cells along x per step.
    """

    sampled: NDArray
    whole: NDArray
    node_half_kick: NDArray
    half_turn: NDArray
    side: NDArray
    per_scale: NDArray
    fastest: NDArray


class HistogramArrays(NamedTuple):
    """What kernels.histogram counts: particles of species[0] in bins[2] along two axes, where weights[2, 7] say; an
    axis that is not asked for has one bin. counts[block, bin].
    """

    species: NDArray
    bins: NDArray
    weights: NDArray
    counts: NDArray


class RecordArrays(NamedTuple):
    """Particles on their way between ranks: the same memory as real numbers and as 32-bit integers."""

    real: NDArray
    whole: NDArray


class SumArrays(NamedTuple):
    """What a sample of the series adds up: limbs[block, species, moment, 3], and of each moment its inverse scale.

    half_kick[species, 9]: see Scene.half_kicks; ratio_sq[3]: squared sides of a cell, in that along x.
    values[block, moment, PAGE]: scratch of single particles; bits[block, moment, 2, 8]: of vectors. places[block,
    species, axis, 2]: sums of x - v / 2, in cells and in 2^-40 of a cell.
    """

    limbs: NDArray
    inv_scale: NDArray
    half_kick: NDArray
    ratio_sq: NDArray
    values: NDArray
    bits: NDArray
    places: NDArray
