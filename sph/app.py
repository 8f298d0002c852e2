"""What the command line knows of SPH. Only `load` and `bench` import anything heavy."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from hpcpic.core.app.app import App, later, named, repeating
from hpcpic.core.case.cases import shipped_with

if TYPE_CHECKING:
    from hpcpic.core.run.model import Make
    from sph.case.config import SphConfig

shipped_cases = partial(shipped_with, "sph")


def until(config: SphConfig, t: float) -> tuple[str, ...]:
    """The end at time t [s], as --set says it."""
    return (f"simulation.end_time={t!r}",)


def grow(config: SphConfig, factor: int) -> tuple[str, ...]:
    """The --set list of the same scene with `factor` times as many particles."""
    return (f"numerics.spacing={config.numerics.spacing / factor ** (1 / config.dimensions)!r}",)


def periods(config: SphConfig) -> tuple[float, ...]:
    """After which the domain repeats itself along each axis, m; infinite where it does not."""
    low, high = config.domain.corners
    return repeating([above - below for below, above in zip(low, high)], config.domain.periodic)


def load() -> Make:
    """The model of a case."""
    from sph.step import Sph

    return Sph


APP = App(
    name="sph",
    title="weakly compressible smoothed particle hydrodynamics",
    schema=named("sph.case.config", "SphConfig"),
    configure=later("sph.configure", "configure"),
    cases=shipped_cases,
    derived=later("sph.forecast.derived", "derived"),
    estimate=later("sph.forecast.estimate", "estimate"),
    load=load,
    until=until,
    time_step=later("sph.physics.stability", "time_step"),
    grow=grow,
    periods=periods,
    free=("description", "simulation.end_time", "gauge", "output", "numerics.balance_period"),
    plots=named("sph.analysis.plots", "PLOTS"),
    plan=later("sph.forecast.plan", "plan"),
    bench=later("sph.bench", "bench"),
    bench_ranks=later("sph.bench", "bench_ranks"),
    knobs=later("sph.forecast.knobs", "knobs_of"),
    knob_names=("dx", "mach", "cfl", "smoothing", "precision", "integrator"),
    sections={
        "pairs": "sums over all pairs of neighbours: accelerations and changes of density",
        "update": "positions, velocities and densities at the next time",
        "migrate": "particles that left a slab go to its new rank; slabs of equal load",
        "ghosts": "copies of particles: from other ranks, across periodic sides, in mirrors",
        "sort": "particles in the order of cells, and who is near whom",
        "dt": "the next time step, from the largest speed and acceleration on all ranks",
    },
)
