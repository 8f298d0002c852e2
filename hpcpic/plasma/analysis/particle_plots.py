"""Figures of particles: phase space and velocity distributions."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from hpcpic.core.app.figures import (
    COLOURS,
    THEORY,
    NoData,
    NotInScene,
    axis_label,
    new_figure,
    plain,
    present,
    style,
)
from hpcpic.core.errors import FileError
from hpcpic.plasma.analysis import series_analysis
from hpcpic.plasma.analysis.predictions import config_of
from hpcpic.plasma.case import config as case
from hpcpic.plasma.case.config import velocity_components
from hpcpic.plasma.forecast.scales import particle_count
from hpcpic.plasma.setup.loaders import loader_of
from hpcpic.plasma.setup.macro_particles import macro_mass

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hpcpic.core.files.histograms import Histogram
    from hpcpic.core.files.reader import Particles, Run

MAX_DOTS = 20_000  # more particles are drawn as a density
PANELS = 4
SNAPSHOTS_FOR_LIMITS = 16  # of a movie, read again for each of its frames
MAX_PATHS = 16  # particles


def snapshots_of(run: Run) -> Particles:
    if not any(species.particles for species in config_of(run).species):
        raise NotInScene("there are no particles")
    return present(lambda: run.particle_snapshots, "the particles")


def _velocity_limits(snapshots: Particles, numbers: Sequence[int]) -> tuple[float, float]:
    """Common limits of vx over the snapshots shown, a little wider than all but a few particles. Raises NoData."""
    low, high = np.inf, -np.inf
    for number in numbers:
        for species in snapshots.species:
            v = snapshots.read(species, number)["velocity"][:, 0]
            if v.size:
                ends = np.quantile(v, (0.001, 0.999))
                low, high = min(low, ends[0]), max(high, ends[1])
    if low > high:
        raise NoData("there are no particles")
    middle, half = 0.5 * (low + high), 0.5 * (high - low) or 1.0
    return float(middle - 1.15 * half), float(middle + 1.15 * half)


def _evenly_chosen(last: int, n: int) -> list[int]:
    """At most n whole numbers from 0 to `last`, evenly spaced."""
    return sorted(set(np.linspace(0, last, n).astype(int).tolist()))


def phase_space(run: Run, step: int | None = None) -> Figure:
    """x and vx of the particles, coloured by species, at up to four times; at one step when it is given."""
    snapshots = snapshots_of(run)
    last = len(snapshots.steps) - 1
    numbers = [snapshots.index(step)] if step is not None else _evenly_chosen(last, PANELS)
    length = config_of(run).simulation.space_length[0]
    limits = _velocity_limits(snapshots, _evenly_chosen(last, SNAPSHOTS_FOR_LIMITS) if step is not None else numbers)
    with style():
        columns = 3 if len(numbers) == 3 else min(2, len(numbers))  # no panel is empty
        lines = -(-len(numbers) // columns)
        size = (6.4, 4.2) if len(numbers) == 1 else (3.5 * columns, 2.5 * lines + 0.5)
        figure, axes = new_figure(lines, columns, size, squeeze=False, sharex=True, sharey=True)
        for axis, number in zip(axes.flat, numbers):
            _phase_panel(axis, snapshots, number, length, limits)
        for axis in axes[-1]:
            axis.set_xlabel("x, m")
        for axis in axes[:, 0]:
            axis.set_ylabel("$v_x$, m/s")
        if len(snapshots.species) > 1:
            _species_legend(figure, snapshots.species)
        return figure


def _phase_panel(axis: Any, snapshots: Particles, number: int, length: float, limits: tuple[float, float]) -> None:
    """Dots while they can be told apart, else the density of each species laid over the others."""
    from matplotlib.colors import LinearSegmentedColormap, to_rgb

    read = [snapshots.read(species, number) for species in snapshots.species]
    dots = sum(len(p["id"]) for p in read) <= MAX_DOTS
    for particles, colour in zip(read, cycle(COLOURS)):
        x, v = particles["position"][:, 0], particles["velocity"][:, 0]
        if dots:
            size = 0.5 if x.size > 500 else 9.0
            axis.scatter(x, v, s=size, color=colour, linewidths=0, rasterized=x.size > 500)
            continue
        density = series_analysis.phase_space(x, v, length, (200, 150), limits)
        shade = np.ma.masked_equal(density, 0) ** 0.4  # faint filaments beside dense cores
        fade = LinearSegmentedColormap.from_list("fade", [(*to_rgb(colour), 0.25), (*to_rgb(colour), 1.0)])
        axis.imshow(
            shade,
            origin="lower",
            extent=(0, length, *limits),
            aspect="auto",
            cmap=fade,
            interpolation="nearest",
        )
    axis.set(xlim=(0, length), ylim=limits)
    axis.grid(visible=False)
    axis.set_title(f"t = {snapshots.times[number]:.4g} s", fontsize=10, weight="normal")


def _species_legend(figure: Figure, species: Sequence[str]) -> None:
    from matplotlib.lines import Line2D

    marks = [Line2D([], [], color=c, marker="o", linestyle="") for _, c in zip(species, cycle(COLOURS))]
    figure.legend(marks, [plain(name) for name in species], ncols=4, loc="outside upper right")


def velocities(run: Run, step: int | None = None) -> Figure:
    """Distribution of each velocity component at the first snapshot and at the last, or the one asked for."""
    snapshots = snapshots_of(run)
    if particle_count(config_of(run)) <= MAX_PATHS:
        raise NotInScene(f"needs more than {MAX_PATHS} particles")
    end = snapshots.index(step)
    found = {name: snapshots.read(name, end)["velocity"] for name in snapshots.species}
    found = {name: late for name, late in found.items() if len(late)}
    components = velocity_components(config_of(run))
    with style():
        figure, axes = new_figure(1, components, (2.4 + 3.0 * components, 3.5), squeeze=False)
        for c, axis in enumerate(axes[0]):
            highest = 0.0
            for (name, late), colour in zip(found.items(), cycle(COLOURS)):
                early, v = snapshots.read(name, 0)["velocity"][:, c], late[:, c]
                limits = (float(min(early.min(), v.min())), float(max(early.max(), v.max())))
                bins = int(np.clip(np.sqrt(v.size) / 2, 12, 160))
                now, then = _stairs(v, bins, limits), _stairs(early, bins, limits)
                if end:
                    axis.stairs(*then, color=colour, linewidth=1.0, alpha=0.45)
                axis.stairs(*now, color=colour, fill=True, alpha=0.14)
                axis.stairs(*now, color=colour, linewidth=1.8, label=plain(name))
                highest = max(highest, min(then[0].max(), 2.0 * now[0].max()), now[0].max())
            axis.set(xlabel=f"$v_{'xyz'[c]}$, m/s", ylim=(0, 1.08 * highest))
        axes[0, 0].set(ylabel="f(v), s/m", title=f"Velocities at t = {snapshots.times[end]:.4g} s")
        axes[0, -1].legend(title="thin: at the start" if end else None, title_fontsize=9)
        return figure


def _stairs(v: np.ndarray, bins: int, limits: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    centres, f = series_analysis.velocity_distribution(v, bins, limits)
    half = 0.5 * (centres[1] - centres[0])
    return f, np.append(centres - half, centres[-1] + half)


def _histograms_of(run: Run) -> dict[str, tuple[case.Histogram, Histogram]]:
    """Every histogram of a run by name: its keys in the case, and its counts."""
    config = config_of(run)
    if not config.histogram:
        raise NotInScene("the case has no histogram")
    try:
        found = {one.name: (one, run.histogram(one.name)) for one in config.histogram}
    except FileError as error:
        raise NoData(f"no histograms (output.every.histograms): {error}") from error
    if not all(len(read.step) for _, read in found.values()):
        raise NoData("nothing was counted yet")
    return found


def steps_of_histograms(run: Run) -> Sequence[int]:
    return [int(step) for step in next(iter(_histograms_of(run).values()))[1].step]


def histograms(run: Run, step: int | None = None) -> Figure:
    """Each histogram at the last count, or at a step: as a line, with that of the first count and the Maxwellian of the
    case, or as a map.
    """
    found, config = _histograms_of(run), config_of(run)
    steps = next(iter(found.values()))[1].step.tolist()
    if step is not None and step not in steps:
        raise NoData(f"no count at step {step}")
    row = steps.index(step) if step is not None else -1
    with style():
        figure, axes = new_figure(len(found), 1, (6.4, 2.6 * len(found) + 0.6), squeeze=False)
        for axis, colour, (one, read) in zip(axes[:, 0], cycle(COLOURS), found.values()):
            names, edges = [*read.edges], [*read.edges.values()]
            axis.set_xlabel(axis_label(names[0], read.units[names[0]]))
            axis.set_title(f"{plain(one.name)}: {plain(one.species)}, t = {read.time[row]:.4g} s")
            if len(names) == 2:
                values = read.density[row].T
                drawn = axis.pcolormesh(*edges, np.ma.masked_equal(values, 0), cmap="viridis", rasterized=True)
                figure.colorbar(drawn, ax=axis, label=axis_label("f", read.unit))
                axis.set_ylabel(axis_label(names[1], read.units[names[1]]))
                continue
            axis.stairs(read.density[0], edges[0], color=colour, alpha=0.45, linewidth=1.0, label="at the start")
            axis.stairs(read.density[row], edges[0], color=colour, linewidth=1.8)
            if names[0].startswith("v") and (f := _maxwellian(config, one, names[0], edges[0])) is not None:
                axis.plot(0.5 * (edges[0][1:] + edges[0][:-1]), f, **THEORY, label="Maxwellian of the case")
            axis.set(ylabel=axis_label("f", read.unit), ylim=(0, None))
            axis.legend()
        return figure


def _maxwellian(config: case.PlasmaConfig, one: case.Histogram, axis: str, edges: np.ndarray) -> np.ndarray | None:
    """Density of the populations of a species as loaded, at the middles of the bins; None of one that is cold."""
    species = next(s for s in config.species if s.name == one.species)
    populations = loader_of(species).populations(species, "xyz".index(axis[1]))
    if not all(part.spread for part in populations):
        return None
    v = 0.5 * (edges[1:] + edges[:-1])
    shares = [
        part.share / (np.sqrt(2 * np.pi) * part.spread) * np.exp(-0.5 * ((v - part.mean) / part.spread) ** 2)
        for part in populations
    ]
    return species.particles * macro_mass(config, species) / species.mass * np.sum(shares, axis=0)


def orbits(run: Run) -> Figure:
    """Paths of all particles when they are few: x and y in 2D and 3D, x in time in 1D; open where they leave it."""
    config, snapshots = config_of(run), snapshots_of(run)
    if not 0 < particle_count(config) <= MAX_PATHS:
        raise NotInScene(f"needs one particle, at most {MAX_PATHS} particles")
    if len(snapshots.steps) < 8:
        raise NoData("needs eight snapshots of the particles (output.sampling_period.particle)")
    lengths = config.simulation.space_length
    with style():
        figure, axes = new_figure(size=(6.4, 3.6))
        for name, colour in zip(snapshots.species, cycle(COLOURS)):
            path = np.array([snapshots.read(name, k)["position"] for k in range(len(snapshots.steps))])
            jump = np.abs(np.diff(path[..., : len(lengths)], axis=0)) > 0.5 * np.array(lengths)
            path[1:][jump.any(axis=2)] = np.nan
            for p in range(path.shape[1]):
                across = path[:, p, 0]
                line = (across, path[:, p, 1]) if config.dimensions > 1 else (snapshots.times, across)
                axes.plot(*line, color=colour, linewidth=1.3, label=plain(name) if p == 0 else None)
                axes.plot(line[0][-1], line[1][-1], "o", color=colour, markersize=5)
        if config.dimensions > 1:
            axes.set(xlabel="x, m", ylabel="y, m", title="Orbits", aspect="equal")
            width, height = (np.ptp(limits) for limits in (axes.get_xlim(), axes.get_ylim()))
            figure.set_size_inches(6.4, np.clip(6.4 * height / width, 1.0, 5.0) + 1.0)
        else:
            axes.set(xlabel="time, s", ylabel="x, m", title="Orbits", ylim=(0, lengths[0]))
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1, ncols=4)
        return figure
