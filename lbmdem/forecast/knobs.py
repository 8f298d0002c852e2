"""What can be turned in an LBM-DEM case, and what is asked of it: drag, permeability, energy, momentum."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hpcpic.core.app.knobs import Choice, Knob, Knobs, Quantity, Seen, reseeded
from hpcpic.core.case.dump import dump
from hpcpic.core.case.texts import value_text
from hpcpic.core.study.quantities import at_end, grown, interval, mean, reduced
from lbmdem.case.config import AXES, LbmDemConfig, seeps
from lbmdem.forecast.driven import between_faces
from lbmdem.forecast.free_fall import stays
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
FINE = 8  # cells that sides have in common: enough spacings divide all of them
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
        growth=lambda series: grown(series["energy_kinetic" if config.fluid else "energy_kinetic_grains"]),
        seed=reseeded if any(grains.diameters for grains in config.grains) else None,  # only these draw numbers
        seen=seen(config) if config.fluid else None,
    )


def seen(config: LbmDemConfig) -> Seen:
    box = (0.0,) * config.dimensions, tuple(config.domain.size), config.points
    return Seen("velocity", *box, lambda time: (f"output.period.fields={time!r}",))


def wet(config: LbmDemConfig) -> list[Knob]:
    """dx at fixed tau is diffusive scaling: dt ~ dx^2. tau - 1/2 alone is the time step."""
    d = config.dimensions
    key = ("fluid", "time_step") if config.liquid.time_step is not None else ("fluid", "relaxation_time")
    order = 1.0 if any(between_faces(config)) else 2.0  # the length between pressure faces is L - dx
    found = [
        Knob("dx", "node spacing, at the same tau", "m", ("domain", "spacing"), lambda c: c.spacing, order, d + 2.0,
             "grid Reynolds number"),
        Knob("tau", "relaxation time, which is the time step", "", key, lambda c: c.tau - 0.5, 2.0, 1.0,
             "Mach number", shown=lambda size: size + 0.5),
    ]  # fmt: skip
    if config.grains_move:
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
    spacing, box = fitting(config, float(sizes.get("dx", config.spacing)))
    excess = float(sizes.get("tau", config.tau - 0.5))
    made += [f"domain.spacing={spacing!r}", *box]
    if "substeps" in sizes and config.grains_move:
        made.append(f"coupling.substeps={max(1, math.ceil(1.0 / sizes['substeps'] - 1e-6))}")
    if config.liquid.time_step is None:
        return (*made, f"fluid.relaxation_time={0.5 + excess!r}")
    return (*made, f"fluid.time_step={excess * CS2 * spacing**2 / config.liquid.kinematic_viscosity!r}")


def fitting(config: LbmDemConfig, wanted: float) -> tuple[float, tuple[str, ...]]:
    """The largest spacing not above the wanted one that divides the sides which must keep their length, and --set words
    for the others.

    Sides along which the box repeats keep their length, else the shortest. The other sides need not be whole: where
    fluid enters and leaves, the outlet moves by at most half a spacing; between walls the box ends beyond the upper
    wall, which becomes a plane anywhere between the nodes.
    """
    points, size, d = config.points, config.domain.size, config.dimensions
    opened = {AXES.index(face.face[0]) for face in config.boundary if face.is_open}
    around = {AXES.index(axis) for axis in config.domain.periodic}
    walled = set(range(d)) - opened - around
    fixed = around or {min(walled or opened, key=lambda axis: size[axis])}
    for axis in sorted(walled - fixed):  # those that fit as well
        if math.gcd(*(points[k] for k in fixed), points[axis]) >= FINE:
            fixed.add(axis)
    whole = math.gcd(*(points[k] for k in fixed))
    fewest = min(points[k] for k in fixed)
    least = math.ceil(COARSEST * whole / fewest) if fewest >= COARSEST else whole
    cells = max(least, math.ceil(whole * config.spacing / wanted - 1e-6))
    spacing = config.spacing * whole / cells
    if math.isclose(spacing, config.spacing, rel_tol=1e-12):
        return config.spacing, ()
    counts = [
        length / spacing if axis in fixed else max(1, round(length / spacing)) if axis in opened
        else max(1, math.ceil(length / spacing - 1e-6))
        for axis, length in enumerate(size)
    ]  # fmt: skip
    cut = [axis for axis in sorted(walled - fixed) if counts[axis] * spacing > size[axis] * 1.001]
    planes = [upper_wall(config, axis) for axis in cut]
    if len(fixed) == d or all(math.isclose(n * spacing, length) for n, length in zip(counts, size)):
        return spacing, ()
    box = [round(n) * spacing for n in counts]
    words: tuple[str, ...] = (f"domain.size={box!r}",)
    if planes:
        lines = ([line.partition("  #")[0] for line in dump(obstacle).splitlines()] for obstacle in config.obstacle)
        given = [f"{{ {' '.join(own)} }}" for own in lines]
        words += (f"obstacle=({', '.join([*given, *planes])})",)
    return spacing, words


def upper_wall(config: LbmDemConfig, axis: int) -> str:
    """The upper wall along an axis as a plane where it is, which slides as the face does, in the words of a case."""
    d, name = config.dimensions, AXES[axis]
    point, normal = ([value if k == axis else 0.0 for k in range(d)] for value in (config.domain.size[axis], -1.0))
    slides = next((list(face.velocity) for face in config.boundary if face.face == f"{name}+" and face.velocity), None)
    velocity = f" velocity = {slides};" if slides else ""
    return f'{{ name = "wall_{name}"; shape = {{ plane = {{ point = {point}; normal = {normal}; }}; }};{velocity} }}'


def work(config: LbmDemConfig) -> float:
    """Updates of nodes, or of grains where there is no fluid."""
    if config.fluid:
        return float(config.n_steps) * math.prod(config.points)
    return float(config.n_steps) * grain_count(config)


# ------------------------------------------------------------------------------------------------- quantities


def quantities_of(config: LbmDemConfig, time: float) -> list[Quantity]:
    """The one that the case is about first. time [s]: of the whole run."""
    moving = any(not stays(config, grains) for grains in config.grains)
    if config.fluid is None:
        text = "mean kinetic energy of the grains over the run"
        why = "the case has grains and no fluid, and grains that come to rest have no energy at the end"
        measure = partial(mean_from, ["energy_kinetic_grains"], 0.0, time)
        return [Quantity("grain-energy", text, time, measure, why=why)]
    axis, bodies = main_axis(config), standing(config)
    found = [] if moving else past_solids(config, axis, bodies, time)
    if moving:
        name, text = "energy_kinetic_grains", "kinetic energy of the grains in the first quarter"
        found.append(Quantity("grain-energy", text, time / 4, partial(curve, name, time / 4), why="grains move"))
    text = "kinetic energy of the fluid in the first quarter"
    why = "no steady push drives a flow along an axis that is open or repeats"
    found.append(Quantity("energy", text, time / 4, partial(curve, "energy_kinetic", time / 4), why=why))
    if axis:
        text, why = f"momentum of the fluid along {axis} in the first quarter", f"a flow is driven along {axis}"
        made = Quantity("momentum", text, time / 4, partial(curve, f"momentum_{axis}", time / 4), why=why)
        found.insert(len(found) if moving or bodies else 0, made)
    return found


def past_solids(config: LbmDemConfig, axis: str, bodies: list[str], time: float) -> list[Quantity]:
    """What a flow along an axis past solids that stay is asked for: their drag, or how much flows where a body force
    drives it, which gives their drag in the end whatever the flow is.
    """
    if seeps(config):
        why, measure = "a flow is driven through grains at rest", partial(at_end, "permeability", time / 2)
        return [Quantity("permeability", "permeability at half the run", time / 2, measure, why=why)]
    if not axis or not bodies:
        return []
    if config.liquid.body_force[AXES.index(axis)]:
        text, why = f"flow rate along {axis} at half the run", f"a body force drives a flow along {axis} past solids"
        measure = partial(at_end, f"flow_rate_{axis}", time / 2)
        return [Quantity("flow-rate", text, time / 2, measure, why=why)]
    columns = [f"force_{name}_{axis}" for name in bodies]
    text = f"mean of {' + '.join(columns)} from t = {time / 2:.4g} to {time:.4g} s"
    why = f"a flow is driven along {axis} past solids that stay"
    measure, noise = (partial(of, columns, time / 2, time) for of in (mean_from, unsure_from))
    return [Quantity("drag", text, time, measure, why=why, noise=noise)]


def standing(config: LbmDemConfig) -> list[str]:
    """Names of sets of grains and of obstacles that stay within the flow: a plane is a wall beside it."""
    held = [grains.name for grains in config.grains if stays(config, grains)]
    return held + [obstacle.name for obstacle in config.obstacle if obstacle.shape.plane is None]


def main_axis(config: LbmDemConfig) -> str:
    """Axis along which a flow is driven that does not end at walls; "" where none is: what a lid drives turns round,
    and its momentum is zero in the mean. Without a force or a velocity it is one with unlike pressures at its ends.
    """
    moved = (*(face.velocity for face in config.boundary), *(obstacle.velocity for obstacle in config.obstacle))
    vectors = [config.liquid.body_force, *moved]
    sizes = [max((abs(v[k]) for v in vectors if len(v) > k), default=0.0) for k in range(config.dimensions)]
    if not any(sizes):
        faces = [face for face in config.boundary if face.type == "pressure"]
        given: dict[str, tuple] = {f.face: (f.pressure or 0.0, f.density, f.pressure_rate) for f in faces}
        ends = [(given.get(f"{axis}-"), given.get(f"{axis}+")) for axis in AXES[: config.dimensions]]
        sizes = [float(None not in (low, high) and low != high) for low, high in ends]
    axis = AXES[int(np.argmax(sizes))]
    return axis if max(sizes) and axis in config.unwalled else ""


def mean_from(columns: list[str], first: float, until: float, series: Series) -> float:
    """Mean over [first, until], s, of the sum of the columns."""
    return sum(float(reduced(name, mean, first, until, series)) for name in columns)


def unsure_from(columns: list[str], first: float, until: float, series: Series) -> float:
    """Half the 95 % interval of mean_from, at most."""
    return sum(interval(name, first, until, series) for name in columns)


def curve(name: str, time: float, series: Series) -> np.ndarray:
    """A scalar at the same times of every pilot, in the second half of [0, time]."""
    from scipy.interpolate import CubicSpline

    wanted = np.clip(np.linspace(0.5 * time, time, SAMPLES), series.time[0], series.time[-1])
    return CubicSpline(series.time, series[name])(wanted)
