"""What can be turned in an LBM-DEM case, and what is asked of it: permeability, energy, momentum, a grain's motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hpcpic.core.app.knobs import Choice, Knob, Knobs, Quantity
from hpcpic.core.case.schema import value_text
from lbmdem.case.config import LbmDemConfig, seeps
from lbmdem.forecast.plan import grain_count
from lbmdem.physics.collision import COLLISIONS
from lbmdem.physics.velocity_sets import CS2
from lbmdem.physics.wall_rules import RULES
from lbmdem.sizes import STORAGE

if TYPE_CHECKING:
    from hpcpic.core.files.series import Series

SAMPLES = 17  # times of a quantity that is a curve
ROWS = 400  # of the series of a whole run, in pilots
COARSEST = 2  # cells across the shortest side
LIMIT = "step of the contacts"  # the derived number
HORIZON_STEPS = 500  # of the fluid in which an instability shows
DRY_STEPS = 10000  # of grains alone


def knobs_of(config: LbmDemConfig) -> Knobs:
    """The knobs of a completed case."""
    time = config.simulation.end_time
    return Knobs(
        knobs=tuple(wet(config) if config.fluid else dry()),
        choices=tuple(choices_of(config)),
        quantities=lambda: quantities_of(config, time),
        settings=partial(settings, config),
        time=time,
        pilot=(
            f"output.period.series={time / ROWS!r}",
            "output.period.fields=0",
            "output.period.grains=0",
            "output.period.checkpoint=0",
        ),
        work=work,
        work_unit="node-updates" if config.fluid else "grain-steps",
        horizon=min(time, (HORIZON_STEPS if config.fluid else DRY_STEPS) * config.time_step),
        growth=growth,
        seed=reseeded if any(grains.diameters for grains in config.grains) else None,  # only these draw numbers
    )


def reseeded(seed: int) -> tuple[str, ...]:
    return (f"simulation.random_seed={seed}",)


def wet(config: LbmDemConfig) -> list[Knob]:
    """dx at fixed tau is diffusive scaling: dt ~ dx^2. tau - 1/2 alone is the time step."""
    d = config.dimensions
    key = ("fluid", "time_step") if config.liquid.time_step is not None else ("fluid", "relaxation_time")
    found = [
        Knob("dx", "node spacing, at the same tau", "m", ("domain", "spacing"), lambda c: c.spacing, 2.0, d + 2.0,
             "grid Reynolds number"),
        Knob("tau", "relaxation time, which is the time step", "", key, lambda c: c.tau - 0.5, 2.0, 1.0,
             "Mach number", shown=lambda size: size + 0.5),
    ]  # fmt: skip
    if any(grains.moving for grains in config.grains):
        found.append(
            Knob("substeps", "steps of the grains in one of the fluid", "", ("coupling", "substeps"),
                 lambda c: 1.0 / c.substeps, 2.0, 0.5, LIMIT, shown=lambda size: 1.0 / size)
        )  # fmt: skip
    return found


def dry() -> list[Knob]:
    key = ("simulation", "time_step")
    return [Knob("dt", "time step of the contacts", "s", key, lambda c: c.time_step, 2.0, 1.0, LIMIT)]


def choices_of(config: LbmDemConfig) -> list[Choice]:
    fluid = config.fluid
    if fluid is None:
        return []
    listed = [
        Choice("collision", ("fluid", "collision"), value_text(fluid.collision),
               others(fluid.collision, tuple(COLLISIONS)), "dx"),
        Choice("storage", ("fluid", "storage"), value_text(fluid.storage),
               others(fluid.storage, tuple(STORAGE))),
    ]  # fmt: skip
    if config.grains or config.obstacle:
        here = config.coupling.bounce_back
        rules = others(here, tuple(RULES))
        listed.append(Choice("bounce_back", ("coupling", "bounce_back"), value_text(here), rules, "dx"))
    return listed


def others(here: str, values: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(value_text(value) for value in values if value != here)


# --------------------------------------------------------------------------------------------------- settings


def settings(config: LbmDemConfig, sizes: Mapping[str, float], time: float) -> tuple[str, ...]:
    """--set list for spacing dx [m], tau - 1/2 or, without fluid, time step dt [s], in a run until time [s]."""
    made = [f"simulation.end_time={time!r}"]
    if config.fluid is None:
        return (*made, f"simulation.time_step={float(sizes.get('dt', config.time_step))!r}", "coupling.substeps=1")
    spacing = fitting(config, float(sizes.get("dx", config.spacing)))
    excess = float(sizes.get("tau", config.tau - 0.5))
    made.append(f"domain.spacing={spacing!r}")
    if "substeps" in sizes and any(grains.moving for grains in config.grains):
        made.append(f"coupling.substeps={max(1, math.ceil(1.0 / sizes['substeps'] - 1e-6))}")
    if config.liquid.time_step is None:
        return (*made, f"fluid.relaxation_time={0.5 + excess!r}")
    return (*made, f"fluid.time_step={excess * CS2 * spacing**2 / config.liquid.kinematic_viscosity!r}")


def fitting(config: LbmDemConfig, wanted: float) -> float:
    """The largest spacing not above the wanted one that divides every side of the box."""
    points = config.points
    whole = math.gcd(*points)
    least = math.ceil(COARSEST * whole / min(points)) if min(points) >= COARSEST else whole
    cells = max(least, math.ceil(whole * config.spacing / wanted - 1e-6))
    return config.spacing * whole / cells


def work(config: LbmDemConfig) -> float:
    """Updates of nodes, or of grains where there is no fluid."""
    if config.fluid:
        return float(config.n_steps) * math.prod(config.points)
    return float(config.n_steps) * grain_count(config)


# ------------------------------------------------------------------------------------------------- quantities


def quantities_of(config: LbmDemConfig, time: float) -> list[Quantity]:
    """The one that the case is about first. time [s]: of the whole run."""
    moving = any(grains.moving for grains in config.grains)
    if config.fluid is None:
        text = "kinetic energy of the grains at the end"
        return [Quantity("grain-energy", text, time, partial(at_end, "energy_kinetic_grains", time))]
    found = []
    if seeps(config) and not moving:
        text = "permeability at half the run"
        found.append(Quantity("permeability", text, time / 2, partial(at_end, "permeability", time / 2)))
    if moving:
        name, text = "energy_kinetic_grains", "kinetic energy of the grains in the first quarter"
        found.append(Quantity("grain-energy", text, time / 4, partial(curve, name, time / 4)))
    text = "kinetic energy of the fluid in the first quarter"
    found.append(Quantity("energy", text, time / 4, partial(curve, "energy_kinetic", time / 4)))
    if any(config.liquid.body_force) or any(any(face.velocity) for face in config.boundary):
        axis = main_axis(config)
        text = f"momentum of the fluid along {axis} in the first quarter"
        found.insert(0 if not config.grains else len(found),
                     Quantity("momentum", text, time / 4, partial(curve, f"momentum_{axis}", time / 4)))  # fmt: skip
    return found


def main_axis(config: LbmDemConfig) -> str:
    """Axis along which the flow is driven."""
    vectors = [config.liquid.body_force, *(face.velocity for face in config.boundary)]
    sizes = [max((abs(v[k]) for v in vectors if len(v) > k), default=0.0) for k in range(config.dimensions)]
    return "xyz"[int(np.argmax(sizes))]


def curve(name: str, time: float, series: Series) -> np.ndarray:
    """A scalar at the same times of every pilot, in the second half of [0, time]."""
    from scipy.interpolate import CubicSpline

    wanted = np.clip(np.linspace(0.5 * time, time, SAMPLES), series.time[0], series.time[-1])
    return CubicSpline(series.time, series[name])(wanted)


def at_end(name: str, time: float, series: Series) -> float:
    return float(np.interp(time, series.time, series[name]))


def growth(series: Series) -> float:
    """Largest kinetic energy over that at the start; what starts at rest is watched by the guards of the run."""
    energy = series.get("energy_kinetic", series.get("energy_kinetic_grains"))
    assert energy is not None
    if not np.isfinite(energy).all():
        return math.inf
    return float(energy.max() / energy[0]) if energy[0] > 0.0 else 1.0
