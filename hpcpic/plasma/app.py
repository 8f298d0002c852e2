"""What the command line knows of the plasma. Only `load` and `bench` import anything heavy."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from hpcpic.core.app.app import App, later, named
from hpcpic.core.case.cases import shipped_with

if TYPE_CHECKING:
    from hpcpic.core.run.model import Make
    from hpcpic.plasma.case.config import PlasmaConfig

shipped_cases = partial(shipped_with, "hpcpic")
MOST_CYCLES = 2.0**62  # that a case file can say


def until(config: PlasmaConfig, t: float) -> tuple[str, ...]:
    """The number of steps that ends at time t [s], as --set says it."""
    return (f"simulation.cycles={max(1, round(min(t / config.simulation.time_step, MOST_CYCLES)))}",)


def grow(config: PlasmaConfig, factor: int) -> tuple[str, ...]:
    """The --set list that makes the box `factor` times as long along the slab axis, with as many particles a cell."""
    axis = config.dimensions - 1
    points, lengths = list(config.points), list(config.simulation.space_length)
    points[axis] *= factor
    lengths[axis] *= factor
    particles = (
        f"species[{k}].particles={(species.particles or 0) * factor}" for k, species in enumerate(config.species)
    )
    return (f"grid.points={points}", f"simulation.space_length={lengths}", *particles)


def mass(config: PlasmaConfig) -> float:
    """Mass of all particles, kg."""
    from hpcpic.plasma.setup.macro_particles import macro_mass

    return sum((species.particles or 0) * macro_mass(config, species) for species in config.species)


def load() -> Make:
    """The model of a case."""
    from hpcpic.plasma.step import Plasma

    return Plasma


APP = App(
    name="hpcpic",
    title="electrostatic particle-in-cell plasma",
    schema=named("hpcpic.plasma.case.config", "PlasmaConfig"),
    configure=later("hpcpic.plasma.configure", "configure"),
    cases=shipped_cases,
    derived=later("hpcpic.plasma.forecast.derived", "derived"),
    estimate=later("hpcpic.plasma.forecast.estimate", "estimate"),
    load=load,
    until=until,
    time_step=lambda config: config.simulation.time_step,
    grow=grow,
    mass=mass,
    periods=lambda config: config.simulation.space_length,
    stop_sem=lambda config: config.simulation.stop_SEM,
    free=(
        "description",
        "simulation.cycles",
        "simulation.stop_SEM",
        "simulation.sampling_period",
        "simulation.plasma_chunks",
        "gauge",
        "histogram",
        "output",
    ),
    bench=later("hpcpic.plasma.bench", "bench"),
    bench_ranks=later("hpcpic.plasma.bench", "bench_ranks"),
    plots=named("hpcpic.plasma.analysis.plots", "PLOTS"),
    plan=later("hpcpic.plasma.forecast.plan", "plan"),
    knobs=later("hpcpic.plasma.analysis.knobs", "knobs_of"),
    knob_names=("dx", "dt", "particles", "gradient", "precision", "shape", "exact_phase"),
    sections={
        "field": "from the charge on the nodes to the electric field, with its transforms",
        "push": "new velocities and places of the particles; who leaves a slab sets off",
        "deposit": "particles arrive in their tiles; their charge is shared among the nodes",
    },
)
