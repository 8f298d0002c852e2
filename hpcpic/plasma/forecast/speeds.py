"""How fast particles become: as loaded, in the waves that the case starts, and in its uniform fields."""

import itertools
import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from hpcpic.core.case.derived import Derived, judged
from hpcpic.plasma.case.config import PlasmaConfig, Species, velocity_components
from hpcpic.plasma.case.units import SYSTEMS
from hpcpic.plasma.forecast.cold_wave import by_start
from hpcpic.plasma.forecast.scales import UNITS, spacing, step_for
from hpcpic.plasma.setup.loaders import loader_of, velocity_moments

MOST_CELLS = 1e9  # that a particle may cross in a step
MOST_OF_LIGHT = 0.1  # of the speed of light, where gamma = 1.005


def motion(config: PlasmaConfig) -> Iterator[Derived]:
    """Velocities as loaded, how far the fastest particle gets in a step, and its speed beside that of light."""
    components = velocity_components(config)
    for species in config.species:
        axes = range(components) if species.particles else ()
        for (mean, spread), equal in itertools.groupby(axes, partial(velocity_moments, config, species)):
            along = ", ".join(f"v{'xyz'[axis]}" for axis in equal)
            yield Derived(f"mean velocity of {species.name}", f"mean {along}", mean, "m/s")
            yield Derived(f"velocity spread of {species.name}", f"std {along}", spread, "m/s")
    fastest = crossing(config)
    cure = f"time_step = {step_for(config, 0.9, fastest):g}"
    legal, limit, source = fastest < MOST_CELLS, "< 1", "one cell per step"
    if not legal:
        limit, source = f"< {MOST_CELLS:g}", "cells are counted in 32 bits"
    cure += " avoids it: slower, not wrong" if legal else f", or a slower particle; {UNITS}"
    yield judged(
        "fastest particle", "v dt/dx", fastest, unit="cells", limit=limit, ok=fastest < 1, legal=legal, source=source,
        cure=cure, key=("simulation", "time_step"),
    )  # fmt: skip
    if math.isfinite(light := SYSTEMS[config.units].light):
        yield against_light(config, light)
    yield Derived("velocity components", "", components)


def crossing(config: PlasmaConfig) -> float:
    """Cells that the fastest particle crosses in a step along an axis."""
    fastest, dt = 0.0, abs(config.simulation.time_step)
    for species in config.species:
        if not species.particles:
            continue
        tail = math.sqrt(2 * math.log(max(species.particles, 2))) * species.thermal_velocity
        loaded, fields = loader_of(species).fastest(species).components, gained(config, species)
        for axis, dx in enumerate(spacing(config)):
            fastest = max(fastest, (loaded[axis] + tail + of_waves(config, species)[axis] + fields[axis]) * dt / dx)
    return fastest


def against_light(config: PlasmaConfig, light: float) -> Derived:
    """The largest speed over that of light."""
    most, reason = 0.0, "as loaded"
    for species in config.species:
        if not species.particles:
            continue
        loaded = loader_of(species).fastest(species).speed + 3 * species.thermal_velocity
        parts = {
            "as loaded": loaded,
            "in the waves that the case starts": math.hypot(*of_waves(config, species)),
            "in field.electric": math.hypot(*gained(config, species)),
        }
        if (speed := sum(parts.values())) > most:
            most, reason = speed, max(parts, key=parts.__getitem__)
    return judged(
        "speed against light", "v/c", most / light, limit=f"< {MOST_OF_LIGHT}", ok=most < MOST_OF_LIGHT * light,
        legal=True, source=f"gamma = 1.005 there; most of it {reason}", key=("species",),
        cure="the equations of motion know no relativity",
    )  # fmt: skip


def of_waves(config: PlasmaConfig, species: Species) -> tuple[float, ...]:
    """Speeds along each axis of the grid that the waves of the start give a species in their swing, m/s."""
    own = abs(species.perturbation.velocity_amplitude) if species.perturbation else 0.0
    axes = range(config.dimensions)
    return tuple(max(own, sum(wave.speed for wave in by_start(config, species, axis))) for axis in axes)


def gained(config: PlasmaConfig, species: Species) -> tuple[float, ...]:
    """Speeds along x, y and z that the uniform fields give a particle at rest until the end of the run, m/s.

    Along B, and without one, it gains (q/m) E t; across B it goes along a cycloid, by up to E/B along E and twice that
    along E x B.
    """
    electric, magnetic = np.array(config.field.electric), np.array(config.field.magnetic)
    time = abs(config.simulation.time_step) * max(config.simulation.cycles, 1)
    ratio, strength = abs(species.charge / species.mass), float(np.linalg.norm(magnetic))
    if not strength:
        return tuple(float(speed) for speed in ratio * np.abs(electric) * time)
    direction, turn = magnetic / strength, ratio * strength
    along = direction * float(electric @ direction)
    across = electric - along
    drift = np.cross(across, direction)
    swing = ratio * np.abs(across) * min(time, 1 / turn if turn else math.inf)
    sideways = ratio * np.abs(drift) * min(turn * time * time / 2, 2 / turn if turn else math.inf)
    return tuple(float(speed) for speed in ratio * np.abs(along) * time + swing + sideways)
