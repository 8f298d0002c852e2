"""Fills in what the settings of a plasma case determine: numbers in place of words, names, vectors of full length."""

from hpcpic.core.case.gauge import named
from hpcpic.core.case.words import in_steps
from hpcpic.plasma.case import units
from hpcpic.plasma.case.config import Constants, Every, Grid, Period, PlasmaConfig, Species, name_of
from hpcpic.plasma.case.older_words import KINDS
from hpcpic.plasma.setup.histograms import completed_histograms
from hpcpic.plasma.setup.macro_particles import numbers


def completed(config: PlasmaConfig) -> PlasmaConfig:
    """The case with numbers in place of words, names, and vectors of full length.

    The period of the series stays None where none is given: what it is to be depends on what a run costs.
    """
    d, points = config.dimensions, config.points
    permittivity = config.constants.vacuum_permittivity or units.SYSTEMS[config.units].permittivity
    every, period, step = config.output.every, config.output.period, config.simulation.time_step
    steps: dict[str, int | None] = {kind: in_steps(getattr(every, kind), getattr(period, kind), step) for kind in KINDS}
    for kind in ("series", "histograms"):  # see configure
        if getattr(every, kind) is None and getattr(period, kind) is None:
            steps[kind] = None
    output = config.output.model_copy(update={"every": Every(**steps), "period": Period()})
    full = config.model_copy(
        update={
            "simulation": config.simulation.model_copy(update={"dimensions": d}),
            "grid": Grid(points=points),
            "constants": Constants(vacuum_permittivity=permittivity),
            "species": tuple(completed_species(species, i, config) for i, species in enumerate(config.species)),
            "gauge": named(config.gauge),
            "output": output,
        }
    )
    return full.model_copy(update={"histogram": completed_histograms(full)})


def completed_species(species: Species, i: int, config: PlasmaConfig) -> Species:
    """Name given, vectors of full length, numbers in the place of words."""
    zeros, d = (0.0,) * 3, config.dimensions
    return species.model_copy(
        update={
            "name": name_of(species, i),
            "drift_velocity": (species.drift_velocity + zeros)[:3],
            "position_init": species.position_init or zeros[:d],
            "position_delta": species.position_delta or zeros[:d],
            **numbers(species, config.cells, units.SYSTEMS[config.units]),
        }
    )
