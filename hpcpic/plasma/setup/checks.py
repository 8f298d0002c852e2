"""What does not fit together in a plasma case: each fault with the key to change."""

import itertools
from collections.abc import Iterator

from hpcpic.core.case import accelerations
from hpcpic.core.case.gauge import gauge_faults
from hpcpic.core.case.schema import Fault, abridged
from hpcpic.plasma.case import units
from hpcpic.plasma.case.config import (
    MOST_PARTICLES,
    MOST_POINTS,
    PlasmaConfig,
    Species,
    name_of,
    velocity_components,
)
from hpcpic.plasma.physics.species_fields import MESH_FIELDS, SPECIES_FIELDS, asked_for, fault, field_units
from hpcpic.plasma.setup.histograms import histogram_faults
from hpcpic.plasma.setup.loaders import LOADERS, loader_faults
from hpcpic.plasma.setup.macro_particles import particle_faults


def faults(config: PlasmaConfig) -> Iterator[Fault]:
    d = config.dimensions
    simulation = config.simulation
    if len(simulation.space_length) != d:
        yield (
            ("simulation", "space_length"),
            f"needs {d} number(s) in {d}D (got {len(simulation.space_length)})",
        )
    if simulation.time_step == 0:
        yield ("simulation", "time_step"), "must not be 0"
    yield from grid_faults(config, d)
    for name in ("magnetic", "electric"):
        vector = getattr(config.field, name)
        if len(vector) != 3:
            yield ("field", name), f"needs 3 numbers, one per axis x, y, z (got {len(vector)})"
    yield from equation_faults(config, d)
    yield from field_faults(config.output.fields)
    if len(config.points) == d:
        yield from mode_faults(config.output.modes, config.points)
    for field in asked_for(config):
        if said := fault(field, d, velocity_components(config)):
            yield ("output", "fields"), f"{field.name}: {said}"
    if len(simulation.space_length) == d:
        yield from gauge_faults(config.gauge, field_units(config), simulation.space_length)
        yield from histogram_faults(config)
    names = [name_of(species, i) for i, species in enumerate(config.species)]
    for i, species in enumerate(config.species):
        if "/" in names[i] or names[i] in (".", ".."):
            yield ("species", i, "name"), f"{names[i]!r} would be a path in the files of a run"
        own = [*accelerations.faults(species.acceleration), *batch_faults(config, species)]
        found = own, species_faults(species, d), particle_faults(species), loader_faults(species, d)
        for key, text in itertools.chain(*found):
            yield ("species", i, *key), text
        if species.particles_per_cell and species.particles_per_cell * config.cells > MOST_PARTICLES:
            yield ("species", i, "particles_per_cell"), f"makes more than {MOST_PARTICLES} particles"
    given, known = config.constants.vacuum_permittivity, units.SI.permittivity
    if config.units == "SI" and given is not None and abs(given / known - 1) > 0.01:
        yield ("constants", "vacuum_permittivity"), f"is {known} F/m in SI units: leave it out (got {given})"


def grid_faults(config: PlasmaConfig, d: int) -> Iterator[Fault]:
    grid = config.grid
    older = [name for name in ("blocks", "blocksize") if getattr(grid, name) is not None]
    if grid.points is not None and older:
        yield ("grid", older[0]), "give either points, or blocks and blocksize"
    elif grid.points is None and len(older) < 2:
        yield ("grid", *older), "needs points = [..] (or blocks and blocksize)"
    for name in ("points", *older):
        vector = getattr(grid, name)
        if vector is not None and len(vector) != d:
            yield ("grid", name), f"needs {d} number(s) in {d}D (got {len(vector)})"
        elif vector is not None and max(vector) > MOST_POINTS:
            yield ("grid", name), f"at most {MOST_POINTS} on an axis (got {max(vector)})"


def equation_faults(config: PlasmaConfig, d: int) -> Iterator[Fault]:
    """Constants of an axis that is not there; clouds and spectral gradients without a Fourier space."""
    equation = config.field.equation
    for name, usual in (("d", 1.0), ("e", 0.0)):
        if d == 1 and (value := getattr(equation, name)) != usual:
            yield ("field", "equation", name), f"is of y, which a 1D box does not have (got {value:g})"
    if config.numerics.cloud_radius and config.simulation.solver == "LU":
        text = f'needs the Fourier space of simulation.solver = "MFT" (got {config.numerics.cloud_radius:g} with "LU")'
        yield ("numerics", "cloud_radius"), text
    if config.numerics.gradient == "spectral" and config.simulation.solver == "LU":
        text = 'needs the Fourier space of simulation.solver = "MFT" (got "spectral" with "LU")'
        yield ("numerics", "gradient"), text


def field_faults(names: tuple[str, ...]) -> Iterator[Fault]:
    """Names in output.fields that no field has, or that stand there twice."""
    known = (*MESH_FIELDS, *SPECIES_FIELDS)
    for name in names:
        if name not in known:
            yield ("output", "fields"), f"{abridged(name)} is no field; there are {', '.join(known)}"
    for name in {name for name in names if names.count(name) > 1}:
        yield ("output", "fields"), f"{abridged(name)} stands there twice"


def mode_faults(modes: tuple[tuple[int, ...], ...], points: tuple[int, ...]) -> Iterator[Fault]:
    """Modes in output.modes that the grid does not have, or that stand there twice."""
    for i, mode in enumerate(modes):
        path = ("output", "modes", i)
        if len(mode) != len(points):
            yield path, f"needs {len(points)} number(s) in {len(points)}D (got {len(mode)})"
        elif not any(mode):
            yield path, "must not be zero on every axis"
        elif any(2 * abs(n) > m for n, m in zip(mode, points)):
            most = ", ".join(str(m // 2) for m in points)
            yield path, f"is shorter than two cells: at most {most} wavelengths along the axes (got {list(mode)})"
        elif mode in modes[:i]:
            yield path, "stands there twice"


def batch_faults(config: PlasmaConfig, species: Species) -> Iterator[Fault]:
    """A number of particles that the loader cannot place."""
    loader, per_cell = LOADERS.get(species.init_method), species.particles_per_cell
    if loader is None or not loader.whole_batches or not config.points:
        return
    if per_cell is not None and per_cell * config.cells > MOST_PARTICLES:
        return  # told elsewhere
    n = species.particles if per_cell is None else round(per_cell * config.cells)
    if not n:
        return
    size = loader.batch_size(species, config.points)
    if n % size:
        least = n // size * size
        fitting = f"{least} or {least + size}" if least else f"at least {size}"
        yield ("particles",), f"must be a multiple of {size} for init_method {loader.name!r}: {fitting} (got {n})"


def species_faults(species: Species, d: int) -> Iterator[Fault]:
    """What does not fit together in one species, in d dimensions."""
    if species.drift_velocity and len(species.drift_velocity) < d:
        yield ("drift_velocity",), f"needs {d} numbers in {d}D, or 3 (got {len(species.drift_velocity)})"
    for name in ("position_init", "position_delta"):
        vector = getattr(species, name)
        if vector and len(vector) != d:
            yield (name,), f"needs {d} number(s) in {d}D (got {len(vector)})"
    if species.perturbation:
        mode = species.perturbation.mode
        if len(mode) != d:
            yield ("perturbation", "mode"), f"needs {d} number(s) in {d}D (got {len(mode)})"
        elif not any(mode):
            yield ("perturbation", "mode"), "must not be zero on every axis"
