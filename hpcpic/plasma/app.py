"""What the command line knows of the plasma. Only `load` and `bench` import anything heavy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from hpcpic.core.cli.app import App, later, named
from hpcpic.core.files.cases import cases_in

if TYPE_CHECKING:
    from hpcpic.plasma.config import PlasmaConfig


MOST_CYCLES = 2.0**62  # that a case file can say


def shipped_cases() -> dict[str, Path]:
    """Name and file of each. `shipped` is package data, in a checkout a link to configs/plasma."""
    return cases_in((Path(__file__).parent / "shipped").resolve())


def until(config: PlasmaConfig, t: float) -> tuple[str, ...]:
    """The number of steps that ends at time t [s], as --set says it."""
    return (f"simulation.cycles={max(1, round(min(t / config.simulation.time_step, MOST_CYCLES)))}",)


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


APP = App(
    name="hpcpic",
    title="electrostatic particle-in-cell plasma",
    schema=named("hpcpic.plasma.config", "PlasmaConfig"),
    cases=shipped_cases,
    derived=later("hpcpic.plasma.derived", "derived"),
    estimate=later("hpcpic.plasma.estimate", "estimate"),
    load=named("hpcpic.plasma.step", "Plasma"),
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
    bench=later("hpcpic.plasma.bench", "bench"),
    bench_ranks=later("hpcpic.plasma.bench", "bench_ranks"),
    plots=named("hpcpic.plasma.plots", "PLOTS"),
    plan=later("hpcpic.plasma.plan", "plan"),
    knobs=later("hpcpic.plasma.knobs", "knobs_of"),
)
