"""Which result of theory belongs to a case: what its modes along x should do, in rad/s."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hpcpic.plasma import theory
from hpcpic.plasma.config import PlasmaConfig
from hpcpic.plasma.derived import plasma_frequency
from hpcpic.plasma.theory import Beam, Mesh


@dataclass(frozen=True, slots=True)
class Prediction:
    """A wave exp(i k x - i omega t): continuum root, root of the scheme, and the name of the law."""

    law: str
    k: float
    omega: complex
    omega_mesh: complex


def beams(config: PlasmaConfig) -> tuple[Beam, ...]:
    """The species as Maxwellian beams along x; two for a species that the thesis's program starts as two."""
    found: list[Beam] = []
    for species in config.species:
        wp = plasma_frequency(config, species)
        if not wp:
            continue
        drift, spread = (species.drift_velocity or (0.0,))[0], species.thermal_velocity
        if species.init_method == "default" and drift:
            found += [Beam(wp / math.sqrt(2), v, spread) for v in (drift, -drift)]
        elif species.init_method == "random position" and not spread and drift:
            found.append(Beam(wp, 0.0, abs(drift) / math.sqrt(3)))
        else:
            found.append(Beam(wp, drift, spread))
    return tuple(found)


def mesh_of(config: PlasmaConfig) -> Mesh:
    """What the dispersion of the scheme needs, for waves along x."""
    dx = config.simulation.space_length[0] / config.grid.points[0]
    return Mesh(
        dx, config.simulation.time_step, config.numerics.shape, config.numerics.gradient == "spectral"
    )


def predict(config: PlasmaConfig, mode: int) -> Prediction | None:
    """What mode `mode` along x should do, or None where no law here applies.

    In order: upper hybrid (cold, B across x), an unstable root, Landau's root, the cold wave.
    """
    found = beams(config)
    if not found or not mode:
        return None
    k, mesh = 2.0 * math.pi * mode / config.simulation.space_length[0], mesh_of(config)
    wp = math.sqrt(sum(b.plasma_frequency**2 for b in found))
    cold = all(b.thermal_velocity == 0.0 for b in found)
    still = all(b.drift == 0.0 for b in found)
    if any(config.field.magnetic[1:]):  # B along k leaves the wave alone
        return _upper_hybrid(config, mode) if cold and still else None
    try:
        omega = theory.unstable_root(k, found)
        law = "two-stream" if len(found) == 2 and found[0].drift == -found[1].drift else "beam instability"
        return Prediction(law, k, omega, _on_mesh(omega, k, found, mesh))
    except theory.NoRoot:
        pass
    if cold and still:
        return Prediction("cold wave", k, complex(wp), _on_mesh(complex(wp), k, found, mesh))
    if len(found) == 1 and still and k * found[0].thermal_velocity / wp < 2.0:
        omega = wp * theory.landau(k * found[0].thermal_velocity / wp)
        return Prediction("Landau damping", k, omega, _on_mesh(omega, k, found, mesh))
    return None


def _on_mesh(omega: complex, k: float, found: tuple[Beam, ...], mesh: Mesh) -> complex:
    try:
        return theory.mesh_root(omega, k, found, mesh)
    except theory.NoRoot:
        return omega


def _upper_hybrid(config: PlasmaConfig, mode: int) -> Prediction | None:
    """Of one cold species with B across x."""
    bx, by, bz = config.field.magnetic
    moving = [s for s in config.species if s.particles]
    if bx or len(moving) != 1:
        return None
    (beam,), mesh = beams(config), mesh_of(config)
    wc = abs(moving[0].charge / moving[0].mass) * math.hypot(by, bz)
    k = 2.0 * math.pi * mode / config.simulation.space_length[0]
    wp = beam.plasma_frequency
    discrete = theory.upper_hybrid_frequency(wp, wc, mesh.dt, k, mesh.dx, config.numerics.exact_phase)
    return Prediction("upper hybrid", k, complex(math.hypot(wp, wc)), complex(discrete))
