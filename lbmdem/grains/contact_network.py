"""The network of contacts, energies and stresses. Sums have the same bits on any number of ranks."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.physics.contact_law import spring_energy
from hpcpic.core.space.products import product
from lbmdem.grains.dem import Dem


@dataclass(frozen=True, slots=True)
class Contacts:
    """Contacts of which this rank owns the grain with the smaller id.

    first, second: ids; -1 - w for wall w. overlap (m); force[m, d] on the first (N); branch[m, d] from the first's
    centre to the second's, or to the wall (m); x[m, d]: the first's centre.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    overlap: NDArray[np.float64]
    force: NDArray[np.float64]
    branch: NDArray[np.float64]
    x: NDArray[np.float64]


def contacts(dem: Dem) -> Contacts:
    """The contacts of the last step; one of zero overlap is none."""
    grains, pairs, d = dem.grains, dem.list, dem.grains.dimensions
    here = np.flatnonzero((pairs.low < grains.n) & (pairs.lines[:, 7] > 0.0))
    low, high, wall = pairs.low[here], pairs.high[here], here >= pairs.n_grain_slots
    second, branch = -1 - high.astype(np.int64), np.empty((len(here), 3))
    i, j = low[~wall], high[~wall]
    second[~wall] = grains.ids[j]
    delta = grains.rows[j, :3] - grains.rows[i, :3]
    branch[~wall] = delta - grains.lengths * np.rint(delta * grains.inverses)
    planes, x = dem.arena["walls"][high[wall]], grains.rows[low[wall], :3]
    branch[wall] = -planes[:, 8:11] * np.sum((x - planes[:, :3]) * planes[:, 8:11], axis=1)[:, None]
    lines = pairs.lines[here]
    return Contacts(
        grains.ids[low], second, 2.0 * lines[:, 7], lines[:, :d].copy(), branch[:, :d], grains.x[low].copy()
    )


def contact_count(dem: Dem) -> int:
    """Collective: contacts of grains with grains and with walls."""
    return int(dem.world.sum_int(np.array([len(contacts(dem).first)]))[0])


def greatest_overlap(dem: Dem) -> float:
    """Collective: overlap / diameter of the smaller grain, at most."""
    pairs, rows = dem.list, dem.grains.rows
    half, radius = pairs.lines[:, 7], rows[pairs.low, 3]
    grain = slice(pairs.n_grain_slots)
    radius[grain] = np.minimum(radius[grain], rows[pairs.high[grain], 3])
    return dem.world.max(float(np.max(half[half > 0.0] / radius[half > 0.0], initial=0.0)))


def kinetic_energy(dem: Dem) -> float:
    """Collective, J: of translation and rotation, of grains that are not fixed, without added mass."""
    c = {name: column[: dem.grains.n] for name, column in dem.grains.columns.items()}
    speed, spin = np.square(c["row"][:, 4:7]).sum(axis=1), np.square(c["row"][:, 8:11]).sum(axis=1)
    return dem.total(np.where(c["fixed"] == 0, 0.5 * (c["mass"] * speed + c["inertia"] * spin), 0.0))


def energies(dem: Dem) -> dict[str, float]:
    """Collective, J: kinetic, elastic, potential (of gravity), heat made so far, work done so far on the grains.

    kinetic + elastic + potential + heat - work is constant but for the error of the time step; given forces and added
    masses are not counted.
    """
    pairs, law, n = dem.list, dem.law, dem.grains.n
    c = {name: column[:n] for name, column in dem.grains.columns.items()}
    here = (pairs.low < n) & (pairs.lines[:, 7] > 0.0)
    elastic = spring_energy(2.0 * pairs.lines[here, 7], law)
    if law.shear > 0.0:
        elastic = elastic + 0.5 * law.shear * np.square(pairs.springs[:, here]).sum(axis=0)
    potential = -np.where(c["fixed"] == 0, c["mass"] * product(c["row"][:, :3], dem.gravity), 0.0)
    parts = {"elastic": elastic, "potential": potential, "heat": c["heat"], "work": c["work"]}
    return {"kinetic": kinetic_energy(dem)} | {name: dem.total(values) for name, values in parts.items()}


def stress(dem: Dem, edges: Sequence[float] | NDArray, area: float = 0.0) -> NDArray[np.float64]:
    """Collective: mean contact stress [slices, d, d] (Pa, compression positive) between edges along the last axis.

    Love-Weber: the sum of force x branch over contacts, each by the share of its branch in the slice, per volume of
    the box (or of `area`, m2; width in 2D, where forces are per metre) between the edges.
    """
    grains, d, ends = dem.grains, dem.grains.dimensions, np.asarray(edges, float)
    found = contacts(dem)
    start = found.x[:, d - 1]
    end = start + found.branch[:, d - 1]
    low, high, length = np.minimum(start, end), np.maximum(start, end), grains.lengths[d - 1]
    result = np.zeros((len(ends) - 1, d, d))
    area = area or float(np.prod(grains.lengths[: d - 1]))
    for k, (a, b) in enumerate(pairwise(ends)):
        share = np.zeros(len(start))
        for shift in (-length, 0.0, length) if grains.periodic[d - 1] else (0.0,):
            flat = (start + shift >= a) & (start + shift < b)
            inside = np.minimum(high + shift, b) - np.maximum(low + shift, a)
            share += np.where(high > low, np.maximum(inside, 0.0) / np.where(high > low, high - low, 1.0), flat)
        moments = -share[:, None, None] * found.force[:, :, None] * found.branch[:, None, :]
        for at in np.ndindex(d, d):
            result[(k, *at)] = dem.total(moments[:, *at]) / (area * (b - a))
    return result


def momentum(dem: Dem) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Collective: linear momentum and angular momentum about the origin (3 values each), of grains that move."""
    c = {name: column[: dem.grains.n] for name, column in dem.grains.columns.items()}
    free, row = c["fixed"] == 0, c["row"]
    p = np.where(free, c["mass"], 0.0)[:, None] * row[:, 4:7]
    spin = np.cross(row[:, :3], p) + np.where(free, c["inertia"], 0.0)[:, None] * row[:, 8:11]
    linear, angular = (np.array([dem.total(values[:, k]) for k in range(3)]) for values in (p, spin))
    return linear, angular


def wall_force(dem: Dem, wall: int) -> NDArray[np.float64]:
    """Collective: force (3 values, N) of the grains on a wall, by contacts and films."""
    pairs = dem.list
    here = np.arange(pairs.n_slots) >= pairs.n_grain_slots
    here &= (pairs.high == wall) & (pairs.low < dem.grains.n)
    return np.array([dem.total(-pairs.lines[here, k]) for k in range(3)])
