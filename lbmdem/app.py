"""What the command line knows of LBM-DEM. Only `load` and `bench` import anything heavy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from hpcpic.core.cli.app import App, later
from lbmdem.cases import shipped_cases

if TYPE_CHECKING:
    from hpcpic.core.cli.figures import Plot
    from hpcpic.core.cli.knobs import Knobs
    from lbmdem.config import LbmDemConfig


def schema() -> type[LbmDemConfig]:
    from lbmdem.config import LbmDemConfig

    return LbmDemConfig


def load() -> type:
    from lbmdem.step import LbmDem

    return LbmDem


def until(config: LbmDemConfig, t: float) -> tuple[str, ...]:
    """The --set list that ends the run at time t [s]."""
    return (f"simulation.end_time={t!r}",)


def grow(config: LbmDemConfig, factor: int) -> tuple[str, ...]:
    """The --set list that makes the box `factor` times as long along the slab axis, with as dense a packing.

    Raises ValueError where grains have places of their own.
    """
    if any(grains.position for grains in config.grains):
        raise ValueError("grains at given places do not multiply")
    size = [*config.domain.size[:-1], config.domain.size[-1] * factor]
    packed = (
        f"grains[{k}].diameters.count={grains.diameters.count * factor}"
        for k, grains in enumerate(config.grains)
        if grains.diameters
    )
    return (f"domain.size={size}", *packed)


def bench(quick: bool) -> Mapping[str, float]:
    from lbmdem.bench import bench as measure

    return measure(quick)


def plots() -> Mapping[str, Plot]:
    from lbmdem.plots import PLOTS

    return PLOTS


def knobs(config: LbmDemConfig) -> Knobs:
    from lbmdem.knobs import knobs_of

    return knobs_of(config)


APP = App(
    name="lbmdem",
    title="lattice Boltzmann with discrete-element grains",
    schema=schema,
    cases=shipped_cases,
    derived=later("lbmdem.derived", "derived"),
    estimate=later("lbmdem.estimate", "estimate"),
    load=load,
    until=until,
    time_step=lambda config: config.time_step,
    grow=grow,
    free=("description", "simulation.end_time", "simulation.blocks", "output"),
    bench=bench,
    plots=plots,
    plan=later("lbmdem.plan", "plan"),
    knobs=knobs,
)
