"""The numbers that decide whether a plasma case is stable and accurate, with their limits and sources."""

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

from hpcpic.core.case.config import Path
from hpcpic.core.case.derived import Derived, Verdict
from hpcpic.plasma.case.config import MOST_POINTS, Equation, PlasmaConfig
from hpcpic.plasma.case.units import known_by_ratio
from hpcpic.plasma.forecast.cold_drift import cold_drift
from hpcpic.plasma.forecast.cold_wave import cold_wave, noise_of_start
from hpcpic.plasma.forecast.collisions import collisions
from hpcpic.plasma.forecast.densest import at_densest, dense_frequency, densest, mean_debyes
from hpcpic.plasma.forecast.estimate import SERIES_SHARE, affordable_period, count_seconds, phases
from hpcpic.plasma.forecast.field_equation import field_equation, field_strength, slowed_by_clouds
from hpcpic.plasma.forecast.noise import (
    MAX_START_NOISE,
    alike_per_cell,
    cell_edges,
    neutral,
    noise,
    share_along,
    start_noise,
)
from hpcpic.plasma.forecast.rates import DEFAULT
from hpcpic.plasma.forecast.recurrence import recurrence
from hpcpic.plasma.forecast.scales import (
    MOST_WITHOUT_FIELD,
    UNITS,
    charge_density,
    driven,
    field_axes,
    particle_count,
    plasma_frequency,
    spacing,
    step_for,
    thermal_velocities,
    total_plasma_frequency,
)
from hpcpic.plasma.forecast.speeds import crossing, motion
from hpcpic.plasma.forecast.trapping import trapping
from hpcpic.plasma.forecast.turning import (
    MOST_WAVE,
    WIDER,
    across_waves,
    fastest_turn,
    stronger_across,
    turn_across_grid,
    turning,
)
from hpcpic.plasma.physics.heating import MIN_PER_CELL, energy_ratio, rate_of_step, rates_across, rates_of
from hpcpic.plasma.physics.poisson import operator_of, response
from hpcpic.plasma.physics.shapes import SHAPES
from hpcpic.plasma.setup.loaders import loader_of

HEATED = 0.1  # growth of the energy by the grid that is warned of
MAX_DOUBLINGS = 5  # doublings of particles or points that are tried against it
CLOUDS = {1: "a seventh", 2: "a thirtieth", 3: "a seventieth"}  # of heating, most at lambda_D = 0.1 dx, measured
CLOUDS_ACROSS = 0.05  # of it where B is across the grid: a 25th and less was measured
SMOOTHEST_SHAPE = "TSC"
MAX_IMBALANCE = 1e-6  # of the charge of species of both signs, over the sum of their moduli: what is rounded in a case
LARGEST = 1e75  # of a number in a case: products of four still are floating-point numbers
NODE_CAPACITY = 2**19  # particles on one node that 64-bit fixed point with 44 fractional bits holds
LEAST_CHANGE = 1e-4  # change in a step below which steps are wasted
TIME_STEP = ("simulation", "time_step")
POINTS = ("grid", "points")
BOOK = "Birdsall & Langdon"


def derived(config: PlasmaConfig, ranks: int = 1) -> list[Derived]:
    """Every derived number of a completed case that runs on so many ranks."""
    if beyond := list(overflows(config)):
        return beyond
    return [
        *mistaken_units(config),
        *stability(config),
        *field_equation(config),
        *resolution(config),
        *cold_drift(config),
        *cold_wave(config),
        *noise_of_start(config),
        *noise(config),
        *collisions(config),
        *cell_edges(config),
        *motion(config),
        *waves(config),
        *recurrence(config),
        *trapping(config),
        *sizes(config),
        *counts(config),
        *blocks(config, ranks),
    ]


def verdict_of(good: bool, legal: bool = True) -> Verdict:
    """ok where it is good, a warning where it is legal, else a refusal."""
    return "ok" if good else "warn" if legal else "fail"


def judged(
    name: str, symbol: str, value: float, limit: str, verdict: Verdict, source: str, cure: str, key: Path,
    unit: str = "", **more: Any,
) -> Derived:  # fmt: skip
    """A number beside its limit. What is well needs no cure."""
    return Derived(name, symbol, value, unit, limit, verdict, source, "" if verdict == "ok" else cure, key, **more)


def overflows(config: PlasmaConfig) -> Iterator[Derived]:
    """The numbers so large or small that products of a few of them leave floating point."""
    simulation = config.simulation
    checked: list[tuple[Path, float]] = [(("simulation", "time_step"), simulation.time_step)]
    checked += [(("constants", "vacuum_permittivity"), config.constants.vacuum_permittivity)]
    checked += [(("simulation", "space_length"), length) for length in simulation.space_length]
    checked += [(("field", "magnetic"), component) for component in config.field.magnetic]
    checked += [(("field", "electric"), component) for component in config.field.electric]
    for i, species in enumerate(config.species):
        for name in ("charge", "mass", "density", "thermal_velocity", "plasma_frequency"):
            checked.append((("species", i, name), getattr(species, name)))
        for name in ("drift_velocity", "position_init", "position_delta"):
            checked += [(("species", i, name), component) for component in getattr(species, name)]
        if wave := species.perturbation:
            checked.append((("species", i, "perturbation", "velocity_amplitude"), wave.velocity_amplitude))
        if species.start is not None:
            checked += [(("species", i, "start"), v) for v in loader_of(species).fastest(species).components]
    if not (wrong := [(key, value) for key, value in checked if value and not 1 / LARGEST < abs(value) < LARGEST]):
        wp = total_plasma_frequency(config)
        wrong = [(("species",), wp)] if wp and not 1 / LARGEST < wp < LARGEST else []
    for key, value in wrong:
        symbol = "wp" if key == ("species",) else str(key[-1])
        limit = f"{1 / LARGEST:g} .. {LARGEST:g}, 0"
        yield judged("magnitude", symbol, value, limit, "fail", "floating point", "choose other units", key)


def mistaken_units(config: PlasmaConfig) -> Iterator[Derived]:
    """Particles in kg and C in a box whose permittivity is 1."""
    if config.constants.vacuum_permittivity != 1.0:
        return
    for i, species in enumerate(config.species):
        known = known_by_ratio(species.charge, species.mass)
        if known and species.particles:
            cure = f'its charge/mass is that of the {known} in C/kg: units = "SI" has the permittivity 8.854e-12 F/m'
            key = ("species", i, "charge")
            yield judged("permittivity", "eps0", 1.0, "8.854e-12", "warn", "SI units", cure, key)


def stability(config: PlasmaConfig) -> Iterator[Derived]:
    """wp dt and, with a magnetic field, wc dt."""
    dt = config.simulation.time_step
    mean, wp, where = total_plasma_frequency(config), dense_frequency(config), at_densest(config)
    yield Derived("plasma frequency", "wp", mean, "rad/s")
    if where:
        yield Derived(f"plasma frequency{where}", "wp max", wp, "rad/s")
    across = stronger_across(config)
    strength = math.sqrt(field_strength(config) * across)
    step = abs(wp * dt) * strength
    limit, source = "<= 0.5" if step < 1.2 else "< 1.2, stable below 2", f"{BOOK} ch. 4"
    if across > WIDER:
        source += f"; sqrt({across:.4g}) of it by numerics.exact_phase: impulses across B"
    yield judged(
        f"time step{where}", "wp dt", step, limit, verdict_of(step <= MOST_WAVE, step < 1.2), source,
        f"time_step = {step_for(config, 0.499, step):g} or less", TIME_STEP,
        forceable=abs(mean * dt) * strength < 2, stable_below=2.0,
    )  # fmt: skip
    turn = fastest_turn(config) * abs(dt)
    if 0 < (change := max(step, turn, crossing(config))) < LEAST_CHANGE and not driven(config):
        name, limit, cure = "largest change in a step", f"> {LEAST_CHANGE:g}", f"a larger time_step does; {UNITS}"
        source = "10 000 steps for one oscillation"
        yield judged(name, "max(wp dt, wc dt, v dt/dx)", change, limit, "warn", source, cure, TIME_STEP)
    if (period := config.periods["series"]) > 1 and step:
        swing = math.hypot(step, turn) if across_waves(config) else step
        yield sampling(math.pi / (swing * period), period)
    if any(config.field.magnetic):
        yield turning(config, turn)


def sampling(samples: float, period: int) -> Derived:
    """How well a series shows the energy of the field, which swings twice in a plasma period, or twice in that of upper
    hybrid waves across a magnetic field.
    """
    cure = f"output.every.series = {max(1, int(period * samples / 8))} shows them"
    name, key = "samples in a swing of the field energy", ("output", "every", "series")
    return judged(name, "pi/(wp dt K)", samples, "> 2", verdict_of(samples > 2), "sampling theorem", cure, key)


def counts(config: PlasmaConfig) -> Iterator[Derived]:
    """What the histograms take of a run."""
    if period := config.periods["histogram"]:
        least, limit = affordable_period(config, count_seconds), f"<= {SERIES_SHARE:g}, or a second"
        share = count_seconds(config, 1, 1, DEFAULT) / period / sum(phases(config, 1, 1, DEFAULT).values())
        verdict, key = verdict_of(period >= least), ("output", "every", "histograms")
        cure = f"output.every.histograms = {least} keeps to it"
        yield judged("time of histograms", "in that of steps", share, limit, verdict, "measured", cure, key)


def resolution(config: PlasmaConfig) -> Iterator[Derived]:
    """Debye length against the grid, and the heating that follows from it."""
    inverse_sq = [0.0] * config.dimensions
    for species, denser in zip(config.species, densest(config)):
        wp = plasma_frequency(config, species)
        for axis, thermal in enumerate(thermal_velocities(config, species)):
            inverse_sq[axis] += denser * (wp / thermal) ** 2 if thermal > 0 else 0.0
    axes = list(zip(inverse_sq, spacing(config), config.points))
    ratios = [1 / math.sqrt(k) / dx if k > 0 and n > MOST_WITHOUT_FIELD else math.inf for k, dx, n in axes]
    ratio = min(ratios)
    if ratio == math.inf:
        return
    known = config.field.equation == Equation() and not config.numerics.cloud_radius
    yield shielding(config, ratios, known)
    longest = max(1 / math.sqrt(k) / length for k, length in zip(inverse_sq, config.simulation.space_length) if k > 0)
    cure, key = f"no shielding in this box: the particles fly freely; {UNITS}", ("simulation", "space_length")
    limit, name = "" if driven(config) else "< 10", "Debye length in boxes"
    verdict = verdict_of(longest < 10 or not limit)
    yield judged(name, "lambda_D/L", longest, limit, verdict, f"{BOOK} ch. 1", cure, key)
    if known:
        yield heating(config)
    elif field_axes(config) == 1:
        yield Derived("predicted heating", "dW/W", math.nan, source="no rates for this scheme in 1D")


def shielding(config: PlasmaConfig, ratios: list[float], known: bool) -> Derived:
    """Debye length against the grid, per axis. known: whether the rates of heating were measured for this scheme."""
    ratio, axes = min(ratios), field_axes(config)
    points = [n * max(1.0, 0.5 / r * (1 - 1e-12)) for n, r in zip(config.points, ratios)]
    cure = "a hotter or thinner plasma"
    if max(points) <= MOST_POINTS:
        cure = f"grid.points = {[math.ceil(n) for n in points]}"
    coarser = config.numerics.shape != SMOOTHEST_SHAPE
    smooth = heated(config, SMOOTHEST_SHAPE) if known and coarser else math.inf
    less = []
    if smooth < HEATED:
        less.append(f'numerics.shape = "{SMOOTHEST_SHAPE}" (the energy grows by {max(smooth, 0.0):.2g})')
    if ratio >= 0.1 and config.simulation.solver == "MFT" and not config.numerics.cloud_radius:  # as measured
        share = f"at most {CLOUDS[axes]} of the heating in {axes}D, waves of 16 points 7 % slower"
        less.append(f"numerics.cloud_radius = {min(spacing(config)):.3g} ({share})")
    if less:
        cure += f"; less heating on this grid by {' or '.join(less)}"
    verdict, limit = verdict_of(ratio >= 0.5, ratio >= 0.03), ">= 0.5" if ratio >= 0.03 else ">= 0.03"
    name = f"Debye length{at_densest(config)}"
    return judged(name, "lambda_D/dx", ratio, limit, verdict, f"{BOOK} ch. 8", cure, POINTS, forceable=True)


def spectral(config: PlasmaConfig) -> bool:
    """Whether E is -ik phi of the exact wave number."""
    return config.numerics.gradient == "spectral"


def heated(config: PlasmaConfig, shape: str, more: float = 1.0, finer: float = 1.0, shorter: float = 1.0) -> float:
    """W(end)/W(0) - 1 by measured rates and that of the step, with `more` times the particles, a `finer` grid and steps
    so much `shorter`; nan where too few. Of cells that are not square it is the mean of what each side makes, and that
    of the longest across a magnetic field, where others were not measured.
    """
    axes = field_axes(config)
    per_cell = more * alike_per_cell(config) / finer**axes
    step = dense_frequency(config) * abs(config.simulation.time_step)
    time = step * config.simulation.cycles
    start = start_noise(config) / more if axes == 1 else 0.0
    if per_cell < MIN_PER_CELL or not start < MAX_START_NOISE:
        return math.nan
    across = rates_across(shape, axes, turn_across_grid(config), time, spectral(config))
    points = rates_of(shape, axes, spectral(config))

    def growth(debye: float) -> float:
        debye *= finer * math.sqrt(1 + start)  # the noise becomes heat at once
        of_step = rate_of_step(shape, axes, debye, step / shorter, spectral(config))
        return energy_ratio(points, debye, per_cell, time, across, of_step) - 1

    debyes = mean_debyes(config)
    sides = [min(debyes)] if across else debyes
    return share_along(config, start) * sum(map(growth, sides)) / len(sides)


def heating(config: PlasmaConfig) -> Derived:
    """Growth of the total energy over the run that the grid causes, from the measured rates, with cures by the same."""
    shape, axes = config.numerics.shape, field_axes(config)
    growth = heated(config, shape)
    if math.isnan(growth):
        source = f"cannot be foretold with less than {MIN_PER_CELL:g} particle per cell"
        if particle_count(config) >= MIN_PER_CELL * math.prod(config.points):
            source += f" of one charge: these have the noise of {alike_per_cell(config):.2g}"
        if axes == 1 and start_noise(config) >= MAX_START_NOISE:
            source = f"cannot be foretold: the field of the random start has {start_noise(config):.2g} times the heat"
        return Derived("predicted heating", "dW/W", growth, source=source)
    factors = [2.0**n for n in range(1, MAX_DOUBLINGS + 1)]
    more = next((f for f in factors if heated(config, shape, more=f) < HEATED), None)
    finer = next((f for f in factors if heated(config, shape, more=f**axes, finer=f) < HEATED), None)
    ways = [f"{more:g} times the particles"] if more else []
    ways += [f"{finer:g} times the points on each axis with as many particles per cell"] if finer else []
    if shorter := next((f for f in factors if heated(config, shape, shorter=f) < HEATED), None):
        ways.insert(0, f"time_step = {config.simulation.time_step / shorter:g}")
    if shape != SMOOTHEST_SHAPE and heated(config, SMOOTHEST_SHAPE) < HEATED:
        ways.insert(0, f'numerics.shape = "{SMOOTHEST_SHAPE}"')
    turn = turn_across_grid(config)
    across = bool(rates_across(shape, axes, turn, time=1.0))
    if (
        across
        and min(mean_debyes(config)) >= 0.1
        and config.simulation.solver == "MFT"
        and growth * CLOUDS_ACROSS < HEATED
    ):
        ways.insert(0, f"numerics.cloud_radius = {min(spacing(config)):.3g}")
    cure = ", or ".join(ways) or f"no grid up to {factors[-1]:g} times as fine cures it"
    verdict, source = verdict_of(growth < HEATED), "rates measured at wp dt = 0.2, and Langdon 1979 for the step"
    if axes == 1 and any(config.field.magnetic[1:]):
        source += "; with B across the line 0.1 to 1.6 times as much was measured"
    if across:
        source += f", with wc = {turn:.2g} wp across the grid, which particles do not cure"
    return judged("predicted heating", "dW/W", growth, f"< {HEATED}", verdict, source, cure, POINTS)


def waves(config: PlasmaConfig) -> Iterator[Derived]:
    """How well the grid carries the waves that the case starts, and how long it watches them."""
    wp, dt = total_plasma_frequency(config), abs(config.simulation.time_step)
    if wp:
        time, key = dt * config.simulation.cycles, ("simulation", "cycles")
        moved = fastest_turn(config) * time >= 1 or driven(config)
        limit, source = ("", "") if moved else ("> 0.16", "wp t > 1")
        cure = f"the plasma does nothing in it: more cycles, a larger time_step; {UNITS}"
        swung = dense_frequency(config) * time
        verdict = verdict_of(swung >= 1 or not limit)
        periods, name = swung / (2 * math.pi), f"length of the run{at_densest(config)}"
        yield judged(name, "wp t/2pi", periods, limit, verdict, source, cure, key, "periods")
    for i, species in enumerate(config.species):
        if not species.perturbation:
            continue
        mode = ("species", i, "perturbation", "mode")
        turns = [2 * math.pi * n / points for n, points in zip(species.perturbation.mode, config.points)]
        step = max(abs(turn) for turn in turns)
        wave = partial(judged, "perturbed wave", "k dx", step, unit="rad")
        if config.numerics.cloud_radius:
            yield slowed_by_clouds(config, i)
        if step > math.pi:
            cure = "a smaller mode or more points"
            yield wave("<= pi", "fail", "shortest wave of a grid", cure, mode, forceable=True)
            continue
        cure = f"more than 1 % slow; {math.ceil(8 * step / math.pi)} times the points"
        yield wave("< pi/8", verdict_of(step <= math.pi / 8), f"{BOOK} ch. 4", cure, mode)
    known = len(config.points) == 1 and not any(config.field.magnetic[1:])  # B across k: upper and lower hybrid waves
    if known and 0 < wp * dt < 2 and config.numerics.gradient == "difference":
        modes = {abs(s.perturbation.mode[0]) for s in config.species if s.perturbation}
        yield from (cold_frequency(config, n, wp * dt) for n in sorted(modes) if 2 * n <= config.points[0])


def cold_frequency(config: PlasmaConfig, mode: int, step: float) -> Derived:
    """The frequency of a cold wave of so many wavelengths in a box of one dimension, with wp dt = step."""
    (dx,), turn = spacing(config), 2 * math.pi * mode / config.points[0]
    _, factor = response(
        operator_of(config), (turn / dx,), (dx,), spectral=False, cloud_radius=config.numerics.cloud_radius
    )
    swing = step / 2 * math.sqrt(SHAPES[config.numerics.shape].cold_response(turn) * max(factor, 0.0))
    frequency = 2 / step * math.asin(min(swing, 1.0))
    return Derived("cold frequency on this grid", "w/wp", frequency, source=f"{BOOK} ch. 4, 8")


def sizes(config: PlasmaConfig) -> Iterator[Derived]:
    """Particles per cell, the charge of the background, and points where the solver minds."""
    cells = math.prod(config.points)
    per_cell = particle_count(config) / cells
    verdict = verdict_of(per_cell <= NODE_CAPACITY / 4, per_cell <= NODE_CAPACITY)
    limit, source = f"< {NODE_CAPACITY}", "64-bit fixed-point charge"
    yield judged("particles per cell", "N/cells", per_cell, limit, verdict, source, "more points", POINTS)
    yield background(config)
    if config.simulation.solver == "LU":
        verdict, key = verdict_of(cells <= 4096, cells <= 16384), ("simulation", "solver")
        name, source, cure = "points of the LU solver", "(5.6), cost (2/3) N^3", 'solver = "MFT"'
        symbol = " ".join(("Nx", "Ny", "Nz")[: config.dimensions])
        yield judged(name, symbol, cells, "< 4096", verdict, source, cure, key, forceable=True)


def background(config: PlasmaConfig) -> Derived:
    """The charge that makes the box neutral. Species of both signs are meant to leave none."""
    charges = [charge_density(config, species) for species in config.species]
    total, moduli = sum(charges), sum(map(abs, charges))
    name, symbol = "background charge density", "rho_0"
    unit = "C/m3" if config.units == "SI" else "C/m" if config.dimensions == 1 else f"C/m{config.dimensions}"
    if not charges or not min(charges) < 0 < max(charges):
        return Derived(name, symbol, -total, unit)
    ways = [neutral(config, i, 1 - total / charge) for i, charge in enumerate(charges) if charge and total / charge < 1]
    verdict, key = verdict_of(abs(total) <= MAX_IMBALANCE * moduli), ("species",)
    source = "species of both signs cancel; a uniform charge makes up for what they leave"
    return judged(name, symbol, -total, "0", verdict, source, ", or ".join(ways), key, unit)


def blocks(config: PlasmaConfig, ranks: int) -> Iterator[Derived]:
    """Rows (3D: planes) per rank and columns per task block."""
    columns, rows = config.points[0], config.points[-1]
    verdict, source, cure = verdict_of(ranks <= rows, False), "slabs end at one row", f"at most {rows} ranks"
    yield judged("rows per rank", "rows/R", rows / ranks, ">= 1", verdict, source, cure, POINTS, forceable=True)
    chunks = config.simulation.plasma_chunks
    if chunks:
        block = (columns if config.dimensions > 1 else rows / ranks) / chunks
        cure, key = "some stay empty: fewer plasma_chunks", ("simulation", "plasma_chunks")
        name, verdict, source = "columns per task block", verdict_of(block >= 1), "one column per block"
        yield judged(name, "Nx/chunks", block, ">= 1", verdict, source, cure, key)
