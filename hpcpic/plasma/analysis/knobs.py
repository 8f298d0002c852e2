"""What can be turned in a plasma case, and what is asked of it: growth, frequency, damping, gyration, energy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hpcpic.core.app.knobs import Choice, Knob, Knobs, Quantity, Seen, reseeded
from hpcpic.core.case.texts import value_text
from hpcpic.plasma.analysis.predictions import Prediction, predict
from hpcpic.plasma.analysis.series_analysis import Oscillation, fit_oscillation, signed
from hpcpic.plasma.case.config import PlasmaConfig, Species, mode_columns
from hpcpic.plasma.diagnostics.scalars import MODES
from hpcpic.plasma.forecast.densest import at_densest
from hpcpic.plasma.forecast.recurrence import on_grid
from hpcpic.plasma.forecast.scales import particle_count, spacing, total_plasma_frequency
from hpcpic.plasma.forecast.turning import fastest_turn
from hpcpic.plasma.physics.shapes import SHAPES
from hpcpic.plasma.setup.loaders import LOADERS, loader_of

if TYPE_CHECKING:
    from hpcpic.core.files.series import Series

PERIODS = 5  # of an oscillation whose frequency is wanted
GROWTH_WINDOW = (3.5, 6.5)  # e-folds after the start: other roots have died out, the beams are not trapped yet
LEAST_GROWTH = 1.0  # e-folds in the run: less is no growth that a slope shows
DAMPING_WINDOW = (0.7, 3.6)  # periods after the start: other roots have died out, noise is still small
LEAST_DAMPING = 1e-3  # of the frequency: a damping rate that the noise of particles hides
SAMPLES = 129  # of a window, the same times in every pilot
PER_CELL = 4  # least particles per cell of a quiet species, or velocities of one in strata
MAX_HORIZON_STEPS = 100_000  # of the case in the horizon: a single proton's plasma frequency is far from its gyration's
HORIZON = 300.0  # 1/wp in which an instability of the time step shows


def knobs_of(config: PlasmaConfig) -> Knobs:
    """Knobs, choices and quantities of a completed case."""
    time = abs(config.simulation.time_step) * config.simulation.cycles
    return Knobs(
        knobs=tuple(continuous(config)),
        choices=tuple(choices_of(config)),
        quantities=lambda: quantities_of(config, time),
        settings=partial(settings, config),
        time=time,
        pilot=(
            "output.every.series=1",
            "output.every.fields=0",
            "output.every.particles=0",
            "output.every.histograms=0",
            "output.openpmd=false",
        ),
        work=lambda c: c.simulation.cycles * max(1, particle_count(c)),
        work_unit="particle-steps",
        horizon=min(
            HORIZON / (total_plasma_frequency(config) or fastest_turn(config) or 1.0),
            MAX_HORIZON_STEPS * abs(config.simulation.time_step),
        ),
        growth=growth,
        quieter=tuple(quieter(config)),
        seed=reseeded if any(loader_of(s).draws_random(s) for s in config.species) else None,
        seen=Seen("E", (0.0,) * config.dimensions, tuple(config.simulation.space_length), config.points, snapshot),
    )


def snapshot(time: float) -> tuple[str, ...]:
    """--set list that writes the fields once, at the end."""
    return (f"output.period.fields={time!r}",)


def quieter(config: PlasmaConfig) -> Iterator[str]:
    """The --set list of strata of velocity for quiet species that are warm: their waves have no noise."""
    strata = LOADERS["strata"]
    for i, s in enumerate(config.species):
        if s.init_method == "quiet" and s.thermal_velocity:
            yield f'species[{i}].init_method="strata"'
            n = count(s.particles, strata.batch_size(s, config.points))
            yield from resized(i, s, n)


def resized(i: int, species: Species, n: int) -> Iterator[str]:
    """The --set list of n particles of a species that are the same plasma."""
    yield f"species[{i}].particles={n}"
    if n != species.particles and not (species.density or species.plasma_frequency):
        for name in ("charge", "mass"):
            yield f"species[{i}].{name}={getattr(species, name) * species.particles / n!r}"


def continuous(config: PlasmaConfig) -> list[Knob]:
    d = config.dimensions
    loaders = [loader_of(s) for s in config.species]
    random, even = any(one.random_positions for one in loaders), all(one.whole_batches for one in loaders)
    found = [
        Knob("dx", "grid spacing", "m", ("grid", "points"), lambda c: spacing(c)[0], 2.0, d, "Debye length",
             largest=coarsest(config), beyond="the wave that it starts would be shorter than two cells"),
        Knob("dt", "time step", "s", ("simulation", "time_step"), lambda c: abs(c.simulation.time_step), 2.0, 1.0,
             f"time step{at_densest(config)}"),
    ]  # fmt: skip
    if scalable(config):
        found.append(
            Knob("particles", "particles of all species", "", ("species", 0, "particles"),
                 lambda c: 1.0 / particle_count(c), 0.5 if random else 2.0 if even else 1.0,
                 1.0, shown=lambda size: 1.0 / size, noisy=not even)
        )  # fmt: skip
    return found


def coarsest(config: PlasmaConfig) -> float:
    """The largest spacing along x of a grid that has the waves that the case starts, with its own proportions."""
    modes = [species.perturbation.mode for species in config.species if species.perturbation]
    shortest = max((abs(n) / m for mode in modes for n, m in zip(mode, config.points)), default=0.0)
    return spacing(config)[0] * max(1.0, 0.5 / shortest) if shortest else math.inf


def scalable(config: PlasmaConfig) -> bool:
    """Whether more particles are the same scene: not where they are placed one by one."""
    return bool(config.species) and all(s.particles > 16 and not loader_of(s).placed for s in config.species)


def choices_of(config: PlasmaConfig) -> list[Choice]:
    numerics = config.numerics
    listed: list[tuple[str, tuple, str]] = [("exact_phase", (False, True), "dt")] if any(config.field.magnetic) else []
    if config.simulation.solver == "MFT":
        listed.append(("gradient", ("difference", "spectral"), "dx"))
    listed += [("precision", ("double", "single"), ""), ("shape", tuple(SHAPES), "dx")]
    found = []
    for name, values, acts_on in listed:
        here = getattr(numerics, name)
        others = tuple(value_text(value) for value in values if value != here)
        found.append(Choice(name, ("numerics", name), value_text(here), others, acts_on))
    return found


# --------------------------------------------------------------------------------------------------- settings


def settings(config: PlasmaConfig, sizes: Mapping[str, float], time: float) -> tuple[str, ...]:
    """--set list for spacing dx [m], time step dt [s] and 1/number of particles, in a run until time [s]."""
    simulation = config.simulation
    dt = abs(simulation.time_step)
    cycles = max(1, math.ceil(time / sizes.get("dt", dt) - 1e-6))
    step = time / cycles
    made = [f"simulation.cycles={cycles}", f"simulation.time_step={math.copysign(step, simulation.time_step)!r}"]
    finer = spacing(config)[0] / sizes["dx"] if "dx" in sizes else 1.0
    points = [n if finer == 1.0 else smooth(max(4.0, n * finer)) for n in config.points]
    made.append(f"grid.points={points}")
    if len(kept := [list(mode) for mode in config.output.modes if on_grid(mode, points)]) < len(config.output.modes):
        made.append(f"output.modes=({', '.join(map(str, kept))})")
    batches = [loader_of(s).batch_size(s, tuple(points)) for s in config.species]
    for i, s in enumerate(config.species):
        if loader_of(s).whole_batches:  # as many velocities on any grid
            batches[i] = loader_of(s).batch_size(s, config.points)
            made.append(f"species[{i}].places={batches[i]}")
    if "particles" in sizes and scalable(config):
        more = 1.0 / (sizes["particles"] * particle_count(config))
        for i, s in enumerate(config.species):
            made += resized(i, s, count(s.particles * more, batches[i]))
    made += [f"{key}={max(1, round(period * dt / step))}" for key, period in sampled(config) if period]
    return tuple(made)


def sampled(config: PlasmaConfig) -> list[tuple[str, int | None]]:
    """Periods in steps, which another time step changes."""
    every = config.output.every
    return [(f"output.every.{kind}", getattr(every, kind)) for kind in ("series", "fields", "particles")]


def smooth(least: float) -> int:
    """The next even number with no prime factor above 5: fast transforms."""
    n = 2 * math.ceil(least / 2 - 1e-6)
    while True:
        rest = n
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return n
        n += 2


def count(wanted: float, multiple: int) -> int:
    """At least so many particles, and a multiple of so many where the loader asks for it."""
    if multiple == 1:
        return max(2, math.ceil(wanted - 1e-6))
    return multiple * max(PER_CELL, math.ceil(wanted / multiple - 1e-6))


# ------------------------------------------------------------------------------------------------- quantities


def quantities_of(config: PlasmaConfig, time: float) -> list[Quantity]:
    """The one that the case is about first. time [s]: of the whole run."""
    found = []
    wc = fastest_turn(config)
    if wc > 100.0 * total_plasma_frequency(config):
        period = 2.0 * math.pi / wc
        text = "angular frequency of the gyration, from momentum_x"
        why, measure = "particles gyrate far faster than the plasma swings", partial(gyration, wc)
        found.append(Quantity("gyration", text, min(time, PERIODS * period), measure, why=why))
    mode = started_mode(config)
    law = predict(config, mode)
    if law is not None and not 0.0 < law.omega.imag * time < LEAST_GROWTH:
        found += waves(law, mode, time)
    elif any(s.perturbation for s in config.species) and any(mode) and (any(mode[1:]) or abs(mode[0]) <= MODES):
        text = f"amplitude of {name_of(mode)} from the start to t = {time:.3g} s, V/m"  # noise may hide it at any time
        why = f"the case starts {name_of(mode)}, of which no law of waves is known"
        found.append(Quantity("amplitude", text, time, partial(course, mode, time), why=why))
    drift = partial(energy, time=time)
    text = "total energy at the end over that at the start, by the trend"
    found.append(Quantity("energy", text, time / 4, drift, exact=1.0, why="no law of a wave is known for this start"))
    return found


def started_mode(config: PlasmaConfig) -> tuple[int, ...]:
    """The mode that the case starts, if the series has it: along x, or asked for; zeros if there is none."""
    none = (0,) * config.dimensions
    for species in config.species:
        if species.perturbation:
            mode = species.perturbation.mode
            if mode in config.output.modes:
                return mode
            if not any(mode[1:]):
                return (abs(mode[0]), *mode[1:])
    return (1,) if all(loader_of(s).placed for s in config.species) and config.dimensions == 1 else none


def name_of(mode: tuple[int, ...]) -> str:
    return f"mode_{'_'.join(map(str, mode if any(mode[1:]) else mode[:1]))}"


def waves(law: Prediction, mode: tuple[int, ...], time: float) -> list[Quantity]:
    """Quantities that follow from a law of waves: growth, or damping and frequency. Windows follow from the law: the
    same for every pilot.
    """
    rate, frequency = law.omega.imag, abs(law.omega.real)
    name = name_of(mode)
    if rate > 1e-6 * abs(law.omega):
        first, last = (min(efolds / rate, time * efolds / GROWTH_WINDOW[1]) for efolds in GROWTH_WINDOW)
        text = f"growth rate of {name} between t = {first:.3g} and {last:.3g} s, 1/s"
        measure = partial(growth_rate, mode, first, last)
        return [Quantity("growth", text, last, measure, why=f"{name} grows by the law of waves")]
    period = 2.0 * math.pi / frequency
    end = min(time, PERIODS * period)
    text = "angular frequency of the wave, from energy_kinetic, rad/s"
    why = f"the case starts {name}, which swings by the law of waves"
    wave = Quantity("frequency", text, end, partial(half_frequency, frequency), why=why)
    if -rate < LEAST_DAMPING * frequency:
        return [wave]
    first, last = (min(n * period, time * n / DAMPING_WINDOW[1]) for n in DAMPING_WINDOW)
    text = f"damping rate of {name} between t = {first:.3g} and {last:.3g} s, 1/s"
    fit = partial(damped, mode, first, last, law.omega)
    return [
        Quantity("damping", text, last, lambda series: -fit(series).rate, why=f"{name} dies by the law of waves"),
        Quantity("frequency", text.replace("damping rate", "frequency"), last, lambda series: fit(series).frequency),
    ]


def at(t: np.ndarray, first: float, last: float) -> np.ndarray:
    """SAMPLES times in [first, last], inside the data whatever the last bits say."""
    return np.clip(np.linspace(first, last, SAMPLES), t[0], t[-1])


def amplitude(mode: tuple[int, ...], series: Series) -> np.ndarray:
    """|E_k| of a mode, which is along x or in output.modes, at the times of the series, V/m."""
    if any(mode[1:]):
        return np.hypot(*(series[column] for column in mode_columns(mode)))
    return series[f"mode_{abs(mode[0])}"]


def course(mode: tuple[int, ...], time: float, series: Series) -> np.ndarray:
    """|E_k|[SAMPLES] from the start until `time`, V/m."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(series.time, amplitude(mode, series))(at(series.time, 0.0, time))


def growth_rate(mode: tuple[int, ...], first: float, last: float, series: Series) -> float:
    """Slope of the log of an amplitude over the window."""
    from scipy.interpolate import CubicSpline

    times = at(series.time, first, last)
    line = CubicSpline(series.time, np.log(np.maximum(amplitude(mode, series), 1e-300)))(times)
    return float(np.polyfit(times - first, line, 1)[0])


def damped(mode: tuple[int, ...], first: float, last: float, omega: complex, series: Series) -> Oscillation:
    from scipy.interpolate import CubicSpline

    times = at(series.time, first, last)
    wave = CubicSpline(series.time, signed(amplitude(mode, series)))(times)
    return fit_oscillation(times, wave, frequency=omega.real, rate=omega.imag)


def half_frequency(frequency: float, series: Series) -> float:
    """The kinetic energy swings twice in a period; unlike that of the field it knows nothing of the grid."""
    fit = fit_oscillation(series.time, series["energy_kinetic"], frequency=2.0 * frequency, damped=False)
    return 0.5 * fit.frequency


def gyration(frequency: float, series: Series) -> float:
    return fit_oscillation(series.time, series["momentum_x"], frequency=frequency, damped=False).frequency


def energy(series: Series, time: float) -> float:
    """1 + the relative change of the total energy in `time` at the trend of the series. Raises ZeroDivisionError."""
    start = float(series["energy_total"][0])
    if not start:
        raise ZeroDivisionError("there is no energy at the start")
    return 1.0 + float(np.polyfit(series.time - series.time[0], series["energy_total"], 1)[0]) * time / start


def growth(series: Series) -> float:
    """Largest total energy over that at the start, or largest field energy where there is none at the start."""
    total = series["energy_total"]
    start = abs(float(total[0]))
    if start == 0.0 or not np.isfinite(total).all():
        return math.inf if not np.isfinite(total).all() else 1.0
    return float(np.abs(total).max()) / start
