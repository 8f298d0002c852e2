"""How stiffly the links of a grain hold it to the fluid: what explicit coupling can be stable with."""

import math

import numpy as np
from numpy.typing import NDArray

from lbmdem.physics.velocity_sets import Lattice

MEAN_WALL_TERM = {
    "halfway": 1.0,
    "interpolated": 0.5 + 0.5 * math.log(2.0),
    "quadratic": 0.5 + math.log(4.0 / 3.0),
    "cli": math.log(3.0),
}
"""Weight of the wall term of each rule, the mean over q from 0 to 1."""


def impedance(lattice: Lattice, rule: str, radius: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
    """Mass and moment of inertia to add to grains of a radius so that light ones are stable, in lattice units.

    The force of the links changes by -zeta du when the grain's velocity changes by du within a step, zeta = sum over
    links of A 6 w e e (A: weight of the wall term). A backward Euler step of that part divides the force by m + zeta.
    The mean over all places of the grain: pi r^2 |e| links of a direction in 3D, 2 r |e| in 2D, at any q alike.
    """
    radius = np.asarray(radius, np.float64)
    strength = float(np.sum(6.0 * lattice.w * np.sum(lattice.e**2, axis=1) ** 1.5)) * MEAN_WALL_TERM[rule]
    if lattice.dimensions == 3:
        mass = strength * math.pi / 3.0 * radius**2
        return mass, 0.5 * mass * radius**2
    return strength * radius, 2.0 / 3.0 * strength * radius**3
