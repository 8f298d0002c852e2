"""Figures of the grains of an LBM-DEM run: where they are, how they touch, and how few of them move in time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hpcpic.core.app.figures import COLOURS, INK, THEORY, NoData, NotInScene, new_figure, pictured, present, style
from hpcpic.core.case.config import loads
from lbmdem.case.config import AXES, LbmDemConfig
from lbmdem.configure import configure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hpcpic.core.files.reader import Particles, Run

SOLID = "#b9bec5"
FLAT = 0.5  # height over width of a box below which pictures stand two in a line, not all in one


def config_of(run: Run) -> LbmDemConfig:
    return configure(loads(run.config, run.config_file))


def snapshots_of(run: Run) -> Particles:
    if not config_of(run).grains:
        raise NotInScene("there are no grains")
    return present(lambda: run.particle_snapshots, "the grains")


def all_grains(run: Run, step: int) -> dict[str, np.ndarray]:
    """Columns of all sets at a step."""
    parts = [run.particles(name, step=step) for name in run.particle_snapshots.species]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def grains(run: Run, step: int | None = None) -> Figure:
    """2D: discs with the lines that show their rotation, at several times or at one step. 3D: spheres seen from y.

    A colour for each of a few grains, as in `tracks`; of many the colour is the speed, on one scale in all pictures.
    """
    snapshots = snapshots_of(run)
    config = config_of(run)
    steps = [int(s) for s in snapshots.steps]
    spread = [steps[k] for k in pictured(snapshots, config.output.pictures)]
    chosen = spread if step is None else [int(snapshots.steps[snapshots.index(step)])]
    size = config.domain.size
    across, along = size[0], size[-1]
    ratio = min(along / across, 4.0)
    lines, flat = math.ceil(len(chosen) / 2), ratio < FLAT and len(chosen) > 1
    shape, inches = (1, len(chosen)), (1.2 + 1.45 * len(chosen), 1.0 + 1.4 * ratio)
    if flat:
        shape, inches = (lines, 2), (9.8, 0.4 + lines * (0.55 + 4.1 * ratio))
    with style():
        figure, axes = new_figure(*shape, inches, squeeze=False)
        scale = _scale_of_speeds([all_grains(run, at) for at in spread])
        for axis in axes.flat[len(chosen) :]:
            axis.remove()
        for axis, at in zip(axes.flat, chosen):
            _draw_box(axis, config)
            _draw_grains(axis, with_images(all_grains(run, at), config), config.dimensions, scale)
            axis.set(xlim=(0, across), ylim=(0, along), aspect="equal", xticks=[0, across], yticks=[0, along])
            axis.tick_params(labelsize=7.5, labelleft=axis in axes[:, 0])
            axis.set_xticklabels(["0", f"{across:.3g}"])
            axis.set_yticklabels(["0", f"{along:.3g}"])
            axis.grid(visible=False)
            for side in axis.spines.values():
                side.set_visible(True)
            axis.set_title(f"{snapshots.times[steps.index(at)]:.3g} s", fontsize=9.5)
        for axis in axes[:, 0]:
            axis.set_ylabel(f"{'yz'[config.dimensions - 2]}, m", fontsize=8.5, labelpad=6 if flat else -4)
        figure.supxlabel("x, m", fontsize=8.5)
        if scale:
            figure.colorbar(scale, ax=list(axes.flat[: len(chosen)]), label="speed, m/s", pad=0.01)
        return figure


def _scale_of_speeds(snapshots: list[dict[str, np.ndarray]]) -> Any:
    """Colours of the speeds of grains, None where they are so few that each has a colour of its own."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    if max(len(columns["id"]) for columns in snapshots) <= len(COLOURS):
        return None
    fastest = max(float(_speeds(columns).max(initial=0.0)) for columns in snapshots)
    return ScalarMappable(Normalize(0.0, fastest or 1.0), "viridis")


def _speeds(columns: dict[str, np.ndarray]) -> np.ndarray:
    return np.linalg.norm(columns["velocity"], axis=1)


def with_images(columns: dict[str, np.ndarray], config: LbmDemConfig, far: float = 0.0) -> dict[str, np.ndarray]:
    """Columns of grains, and of those that come within `far` of a periodic side again beyond the opposite one."""
    for k in range(config.dimensions):
        if AXES[k] not in config.domain.periodic:
            continue
        length, x = config.domain.size[k], columns["position"][:, k]
        reach = columns["radius"] + far
        for here, shift in ((x < reach, length), (x > length - reach, -length)):
            again = {name: values[: len(x)][here].copy() for name, values in columns.items()}
            again["position"][:, k] += shift
            columns = {name: np.concatenate([values, again[name]]) for name, values in columns.items()}
    return columns


def _draw_box(axis: Any, config: LbmDemConfig) -> None:
    """Obstacles in the plane of the figure, without planes inclined to it, and dashed the screen under a sample."""
    from matplotlib.patches import Polygon, Rectangle

    from lbmdem.setup.box_walls import floor_height

    if screen := floor_height(config):
        axis.axhline(screen, color=INK, linestyle="--", linewidth=0.8)
    up, far = config.dimensions - 1, 10.0 * max(config.domain.size)
    for plane, box in ((obstacle.shape.plane, obstacle.shape.box) for obstacle in config.obstacle):
        if box is not None:
            sides = (box.high[0] - box.low[0], box.high[up] - box.low[up])
            axis.add_patch(Rectangle((box.low[0], box.low[up]), *sides, color=SOLID))
        elif plane is not None and not any(plane.normal[1:up]):
            point = np.array([plane.point[0], plane.point[up]])
            normal = far * np.array([plane.normal[0], plane.normal[up]]) / np.hypot(plane.normal[0], plane.normal[up])
            along = np.array([-normal[1], normal[0]])
            corners = [point + along, point - along, point - along - normal, point + along - normal]
            axis.add_patch(Polygon(corners, color=SOLID))


def _draw_grains(axis: Any, columns: dict[str, np.ndarray], dimensions: int, scale: Any) -> None:
    from matplotlib.collections import LineCollection, PatchCollection
    from matplotlib.patches import Circle

    x, r = columns["position"], columns["radius"]
    order = np.argsort(-x[:, 1]) if dimensions == 3 else np.arange(len(x))
    up = 2 if dimensions == 3 else 1
    circles = [Circle((x[k, 0], x[k, up]), r[k]) for k in order]
    if scale:
        colours = scale.to_rgba(_speeds(columns)[order])
    else:  # an image has the number, and so the colour, of its grain
        colours = [COLOURS[k % len(COLOURS)] for k in columns["id"][order]]
    axis.add_collection(PatchCollection(circles, facecolor=colours, edgecolor=INK, linewidth=0.4))
    if dimensions == 2:
        ends = np.stack([np.cos(columns["angle"]), np.sin(columns["angle"])], axis=1) * r[:, None]
        lines = np.stack([x[:, :2] - ends, x[:, :2] + ends], axis=1)
        colour, width = (INK, 0.5) if scale else ("white", 1.2)
        axis.add_collection(LineCollection(list(lines), color=colour, linewidth=width))


def contacts(run: Run, step: int | None = None) -> Figure:
    """Which grains touch: a line for each contact, as wide as k_n times its overlap, what presses there at rest."""
    config, snapshots = config_of(run), snapshots_of(run)
    number = snapshots.index(step)
    columns = all_grains(run, int(snapshots.steps[number]))
    count = len(columns["id"])
    if count < 2:
        raise NotInScene("needs two grains")
    columns = with_images(columns, config, float(columns["radius"].max()))
    ends, overlap, share, neighbours = touching(columns, config, count)
    if not len(ends):
        raise NoData("no grains touch")
    force, up = config.contact.normal_stiffness * overlap, config.dimensions - 1
    width, height = config.domain.size[0], config.domain.size[up]
    ratio = min(max(height / width, 0.3), 2.5)
    with style():
        from matplotlib.collections import LineCollection, PatchCollection
        from matplotlib.patches import Circle

        figure, axes = new_figure(size=(5.4, 1.2 + 4.6 * ratio))
        _draw_box(axes, config)
        circles = [Circle(x[[0, up]], r) for x, r in zip(columns["position"], columns["radius"])]
        axes.add_collection(PatchCollection(circles, facecolor="none", edgecolor=INK, linewidth=0.4, alpha=0.5))
        mean = float(force @ share / share.sum())
        widths = 2.0 * force / mean
        axes.add_collection(LineCollection(list(ends[:, :, [0, up]]), linewidths=widths, color=COLOURS[1]))
        axes.set(xlim=(0, width), ylim=(0, height), aspect="equal", xlabel="x, m", ylabel=f"{AXES[up]}, m")
        axes.grid(visible=False)
        unit = "N/m" if config.dimensions == 2 else "N"
        figure.suptitle(
            f"{share.sum():.0f} contacts at t = {snapshots.times[number]:.4g} s\n"
            f"{neighbours / count:.2f} neighbours of a grain, mean force {mean:.3g} {unit}"
        )
        return figure


def touching(
    columns: dict[str, np.ndarray], config: LbmDemConfig, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Ends [n, 2, d], overlaps [n] (m) and weights [n] of contacts between grains and with walls, and how
    many neighbours all have together. Those behind the first `count` grains are images: of a contact with one there are
    two halves.
    """
    from scipy.spatial import cKDTree

    from lbmdem.setup.box_walls import box_walls
    from lbmdem.setup.scene import Scene

    d = config.dimensions
    x, r = columns["position"][:, :d], columns["radius"]
    pairs = cKDTree(x).query_pairs(2.0 * float(r.max()), output_type="ndarray")
    overlap = r[pairs].sum(axis=1) - np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
    real = (overlap > 0.0) & (pairs < count).any(axis=1)
    pairs, overlap = pairs[real], overlap[real]
    ends, depths, shares = [x[pairs]], [overlap], [(pairs < count).mean(axis=1)]
    for wall in box_walls(Scene(config)):
        normal = np.array(wall.normal) / np.linalg.norm(wall.normal)
        gap = (x - np.array(wall.point)) @ normal
        near = np.flatnonzero(gap < r)
        ends.append(np.stack([x[near], x[near] - gap[near, None] * normal], axis=1))
        depths.append((r - gap)[near])
        shares.append(near < count)
    return np.concatenate(ends), np.concatenate(depths), np.concatenate(shares), 2.0 * float(shares[0].sum())


def tracks(run: Run) -> Figure:
    """Height and velocity along the last axis of up to eight grains in time."""
    snapshots = snapshots_of(run)
    up = config_of(run).dimensions - 1
    history = [all_grains(run, int(s)) for s in snapshots.steps]
    if len(history[0]["id"]) > 8:
        raise NotInScene("needs at most eight grains")
    if len(history) < 3:
        raise NoData("needs three snapshots of the grains (output.period.grains)")
    height = np.array([columns["position"][:, up] for columns in history])
    speed = np.array([columns["velocity"][:, up] for columns in history])
    with style():
        figure, (top, low) = new_figure(2, 1, (6.2, 4.6), sharex=True)
        for k in range(height.shape[1]):
            top.plot(snapshots.times, height[:, k], color=COLOURS[k], label=f"grain {k}")
            low.plot(snapshots.times, speed[:, k], color=COLOURS[k])
        top.set(ylabel="height, m", title="Grains in time")
        if height.shape[1] > 1:
            top.legend(ncols=2)
        low.set(xlabel="time, s", ylabel="vertical velocity, m/s")
        return figure


def rolling(run: Run) -> Figure:
    """Speed of one sphere's centre along x, and of its surface against the centre, beside rigid bodies' with Coulomb
    friction: it slides until both are the same, then rolls with 5/7 of what pulls it.
    """
    config, snapshots = config_of(run), snapshots_of(run)
    history = [all_grains(run, int(s)) for s in snapshots.steps]
    if config.dimensions == 2 or config.fluid or len(history[0]["id"]) != 1 or not any(config.gravity):
        raise NotInScene("needs one sphere without fluid on a floor")
    first, t = history[0], np.asarray(snapshots.times)
    v = np.array([columns["velocity"][0, 0] for columns in history])
    surface = np.array([columns["angular_velocity"][0, 1] * columns["radius"][0] for columns in history])
    pull, slows = config.gravity[0], config.contact.friction * abs(config.gravity[2])
    if 3.5 * slows <= pull:
        raise NotInScene("needs friction enough to end sliding")
    until = float(first["velocity"][0, 0]) / (3.5 * slows - pull)
    fine = np.linspace(0.0, t[-1], 400)
    sliding, after = np.minimum(fine, until), np.maximum(fine - until, 0.0)
    roll = 5.0 / 7.0 * pull * after
    with style():
        figure, axes = new_figure(size=(6.2, 3.6))
        axes.plot(t, v, "o", markersize=6, color=COLOURS[0], label="centre")
        axes.plot(t, surface, "s", markersize=3, color=COLOURS[1], label="surface about the centre")
        axes.plot(fine, v[0] + (pull - slows) * sliding + roll, label="rigid bodies", **THEORY)
        axes.plot(fine, 2.5 * slows * sliding + roll, **THEORY)
        axes.set(xlabel="time, s", ylabel="speed along x, m/s", title="Sliding and rolling", ylim=(0, None))
        axes.legend()
        return figure
