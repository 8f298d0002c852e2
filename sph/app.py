"""What the command line knows of SPH. Only `load` and `bench` import anything heavy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from hpcpic.core.cli.app import App, later
from sph.cases import shipped_cases

if TYPE_CHECKING:
    from hpcpic.core.cli.figures import Plot
    from hpcpic.core.cli.knobs import Knobs
    from sph.config import SphConfig


def schema() -> type[SphConfig]:
    from sph.config import SphConfig

    return SphConfig


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


def plots() -> Mapping[str, Plot]:
    from sph.plots import PLOTS

    return PLOTS


def knobs(config: SphConfig) -> Knobs:
    from sph.knobs import knobs_of

    return knobs_of(config)


APP = App(
    name="sph",
    title="weakly compressible smoothed particle hydrodynamics",
    schema=schema,
    cases=shipped_cases,
    derived=later("sph.derived", "derived"),
    estimate=later("sph.estimate", "estimate"),
    load=load,
    until=until,
    time_step=later("sph.limits", "time_step"),
    grow=grow,
    free=("description", "simulation.end_time", "gauge", "output", "numerics.balance_period"),
    plots=plots,
    plan=later("sph.plan", "plan"),
    bench=bench,
    knobs=knobs,
)
