"""What the command line knows of LBM-DEM. Only `load` and `bench` import anything heavy."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from hpcpic.core.app.app import App, later, named, repeating
from hpcpic.core.case.cases import shipped_with

if TYPE_CHECKING:
    from hpcpic.core.run.model import Make
    from lbmdem.case.config import LbmDemConfig

shipped_cases = partial(shipped_with, "lbmdem")


def until(config: LbmDemConfig, t: float) -> tuple[str, ...]:
    """The --set list that ends the run at time t [s]."""
    return (f"simulation.end_time={t!r}",)


def grow(config: LbmDemConfig, factor: int) -> tuple[str, ...]:
    """The --set list that makes the box `factor` times as long along the slab axis, with as dense a packing.

    Raises ValueError where grains have places of their own.
    """
    if any(len(grains.centres) for grains in config.grains):
        raise ValueError("grains at given places do not multiply")
    size = [*config.domain.size[:-1], config.domain.size[-1] * factor]
    packed = (
        f"grains[{k}].diameters.count={grains.diameters.count * factor}"
        for k, grains in enumerate(config.grains)
        if grains.diameters
    )
    return (f"domain.size={size}", *packed)


def load() -> Make:
    """The model of a case."""
    from lbmdem.step import LbmDem

    return LbmDem


APP = App(
    name="lbmdem",
    title="lattice Boltzmann with discrete-element grains",
    schema=named("lbmdem.case.config", "LbmDemConfig"),
    configure=later("lbmdem.configure", "configure"),
    cases=shipped_cases,
    derived=later("lbmdem.forecast.derived", "derived"),
    estimate=later("lbmdem.forecast.estimate", "estimate"),
    load=load,
    until=until,
    time_step=lambda config: config.time_step,
    grow=grow,
    periods=lambda config: repeating(config.domain.size, config.domain.periodic),
    free=("description", "simulation.end_time", "simulation.blocks", "gauge", "output"),
    bench=later("lbmdem.bench", "bench"),
    bench_ranks=later("lbmdem.bench", "bench_ranks"),
    plots=named("lbmdem.analysis.plots", "PLOTS"),
    plan=later("lbmdem.forecast.plan", "plan"),
    knobs=later("lbmdem.forecast.knobs", "knobs_of"),
    knob_names=("dx", "tau", "substeps", "dt", "collision", "storage", "bounce_back"),
    sections={
        "fluid": "collide and stream, with walls and forces on grains",
        "grains": "contacts, films and motion of the grains, in substeps",
        "solid": "which nodes the grains have covered and left, and where links cross them",
    },
)
