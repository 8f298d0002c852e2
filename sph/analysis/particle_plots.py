"""Figures of particles: pictures in time, profiles across a channel, pressure in depth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hpcpic.core.app.figures import COLOURS, INK, NoData, NotInScene, new_figure, pictured, present, style
from sph.analysis import outlines, render, theory
from sph.analysis.outlines import is_body
from sph.analysis.run_config import config_of, scene_of
from sph.case import geometry
from sph.physics.reference import velocity_gradient
from sph.physics.smoothing import SMOOTHING
from sph.physics.stability import support_of
from sph.setup.channel import Channel, channel_of
from sph.setup.flows import Linear, at_rest, flow_of, heights, hydrostatic, up

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hpcpic.core.files.reader import Particles, Run
    from sph.case.config import SphConfig
    from sph.case.config import Wall as WallSection

PIXELS = 720  # width of a rendered picture
SMALL = 0.02  # m: boxes below are told in mm
THEORY: dict[str, Any] = {"color": INK, "linewidth": 1.0}
WALL, BODY = "#b8bcc2", COLOURS[1]
SECOND = 0.3  # area of the dots of a liquid that differs from the first, over that of the first one's


def snapshots_of(run: Run) -> Particles:
    return present(lambda: run.particle_snapshots, "the particles")


def fluid_names(run: Run, gases: bool) -> list[str]:
    """Names of the fluids, and of what inlets let in."""
    config = config_of(run)
    return [fluid.name for fluid in config.fluid if gases or not fluid.gas] + [inlet.name for inlet in config.inlet]


def fluid_at(run: Run, snapshots: Particles, number: int, gases: bool = True) -> dict[str, np.ndarray]:
    """All fluid particles of a snapshot, whichever set they are from; without those of gases on demand."""
    parts = [snapshots.read(name, number) for name in fluid_names(run, gases) if name in snapshots.species]
    if not parts or not sum(len(part["id"]) for part in parts):
        raise NoData("there are no fluid particles")
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def walls_at(run: Run, snapshots: Particles, number: int, kind: Callable[[WallSection], bool]) -> np.ndarray:
    """Positions[n, 3] of the particles of the walls of a kind in a snapshot."""
    names = [wall.name for wall in config_of(run).wall if kind(wall) and wall.name in snapshots.species]
    parts = [snapshots.read(name, number)["position"] for name in names]
    return np.concatenate([*parts, np.zeros((0, 3))])


def gases_at(run: Run, snapshots: Particles, number: int) -> np.ndarray:
    """Positions[n, 3] of the particles of gases in a snapshot."""
    names = [fluid.name for fluid in config_of(run).fluid if fluid.gas and fluid.name in snapshots.species]
    return np.concatenate([*(snapshots.read(name, number)["position"] for name in names), np.zeros((0, 3))])


def shares_of_dots(run: Run, snapshots: Particles, number: int) -> np.ndarray:
    """Areas[n] of dots over the usual one, in the order of `fluid_at` without gases: those of liquids that differ from
    the first are small, so that one sees where they are, as colours tell the pressure. [1] where there is one.
    """
    kinds = {fluid.name: (fluid.density, fluid.dynamic_viscosity) for fluid in config_of(run).fluid if not fluid.gas}
    first = next(iter(kinds.values()), None)
    shares = {name: SECOND for name, kind in kinds.items() if kind != first}
    if not shares:
        return np.ones(1)
    names = [name for name in fluid_names(run, gases=False) if name in snapshots.species]
    return np.concatenate([np.full(len(snapshots.read(name, number)["id"]), shares.get(name, 1.0)) for name in names])


def is_no_body(wall: WallSection) -> bool:
    return wall.body is None


def is_rounded(wall: WallSection) -> bool:
    """A solid that stays or goes a given way, and is no box."""
    return wall.body is None and wall.solid and wall.shape.box is None


def moorings_at(run: Run, snapshots: Particles, number: int) -> list[np.ndarray]:
    """The lines of moored bodies in a snapshot: ends[2, 3], on the body and at the anchor."""
    found = []
    for wall in scene_of(run).walls:
        body = wall.section.body
        if body and body.mooring and wall.name in snapshots.species:
            particles = snapshots.read(wall.name, number)
            space = (0, 0), (0, 3 - scene_of(run).dimensions)
            start = np.pad(wall.at(particles["id"])[0], space)
            for line in body.mooring:
                at, anchor = np.pad([line.at, line.anchor], space)
                found.append(np.stack([moved(at, start, particles["position"]), anchor]))
    return found


def moved(point: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Where a rigid motion takes a point[3] that takes places before[n, 3] to after[n, 3] (Kabsch 1976)."""
    middle, now = before.mean(axis=0), after.mean(axis=0)
    u, _, v = np.linalg.svd((before - middle).T @ (after - now))
    u[:, 2] *= np.sign(np.linalg.det(u @ v))  # no reflection; in a plane, z stays as it is
    return now + (point - middle) @ (u @ v)


def chosen(run: Run, snapshots: Particles) -> list[int]:
    """Numbers of the snapshots that are shown."""
    return pictured(snapshots, config_of(run).output.pictures)


def sequence(run: Run, step: int | None = None) -> Figure:
    """The particles at several times, or at one step: pressure in 2D, speed in 3D; gases as dots, in 3D not at all."""
    snapshots = snapshots_of(run)
    numbers = chosen(run, snapshots) if step is None else [snapshots.index(step)]
    make = _panels_2d if config_of(run).dimensions == 2 else _panels_3d
    with style():
        return make(run, snapshots, numbers)


def view_limits(run: Run, snapshots: Particles) -> tuple[np.ndarray, np.ndarray]:
    """The box that is shown: the domain up to what fluid and bodies reach on each side; without walls from it, too."""
    scene = scene_of(run)
    low, high = scene.low.copy(), scene.high.copy()
    reached_low, reached_high = np.full(scene.dimensions, np.inf), np.full(scene.dimensions, -np.inf)
    strays = 0.001 if scene.dimensions == 2 else 0.0  # left out on each side: a dot, but not half a ball
    fluids, bodies = fluid_names(run, gases=True), [wall.name for wall in config_of(run).wall if is_body(wall)]
    for number in range(len(snapshots.steps)):
        x = snapshots.positions(fluids, number)[:, : scene.dimensions]
        if not len(x):
            raise NoData("there are no fluid particles")
        reached_low = np.minimum(reached_low, np.quantile(x, strays, axis=0))
        reached_high = np.maximum(reached_high, np.quantile(x, 1.0 - strays, axis=0))
        solid = snapshots.positions(bodies, number)[:, : scene.dimensions]
        reached_low = np.minimum(reached_low, solid.min(axis=0, initial=np.inf))
        reached_high = np.maximum(reached_high, solid.max(axis=0, initial=-np.inf))
    margin = 0.03 * (high - low).max()
    if not scene.walls:
        return np.maximum(low, reached_low - margin), np.minimum(high, reached_high + margin)
    return low - margin, np.minimum(high, reached_high) + margin


def layout(panels: int, most: int) -> tuple[int, int]:
    """Lines and columns, of which there are at most so many, with the fewest places left empty on that many lines; one
    column more where three lines or more leave fewer empty so.
    """

    def fitted(columns: int) -> tuple[int, int]:
        lines = math.ceil(panels / columns)
        return lines, math.ceil(panels / lines)

    return min(map(fitted, (most, most + 1) if panels > 2 * most else (most,)), key=math.prod)


def _panels_2d(run: Run, snapshots: Particles, numbers: Sequence[int]) -> Figure:
    low, high = view_limits(run, snapshots)
    lines, columns = layout(len(numbers), 3 if (high - low)[0] < 2.2 * (high - low)[1] else 2)
    width = 9.0 / columns if len(numbers) > 1 else 6.4
    tall = max(0.2 * width, min(1.25 * width, (width - 0.5) * (high - low)[1] / (high - low)[0]))
    found = [fluid_at(run, snapshots, number, gases=False) for number in numbers]
    ends = np.array([np.quantile(particles["pressure"], (0.01, 0.99)) for particles in found])
    least, most = (0.0, ends[:, 1].max()) if ends[:, 0].min() > -0.1 * ends[:, 1].max() else (ends.min(), ends.max())
    figure, axes = new_figure(lines, columns, (width * columns + 0.6, lines * (tall + 0.5) + 0.4), squeeze=False,
                              sharex=True, sharey=True)  # fmt: skip
    inches = min((width - 0.7) / (high - low)[0], tall / (high - low)[1])
    size = max(0.3, (config_of(run).numerics.spacing * inches * 72 * 0.95) ** 2)
    for axis, number, particles in zip(axes.flat, numbers, found):
        x, walls = particles["position"], walls_at(run, snapshots, number, is_no_body)
        axis.scatter(walls[:, 0], walls[:, 1], s=0.35 * size, color=WALL, linewidths=0, rasterized=True)
        solid = walls_at(run, snapshots, number, is_body)
        axis.scatter(solid[:, 0], solid[:, 1], s=size, color=BODY, linewidths=0, rasterized=True)
        air = gases_at(run, snapshots, number)
        axis.scatter(air[:, 0], air[:, 1], s=0.25 * size, color=WALL, linewidths=0, rasterized=True)
        dots = axis.scatter(x[:, 0], x[:, 1], c=particles["pressure"], s=size * shares_of_dots(run, snapshots, number),
                            linewidths=0, vmin=least, vmax=most, rasterized=True)  # fmt: skip
        for line in outlines.in_plane(scene_of(run).walls, float(snapshots.times[number]), low, high):
            axis.plot(*line, color=WALL, linewidth=1.5 if not len(walls) else 0.8)
        for ends in moorings_at(run, snapshots, number):
            axis.plot(ends[:, 0], ends[:, 1], color=BODY, linewidth=1.0)
        for outline in predicted_outline(config_of(run), float(snapshots.times[number])):
            axis.plot(*outline, **THEORY)
        axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axis.set_title(f"t = {snapshots.times[number]:.3g} s", fontsize=10, fontweight="normal")
        axis.grid(visible=False)
    for axis in axes.flat[len(numbers) :]:
        axis.set_visible(False)
    metre, unit = (1e3, "mm") if (high - low).max() < SMALL else (1.0, "m")
    for axis in axes.flat:
        for way in (axis.xaxis, axis.yaxis):
            way.set_major_formatter(lambda value, _: f"{value * metre:.4g}")
    for axis in axes.flat[len(numbers) - columns : len(numbers)]:  # the lowest of each column
        axis.set_xlabel(f"x, {unit}")
        axis.tick_params(labelbottom=True)
    for axis in axes[:, 0]:
        axis.set_ylabel(f"y, {unit}")
    figure.colorbar(dots, ax=axes, label="pressure, Pa", pad=0.01, aspect=30)
    return figure


def predicted_outline(config: SphConfig, t: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Where theory puts the surface: the ellipse of a round drop that is drawn out along y."""
    flow, shape = flow_of(config.fluid[0], Linear), config.fluid[0].shape
    if not (flow and shape.sphere):
        return []
    g = flow.gradient
    if not (g[1] == g[2] == 0.0 and g[0] == -g[3] < 0):
        return []
    a, b = theory.drop_axes(np.array([t]), g[3], shape.sphere.radius)
    angle = np.linspace(0.0, 2 * np.pi, 181)
    return [(shape.sphere.centre[0] + a * np.cos(angle), shape.sphere.centre[1] + b * np.sin(angle))]


def _panels_3d(run: Run, snapshots: Particles, numbers: Sequence[int]) -> Figure:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize, to_rgb

    low, high = view_limits(run, snapshots)
    radius = 0.6 * config_of(run).numerics.spacing
    view = render.View(np.stack([low - radius, high + radius]), PIXELS)
    found = [fluid_at(run, snapshots, number, gases=False) for number in numbers]
    speeds = [np.linalg.norm(particles["velocity"], axis=1) for particles in found]
    norm = Normalize(0.0, max(float(np.quantile(speed, 0.995)) for speed in speeds) or 1.0)
    colours = colormaps["viridis"]
    ratio = view.shape[0] / view.shape[1]
    lines, columns = layout(len(numbers), 2 if ratio < 1 else 3)
    width = min(9.2 / columns if len(numbers) > 1 else 6.4, 4.6 / ratio)
    tall = width * ratio
    figure, axes = new_figure(lines, columns, (width * columns + 0.6, lines * (tall + 0.3)), squeeze=False)
    spacing = config_of(run).numerics.spacing
    for axis, number, particles, speed in zip(axes.flat, numbers, found, speeds):
        x, paint, t = particles["position"], colours(norm(speed))[:, :3], float(snapshots.times[number])
        for wall in outlines.solid_boxes(scene_of(run).walls, t):
            surface = render.box_surface(np.clip(wall[0], low, high), np.clip(wall[1], low, high), spacing / 2)
            x = np.concatenate([x, surface])
            paint = np.concatenate([paint, np.full((len(surface), 3), to_rgb(WALL))])
        for kind, colour in ((is_rounded, WALL), (is_body, BODY)):
            solid = walls_at(run, snapshots, number, kind)
            x = np.concatenate([x, solid])
            paint = np.concatenate([paint, np.full((len(solid), 3), to_rgb(colour))])
        for ends in moorings_at(run, snapshots, number):
            beads = np.linspace(ends[0], ends[1], max(2, int(np.linalg.norm(ends[1] - ends[0]) / (0.3 * spacing))))
            x = np.concatenate([x, beads])
            paint = np.concatenate([paint, np.full((len(beads), 3), to_rgb(BODY))])
        axis.imshow(render.paint(view, x, paint, radius), interpolation="bilinear", zorder=2)
        for edge in outlines.tank(scene_of(run).walls, t, low, high):
            line = view.project(edge)
            axis.plot(line[:, 0], view.shape[0] - 1 - line[:, 1], color="#8a8f98", linewidth=0.6, zorder=1)
        axis.set_title(f"t = {snapshots.times[number]:.3g} s", fontsize=10, fontweight="normal")
        axis.axis("off")
    for axis in axes.flat[len(numbers) :]:
        axis.set_visible(False)
    figure.colorbar(ScalarMappable(norm, colours), ax=axes, label="speed, m/s", pad=0.01, aspect=30)
    corners = np.concatenate(outlines.tank(scene_of(run).walls, 0.0, low, high))
    edges = " x ".join(f"{edge:.3g}" for edge in np.nanmax(corners, axis=0) - np.nanmin(corners, axis=0))
    figure.supxlabel(f"box {edges} m", fontsize=9)
    return figure


# ------------------------------------------------------------------------------------------- profiles


def rows(z: np.ndarray, values: np.ndarray, width: float, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Means of z and values over the layers of particles across a channel."""
    n = geometry.count(width, spacing)
    row = np.clip((z / width * n).astype(int), 0, n - 1)
    counts = np.maximum(np.bincount(row, minlength=n), 1)
    return np.bincount(row, z, n) / counts, np.bincount(row, values, n) / counts


def shear_stress(config: SphConfig, channel: Channel, particles: dict[str, np.ndarray]) -> np.ndarray:
    """Stress[n] of each particle along a channel, mu epsilon of (MP 22) with the images in its planes, Pa."""
    along, across, floor, width, _, nu, _ = channel
    d, h, mass = config.dimensions, config.h, particles["mass"]
    plane = np.eye(d)[across]
    x, v, volume = particles["position"][:, :d], particles["velocity"][:, :d], mass / particles["density"]
    images = [x - 2 * plane * (x[:, across, None] - end) for end in (floor, floor + width)]
    all_x, all_v, all_volume = np.concatenate([x, *images]), np.concatenate([v, -v, -v]), np.tile(volume, 3)
    low, high = (np.array(corner) for corner in config.domain.corners)
    period = np.where(np.arange(d) == across, np.inf, high - low)
    found = np.empty(len(x))
    for place in np.arange(floor, floor + width, h):
        own = np.flatnonzero((x[:, across] >= place) & (x[:, across] < place + h))
        near = np.abs(all_x[:, across] - place - h / 2) < support_of(config) + h / 2
        dx = x[own].T[:, :, None] - all_x[near].T[:, None, :]
        dx -= np.where(np.isinf(period), 0.0, period)[:, None, None] * np.rint(dx / period[:, None, None])
        f = SMOOTHING[config.numerics.kernel].gradient(np.sqrt(np.sum(dx * dx, axis=0)) / h, d) / h ** (d + 2)
        slopes = velocity_gradient(all_volume[near], f, dx, v[own].T[:, :, None] - all_v[near].T[:, None, :])
        found[own] = config.fluid[0].density * nu * (slopes[along, across] + slopes[across, along])
    return found


def profiles(run: Run, step: int | None = None) -> Figure:
    """Velocity and shear stress across a channel at several times beside the series (MP 24)."""
    config = config_of(run)
    channel = channel_of(config)
    if channel is None:
        raise NotInScene("only for a viscous flow that a body force drives between two planes")
    if len(channel.layers) > 1:
        return layered_profiles(run, channel, step)
    along, across, floor, width, force, nu, _ = channel
    snapshots, density, spacing = snapshots_of(run), config.fluid[0].density, config.numerics.spacing
    settled = width * width / nu
    if step is None:
        wanted = [t * settled for t in (0.0225, 0.045, 0.1125, 0.225, 1.0)]
        numbers = sorted({snapshots.index(time=t) for t in wanted if t <= snapshots.times[-1] + 0.02 * settled})
    else:
        numbers = [snapshots.index(step)]
    fine = np.linspace(0.0, width, 201)
    steady, wall = channel.fastest, density * force * width / 2
    worst = 0.0
    with style():
        figure, (left, right) = new_figure(1, 2, (8.4, 3.9), sharey=True)
        for number, colour in zip(numbers, COLOURS):
            t, particles = float(snapshots.times[number]), fluid_at(run, snapshots, number)
            z = particles["position"][:, across] - floor
            middle, v = rows(z, particles["velocity"][:, along], width, spacing)
            exact = theory.poiseuille(z, t, force, nu, width)
            worst = max(worst, float(np.abs(particles["velocity"][:, along] - exact).max()) / steady)
            left.plot(v / steady, middle / width, "o", markersize=3.2, color=colour, label=f"t = {t:.3g} s")
            left.plot(theory.poiseuille(fine, t, force, nu, width) / steady, fine / width, **THEORY)
            middle, stress = rows(z, shear_stress(config, channel, particles), width, spacing)
            right.plot(stress / wall, middle / width, "o", markersize=3.2, color=colour)
            right.plot(theory.poiseuille_stress(fine, t, force, nu, width, density) / wall, fine / width, **THEORY)
        left.set(xlabel=r"velocity / $FL^2/8\nu$", ylabel="z / L", title="Velocity")
        right.set(xlabel=r"shear stress / $\rho FL/2$", title="Shear stress")
        left.text(0.98, 0.03, f"largest error {worst:.2%}\nlines: series", transform=left.transAxes, ha="right")
        right.legend(*left.get_legend_handles_labels(), loc="upper right")
        return figure


def layered_profiles(run: Run, channel: Channel, step: int | None) -> Figure:
    """Velocity across a channel of several layers at several times, beside the steady profile."""
    snapshots, spacing = snapshots_of(run), config_of(run).numerics.spacing
    numbers = chosen(run, snapshots)[1:] if step is None else [snapshots.index(step)]
    fine = np.linspace(0.0, channel.width, 201)
    with style():
        figure, axes = new_figure(size=(5.2, 3.9))
        for number, colour in zip(numbers, COLOURS):
            particles = fluid_at(run, snapshots, number)
            z, v = particles["position"][:, channel.across] - channel.floor, particles["velocity"][:, channel.along]
            middle, mean = rows(z, v, channel.width, spacing)
            label = f"t = {snapshots.times[number]:.3g} s"
            axes.plot(mean, middle / channel.width, "o", markersize=3.2, color=colour, label=label)
            worst = float(np.abs(v - channel.steady(z)).max()) / channel.fastest
        axes.plot(channel.steady(fine), fine / channel.width, label="steady, theory", **THEORY)
        axes.set(xlabel="velocity, m/s", ylabel="z / L", title=f"Last: largest error {worst:.2%}")
        axes.legend()
        return figure


def depth(run: Run, step: int | None = None) -> Figure:
    """Pressure of the particles over the height, beside that of fluid at rest."""
    scene = scene_of(run)
    still = [fluid for fluid in scene.fluids if at_rest(fluid.section)]
    if not scene.gravity.any() or not still:
        raise NotInScene("only for fluid that starts at rest under gravity")
    snapshots = snapshots_of(run)
    number = snapshots.index(step)
    particles = fluid_at(run, snapshots, number)
    g = float(np.sqrt(scene.gravity @ scene.gravity))
    height = -particles["position"][:, : scene.dimensions] @ scene.gravity / g
    top = max(max(np.dot(c, -scene.gravity / g) for c in geometry.corners(fluid.section.shape)) for fluid in still)
    bottom = float(height.min())
    line = np.linspace(bottom, top, 50)
    exact = scene.eos.pressure(scene.eos.excess_at_rest(top - line, g))
    if scene.liquids.several:
        below = sorted((heights(scene, fluid.section), fluid.section.name, fluid.section) for fluid in still)
        parts = [(np.linspace(*ends, 20), section) for ends, _, section in below]
        line = np.concatenate([places for places, _ in parts])
        found = [hydrostatic(scene, section, places[:, None] * up(scene)) for places, section in parts]
        exact = scene.eos.pressure(np.concatenate(found))
    with style():
        figure, axes = new_figure(size=(6.4, 4.0))
        axes.scatter(particles["pressure"], height, s=4, color=COLOURS[0], linewidths=0, rasterized=True)
        axes.plot(exact, line, label="at rest, equation of state", **THEORY)
        axes.set(xlabel="pressure, Pa", ylabel="height, m", title=f"Pressure at t = {snapshots.times[number]:.3g} s")
        axes.legend()
        return figure
