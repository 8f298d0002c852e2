"""Flows that a fluid may start with, by the name in a case (fluid.initial.flow): a new one is its velocity, and its
density if the pressure is not even, its entry in FLOWS and its name in `case/config.py`.

Each is a function of x and y at nodes, that broadcast, and of the lengths of the box, m; speed: in lattice units.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.elementary import cos, sin, tanh
from lbmdem.physics.velocity_sets import CS2


class Flow(NamedTuple):
    """velocity: along x and y, lattice units. excess: of the density over that of rest; None: no excess."""

    velocity: Callable[[NDArray, NDArray, Sequence[float], float], tuple[NDArray, NDArray]]
    excess: Callable[[NDArray, NDArray, Sequence[float], float], NDArray] | None = None


def _wave_numbers(size: Sequence[float]) -> tuple[float, float]:
    return 2.0 * math.pi / size[0], 2.0 * math.pi / size[1]


def taylor_green(x: NDArray, y: NDArray, size: Sequence[float], speed: float) -> tuple[NDArray, NDArray]:
    """Vortices that viscosity ends without a change of their form."""
    kx, ky = _wave_numbers(size)
    return -speed * cos(kx * x) * sin(ky * y), speed * kx / ky * sin(kx * x) * cos(ky * y)


def taylor_green_excess(x: NDArray, y: NDArray, size: Sequence[float], speed: float) -> NDArray:
    """The pressure that turns the fluid round the vortices."""
    kx, ky = _wave_numbers(size)
    ratio = kx * kx / (ky * ky)
    waves = ratio * cos(2.0 * ky * y) + cos(2.0 * kx * x)
    return -0.25 * speed * speed / CS2 * waves


def shear_layer(x: NDArray, y: NDArray, size: Sequence[float], speed: float) -> tuple[NDArray, NDArray]:
    """Two layers of shear in a doubly periodic box (Minion & Brown 1997), kappa 80."""
    s = y / size[1]
    along = speed * np.where(s <= 0.5, tanh(80.0 * (s - 0.25)), tanh(80.0 * (0.75 - s)))
    return along, 0.05 * speed * sin(_wave_numbers(size)[0] * x + 0.5 * math.pi)


FLOWS = {"taylor-green": Flow(taylor_green, taylor_green_excess), "shear-layer": Flow(shear_layer)}
