"""Waves of the discrete SPH operators on a lattice, as sums over the neighbours of a lattice point."""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sph.physics.smoothing import SMOOTHING

NUMBERS_OF_WAVES = 24  # per direction
LONG_WAVE = 40  # particles to half a wave that counts as long
LEAST_REACH = 3.0  # h, of the neighbours that are looked at
SLOPE_STEP = 1e-4  # h, for the slope of the pair sum of shifts


class Waves(NamedTuple):
    """What the operators make of waves along axes, face and space diagonals, in units of c0 / h.

    acoustic: the frequency by the gradient, square its square; laplacian: of differences 2 F; pairs: of those along the
    line between two particles, of velocities along the wave; upwind: of differences F r. xi: see `cleary_constant`.
    """

    acoustic: NDArray[np.float64]
    square: NDArray[np.float64]
    laplacian: NDArray[np.float64]
    pairs: NDArray[np.float64]
    upwind: NDArray[np.float64]
    xi: float


def neighbourhood(kernel: str, d: int, smoothing: float) -> tuple[NDArray, NDArray, NDArray]:
    """r[n, d] in h and |r| of the neighbours of a lattice point, and V F with F = -W' / r, in units of 1 / h^2."""
    reach = int(np.ceil(max(SMOOTHING[kernel].support, LEAST_REACH) * smoothing))
    r = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1.0)] * d), axis=-1).reshape(-1, d) / smoothing
    r = r[np.any(r != 0, axis=1)]
    distance = np.sqrt(np.sum(r * r, axis=1))
    return r, distance, -SMOOTHING[kernel].gradient(distance, d) * smoothing**-d


@functools.lru_cache(maxsize=64)
def cleary_constant(kernel: str, d: int, smoothing: float) -> float:
    """xi of (SC 6), calibrated as Cleary did with a shear flow: a long shear wave along an axis of the lattice decays
    with the viscosity asked for. (Cubic spline, 2D, h/dp = 1.2: 5.1, Cleary 4.963; dense neighbours: d + 2, which is
    also taken where the support does not reach across the diagonal of a square, so that no constant would do.)
    """
    r, distance, f = neighbourhood(kernel, d, smoothing)
    k = np.pi / LONG_WAVE * smoothing
    wave = np.array([1 - math.cos(k * y) for y in r[:, 1].tolist()])  # of the C library: the state follows xi
    shear = np.sum(f * r[:, 0] ** 2 / (distance**2 + 0.01) * wave) / k**2
    return float(1 / (2 * shear)) if shear > 0 else d + 2.0


@functools.lru_cache(maxsize=64)
def waves_of(kernel: str, d: int, smoothing: float) -> Waves:
    """The waves of particles at h / dp = `smoothing`."""
    r, distance, f = neighbourhood(kernel, d, smoothing)
    directions = [np.array([1.0] * n + [0.0] * (d - n)) for n in range(1, d + 1)]
    numbers = np.arange(1, NUMBERS_OF_WAVES + 1) / NUMBERS_OF_WAVES
    k = np.concatenate([np.outer(numbers, e) for e in directions]) * np.pi * smoothing
    phase = k @ r.T
    damping, along = 1 - np.cos(phase), (k @ r.T / np.sqrt(np.sum(k * k, axis=1))[:, None] / distance) ** 2
    gradient = np.sin(phase) @ (f[:, None] * r)
    square = np.sum(gradient * gradient, axis=1)
    pairs = (damping * along) @ f
    xi = cleary_constant(kernel, d, smoothing)
    return Waves(np.sqrt(square), square, 2 * damping @ f, pairs, damping @ (f * distance), xi)


@functools.lru_cache(maxsize=64)
def shift_decay(kernel: str, d: int, smoothing: float) -> float:
    """The most by which shifts undo displacements, over all waves of them on the lattice: shifts of Sun et al. 2017 (9)
    with the velocity U in steps of dt take U dt / h times this from the worst one. Beyond 1 they overshoot, beyond 2
    they grow (Wendland C2, 2D, h/dp = 1.3, 1.5, 2.0: 20.3, 15.7, 11.8).
    """
    r, distance, _ = neighbourhood(kernel, d, smoothing)
    crowded = SMOOTHING[kernel].value(1 / smoothing, d)

    def factor(q: NDArray) -> NDArray[np.float64]:
        w = SMOOTHING[kernel].value(q, d) / crowded
        return 4 * smoothing**-d * (1 + 0.2 * w**4) * SMOOTHING[kernel].gradient(q, d)

    slope = (factor(distance + SLOPE_STEP) - factor(distance - SLOPE_STEP)) / (2 * SLOPE_STEP)
    directions = [np.array([1.0] * n + [0.0] * (d - n)) for n in range(1, d + 1)]
    numbers = np.arange(1, NUMBERS_OF_WAVES + 1) / NUMBERS_OF_WAVES
    k = np.concatenate([np.outer(numbers, e) for e in directions]) * np.pi * smoothing
    pull, bend = factor(distance)[:, None, None], (slope / distance)[:, None, None]
    stiffness = pull * np.eye(d) + bend * r[:, :, None] * r[:, None]
    decay = np.linalg.eigvalsh(np.tensordot(1 - np.cos(k @ r.T), stiffness, 1)).max()
    return float(f"{decay:.6g}")  # the state follows it: without the digits that differ by processor
