"""Figures of an LBM-DEM run, by name in PLOTS. Each takes a run folder that is open and makes one figure.

Lines of theory are drawn dashed and dark; what was measured is coloured.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpcpic.core.app.figures import (
    COLOURS,
    THEORY,
    TIMERS,
    NotInScene,
    Plot,
    axis_label,
    columns_of,
    gauges_figure,
    new_figure,
    plain,
    present,
    series_of,
    steps_of,
    style,
    thinned,
)
from lbmdem.analysis.grain_plots import all_grains, config_of, contacts, grains, rolling, snapshots_of, tracks
from lbmdem.analysis.quick_condition import (
    centres,
    critical_gradient,
    gradient_inside,
    lifted,
    lines,
    meeting,
    porosity_between,
)
from lbmdem.case.config import LbmDemConfig
from lbmdem.diagnostics.sample import slice_edges

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hpcpic.core.files.reader import Fields, Run

SPIKE = 3.0  # times the largest force of later, from where a blow of the start is cut off


def _fields(run: Run) -> Fields:
    if config_of(run).fluid is None:
        raise NotInScene("there is no fluid")
    return present(lambda: run.field_snapshots, "the fluid")


# ---------------------------------------------------------------------------------------------- fluid


def flow(run: Run, step: int | None = None) -> Figure:
    """Speed of the fluid in the plane of a 2D case, or in the middle plane across y of a 3D case; solid is grey."""
    snapshots = _fields(run)
    number = snapshots.index(step)
    at = int(snapshots.steps[number])
    speed = np.linalg.norm(run.field("velocity", at), axis=-1)
    solid = run.field("solid", at) > 0.5
    spacing, up = snapshots.spacing, "y"
    if speed.ndim == 3:
        middle = speed.shape[1] // 2
        speed, solid, up = speed[:, middle], solid[:, middle], "z"
    height, width = speed.shape[0] * spacing[0], speed.shape[1] * spacing[-1]
    with style():
        figure, axes = new_figure(size=_panel(width, height))
        figure.set_layout_engine("compressed")  # round axes of a fixed aspect
        shown = np.ma.masked_array(speed, mask=solid)
        axes.set_facecolor("#b9bec5")
        image = axes.imshow(shown, origin="lower", extent=(0, width, 0, height), cmap="viridis", vmin=0, aspect="equal")
        figure.colorbar(image, ax=axes, label=axis_label("speed", snapshots.units["velocity"]), shrink=0.85, pad=0.03)
        axes.grid(visible=False)
        axes.locator_params(axis="x", nbins=3 if height > 1.5 * width else 6)
        axes.set(xlabel="x, m", ylabel=f"{up}, m", title=f"Flow at t = {snapshots.times[number]:.4g} s")
        return figure


def _panel(width: float, height: float) -> tuple[float, float]:
    """Inches of a figure for a picture of this shape."""
    ratio = min(max(height / width, 0.25), 2.5)
    return (2.2 + 4.2 / max(ratio, 0.8), 1.1 + 4.2 * min(ratio, 1.6))


def profile(run: Run, step: int | None = None) -> Figure:
    """Velocity along x across the last axis, averaged over the others, beside theory between two plates."""
    config = config_of(run)
    snapshots = _fields(run)
    number = snapshots.index(step)
    u = run.field("velocity", int(snapshots.steps[number]))[..., 0]
    u = u.mean(axis=tuple(range(1, u.ndim)))
    length = config.domain.size[-1]
    y = (np.arange(len(u)) + 0.5) * snapshots.spacing[0]
    floor = _floor(config)
    u, y = u[y > floor], y[y > floor]
    exact = _between_plates(config, y, floor)
    if config.grains or exact is None or not np.any(exact):
        raise NotInScene("there is no flow between plates along x")
    with style():
        figure, axes = new_figure(size=(5.2, 4.0))
        axes.plot(u, y, "o", markersize=4, color=COLOURS[0], label="nodes")
        axes.plot(exact, y, label="steady theory", **THEORY)
        error = np.linalg.norm(u - exact) / np.linalg.norm(exact)
        axes.text(0.03, 0.5, f"departure {error:.2g}", transform=axes.transAxes)
        across = "xyz"[config.dimensions - 1]
        axes.set(xlabel=axis_label("velocity along x", "m/s"), ylabel=f"{across}, m", ylim=(0, length))
        axes.set_title(f"Profile at t = {snapshots.times[number]:.4g} s")
        axes.legend()
        return figure


def _floor(config: LbmDemConfig) -> float:
    """Height of a plate at rest that lies above the lower face, facing up; 0 without one."""
    only = config.obstacle[0] if len(config.obstacle) == 1 else None
    if only is None or only.shape.plane is None or any(only.velocity) or any(only.shape.plane.normal[:-1]):
        return 0.0
    return only.shape.plane.point[-1] if only.shape.plane.normal[-1] > 0 else 0.0


def _between_plates(config: LbmDemConfig, y: np.ndarray, floor: float) -> np.ndarray | None:
    """Steady velocity of plane Poiseuille and Couette flow; None unless two walls face each other alone."""
    axis, others = "xyz"[config.dimensions - 1], "xyz"[: config.dimensions - 1]
    if (config.obstacle and not floor) or config.fluid is None or set(others) != set(config.domain.periodic):
        return None
    if any(face.is_open for face in config.boundary):
        return None
    speeds: dict[str, float] = {face.face: face.velocity[0] for face in config.boundary if face.type == "wall"}
    length, a = config.domain.size[-1] - floor, config.liquid.body_force[0]
    low, high = 0.0 if floor else speeds.get(f"{axis}-", 0.0), speeds.get(f"{axis}+", 0.0)
    y = y - floor
    return 0.5 * a / config.liquid.kinematic_viscosity * y * (length - y) + low + (high - low) * y / length


def carman_kozeny(porosity: np.ndarray) -> np.ndarray:
    """Permeability of packed spheres over the square of their diameter."""
    return porosity**3 / (180.0 * (1.0 - porosity) ** 2)


def permeability(run: Run) -> Figure:
    """Permeability in time, with what it converges to beside Carman and Kozeny's."""
    from lbmdem.grains.placement import mean_diameters

    if "permeability" not in series_of(run):
        raise NotInScene("the series has no permeability: no flow is driven through grains")
    t, k, porosity = columns_of(run, "permeability", "porosity")
    mean, sauter = mean_diameters(config_of(run))
    n, last, half = porosity[-1], k[-1], k[len(k) // 2]
    kozeny = carman_kozeny(n)
    with style():
        figure, axes = new_figure(size=(6.4, 3.8))
        axes.plot(*thinned(t, k), color=COLOURS[0], label="measured")
        axes.axhline(kozeny * sauter**2, label="Carman-Kozeny", **THEORY)
        axes.text(
            0.98, 0.06,
            f"k = {last:.4g} m$^2$, changed by {abs(last - half) / abs(last):.1e} in the last half\n"
            f"k/<d>$^2$ = {last / mean**2:.4g} at porosity {n:.4f}\n"
            f"over Carman-Kozeny: {last / (kozeny * mean**2):.3f} with <d>, "
            f"{last / (kozeny * sauter**2):.3f} with <d$^3$>/<d$^2$>",
            transform=axes.transAxes, ha="right", va="bottom", linespacing=1.5,
        )  # fmt: skip
        axes.set(xlabel="time, s", ylabel="permeability, m$^2$", title="Permeability", ylim=(0, None))
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)
        return figure


def mass(run: Run) -> Figure:
    """Relative change of the mass of the fluid, of its mean density where grains move, and the largest Mach number."""
    if config_of(run).fluid is None:
        raise NotInScene("there is no fluid")
    name = "mean_density" if "mean_density" in series_of(run) else "mass"
    words, (t, m, mach) = name.replace("_", " "), columns_of(run, name, "max_mach")
    with style():
        figure, (top, low) = new_figure(2, 1, (6.0, 4.2), sharex=True)
        top.plot(*thinned(t, m / m[0] - 1.0), color=COLOURS[2])
        top.set(ylabel=f"change of {words}", title=f"{words.capitalize()} and Mach number")
        low.plot(*thinned(t, mach), color=COLOURS[1])
        low.set(xlabel="time, s", ylabel="largest Mach number", ylim=(0, 1.05 * float(mach.max()) or None))
        return figure


def gauges(run: Run) -> Figure:
    """Gauges in the fluid, in time."""
    return gauges_figure(run, config_of(run).gauge)


def stress(run: Run) -> Figure:
    """Stress between grains in the control slices against the gradient between them, and where their lines meet."""
    config = config_of(run)
    up, count = config.dimensions - 1, config.output.stress_slices
    slices = range(1, count + 1)
    if config.dimensions == 2 or config.fluid is None or count < 2:
        raise NotInScene("needs spheres, a fluid and two control slices (output.stress_slices)")
    _, overall, *values = columns_of(
        run, "hydraulic_gradient", *(f"stress_zz_{k}" for k in slices), *(f"pressure_{k}" for k in slices)
    )
    bed = _bed(run, config)
    stresses, pressures = values[:count], values[count:]
    gradient = gradient_inside(pressures, bed.middles, config.liquid.density * math.hypot(*config.gravity))
    ratio = config.grains[0].density / config.liquid.density
    critical = critical_gradient(ratio, bed.porosity_inside)
    met, rest = meeting(gradient, stresses)
    _, force = columns_of(run, f"force_{config.grains[0].name}_{'xyz'[up]}")
    lift = lifted(overall, force, bed.weight) / critical_gradient(ratio, bed.porosity)
    with style():
        figure, axes = new_figure(size=(6.6, 4.6))
        fits = lines(gradient, stresses)
        bottom, ends = fits[0, 1], np.array([0.0, 1.04 * critical])
        for k, (points, (slope, offset)) in enumerate(zip(stresses, fits)):
            axes.plot(gradient, points / bottom, "o", markersize=4, color=COLOURS[k], label=f"slice {k + 1}")
            axes.plot(ends, (offset + slope * ends) / bottom, color=COLOURS[k], linewidth=1.0)
        axes.axvline(critical, ymax=0.72, label="critical gradient", **THEORY)
        axes.text(
            0.98, 0.97,
            f"lines meet at i = {met:.4f}, {rest / bottom:.3f} of the lowest stress\n"
            f"($\\rho_s - \\rho_w)(1 - n)/\\rho_w$ = {critical:.4f}, n = {bed.porosity_inside:.4f} between the slices\n"
            f"the one over the other: {met / critical:.4f}\n"
            f"the fluid carries the whole bed (n = {bed.porosity:.4f}) at {lift:.4f} of its own",
            transform=axes.transAxes, ha="right", va="top", linespacing=1.5, fontsize=8.5,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.9, "pad": 2.0},
        )  # fmt: skip
        axes.set(xlabel="hydraulic gradient inside", ylabel="stress / stress in slice 1 without flow")
        axes.set(title="Stress between grains, slice 1 lowest", xlim=(0, None), ylim=(-0.05, 1.42))
        axes.legend(fontsize=8, loc="center right", bbox_to_anchor=(0.9, 0.56))
        return figure


class Bed(NamedTuple):
    """The bed at the start: porosity of the whole, and between the middles (m) of the outer slices; weight less
    buoyancy of all, N."""

    porosity: float
    porosity_inside: float
    middles: np.ndarray
    weight: float


def _bed(run: Run, config: LbmDemConfig) -> Bed:
    columns = all_grains(run, int(snapshots_of(run).steps[0]))
    z, r = columns["position"][:, 2], columns["radius"]
    low, high, area = float((z - r).min()), float((z + r).max()), math.prod(config.domain.size[:2])
    middle = centres(slice_edges(low, high, 2.0 * float(r.max()), config.output.stress_slices))
    solid = float((4.0 / 3.0 * math.pi * r**3).sum())
    heavier = (config.grains[0].density - config.liquid.density) * math.hypot(*config.gravity)
    inside = porosity_between(z, r, middle[0], middle[-1], area)
    return Bed(1.0 - solid / (area * (high - low)), inside, middle, heavier * solid)


def energies(run: Run) -> Figure:
    """Kinetic energy of the fluid and of the grains."""
    t, *_ = columns_of(run)
    names = [name for name in ("energy_kinetic", "energy_kinetic_grains") if name in run.series]
    if not names:
        raise NotInScene("the series has no energies")
    with style():
        figure, axes = new_figure(size=(6.2, 3.6))
        for name, colour in zip(names, COLOURS):
            label = "grains" if name.endswith("grains") else "fluid"
            axes.plot(*thinned(t, run.series[name]), color=colour, label=label)
        decay = _decay(config_of(run))
        if decay and "energy_kinetic" in names:
            axes.plot(t, run.series["energy_kinetic"][0] * np.exp(-decay * t), label="theory", zorder=3, **THEORY)
        positive = np.concatenate([run.series[name][1:] for name in names])
        if positive.min() > 0 and positive.max() > 100 * positive.min():
            axes.set_yscale("log")
        axes.set(xlabel="time, s", ylabel=axis_label("kinetic energy", run.series.units[names[0]]), title="Energy")
        axes.legend()
        return figure


def forces(run: Run) -> Figure:
    """Force of the fluid on each obstacle, and on each set of grains that stays, along every axis."""
    config = config_of(run)
    held = [group.name for group in config.grains if config.coupling.frozen or not group.moving]
    names = [name for name in (*(one.name for one in config.obstacle), *held) if f"force_{name}_x" in series_of(run)]
    if not names:
        raise NotInScene("no obstacle and no grains that stay are in a fluid")
    with style():
        figure, axes = new_figure(len(names), 1, (6.4, 2.6 * len(names) + 0.4), squeeze=False, sharex=True)
        for axis, name in zip(axes[:, 0], names):
            for along, colour in zip("xyz"[: config.dimensions], COLOURS):
                axis.plot(*thinned(*columns_of(run, f"force_{name}_{along}")), color=colour, label=along)
            unit = run.series.units[f"force_{name}_x"]
            _cut_the_start_off(axis)
            axis.set(ylabel=axis_label("force", unit), title=f"Force on {plain(name)}")
            axis.legend(ncols=3)
        axes[-1, 0].set_xlabel("time, s")
        return figure


def _cut_the_start_off(axis: Axes) -> None:
    """Let an axis show all of its lines after the first fifth of the time, where a blow of the start is far beyond."""
    t, force = np.concatenate([line.get_xydata() for line in axis.get_lines()]).T
    first = t <= t.min() + (t.max() - t.min()) / 5.0
    low, high = float(force.min(where=~first, initial=0.0)), float(force.max(where=~first, initial=0.0))
    blow = float(np.abs(force[first]).max())
    if blow > SPIKE * max(high, -low) > 0.0:
        axis.set_ylim(low - 0.5 * (high - low), high + 0.5 * (high - low))
        axis.text(0.99, 0.03, f"{blow:.2g} at the start is cut off", transform=axis.transAxes, ha="right")


def _decay(config: LbmDemConfig) -> float:
    """Rate of the kinetic energy of vortices that viscosity ends, 1/s; 0 of any other flow."""
    fluid = config.fluid
    alone = not (config.grains or config.obstacle or config.boundary)
    if fluid is None or fluid.initial is None or fluid.initial.flow != "taylor-green" or not alone:
        return 0.0
    return 2.0 * fluid.kinematic_viscosity * sum((2.0 * math.pi / length) ** 2 for length in config.domain.size[:2])


PLOTS = {
    "flow": Plot("Speed of the fluid", flow, steps_of(_fields)),
    "profile": Plot("Velocity profile beside theory", profile, steps_of(_fields)),
    "grains": Plot("Grains", grains, steps_of(snapshots_of)),
    "contacts": Plot("Contacts between grains", contacts, steps_of(snapshots_of)),
    "tracks": Plot("Grains in time", tracks),
    "rolling": Plot("From sliding to rolling", rolling),
    "permeability": Plot("Permeability in time", permeability),
    "stress": Plot("Stress between grains against the hydraulic gradient", stress),
    "forces": Plot("Forces on obstacles, and on grains that stay", forces),
    "gauges": Plot("Gauges in time", gauges),
    "energies": Plot("Kinetic energies", energies),
    "mass": Plot("Mass and Mach number", mass),
    "timers": TIMERS,
}
