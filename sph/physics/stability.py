"""How long a step may be: von Neumann's analysis of the discrete SPH operators on a lattice.

A wave exp(i k.r) of density r and velocity u along k obeys r' = -l r - i a u, u' = -i a r - n u. Acoustic frequency a,
decay rate l of the density flux and n of viscosity are sums over the neighbours of a lattice point; in units of c0 / h
they depend on dimension, kernel, h / dp and coefficients only. A step is stable while no wave grows.
"""

import functools

import numpy as np
from numpy.typing import NDArray

from sph.case.config import SphConfig
from sph.physics.fluxes import FLUXES
from sph.physics.integrators import INTEGRATORS
from sph.physics.liquids import liquids_of
from sph.physics.smoothing import SMOOTHING
from sph.physics.viscosities import viscosity_of
from sph.physics.waves import waves_of

GROWTH = 1e-3  # per step, that counts as stable: an explicit run is short beside 1 / GROWTH steps of growth
MAX_VISCOUS_STEP = 0.125  # of h^2 / nu: the customary viscous limit
MAX_FORCE_STEP = 0.25  # of sqrt(h / acceleration)
MAX_COURANT = 4.0  # Courant numbers looked at


def support_of(config: SphConfig) -> float:
    """The radius of the kernel of a case, m."""
    return SMOOTHING[config.numerics.kernel].support * config.h


def fastest_sound(config: SphConfig) -> float:
    """The largest sound speed of rest of its liquids, m/s."""
    return config.sound_speed * liquids_of(config).swiftest


def kinematic_viscosity(config: SphConfig) -> float:
    """nu of the fluid, the largest of its liquids, m2/s."""
    return max((fluid.dynamic_viscosity / fluid.density for fluid in config.fluid), default=0.0)


def physical_viscosity(config: SphConfig) -> float:
    """nu of the fluid, m2/s, where a term of the pair sums has it; else 0."""
    return kinematic_viscosity(config) if viscosity_of(config.numerics.viscosity_form).physical else 0.0


def amplification(integrator: str, a: NDArray, l: NDArray, n: NDArray, z: float) -> float:
    """Largest |eigenvalue| of one step of Courant number z, over all waves."""
    m = z * np.stack([np.stack([-l + 0j, -1j * a], -1), np.stack([-1j * a, -n + 0j], -1)], -2)
    step = INTEGRATORS[integrator].linear(m)
    trace = step[..., 0, 0] + step[..., 1, 1]
    determinant = step[..., 0, 0] * step[..., 1, 1] - step[..., 0, 1] * step[..., 1, 0]
    root = np.sqrt(trace * trace / 4 - determinant)
    return float(np.maximum(np.abs(trace / 2 + root), np.abs(trace / 2 - root)).max())


def decays(config: SphConfig, viscous: bool) -> tuple[NDArray, NDArray, NDArray]:
    """a, l and n of all waves of a case, in units of c0 / h; `viscous`: with the physical viscosity."""
    numerics = config.numerics
    waves = waves_of(numerics.kernel, config.dimensions, numerics.smoothing)
    n = (numerics.artificial_viscosity or 0.0) * waves.pairs
    decay = viscosity_of(numerics.viscosity_form).decay
    if viscous and decay:
        n = n + kinematic_viscosity(config) / (config.sound_speed * config.h) * decay(waves)
    return waves.acoustic, (numerics.flux_coefficient or 0.0) * FLUXES[numerics.density_flux].decay(waves), n


def limit_of(integrator: str, a: NDArray, l: NDArray, n: NDArray) -> float:
    """The largest Courant number below which no wave grows by more than GROWTH per step."""

    def stable(z: float) -> bool:
        return amplification(integrator, a, l, n, z) <= 1 + GROWTH

    low = 0.0
    for high in MAX_COURANT * np.geomspace(1e-6, 1.0, 120):
        if not stable(high):
            break
        low = high
    else:
        return MAX_COURANT
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return float(low)


@functools.lru_cache(maxsize=64)
def _limit(config: SphConfig, viscous: bool) -> float:
    return limit_of(config.simulation.integrator, *decays(config, viscous))


def courant_limit(config: SphConfig) -> float:
    """Limit of dt c0 / h without the physical viscosity, which has a limit of its own."""
    return _limit(config, False)


def grows(config: SphConfig, z: float) -> float:
    """Growth of the worst wave per step of Courant number z, all terms included; 0 when none grows."""
    return max(0.0, amplification(config.simulation.integrator, *decays(config, True), z) - 1.0)


def viscous_limit(config: SphConfig) -> float:
    """Limit of nu dt / h^2: the customary one, or less where the integrator would not stand the fastest decay."""
    numerics = config.numerics
    decay = viscosity_of(numerics.viscosity_form).decay
    if decay is None:
        return MAX_VISCOUS_STEP
    fastest = decay(waves_of(numerics.kernel, config.dimensions, numerics.smoothing)).max()
    limit = 0.9 * INTEGRATORS[config.simulation.integrator].decay / float(fastest)
    return min(MAX_VISCOUS_STEP, float(f"{limit:.6g}"))  # steps follow it: without the digits that differ by processor


def step_parts(config: SphConfig) -> dict[str, float]:
    """The criteria of the step in s at t = 0: acoustic, viscous, force; the least of them is taken."""
    h, nu = config.h, physical_viscosity(config)
    parts = {"acoustic": (config.simulation.cfl or 0.0) * h / fastest_sound(config)}
    if nu:
        parts["viscous"] = viscous_limit(config) * h * h / nu
    acceleration = float(np.hypot(np.hypot(config.gravity[0], config.gravity[1]), sum(config.gravity[2:])))
    acceleration += float(np.sqrt(sum(b * b for b in config.body_force)))
    if acceleration:
        parts["force"] = MAX_FORCE_STEP * float(np.sqrt(h / acceleration))
    return parts


def time_step(config: SphConfig) -> float:
    """The step at t = 0, s."""
    return config.simulation.time_step or min(step_parts(config).values())
