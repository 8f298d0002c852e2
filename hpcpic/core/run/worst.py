"""The particles and nodes that a post-mortem shows: those that are nowhere, or not a number, then the fastest."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.files.arrays import ParticleArray

SHOWN = 10


def worst_particles(species: Mapping[str, ParticleArray]) -> list[str]:
    """A line for each of the worst of this rank."""
    found: list[tuple[float, str]] = []
    for name, particles in species.items():
        v = particles.columns["velocity"]
        for k, badness in ordered(particles.position, v):
            more = f", density {particles.columns['density'][k]:.5g} kg/m3" if "density" in particles.columns else ""
            place = f"at {vector(particles.position[k])} m, velocity {vector(v[k])} m/s{more}"
            found.append((badness, f"{name} {particles.ids[k]} {place}"))
    return [line for _, line in sorted(found, key=lambda one: -one[0])[:SHOWN]]


def worst_nodes(density: NDArray, velocity: NDArray, first_row: int) -> list[str]:
    """A line for each worst node; density[rows, ...] over that of rest, velocity[rows, ..., d] in nodes a step."""
    shape, d = density.shape, velocity.shape[-1]
    rho, u = density.reshape(-1, 1), velocity.reshape(-1, d)
    lines = []
    for k, _ in ordered(rho, u):
        row, *others = (int(n) for n in np.unravel_index(k, shape))
        index = ", ".join(str(n) for n in (*reversed(others), row + first_row))
        lines.append(f"node ({index}), density {rho[k, 0]:.5g} of rest, {vector(u[k])} nodes a step")
    return lines


def ordered(place: NDArray, velocity: NDArray) -> list[tuple[int, float]]:
    """(row, how bad) of the worst rows of place[n, ...] and velocity[n, d]."""
    with np.errstate(all="ignore"):
        badness = np.sqrt((velocity.astype(np.float64) ** 2).sum(axis=1))
    sound = np.isfinite(badness) & np.isfinite(place).all(axis=1)
    badness = np.where(sound, badness, np.inf)
    worst = np.argsort(-badness, kind="stable")[:SHOWN]
    return [(int(k), float(badness[k])) for k in worst]


def vector(values: NDArray) -> str:
    return f"({', '.join(f'{value:.6g}' for value in values)})"
