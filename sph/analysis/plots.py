"""Figures of an SPH run: energies, front, forces, gauges beside theory and measurements; particles by time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hpcpic.core.app.figures import (
    COLOURS,
    INK,
    TIMERS,
    NotInScene,
    Plot,
    axis_label,
    columns_of,
    new_figure,
    plain,
    steps_of,
    style,
    thinned,
)
from sph.analysis import experiments, theory
from sph.analysis.particle_plots import THEORY, depth, profiles, sequence, snapshots_of
from sph.analysis.run_config import config_of, scene_of
from sph.case import columns, geometry
from sph.case.config import ELEVATION, FRONT, PRESSURE, WALL_PRESSURE, Gauge, SphConfig
from sph.setup.flows import StandingWave, Vortices, flow_of, interface, interfacial

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hpcpic.core.files.reader import Run

DATA: dict[str, Any] = {"marker": "o", "linestyle": "none", "markersize": 4, "color": INK, "markerfacecolor": "none"}
ABOVE: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1,
                         "columnspacing": 1.0, "handlelength": 1.5, "fontsize": 8.5}  # fmt: skip
PRESSURES = (PRESSURE, WALL_PRESSURE)
DAM_BREAKS = (  # source, depth of the water, where the wall is, below which height the sensor is, m; what it measured
    ("Lobovsky et al. 2014", 0.3, 1.61, 0.01, experiments.LOBOVSKY_PRESSURE),
    ("Buchner 2002", 0.6, 3.22, 0.2, experiments.BUCHNER_PRESSURE),
)
SPIKE = 3.0  # times the largest measured value, from where a panel is cut off
NEAR = 0.05  # of a length: how like the case must be to an experiment to be shown beside it


def energies(run: Run) -> Figure:
    """Kinetic energy, changes of potential and internal energy, and of their sum."""
    t, kinetic, potential, internal = columns_of(run, "energy_kinetic", "energy_potential", "energy_internal")
    decay = predicted_decay(config_of(run))
    with style():
        figure, axes = new_figure(size=(6.4, 3.8))
        changes = {"potential": potential - potential[0], "internal": internal - internal[0]}
        if decay is not None:
            axes.plot(t, kinetic[0] * np.exp(-decay * t), label="theory of the decay", zorder=3, **THEORY)
        axes.plot(*thinned(t, kinetic), label="kinetic", color=COLOURS[0])
        for (name, values), colour in zip(changes.items(), COLOURS[1:]):
            if np.abs(values).max() > 1e-4 * np.abs(kinetic).max() or not kinetic.any():
                axes.plot(*thinned(t, values), label=f"{name} (change)", color=colour, linewidth=1.3)
        total = kinetic + sum(changes.values())
        axes.plot(*thinned(t, total), label="sum", color=COLOURS[6], linewidth=1.2, linestyle="--")
        axes.set(xlabel="time, s", ylabel=axis_label("energy", run.series.units["energy_kinetic"]), title="Energy")
        axes.legend(ncols=4, **ABOVE)
        return figure


def predicted_decay(config: SphConfig) -> float | None:
    """Rate of the kinetic energy of vortices that viscosity ends, 1/s."""
    flow = flow_of(config.fluid[0], Vortices) if config.fluid else None
    if flow is None:
        return None
    return 4 * (2 * math.pi / flow.wavelength) ** 2 * config.fluid[0].dynamic_viscosity / config.fluid[0].density


def column_of(config: SphConfig) -> tuple[float, float, float]:
    """Width, height of the first fluid and g, of a column that collapses along x; raises NoData."""
    scene_axis = config.dimensions - 1
    if not config.fluid or not config.fluid[0].shape.box or not config.gravity[scene_axis] < 0:
        raise NotInScene("only for a column of water that collapses")
    low, high = geometry.bounds(config.fluid[0].shape)
    if high[0] - low[0] > 0.8 * (config.domain.corners[1][0] - config.domain.corners[0][0]):
        raise NotInScene("the fluid fills the tank: it has no front")
    return high[0] - low[0], high[scene_axis] - low[scene_axis], -config.gravity[scene_axis]


def front(run: Run) -> Figure:
    """The farthest fluid along x, beside the dry-bed solution of shallow water and, where it fits, an experiment."""
    config = config_of(run)
    width, height, g = column_of(config)
    t, x = columns_of(run, "front_x")
    low = config.domain.corners[0][0]
    end = (config.domain.corners[1][0] - low) / width
    if x[0] - low >= 0.97 * end * width:
        raise NotInScene("there is fluid up to the far wall from the start: no front is seen")
    clock = math.sqrt(2 * g / width)
    with style():
        figure, axes = new_figure(size=(6.4, 4.0))
        axes.plot(*thinned(t * clock, (x - low) / width), label="front")
        arrived = np.flatnonzero((x - low) / width >= 0.97 * end)
        last = (t * clock)[min(int(1.25 * arrived[0]), len(t) - 1)] if len(arrived) else (t * clock)[-1]
        ritter = np.linspace(0.0, last, 60)
        speed = 2 * math.sqrt(g * height) / clock / width
        axes.plot(ritter, np.minimum(1 + speed * ritter, 1.02 * end), label="shallow water, dry bed (Ritter)",
                  linestyle=":", **THEORY)  # fmt: skip
        if abs(height / width - 2) < 2 * NEAR:
            found = experiments.KOSHIZUKA_FRONT
            error = np.interp(found[:, 0], t * clock, (x - low) / width) - found[:, 1]
            inside = found[:, 1] < end - 0.4
            axes.plot(*found.T, label="experiment: Koshizuka & Oka 1996", **DATA)
            rms = float(np.sqrt(np.mean(error[inside] ** 2)))
            axes.text(0.98, 0.04, f"rms departure {rms:.3f} L", transform=axes.transAxes, ha="right")
        axes.set(xlabel=r"$t\,\sqrt{2g/L}$", ylabel="x / L", xlim=(0, last), ylim=(0.8, 1.06 * end), title="Front")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.08))
        return figure


def measured_walls(run: Run) -> list[str]:
    names = [wall.name for wall in config_of(run).wall if wall.measure_force]
    if not names:
        raise NotInScene("no wall has measure_force = true")
    return names


def impact(config: SphConfig) -> bool:
    """Whether the case is the tank of Yeh & Petroff with its column."""
    if config.dimensions != 3 or "column" not in [wall.name for wall in config.wall]:
        return False
    size = [b - a for a, b in zip(*config.domain.corners)]
    return all(abs(a / b - 1) < NEAR for a, b in zip(size, (1.6, 0.61, 0.75)))


def forces(run: Run) -> Figure:
    """Force along x on the measured walls: as it is and, of samples that are close enough, through the 13 ms triangular
    filter of (SC).
    """
    names = measured_walls(run)
    with style():
        figure, axes = new_figure(len(names), 1, (6.4, 3.4 * len(names)), squeeze=False, sharex=True)
        for axis, name in zip(axes[:, 0], names):
            t, force = theory.mean_rate(*columns_of(run, f"impulse_{name}_x"))
            smooth = theory.triangular(t, force)
            if np.diff(t).min(initial=np.inf) < theory.FILTER / 2:  # else each mean is of one sample
                axis.plot(t, force, color=COLOURS[6], linewidth=0.5, alpha=0.5, label="unfiltered")
                axis.plot(*thinned(t, smooth), color=COLOURS[0], linewidth=1.5, label="13 ms filter")
            else:
                axis.plot(t, force, color=COLOURS[0], linewidth=1.5, label="mean between samples")
            if name == "column" and impact(config_of(run)):
                at, known = experiments.COLUMN_FORCE.T
                look = DATA | {"markersize": 2.8, "label": "experiment: Yeh & Petroff, 0.068 s earlier"}
                axis.plot(at - experiments.COLUMN_SHIFT, known, **look)
                axis.set_ylim(-30, max(60.0, 1.05 * smooth.max()))
            else:
                ends = np.quantile(smooth, (0.0, 1.0))
                axis.set_ylim(ends[0] - 0.3 * np.ptp(ends), ends[1] + 0.3 * np.ptp(ends))
            label = axis_label("force along x", run.series.units[f"force_{name}_x"])
            axis.set(ylabel=label, title=f"Force on {plain(name)}")
            axis.legend()
        axes[-1, 0].set_xlabel("time, s")
        return figure


def impulses(run: Run) -> Figure:
    """Time integrals of |F| (SC) and of the force along x on the measured walls."""
    names = measured_walls(run)
    with style():
        figure, axes = new_figure(size=(6.4, 3.8))
        for name, colour in zip(names, COLOURS):
            t, size, along = columns_of(run, f"impulse_{name}", f"impulse_{name}_x")
            axes.plot(*thinned(t, along), color=colour, label=f"{plain(name)}, along x")
            axes.plot(*thinned(t, size), color=colour, linewidth=1.1, linestyle="--", label=f"{plain(name)}, of |F|")
        if "column" in names and impact(config_of(run)):
            t, force = experiments.COLUMN_FORCE.T
            look = DATA | {"markersize": 2.8, "label": "experiment, along x, 0.068 s earlier"}
            axes.plot(t - experiments.COLUMN_SHIFT, theory.cumulative(t, force), **look)
        unit = run.series.units[f"impulse_{names[0]}"]
        axes.set(xlabel="time, s", ylabel=axis_label("impulse", unit), title="Impulse")
        axes.legend()
        return figure


def bodies(run: Run) -> Figure:
    """Ways of the rigid bodies along each axis, and the angles by which they have turned."""
    config = config_of(run)
    bodies = {wall.name: wall.body for wall in config.wall if wall.body}
    if not bodies:
        raise NotInScene("no wall is a body")
    with style():
        figure, axes = new_figure(len(bodies), 2, (8.0, 2.6 * len(bodies) + 0.4), squeeze=False, sharex=True)
        for row, (name, body) in zip(axes, bodies.items()):
            every = columns.body_columns(name, body, config.dimensions)
            for axis, (kind, label) in zip(row, {"position": "way from the start", "angle": "angle"}.items()):
                shown = [column for column in every if column.startswith(kind)]
                for column, colour in zip(shown, COLOURS):
                    t, values = columns_of(run, column)
                    axis.plot(*thinned(t, values - values[0]), color=colour, label=column[-1])
                axis.set(ylabel=axis_label(label, run.series.units[shown[0]]), title=plain(name))
                axis.legend()
        for axis in axes[-1]:
            axis.set_xlabel("time, s")
        return figure


def gauges(run: Run) -> Figure:
    """Every gauge in time, beside what theory or an experiment says where that is known."""
    config = config_of(run)
    shown = [gauge for gauge in config.gauge if gauge.kind is not FRONT]
    if not shown:
        raise NotInScene("the case has no gauge but of the front")
    with style():
        figure, axes = new_figure(len(shown), 1, (6.4, 2.3 * len(shown) + 0.4), squeeze=False, sharex=True)
        for axis, gauge in zip(axes[:, 0], shown):
            _gauge_panel(axis, run, gauge)
        axes[-1, 0].set_xlabel("time, s")
        return figure


def _gauge_panel(axis: Any, run: Run, gauge: Gauge) -> None:
    config = config_of(run)
    names = [*columns.columns_of(gauge, gauge.name, config.dimensions)]
    for name in names:
        t, values = columns_of(run, name)
        axis.plot(*thinned(t, values), label=plain(name) if len(names) > 1 else None, linewidth=1.3)
    expected = _expectation(run, config, gauge, t, values)
    if expected is not None:
        text, times, values, style_of = expected
        axis.plot(times, values, label=text, **style_of)
        measured_top, top = float(np.max(values)), axis.get_ylim()[1]
        if text.startswith("experiment") and top > SPIKE * measured_top > 0:  # single particles that hit the gauge
            axis.set_ylim(-0.5 * SPIKE * measured_top, SPIKE * measured_top)
            axis.text(0.99, 0.03, f"peaks up to {top:.2g} are cut off", transform=axis.transAxes, ha="right")
    place = ", ".join(f"{x:g}" for x in gauge.at)
    axis.set(ylabel=axis_label(gauge.what, run.series.units[names[0]]), title=f"{plain(gauge.name)} at ({place}) m")
    if axis.get_legend_handles_labels()[1]:
        axis.legend(ncols=3, **ABOVE)


def _expectation(
    run: Run, config: SphConfig, gauge: Gauge, t: np.ndarray, read: np.ndarray
) -> tuple[str, Any, Any, dict] | None:
    """What a gauge that has read `read` should read: words, times, values, look of the line. The clock of an experiment
    behind a gate is laid beside that of the run.
    """
    scene = scene_of(run)
    if not scene.gravity.any() or not config.fluid:
        return None
    g, vertical = float(np.abs(scene.gravity).max()), int(np.argmax(np.abs(scene.gravity)))
    low, high = geometry.bounds(config.fluid[0].shape)
    flow, water = config.fluid[0].flow, high[vertical] - low[vertical]
    if flow and flow_of(config.fluid[0], StandingWave) and gauge.kind is ELEVATION:
        k = 2 * math.pi / flow.wavelength
        square, level = theory.wave_frequency(k, water, g) ** 2, high[vertical]
        if other := interface(config, config.fluid[0], vertical):
            square, level = interfacial(config.fluid[0], other, vertical, k, g)
        swing = np.sin(math.sqrt(square) * t) if square > 0 else np.sinh(math.sqrt(-square) * t)
        phase = swing * math.cos(k * (gauge.at[0] - low[0]))
        return "linear theory", t, level + flow.amplitude * phase, THEORY
    if (shaft := cushions(config, vertical)) and gauge.kind in (*PRESSURES, ELEVATION):
        fallen, pressure = theory.cushioned_fall(t, *shaft, config.eos.ambient_pressure, g)
        return "Bagnold", t, high[vertical] - fallen if gauge.kind is ELEVATION else pressure, THEORY
    if scene.liquids.several:
        return None
    fills = all(a <= b for a, b in zip(scene.high - scene.low, [1.001 * (q - p) for p, q in zip(low, high)][:-1]))
    moving = any(wall.motion for wall in config.wall)
    if fills and not moving and not flow and gauge.kind in (*PRESSURES, ELEVATION):
        deep = np.array([high[vertical] - gauge.at[vertical]])
        at_rest = float(scene.eos.pressure(scene.eos.excess_at_rest(deep, g))[0])
        value = at_rest if gauge.kind in PRESSURES else high[vertical]
        return "at rest", t[[0, -1]], [value, value], THEORY
    for name, deep_water, x, highest, measured in DAM_BREAKS:
        there = len(gauge.at) == 2 and abs(gauge.at[0] - x) < 0.02 and gauge.at[1] < highest
        if gauge.kind in PRESSURES and there and abs(water - deep_water) < NEAR * deep_water:
            clock, unit = math.sqrt(water / g), scene.rho0 * g * water
            times, pressure = clock * measured[:, 0], unit * measured[:, 1]
            words, rise = f"experiment: {name}", unit * experiments.PRESSURE_RISE
            if moving and read.max() > rise:
                late = experiments.passing(t, read, rise) - experiments.passing(times, pressure, rise)
                times, words = times + late, f"{words}, {1e3 * late:.0f} ms later"
            return words, times, pressure, DATA | {"markersize": 3}
    return None


def cushions(config: SphConfig, vertical: int) -> tuple[float, float, float] | None:
    """Mass per area of a layer of liquid across a closed shaft, kg/m2, and thickness of the gas below and above it, m,
    at pressures of rest at t = 0; None where that is not the scene.
    """
    if len(config.fluid) != 2 or [fluid.gas for fluid in config.fluid] != [False, True]:
        return None
    (low, high), (bottom, top) = (geometry.bounds(fluid.shape) for fluid in config.fluid)
    across = all(low[k] <= bottom[k] and high[k] >= top[k] for k in range(len(low)) if k != vertical)
    if not across or any(fluid.initial_pressure != "zero" or any(fluid.velocity) for fluid in config.fluid):
        return None
    below, above = low[vertical] - bottom[vertical], top[vertical] - high[vertical]
    mass = config.fluid[0].density * (high[vertical] - low[vertical])
    return (mass, below, above) if below > 0 and above > 0 else None


def step_sizes(run: Run) -> Figure:
    """Time step, largest speed over the sound speed, and largest change of density."""
    t, dt, speed, error = columns_of(run, "dt", "max_velocity", "max_density_error")
    c0 = config_of(run).sound_speed
    with style():
        figure, (top, low) = new_figure(2, 1, (6.4, 4.2), sharex=True)
        taken = dt > 0
        top.plot(*thinned(t[taken], dt[taken]), color=COLOURS[0])
        top.set(ylabel="time step, s", title="Time step", ylim=(0, None))
        low.plot(*thinned(t, 100 * error), label="density change", color=COLOURS[1])
        low.plot(*thinned(t, 100 * (speed / c0) ** 2), label=r"$(v/c_0)^2$", color=COLOURS[2])
        low.set(ylabel="largest, %", xlabel="time, s", title="Compressibility")
        low.legend()
        return figure


PLOTS = {
    "sequence": Plot("The particles in time", sequence, steps_of(snapshots_of)),
    "energies": Plot("Energy in time", energies),
    "front": Plot("Front beside theory and experiment", front),
    "forces": Plot("Force on walls, filtered", forces),
    "impulses": Plot("Impulse on walls", impulses),
    "bodies": Plot("Ways and angles of rigid bodies", bodies),
    "gauges": Plot("Gauges in time", gauges),
    "profiles": Plot("Velocity and shear stress across a channel", profiles, steps_of(snapshots_of)),
    "depth": Plot("Pressure over the depth", depth, steps_of(snapshots_of)),
    "step": Plot("Time step and compressibility", step_sizes),
    "timers": TIMERS,
}
