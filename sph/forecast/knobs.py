"""What can be turned in an SPH case, and what is asked of it: impulse, gauges, front, energy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hpcpic.core.app.knobs import Choice, Knob, Knobs, Quantity, Seen, reseeded
from hpcpic.core.case.texts import value_text
from hpcpic.core.study.quantities import at_end, grown
from sph.case.config import FRONT, PRESSURE, WALL_PRESSURE, Gauge, SphConfig
from sph.forecast.plan import counts
from sph.physics import stability
from sph.physics.integrators import INTEGRATORS
from sph.physics.wall_rules import rule_of
from sph.setup.flows import Linear, flow_of

if TYPE_CHECKING:
    from hpcpic.core.files.series import Series

SAMPLES = 17  # times of a quantity that is a curve
ROWS = 400  # of the series of a whole run, in pilots
LAYERS = 8  # particles across the thinnest box of fluid or a sphere, at least
HORIZON_STEPS = 500  # in which an instability shows
SMOOTHINGS = (1.3, 1.5, 2.0)
DISORDER = 0.01  # of the spacing: another start of the same scene


def knobs_of(config: SphConfig) -> Knobs:
    """Knobs, choices and quantities of a completed case."""
    time = config.simulation.end_time
    return Knobs(
        knobs=tuple(continuous(config)),
        choices=tuple(choices_of(config)),
        quantities=lambda: quantities_of(config, time),
        settings=partial(settings, config),
        time=time,
        pilot=(
            f"output.period.series={time / ROWS!r}",
            "output.period.particles=0",
            "output.period.checkpoint=0",
        ),
        work=lambda c: c.simulation.end_time / stability.time_step(c) * sum(counts(c)),
        work_unit="particle-steps",
        horizon=min(time, HORIZON_STEPS * stability.time_step(config)),
        growth=lambda series: grown(series["energy_kinetic"]),
        seed=reseeded if any(fluid.disorder for fluid in config.fluid) else None,
        shaken=partial(shaken, config),
        seen=seen(config),
    )


def shaken(config: SphConfig, seed: int) -> tuple[str, ...]:
    """Fluids that start on a perfect lattice are disordered a little."""
    return (*reseeded(seed), *(f"fluid[{i}].disorder={DISORDER!r}" for i in range(len(config.fluid))))


def seen(config: SphConfig) -> Seen:
    low, high = config.domain.corners
    cells = tuple(round((b - a) / config.numerics.spacing) for a, b in zip(low, high))
    return Seen("velocity", low, high, cells, snapshot)


def snapshot(time: float) -> tuple[str, ...]:
    """--set list that writes the particles of the fluid at the end."""
    return (f"output.period.particles={time!r}", "output.walls=false")


def continuous(config: SphConfig) -> list[Knob]:
    """Spacing (with h / dp as it is), Courant number, and the Mach number that the sound speed gives."""
    eos = ("eos", "sound_speed_factor" if factor_counts(config) else "sound_speed")
    found = [
        Knob("dx", "particle spacing, at the same h/dp", "m", ("numerics", "spacing"), lambda c: c.numerics.spacing,
             2.0 if closed(config) else 1.0, config.dimensions + 1.0),
        Knob("mach", "largest velocity expected over sound speed", "", eos, mach, 2.0, 1.0),
    ]  # fmt: skip
    if config.simulation.time_step is None:
        found.append(
            Knob("cfl", "time step over h / c0", "", ("simulation", "cfl"), lambda c: c.simulation.cfl,
                 INTEGRATORS[config.simulation.integrator].order, 1.0, "Courant number", overruled=overruled(config))
        )  # fmt: skip
    return found


def overruled(config: SphConfig) -> str:
    """Which other criterion sets the step before cfl comes to its limit, and what would be right; "" if none does."""
    steps, limit = stability.step_parts(config), stability.courant_limit(config)
    acoustic, here = limit * config.h / stability.fastest_sound(config), steps.pop("acoustic")
    name = min(steps, key=lambda part: steps[part], default="")
    if not name or steps[name] >= acoustic:
        return ""
    speed = f"{1.1 * config.sound_speed * acoustic / steps[name]:.2g}"
    what = {"viscous": f"viscosity (nu dt/h2 = {stability.viscous_limit(config):.3g})",
            "force": f"acceleration (dt = {stability.MAX_FORCE_STEP:g} sqrt(h/a))"}[name]  # fmt: skip
    does = f"sets no step from {steps[name] * limit / acoustic:.3g} on" if here < steps[name] else "sets no step here"
    return (
        f"it {does}, as {what} allows no more than {steps[name]:.3g} s, and the limit {limit:.3g} of cfl is "
        f"{acoustic:.3g} s. No setting turns that criterion: a longer step, fixed by simulation.time_step, is tried by "
        f"run --beyond-limits. With --set eos.sound_speed={speed} cfl has its limit"
    )


def closed(config: SphConfig) -> bool:
    """Whether the fluid ends nowhere, or at mirrors only: a free surface and other walls are of first order."""
    filled = any(
        fluid.shape.box and (fluid.shape.box.low, fluid.shape.box.high) == (config.domain.low, config.domain.high)
        for fluid in config.fluid
    )
    return filled and all(rule_of(wall.type).images for wall in config.wall)


def mach(config: SphConfig) -> float:
    """Largest velocity over sound speed; of a case that expects none, a hundredth of c0 is assumed."""
    return (config.eos.max_velocity or 0.01 * config.sound_speed) / config.sound_speed


def factor_counts(config: SphConfig) -> bool:
    """Whether c0 follows from the factor."""
    eos = config.eos
    return bool(eos.max_velocity) and math.isclose(
        eos.sound_speed or 0.0, eos.sound_speed_factor * (eos.max_velocity or 0.0), rel_tol=1e-9
    )


def choices_of(config: SphConfig) -> list[Choice]:
    numerics, integrator = config.numerics, config.simulation.integrator
    listed = (
        ("smoothing", ("numerics", "smoothing"), numerics.smoothing, SMOOTHINGS, "dx"),
        ("precision", ("numerics", "precision"), numerics.precision, ("double", "single"), ""),
        ("integrator", ("simulation", "integrator"), integrator, tuple(INTEGRATORS), "cfl"),
    )
    return [
        Choice(name, key, value_text(here), tuple(value_text(v) for v in values if v != here), acts_on)
        for name, key, here, values, acts_on in listed
    ]


def settings(config: SphConfig, sizes: Mapping[str, float], time: float) -> tuple[str, ...]:
    """--set list for spacing dx [m], Courant number and Mach number, in a run until time [s]."""
    made = [f"simulation.end_time={time!r}"]
    if "dx" in sizes:
        made.append(f"numerics.spacing={float(dividing(config, sizes['dx']))!r}")
    if "cfl" in sizes and config.simulation.time_step is None:
        made.append(f"simulation.cfl={float(sizes['cfl'])!r}")
    if "mach" in sizes and not math.isclose(sizes["mach"], mach(config), rel_tol=1e-9):
        speed = config.sound_speed * mach(config) / sizes["mach"]
        made.append(f"eos.sound_speed={float(speed)!r}")
    return tuple(made)


def dividing(config: SphConfig, wanted: float) -> float:
    """The largest spacing not above the wanted one that divides the thinnest side of a box of fluid, and puts LAYERS
    particles across every sphere.
    """
    if math.isclose(wanted, config.numerics.spacing, rel_tol=1e-9):
        return wanted
    shapes = [fluid.shape for fluid in config.fluid]
    edges = [b - a for shape in shapes if shape.box for a, b in zip(shape.box.low, shape.box.high)]
    wanted = min([wanted, *(2 * shape.sphere.radius / LAYERS for shape in shapes if shape.sphere)])
    return min(edges) / max(LAYERS, math.ceil(min(edges) / wanted - 1e-6)) if edges else wanted


# ------------------------------------------------------------------------------------------------- quantities


def quantities_of(config: SphConfig, time: float) -> list[Quantity]:
    """The one that the case is about first. time [s]: of the whole run."""
    found, end = [], time / 4
    for wall in config.wall:
        if wall.measure_force:
            name = f"impulse_{wall.name}"
            text, why = f"impulse on {wall.name} at the end", f"the case measures the force on {wall.name}"
            found.append(Quantity(name, text, time, partial(at_end, name, time), why=why))
    found += [asked_of(gauge, config, time) for gauge in config.gauge]
    text = "kinetic energy in the first quarter, over that at the start if there is any"
    flows = any(fluid.flow for fluid in config.fluid)
    why = "the fluid starts in a flow" if flows else "" if found else "the case has no gauge and measures no force"
    found.insert(0 if flows else len(found), Quantity("energy", text, end, partial(energy_curve, end), why=why))
    if any(flow_of(fluid, Linear) for fluid in config.fluid):  # whose energy hardly changes
        text = "largest x in the first quarter, over that at the start"
        why = "a linear flow stretches the fluid"
        found.insert(0, Quantity("stretch", text, end, partial(stretch, end), why=why))
    return found


def asked_of(gauge: Gauge, config: SphConfig, time: float) -> Quantity:
    """What is asked of a gauge: velocities and fronts while they grow, what else it reads later, pressures in the mean.
    Levels and flows need time until fluid arrives.
    """
    name, why, early = gauge.name, f"the case has the gauge {gauge.name}", time / 4
    if gauge.kind.vector:
        axis = "xyz"[int(np.argmax(np.abs(config.body_force)))]
        text, column = f"{gauge.what} along {axis} at {name} in the first quarter", f"{name}_{axis}"
        return Quantity(name, text, early, partial(curve, column, early), why=why)
    if gauge.kind is FRONT:
        return Quantity(name, f"{name} in the first quarter", early, partial(curve, name, early), why=why)
    if gauge.kind in (PRESSURE, WALL_PRESSURE):
        text = f"mean pressure at {name} in the second half"
        return Quantity(name, text, time, partial(mean, name, time), why=why)
    return Quantity(name, f"{gauge.what} at {name} in the second half", time, partial(curve, name, time), why=why)


def curve(name: str, time: float, series: Series) -> np.ndarray:
    """A scalar at the same times of every pilot, in the second half of [0, time]."""
    known = np.isfinite(series[name])
    return np.interp(np.linspace(0.5 * time, time, SAMPLES), series.time[known], series[name][known])


def energy_curve(time: float, series: Series) -> np.ndarray:
    """Energy of a flow that is there at the start: its energy then is that of a lattice cut by the shape of the fluid:
    an error that neither falls steadily with the spacing nor belongs to the scheme.
    """
    return curve("energy_kinetic", time, series) / (float(series["energy_kinetic"][0]) or 1.0)


def stretch(time: float, series: Series) -> np.ndarray:
    """Stretch of the drop by its outermost particle, wherever on the lattice it began."""
    return curve("front_x", time, series) / float(series["front_x"][0])


def mean(name: str, time: float, series: Series) -> float:
    known = np.isfinite(series[name]) & (series.time >= 0.5 * time)
    return float(series[name][known].mean())
