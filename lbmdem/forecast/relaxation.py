"""The relaxation time: its limits, what it may be instead, and the speeds that it bears."""

import math
from collections.abc import Iterator

from hpcpic.core.case.config import Path
from hpcpic.core.case.derived import Derived, Verdict, judged, rounded_down
from lbmdem.case.config import LbmDemConfig, whole_spacing
from lbmdem.physics.collision import BRAKES, COLLISIONS, HOLDS

TAU = ("fluid", "relaxation_time")
SPACING = ("domain", "spacing")
CENTRAL = 'collision = "central" has no such limit'
# The grid Reynolds number up to which a flow past a cylinder of 10 nodes holds for 3 s, and one that diverges, measured
PAST_SOLIDS = {"TRT": (7.5, 10.0), "BGK": (3.75, 7.5)}
MANY_STEPS = 1e9  # of a run
LEAST_EXCESS = 1e-12  # of tau over 1/2: of less, rounding leaves fewer than four digits of the viscosity


def unlimited(config: LbmDemConfig) -> str:
    """What central moments have no limit of, and what they are not for."""
    return CENTRAL + (BRAKES if config.grains_move else HOLDS if config.grains else "")


def other_collision(config: LbmDemConfig) -> str:
    """The ways to a lower grid Reynolds number, or to none that matters."""
    return f"{unlimited(config)}; a finer spacing lowers it"


def finer(config: LbmDemConfig, most: float) -> str:
    """The largest spacing up to `most` (m) of which all sides hold a whole number, in the words of a case."""
    return f"domain.spacing = {whole_spacing(config.domain.size, most) or rounded_down(most):.9g}"


def key_of_tau(config: LbmDemConfig) -> Path:
    return ("fluid", "time_step") if config.liquid.time_step is not None else TAU


def relaxation(config: LbmDemConfig) -> Iterator[Derived]:
    """tau and the time step that goes with it [5]."""
    tau, collision = config.tau, COLLISIONS[config.liquid.collision]
    yield Derived("time step", "dt", config.time_step, "s")
    yield judged(
        "steps", "N", config.n_steps, ok=config.n_steps <= MANY_STEPS, legal=True, limit=f"<= {MANY_STEPS:g}",
        source="a millisecond each: 11 days", key=("simulation", "end_time"),
        cure="a shorter end_time, or check the units of viscosity and spacing",
    )  # fmt: skip
    verdict: Verdict = "ok"
    limit, cure = "0.5 < tau <= 5", ""
    source = "Mansouri et al. [5]; Ginzburg & d'Humieres 2003"
    if tau - 0.5 < LEAST_EXCESS:
        verdict, limit = "fail", f"> 0.5 + {LEAST_EXCESS:g}"
        cure = "rounding leaves no viscosity: a larger time step or viscosity, or a finer spacing"
    elif tau >= 1e3:
        verdict, limit, cure = "fail", "< 1000", "relaxation_time = 5 is large and accurate with TRT"
    elif tau > 5:
        verdict, cure = "warn", "the time step is no longer short against what happens in a cell"
    elif tau < 0.505 and math.isfinite(collision.grid_reynolds):
        verdict, limit = "warn", ">= 0.505"
        cure = f"nearly no viscosity on this lattice: stable below U dx/nu = {collision.grid_reynolds:g} only"
    yield Derived("relaxation time", "tau", tau, "", limit, verdict, source, cure, key_of_tau(config))


def grid_reynolds(config: LbmDemConfig, value: float) -> Derived:
    """The grid Reynolds number of the largest known velocity: past solids layers and wakes are thinner than what a
    shear layer without walls bears.
    """
    most = COLLISIONS[config.liquid.collision].grid_reynolds
    limit, best, cure = f"<= {most:g}" if math.isfinite(most) else "none", most / 2, other_collision(config)
    source = "doubly periodic shear layer, measured (tests/validation)"
    if math.isfinite(most) and (config.grains or config.obstacle):
        best, diverges = PAST_SOLIDS[config.liquid.collision]
        limit = f"<= {best:g} past solids, {most:g} at all"
        source = f"measured past a cylinder, {config.liquid.collision}: {diverges:g} diverges, {best:g} holds"
        cure = f"{unlimited(config)}; {finer(config, config.spacing * best / value)} is fine enough"
    return judged(
        "grid Reynolds number", "U dx/nu", value, ok=value <= best * (1 + 1e-9), legal=value <= most, limit=limit,
        source=source, cure=cure, key=SPACING, forceable=True,
    )  # fmt: skip


def slower(config: LbmDemConfig, factor: float) -> str:
    """The relaxation time with so many times the time step: three digits of what it has above 1/2."""
    excess = max((config.tau - 0.5) * factor, LEAST_EXCESS)
    return f"{0.5 + excess:.{max(1, 2 - math.floor(math.log10(excess)))}f}"
