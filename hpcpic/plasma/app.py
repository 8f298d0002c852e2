"""What the command line knows of the plasma. Only `load` and `bench` import anything heavy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from hpcpic.core.cli.app import App, later
from hpcpic.plasma.cases import shipped_cases

if TYPE_CHECKING:
    from hpcpic.core.cli.figures import Plot
    from hpcpic.core.cli.knobs import Knobs
    from hpcpic.plasma.config import PlasmaConfig


def schema() -> type[PlasmaConfig]:
    from hpcpic.plasma.config import PlasmaConfig

    return PlasmaConfig


def load() -> type:
    from hpcpic.plasma.step import Plasma

    return Plasma


def until(config: PlasmaConfig, t: float) -> tuple[str, ...]:
    """The number of steps that ends at time t [s], as --set says it."""
    return (f"simulation.cycles={max(1, round(t / config.simulation.time_step))}",)


def grow(config: PlasmaConfig, factor: int) -> tuple[str, ...]:
    """The --set list that makes the box `factor` times as long along the slab axis, with as many particles a cell."""
    axis = config.dimensions - 1
    points, lengths = list(config.grid.points), list(config.simulation.space_length)
    points[axis] *= factor
    lengths[axis] *= factor
    particles = (
        f"species[{k}].particles={species.particles * factor}" for k, species in enumerate(config.species)
    )
    return (f"grid.points={points}", f"simulation.space_length={lengths}", *particles)


def bench(quick: bool) -> Mapping[str, float]:
    from hpcpic.plasma.bench import bench as measure

    return measure(quick)


def plots() -> Mapping[str, Plot]:
    from hpcpic.plasma.plots import PLOTS

    return PLOTS


def knobs(config: PlasmaConfig) -> Knobs:
    from hpcpic.plasma.knobs import knobs_of

    return knobs_of(config)


APP = App(
    name="hpcpic",
    title="electrostatic particle-in-cell plasma",
    schema=schema,
    cases=shipped_cases,
    derived=later("hpcpic.plasma.derived", "derived"),
    estimate=later("hpcpic.plasma.estimate", "estimate"),
    load=load,
    until=until,
    time_step=lambda config: config.simulation.time_step,
    grow=grow,
    free=(
        "description",
        "simulation.cycles",
        "simulation.stop_SEM",
        "simulation.sampling_period",
        "simulation.plasma_chunks",
        "output",
    ),
    bench=bench,
    plots=plots,
    plan=later("hpcpic.plasma.plan", "plan"),
    knobs=knobs,
)
