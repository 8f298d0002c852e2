"""The numbers that decide whether a plasma case is stable and accurate, with their limits and sources."""

import itertools
import math
from collections.abc import Iterator

from hpcpic.core.files.derived import Derived
from hpcpic.plasma.config import PlasmaConfig, Species, velocity_components, volume

# d ln W / d(wp t) times particles per cell against lambda_D/dx: CIC, centred differences, 2D, wp dt = 0.2
HEATING = ((0.1, 2.8e-2), (0.3, 9.5e-3), (0.5, 3.1e-3), (1.0, 5.0e-4))
HUGE = 1e75
NODE_CAPACITY = 2**19  # particles on one node that 64-bit fixed point with 44 fractional bits holds
TIME_STEP = ("simulation", "time_step")
POINTS = ("grid", "points")
BOOK = "Birdsall & Langdon"


def derived(config: PlasmaConfig, ranks: int = 1) -> list[Derived]:
    """Every derived number of a completed case that runs on so many ranks."""
    beyond = list(overflows(config))
    if beyond:
        return beyond
    return [
        *stability(config),
        *resolution(config),
        *motion(config),
        *waves(config),
        *sizes(config),
        *blocks(config, ranks),
    ]


def plasma_frequency(config: PlasmaConfig, species: Species) -> float:
    """wp of one species in rad/s: its own where the case gives it, else sqrt(n q^2 / (eps0 m))."""
    if not species.particles:
        return 0.0
    if species.plasma_frequency:
        return species.plasma_frequency
    density = species.particles / volume(config)
    ratio = species.charge / species.mass
    return math.sqrt(density * species.charge * ratio / config.constants.vacuum_permittivity)


def total_plasma_frequency(config: PlasmaConfig) -> float:
    return math.hypot(0.0, *(plasma_frequency(config, species) for species in config.species))


def thermal_velocities(config: PlasmaConfig, species: Species) -> tuple[float, ...]:
    """Standard deviation of the velocity per grid axis, m/s; v / sqrt(3) where it is uniform in [-v, v]."""
    d = config.dimensions
    if species.init_method == "random position" and not species.thermal_velocity:
        return tuple(abs(v) / math.sqrt(3) for v in species.drift_velocity[:d])
    return (species.thermal_velocity,) * d


def spacing(config: PlasmaConfig) -> tuple[float, ...]:
    return tuple(length / n for length, n in zip(config.simulation.space_length, config.grid.points))


def rounded_down(value: float) -> float:
    """The largest number of two digits that is not above value > 0."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / scale) * scale:.2g}")


def overflows(config: PlasmaConfig) -> Iterator[Derived]:
    """The numbers so large or small that products of a few of them leave floating point."""
    simulation = config.simulation
    checked = [(("simulation", "time_step"), simulation.time_step)]
    checked += [(("constants", "vacuum_permittivity"), config.constants.vacuum_permittivity)]
    checked += [(("simulation", "space_length"), length) for length in simulation.space_length]
    checked += [(("field", "magnetic"), component) for component in config.field.magnetic]
    checked += [(("field", "electric"), component) for component in config.field.electric]
    for i, species in enumerate(config.species):
        for name in ("charge", "mass", "thermal_velocity", "plasma_frequency"):
            checked.append((("species", i, name), getattr(species, name)))
        checked += [(("species", i, "drift_velocity"), component) for component in species.drift_velocity]
    wrong = [(key, value) for key, value in checked if value and not 1 / HUGE < abs(value) < HUGE]
    if not wrong:
        wp = total_plasma_frequency(config)
        wrong = [(("species",), wp)] if wp and not 1 / HUGE < wp < HUGE else []
    for key, value in wrong:
        symbol = "wp" if key == ("species",) else str(key[-1])
        limit = f"{1 / HUGE:g} .. {HUGE:g}"
        cure = "choose other units"
        yield Derived("magnitude", symbol, value, "", limit, "fail", "floating point", cure, key)


def stability(config: PlasmaConfig) -> Iterator[Derived]:
    """wp dt and, with a magnetic field, wc dt."""
    dt = config.simulation.time_step
    wp = total_plasma_frequency(config)
    source = f"{BOOK} ch. 4"
    yield Derived("plasma frequency", "wp", wp, "rad/s")
    step = abs(wp * dt)
    verdict = "ok" if step <= 0.5 else "warn" if step < 1.2 else "fail"
    limit = "< 2, accurate below 0.5" if step < 1.2 else "< 1.2, stable below 2" if step < 2 else "< 2"
    legal = math.copysign(rounded_down(1.19 / wp), dt) if wp else dt
    good = math.copysign(rounded_down(0.2 / wp), dt) if wp else dt
    cure = "" if verdict == "ok" else f"time_step = {legal:g} is the nearest legal one, {good:g} is accurate"
    yield Derived(
        "time step", "wp dt", step, "", limit, verdict, source, cure, TIME_STEP, step < 2, stable_below=2.0
    )
    if (period := config.periods["series"]) > 1 and step:
        yield sampling(math.pi / (step * period), period)
    magnetic = math.hypot(*config.field.magnetic)
    if magnetic:
        yield from turning(config, magnetic)


def sampling(samples: float, period: int) -> Derived:
    """How well a series shows the energy of the field, which swings twice in a plasma period."""
    verdict = "ok" if samples > 2 else "warn"
    cure = "" if verdict == "ok" else f"output.every.series = {max(1, int(period * samples / 8))} shows them"
    key = ("output", "every", "series")
    name = "samples in a swing of the field energy"
    return Derived(name, "pi/(wp dt K)", samples, "", "> 2", verdict, "sampling theorem", cure, key)


def turning(config: PlasmaConfig, magnetic: float) -> Iterator[Derived]:
    """The angle by which a particle turns in a step."""
    ratio = max((abs(species.charge / species.mass) for species in config.species), default=0.0)
    step = ratio * magnetic * abs(config.simulation.time_step)
    if config.numerics.exact_phase:
        verdict, cure = (
            ("ok", "") if step < math.pi else ("fail", "exact_phase = false, or a smaller time_step")
        )
        yield Derived(
            "turn per step", "wc dt", step, "rad", "< pi", verdict, f"{BOOK} ch. 4", cure, TIME_STEP
        )
        return
    verdict = "ok" if step <= 0.35 else "warn"
    cure = (
        ""
        if verdict == "ok"
        else f"exact_phase = true, or time_step = {rounded_down(0.35 / (ratio * magnetic)):g}"
    )
    limit = "< 0.35 for the gyro-phase to 1 %"
    yield Derived("turn per step", "wc dt", step, "rad", limit, verdict, f"{BOOK} ch. 4", cure, TIME_STEP)


def resolution(config: PlasmaConfig) -> Iterator[Derived]:
    """Debye length against the grid, and the heating that follows from it."""
    inverse_sq = [0.0] * config.dimensions
    for species in config.species:
        wp = plasma_frequency(config, species)
        for axis, thermal in enumerate(thermal_velocities(config, species)):
            inverse_sq[axis] += (wp / thermal) ** 2 if thermal > 0 else 0.0
    axes = zip(inverse_sq, spacing(config), config.grid.points)
    ratios = [1 / math.sqrt(k) / dx for k, dx, n in axes if k > 0 and n > 1]  # one point has no field along its axis
    if not ratios:
        return
    ratio = min(ratios)
    verdict = "ok" if ratio >= 0.5 else "warn" if ratio >= 0.03 else "fail"
    fine = math.ceil(0.5 / ratio * max(config.grid.points))
    cure = "" if verdict == "ok" else f'numerics.shape = "TSC" (cheaper), or about {fine} points on an axis'
    yield Derived(
        "Debye length",
        "lambda_D/dx",
        ratio,
        "",
        "> 0.5",
        verdict,
        f"{BOOK} ch. 8",
        cure,
        POINTS,
        forceable=True,
    )
    measured = (
        config.dimensions == 2 and config.numerics.shape == "CIC" and config.numerics.gradient == "difference"
    )
    if measured:
        yield heating(config, ratio)


def heating(config: PlasmaConfig, ratio: float) -> Derived:
    """Growth of the total energy over the run that the grid causes, from the measured rates."""
    cells = math.prod(config.grid.points)
    per_cell = sum(species.particles for species in config.species) / cells
    x = math.log(ratio)
    points = [(math.log(a), math.log(b)) for a, b in HEATING]
    pair = next(((a, b) for a, b in itertools.pairwise(points) if x <= b[0]), (points[-2], points[-1]))
    (x0, y0), (x1, y1) = pair
    rate = math.exp(y0 + (y1 - y0) / (x1 - x0) * (max(x, points[0][0]) - x0)) / per_cell
    periods = total_plasma_frequency(config) * abs(config.simulation.time_step) * config.simulation.cycles
    growth = math.expm1(min(rate * periods, 700.0))
    verdict = "ok" if growth < 0.1 else "warn"
    cure = (
        ""
        if verdict == "ok"
        else f"the energy doubles in {0.69 / rate:.3g}/wp: more particles, TSC, or finer grid"
    )
    return Derived(
        "predicted heating",
        "dW/W",
        growth,
        "",
        "< 0.1",
        verdict,
        "measured with this scheme at wp dt = 0.2",
        cure,
        POINTS,
    )


def motion(config: PlasmaConfig) -> Iterator[Derived]:
    """Cells that the fastest particle crosses in a step."""
    fastest = 0.0
    for species in config.species:
        if not species.particles:
            continue
        tail = math.sqrt(2 * math.log(max(species.particles, 2)))
        uniform = species.init_method == "random position" and not species.thermal_velocity
        for axis, dx in enumerate(spacing(config)):
            speed = abs(species.drift_velocity[axis]) + (0 if uniform else tail * species.thermal_velocity)
            fastest = max(fastest, speed * abs(config.simulation.time_step) / dx)
    verdict = "ok" if fastest < 1 else "warn"
    cure = (
        ""
        if verdict == "ok"
        else f"slower, not wrong; time_step = {step_for(config, 0.9 / fastest):g} avoids it"
    )
    yield Derived(
        "fastest particle", "v dt/dx", fastest, "cells", "< 1", verdict, "one cell per step", cure, TIME_STEP
    )
    yield Derived("velocity components", "", velocity_components(config))


def step_for(config: PlasmaConfig, factor: float) -> float:
    dt = config.simulation.time_step
    return math.copysign(rounded_down(abs(dt) * factor), dt)


def waves(config: PlasmaConfig) -> Iterator[Derived]:
    """How well the grid carries the waves that the case starts, and how long it watches them."""
    wp, dt = total_plasma_frequency(config), abs(config.simulation.time_step)
    if wp:
        yield Derived(
            "length of the run", "wp t/2pi", wp * dt * config.simulation.cycles / (2 * math.pi), "periods"
        )
    for i, species in enumerate(config.species):
        if not species.perturbation:
            continue
        key = ("species", i, "perturbation", "mode")
        turns = [2 * math.pi * n / points for n, points in zip(species.perturbation.mode, config.grid.points)]
        step = max(abs(turn) for turn in turns)
        if step > math.pi:
            yield Derived(
                "perturbed wave",
                "k dx",
                step,
                "rad",
                "<= pi",
                "fail",
                "shortest wave of a grid",
                "a smaller mode or more points",
                key,
                forceable=True,
            )
            continue
        verdict = "ok" if step <= math.pi / 8 else "warn"
        cure = (
            "" if verdict == "ok" else f"more than 1 % slow; {math.ceil(8 * step / math.pi)} times the points"
        )
        yield Derived("perturbed wave", "k dx", step, "rad", "< pi/8", verdict, f"{BOOK} ch. 4", cure, key)
        if len(turns) == 1 and 0 < wp * dt < 2 and config.numerics.gradient == "difference":
            frequency = 2 / (wp * dt) * math.asin(wp * dt / 2 * math.cos(step / 2))
            yield Derived("cold frequency on this grid", "w/wp", frequency, source=f"{BOOK} ch. 4, 8")


def sizes(config: PlasmaConfig) -> Iterator[Derived]:
    """Particles per cell, the charge of the background, and points where the solver minds."""
    cells = math.prod(config.grid.points)
    per_cell = sum(species.particles for species in config.species) / cells
    verdict = "ok" if per_cell <= NODE_CAPACITY / 4 else "warn" if per_cell <= NODE_CAPACITY else "fail"
    limit, source = f"< {NODE_CAPACITY}", "64-bit fixed-point charge"
    cure = "" if verdict == "ok" else "more points"
    yield Derived("particles per cell", "N/cells", per_cell, "", limit, verdict, source, cure, POINTS)
    density = -sum(charge_density(config, species) for species in config.species)
    unit = "C/m" if config.dimensions == 1 else "C/m2"
    yield Derived("background charge density", "rho_0", density, unit)
    if config.simulation.solver == "LU":
        verdict = "ok" if cells <= 4096 else "warn" if cells <= 16384 else "fail"
        cure, source = "" if verdict == "ok" else 'solver = "MFT"', "(5.6), cost (2/3) N^3"
        key = ("simulation", "solver")
        yield Derived(
            "points of the LU solver", "Nx Ny", cells, "", "< 4096", verdict, source, cure, key, True
        )


def charge_density(config: PlasmaConfig, species: Species) -> float:
    """Mean charge density of one species; where wp is given, wp^2 eps0 / (q/m)."""
    if species.plasma_frequency and species.particles:
        wp = species.plasma_frequency
        return wp * wp * config.constants.vacuum_permittivity * species.mass / species.charge
    return species.particles * species.charge / volume(config)


def blocks(config: PlasmaConfig, ranks: int) -> Iterator[Derived]:
    """Rows per rank and columns per task block."""
    columns, rows = config.grid.points[0], config.grid.points[-1]
    verdict = "ok" if ranks <= rows else "fail"
    cure = "" if verdict == "ok" else f"at most {rows} ranks"
    source = "slabs end at one row"
    yield Derived("rows per rank", "rows/R", rows / ranks, "", ">= 1", verdict, source, cure, POINTS, True)
    chunks = config.simulation.plasma_chunks
    if chunks:
        block = (columns if config.dimensions == 2 else rows / ranks) / chunks
        verdict = "ok" if block >= 1 else "warn"
        cure = "" if block >= 1 else "some stay empty: fewer plasma_chunks"
        key = ("simulation", "plasma_chunks")
        source = "one column per block"
        yield Derived("columns per task block", "Nx/chunks", block, "", ">= 1", verdict, source, cure, key)
