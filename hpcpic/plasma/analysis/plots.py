"""Figures of a plasma run, by name in PLOTS. Each takes a run folder that is open and makes one figure.

Lines of theory are drawn dashed and dark; what was measured is coloured.
"""

from __future__ import annotations

import math
from itertools import cycle
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from hpcpic.core.app.figures import (
    COLOURS,
    INK,
    THEORY,
    TIMERS,
    NoData,
    NotInScene,
    Plot,
    axis_label,
    columns_of,
    gauges_figure,
    new_figure,
    present,
    series_of,
    steps_of,
    style,
    thinned,
)
from hpcpic.plasma.analysis import series_analysis, theory
from hpcpic.plasma.analysis.particle_plots import (
    histograms,
    orbits,
    phase_space,
    snapshots_of,
    steps_of_histograms,
    velocities,
)
from hpcpic.plasma.analysis.predictions import (
    Compared,
    Prediction,
    beams_along_x,
    compare_mode,
    compare_parts,
    config_of,
    predict,
    predict_sound,
    scaled,
)
from hpcpic.plasma.case.config import PlasmaConfig, mode_columns
from hpcpic.plasma.forecast.noise import noise_over_wave
from hpcpic.plasma.forecast.scales import spacing
from hpcpic.plasma.forecast.turning import fastest_turn
from hpcpic.plasma.physics.dispersion import total_frequency
from hpcpic.plasma.physics.poisson import operator_of, response

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hpcpic.core.files.reader import Fields, Run

SIGNED, POSITIVE = "RdBu_r", "viridis"
MOST_ACROSS = 4  # fields in a row
MOST_HARMONICS = 40  # that a spectrum can show apart
WEAKLY_DAMPED = 0.6  # k lambda_D of waves that a spectrum shows
WIDEST = 72  # characters of a line in a figure: a longer one would narrow its axes


def _fields(run: Run) -> Fields:
    found = present(lambda: run.field_snapshots, "the fields")
    if not found.points:
        raise NotInScene("the grid has one point")
    return found


# --------------------------------------------------------------------------------------------- series


def energies(run: Run) -> Figure:
    """Field, kinetic and total energy, and below them the relative change of the total.

    Logarithmic where the field has under a hundredth of the energy; only the beginning of a long oscillation.
    """
    t, field, kinetic, total = columns_of(run, "energy_field", "energy_kinetic", "energy_total")
    with style():
        figure, (top, low) = new_figure(2, 1, (6.4, 4.6), height_ratios=(2.2, 1))
        shown = slice(0, _first_swings(field))
        for values, colour, label in ((total, INK, "total"), (kinetic, COLOURS[0], "kinetic")):
            top.plot(*thinned(t[shown], values[shown]), color=colour, label=label)
        top.plot(*thinned(t[shown], field[shown]), color=COLOURS[1], label="field")
        if 0.0 < field.max() < 0.01 * total.max():
            top.set_yscale("log")
            top.set_ylim(0.3 * np.percentile(field[field > 0], 2), 4.0 * total.max())
        else:
            top.set_ylim(0, None)
        title = "Energy" if shown.stop == len(t) else f"Energy until {t[shown][-1]:.3g} s"
        top.set(ylabel=axis_label("energy", run.series.units["energy_total"]), title=title)
        top.legend(ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
        low.plot(*thinned(t, series_analysis.relative_drift(total)), color=COLOURS[3], linewidth=1.2)
        low.set(ylabel="change of total", xlabel="time, s")
        return figure


def _first_swings(signal: np.ndarray, crossings: int = 40) -> int:
    """How many samples a figure shows: up to so many crossings of the mean where there are over four times as many."""
    crossed = np.flatnonzero(np.diff(np.sign(signal - signal.mean())) != 0)
    return int(crossed[crossings]) if len(crossed) > 4 * crossings else len(signal)


def gauges(run: Run) -> Figure:
    """Gauges in the fields, in time."""
    return gauges_figure(run, config_of(run).gauge)


def conservation(run: Run) -> Figure:
    """Departures of charge, momentum and total energy, of what the scene keeps: momentum relative to sqrt(2 m W)."""
    t, charge, total, kinetic = columns_of(run, "charge", "energy_total", "energy_kinetic")
    config = config_of(run)
    momenta = [name for name in config.conserved if name.startswith("momentum") and name in run.series]
    mass = sum(species_masses(config))
    scale = float(np.sqrt(2.0 * mass * kinetic.max())) if mass else 0.0
    lines = [("charge", series_analysis.relative_drift(charge))]
    if "energy_total" in config.conserved:
        lines.insert(0, ("energy", series_analysis.relative_drift(total)))
    lines += [(name.replace("_", " "), series_analysis.relative_drift(run.series[name], scale)) for name in momenta]
    if not any(values.any() for _, values in lines):
        raise NoData(f"exact: {', '.join(name for name, _ in lines)}")
    with style():
        figure, axes = new_figure(size=(6.4, 3.6))
        for (name, values), colour in zip(lines, COLOURS):
            size = np.abs(values)
            label = name if size.any() else f"{name}: exact"
            axes.plot(*thinned(t, np.where(size > 0, size, np.nan)), color=colour, label=label, linewidth=1.2)
        axes.set_yscale("log")
        axes.set(xlabel="time, s", ylabel="relative departure", title="Conservation")
        axes.set_xlim(t[0], t[-1])
        figure.legend(ncols=4, loc="outside lower center")  # too wide to stand beside the title
        return figure


def species_masses(config: PlasmaConfig) -> list[float]:
    """Mass of all particles of each species in kg, as the scene makes them."""
    from hpcpic.plasma.setup.scene import Scene

    return [species.m * species.n for species in Scene(config).species]


def amplitudes(run: Run) -> tuple[np.ndarray, dict[tuple[int, ...], np.ndarray]]:
    """Times, and |E_k| in V/m by mode: of the modes along x in every series, and of those that the case asks for."""
    series, config = series_of(run), config_of(run)
    along_x = [name for name in series if name.startswith("mode_") and name[5:].isdigit()]
    found = {(int(name[5:]), *(0,) * (config.dimensions - 1)): series[name] for name in along_x}
    for mode in config.output.modes:
        real, imaginary = mode_columns(mode)
        if real in series:
            found[mode] = np.hypot(series[real], series[imaginary])
    found = {mode: values for mode, values in found.items() if np.isfinite(values).any()}
    if not found:
        raise NoData("the series has no mode_1 ...")
    known = np.all([np.isfinite(values) for values in found.values()], axis=0)
    if known.sum() < 2:
        raise NoData("the series lacks a second sample")
    return series.time[known], {mode: values[known] for mode, values in found.items()}


def chosen_mode(config: PlasmaConfig, found: dict[tuple[int, ...], np.ndarray]) -> tuple[int, ...]:
    """The mode that theory and measurement are compared for: the one the case starts, or the largest."""
    for species in config.species:
        if species.perturbation:
            mode = species.perturbation.mode
            kept = next((m for m in (mode, tuple(-n for n in mode)) if m in found), None)
            if kept is None:
                raise NoData(f"the series lacks the mode that the case starts; add output.modes = ({list(mode)})")
            return kept
    return max(found, key=lambda mode: (found[mode].max(), mode))


def modes(run: Run) -> Figure:
    """Amplitudes |E_k| of the modes in the series, the one that the case starts beside the law that it allows."""
    config, (t, found) = config_of(run), amplitudes(run)
    chosen = chosen_mode(config, found)
    amplitude = found[chosen]
    if not amplitude.any():
        raise NoData("there is no field")
    law = predict(config, chosen)
    sound = predict_sound(config, chosen) if law is None else None
    if sound is None:
        compared = compare_mode(t, amplitude, law, noise_over_wave(config, chosen))
    else:
        compared = _compared_sound(run, chosen, sound)
    with style():
        figure, axes = new_figure(size=(6.4, 4.0))
        for mode, values in found.items():
            if mode != chosen:
                axes.plot(*thinned(t, values), linewidth=0.8, alpha=0.45, color=COLOURS[6])
        number = chosen[0] if not any(chosen[1:]) else chosen
        axes.plot(t, amplitude, color=COLOURS[0], linewidth=2.2, label=f"mode {number}")
        if compared.line is not None:
            axes.plot(t, compared.line, label="theory, in this mesh and step", **THEORY)
        top = amplitude.max()
        if compared.shown:
            axes.set(xlim=compared.shown, ylim=(0, 1.45 * top))
        else:
            axes.set_yscale("log")
            resolved = amplitude[amplitude > series_analysis.RESOLVED * top]
            axes.set_ylim(0.5 * resolved.min(), 12.0 * top)
        axes.set(xlabel="time, s", ylabel=axis_label("|$E_k$|", "V/m"), title="Modes of the field")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)
        words = "\n".join(fill(line, WIDEST) for line in compared.words.splitlines())
        axes.text(0.015, 0.975, words, transform=axes.transAxes, va="top", linespacing=1.5)
        return figure


def _compared_sound(run: Run, mode: tuple[int, ...], sound: Prediction) -> Compared:
    """A mode beside the wave of several species; it takes both parts of E_k, as faster waves hide where it turns."""
    real, imaginary = mode_columns(mode)
    if real not in run.series:
        law = f"theory {-sound.omega.imag:.4g} and {sound.omega.real:.5g} ({sound.law})"
        return Compared(f"not fitted: add output.modes = ({list(mode)})\n{law}")
    parts = run.series[real] + 1j * run.series[imaginary]
    known = np.isfinite(parts)
    return compare_parts(run.series.time[known], parts[known], sound)


def spectrum(run: Run) -> Figure:
    """Power of the field along x over wave number and frequency, with the branches that theory gives."""
    snapshots = _fields(run)
    name = next((n for n in ("E", "phi") if n in snapshots.names), None)
    if name is None or len(snapshots.steps) < 16 or len(set(np.diff(snapshots.steps))) > 1:
        raise NoData("needs 16 snapshots of E or phi at equal intervals (output.every.fields)")
    species = beams_along_x(config_of(run))
    wp = total_frequency(species) or 1.0
    dt = float(abs(snapshots.times[1] - snapshots.times[0]))
    if np.pi / dt < 1.5 * wp:
        raise NoData(f"needs a snapshot of the fields every {np.pi / (2 * wp):.3g} s or less (here {dt:.3g} s)")
    rows = np.array([_along_x(run, name, int(s)) for s in snapshots.steps])
    k, omega, power = series_analysis.spectrum(rows, dt, snapshots.spacing[-1])
    speed = max((max(abs(b.drift), b.thermal_velocity) for b in species), default=0.0)
    high = min(4.0 * wp, omega[-1])
    right = min(k[-1], max(2.0 * wp / speed, k[min(8, len(k) - 1)])) if speed else k[-1]
    with style():
        figure, axes = new_figure(size=(6.4, 4.2))
        shown = np.log10(power + 1e-300)
        top = shown[np.ix_(omega <= high, (k > 0) & (k <= right))].max()
        mesh = axes.pcolormesh(k[1:], omega, shown[:, 1:], vmin=top - 6, vmax=top, cmap="magma", rasterized=True)
        axes.scatter(*_branches(config_of(run), np.linspace(k[1], right, 80), high), s=3, color="white", linewidths=0)
        axes.axhline(wp, color="white", linewidth=0.8, alpha=0.6)
        label = {"xytext": (-4, 4), "textcoords": "offset points", "ha": "right", "color": "white"}
        axes.annotate(r"$\omega_p$", (right, wp), **label)
        axes.grid(visible=False)
        figure.colorbar(mesh, ax=axes, label=f"log$_{{10}}$ power of {name}", pad=0.02)
        axes.set(xlabel="wave number, rad/m", ylabel="frequency, rad/s", title="Spectrum of the field")
        axes.set(xlim=(0.5 * k[1], right), ylim=(0, high))
        return figure


def _branches(config: PlasmaConfig, waves: np.ndarray, high: float) -> tuple[list[float], list[float]]:
    """k along x and omega up to `high` of the waves of cold species that do not grow, or of one warm species: Landau's
    root while damping is weak, Bernstein's across a magnetic field; by the field equation, and as seen from the box
    where the species drifts. None where the field is oblique or too weak to see.
    """
    operator, still = operator_of(config), beams_along_x(config)
    found: list[tuple[float, float]] = []
    if not still or operator.b:
        return [], []
    for k in waves.tolist():
        factor, _ = response(operator, [k], spacing(config)[:1], spectral=False, cloud_radius=0.0)
        if factor > 0:
            found += [(k, abs(w)) for w in _frequencies(config, k, scaled(still, factor), high) if abs(w) <= high]
    return [k for k, _ in found], [w for _, w in found]


def _frequencies(config: PlasmaConfig, k: float, species: tuple[theory.Beam, ...], high: float) -> list[float]:
    """omega in both directions of the waves of _branches at one k."""
    (along, *across), first = config.field.magnetic, species[0]
    if any(across):
        wc = fastest_turn(config)
        drawn = len(species) == 1 and not along and not first.drift and high < MOST_HARMONICS * wc
        return theory.bernstein(k, first, wc, high) if drawn else []
    if all(b.thermal_velocity == 0.0 for b in species):
        return [w.real for w in theory.cold_roots(k, species) if abs(w.imag) < 1e-6 * abs(w)]
    debye = first.thermal_velocity / first.plasma_frequency
    if len(species) > 1 or k * debye >= WEAKLY_DAMPED:
        return []
    omega = first.plasma_frequency * theory.landau(k * debye).real
    return [k * first.drift + omega] + ([k * first.drift - omega] if first.drift else [])


def _along_x(run: Run, name: str, step: int) -> np.ndarray:
    """A scalar, or a vector's component along x, averaged over y, z: values[x]; or along the one axis with points."""
    values = run.field(name, step)
    if values.ndim > len(run.field_snapshots.points):
        values = values[..., _line_axis(run.field_snapshots)]
    return values.mean(axis=tuple(range(values.ndim - 1))) if values.ndim > 1 else values


def _line_axis(snapshots: Fields) -> int:
    """The axis that a line of nodes lies on: 0 for x; 1 for y, where x has one point; 2 for z."""
    return len(snapshots.grid[0]) - len(snapshots.points)


# --------------------------------------------------------------------------------------------- fields


def fields(run: Run, step: int | None = None) -> Figure:
    """1D: E in space and time, and profiles at a step. 2D: charge, potential, |E| at a step; 3D: in one plane."""
    snapshots = _fields(run)
    number = snapshots.index(step)
    if len(snapshots.points) == 1:
        return _fields_1d(run, snapshots, number)
    return _fields_in_plane(run, snapshots, number)


def _fields_1d(run: Run, snapshots: Fields, number: int) -> Figure:
    length = snapshots.points[0] * snapshots.spacing[0]
    x = np.arange(snapshots.points[0]) * snapshots.spacing[0]
    there = snapshots.names_at(number)
    known = [name for name in ("rho", "phi", "E") if name in there]
    names = [*(name for name in there if name not in known), *known]
    shown = names[-1]
    held = [shown in snapshots.names_at(k) for k in range(len(snapshots.steps))]
    several = sum(held) > 3
    with style():
        height = 1.25 * len(names) + (2.8 if several else 0.6)
        ratios = ([2.4] if several else []) + [1.0] * len(names)
        figure, axes = new_figure(len(ratios), 1, (6.4, height), height_ratios=ratios, squeeze=False)
        rows = list(axes[:, 0])
        if several:
            top = rows.pop(0)
            history = np.array([_along_x(run, shown, int(s)) for s in snapshots.steps[held]])
            limit = float(np.abs(history).max()) or 1.0
            seen = {"cmap": SIGNED, "vmin": -limit, "vmax": limit, "rasterized": True}
            mesh = top.pcolormesh(x, snapshots.times[held], history, **seen)
            top.axhline(snapshots.times[number], color=INK, linewidth=0.8)
            top.grid(visible=False)
            figure.colorbar(mesh, ax=top, label=axis_label(shown, snapshots.units[shown]), pad=0.02)
            wp = total_frequency(beams_along_x(config_of(run)))
            coarse = wp * float(np.abs(np.diff(snapshots.times[:2])).max()) > np.pi
            title = "Field, in snapshots too rare for its swing" if coarse else "Field in space and time"
            top.set(ylabel="time, s", title=title, xlim=(0, length))
        for axis, name, colour in zip(rows, names, cycle(COLOURS)):
            axis.plot(x, _along_x(run, name, int(snapshots.steps[number])), color=colour)
            axis.set(ylabel=axis_label(name, snapshots.units[name]), xlim=(0, length))
        rows[0].set_title(f"Profiles at t = {snapshots.times[number]:.4g} s")
        rows[-1].set_xlabel(f"{'xyz'[_line_axis(snapshots)]}, m")
        for axis in rows[:-1]:
            axis.tick_params(labelbottom=False)
        return figure


def _axes(snapshots: Fields) -> list[str]:
    """The axes that have more than one point, in the order of the arrays."""
    points = snapshots.grid[0]
    return [name for name, n in zip("xyz"[: len(points)][::-1], points) if n > 1]


def _fields_in_plane(run: Run, snapshots: Fields, number: int) -> Figure:
    *_, ly, lx = (n * d for n, d in zip(snapshots.points, snapshots.spacing))
    *third, vertical, horizontal = _axes(snapshots)
    at, middle = int(snapshots.steps[number]), snapshots.points[0] // 2
    there = [name for name in ("rho", "phi") if name in snapshots.names_at(number)]
    panels: list[tuple[str, Any, Any]] = [(name, run.field(name, at), SIGNED) for name in there]
    panels = [("rho - mean", v - v.mean(), c) if name == "rho" else (name, v, c) for name, v, c in panels]
    panels = [(name, v[middle] if third else v, c) for name, v, c in panels]
    for name in snapshots.names_at(number):
        if name not in ("rho", "phi"):
            values = run.field(name, at)
            values = values[middle] if third else values
            vector = values.ndim > 2
            size = np.linalg.norm(values, axis=-1) if vector else values
            panels.append((f"|{name}|" if vector else name, size, POSITIVE))
    with style():
        across = len(panels) if len(panels) <= MOST_ACROSS else MOST_ACROSS - 1
        rows = math.ceil(len(panels) / across)
        height = 0.9 + rows * 3.0 * min(max(ly / lx, 0.4), 1.6)
        figure, axes = new_figure(rows, across, (3.4 * across, height), squeeze=False)
        for axis in axes.flat[len(panels) :]:
            axis.set_axis_off()
        for axis, (name, values, colours) in zip(axes.flat, panels):
            limit, least = float(np.abs(values).max()) or 1.0, float(values.min())
            low = -limit if colours == SIGNED else least if least > limit / 2 else 0.0  # so a wave of 1 % of n shows
            image = axis.imshow(
                values,
                origin="lower",
                extent=(0, lx, 0, ly),
                cmap=colours,
                vmin=low,
                vmax=limit,
                aspect="equal",
            )
            stored = name.removesuffix(" - mean").strip("|")
            figure.colorbar(image, ax=axis, shrink=0.8, pad=0.02)
            axis.grid(visible=False)
            axis.set(xlabel=f"{horizontal}, m", title=axis_label(name, snapshots.units[stored]))
        for axis in axes[:, 0]:
            axis.set_ylabel(f"{vertical}, m")
        where = f" in the plane {third[0]} = {middle * snapshots.spacing[0]:.4g} m" if third else ""
        figure.suptitle(f"Fields at t = {snapshots.times[number]:.4g} s{where}", x=0.01, ha="left", fontsize=11)
        return figure


PLOTS = {
    "energies": Plot("Energy in time", energies),
    "modes": Plot("Modes of the field beside theory", modes),
    "conservation": Plot("Departures of charge, momentum and energy", conservation),
    "gauges": Plot("Gauges in time", gauges),
    "fields": Plot("Charge, potential and field", fields, steps_of(_fields)),
    "phase-space": Plot("Particles in phase space", phase_space, steps_of(snapshots_of)),
    "orbits": Plot("Paths of single particles", orbits),
    "velocities": Plot("Velocity distribution", velocities, steps_of(snapshots_of)),
    "histograms": Plot("Histograms beside the Maxwellian of the case", histograms, steps_of_histograms),
    "spectrum": Plot("Spectrum over wave number and frequency", spectrum),
    "timers": TIMERS,
}
