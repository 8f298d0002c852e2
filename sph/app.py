"""What the command line knows of SPH. Only `load` and `bench` import anything heavy."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from hpcpic.core.cli.app import App
from sph.cases import shipped_cases
from sph.config import SphConfig
from sph.derived import derived
from sph.estimate import estimate
from sph.limits import time_step
from sph.plan import plan

if TYPE_CHECKING:
    from hpcpic.core.cli.figures import Plot
    from hpcpic.core.cli.knobs import Knobs


def load() -> type:
    from sph.step import Sph

    return Sph


def until(config: SphConfig, t: float) -> tuple[str, ...]:
    """The end at time t [s], as --set says it."""
    return (f"simulation.end_time={t!r}",)


def grow(config: SphConfig, factor: int) -> tuple[str, ...]:
    """The --set list of the same scene with `factor` times as many particles."""
    return (f"numerics.spacing={config.numerics.spacing / factor ** (1 / config.dimensions)!r}",)


def bench(quick: bool) -> Mapping[str, float]:
    from sph.bench import bench as measure

    return measure(quick)


def plots() -> "Mapping[str, Plot]":
    from sph.plots import PLOTS

    return PLOTS


def knobs(config: SphConfig) -> "Knobs":
    from sph.knobs import knobs_of

    return knobs_of(config)


APP = App(
    name="sph",
    title="weakly compressible smoothed particle hydrodynamics",
    schema=lambda: SphConfig,
    cases=shipped_cases,
    derived=derived,
    estimate=estimate,
    load=load,
    until=until,
    time_step=time_step,
    grow=grow,
    free=("description", "simulation.end_time", "gauge", "output", "numerics.balance_period"),
    plots=plots,
    plan=plan,
    bench=bench,
    knobs=knobs,
)
