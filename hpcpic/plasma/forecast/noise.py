"""Where a plasma has so few particles that their noise hides it, or the wave that it starts with; or rounding does, or
NGP, which sees no wave within a cell.
"""

import math
from collections.abc import Iterator

from hpcpic.core.case.derived import Derived, judged, rounded_up
from hpcpic.plasma.case.config import MOST_PARTICLES, PlasmaConfig, Species, velocity_components
from hpcpic.plasma.forecast.densest import at_densest, densest
from hpcpic.plasma.forecast.scales import (
    charge_density,
    field_axes,
    plasma_frequency,
    spacing,
    thermal_velocities,
    total_plasma_frequency,
)
from hpcpic.plasma.physics.quiet_start import lattice
from hpcpic.plasma.physics.shapes import SHAPES
from hpcpic.plasma.physics.species_fields import asked_for
from hpcpic.plasma.setup.loaders import Loader, Quiet, loader_of, random_places
from hpcpic.plasma.setup.macro_particles import macro_charge, macro_mass
from hpcpic.plasma.sizes import WHOLE_BITS

# In equilibrium the field of a wave has T/2 / (1 + (k lambda_D)^2) (Birdsall & Langdon, chapter 12): over all waves of
# a grid of dx = lambda_D, 10 particles per Debye length make 5 % of the heat in 1D (1/(2 N_D)), 6 % in 2D, 5 % in 3D.
MIN_PER_DEBYE = 10.0
# Noise has random phases: that of its amplitude is above 3 times its root mean square in one start of exp(9) = 8000.
MIN_OVER_NOISE = 3.0
# A quiet start has no noise at t = 0. Later, at tau = k v t, the amplitude of a wave of m lengths in the box is up to
# some ALONG_X m tau/N along x, where places are even, and ELSEWHERE m tau/N with a part along y or z, which are as
# velocities in digit-reversed order: N of 1024 to 262 144, until tau = QUIET_UNTIL, and no more after it.
ALONG_X, ELSEWHERE = 1.0, 3.0
QUIET_UNTIL = 10.0
MIN_PARTS = 20.0  # of a cell, 2^-20 each, that a wave moves a cold species in a step
MAX_START_NOISE = 0.5  # field of a random start over heat, in 1D: with more, seeds differ in heating by more than 2
MOST_LOW = 0.02  # of the temperature of a species at nodes
MOST_KNOWN = 0.25  # of it, that a mean over nodes can be corrected by: measured 0.20 to 0.23 for 0.22 told
BALLS = {1: ("length", 1.0), 2: ("circle", math.pi), 3: ("sphere", 4 / 3 * math.pi)}  # by axes, of radius 1


def noise(config: PlasmaConfig) -> Iterator[Derived]:
    """Particles of each warm species per Debye length, and each wave over the noise of random places and rounding."""
    for i, species in enumerate(config.species):
        yield from per_debye_length(config, i, species)
        if species.perturbation and species.particles and random_places(species):
            yield from wave_over_noise(config, i, species)
    yield from rounding(config)
    yield from node_temperatures(config)


def per_debye_length(config: PlasmaConfig, i: int, species: Species) -> Iterator[Derived]:
    """Particles of a species in a Debye length of its own. Even places have no noise at the start: not judged."""
    axes = [axis for axis, n in enumerate(config.points) if n > 1]
    wp, thermal = plasma_frequency(config, species), thermal_velocities(config, species)
    if not axes or not wp or not all(thermal[axis] for axis in axes):
        return
    ball, size = BALLS[len(axes)]
    lengths = (thermal[axis] / wp / config.simulation.space_length[axis] for axis in axes)
    value, name = species.particles * size * math.prod(lengths), f"{species.name} per Debye {ball}"
    if not random_places(species):
        value *= densest(config)[i] ** (1 - len(axes) / 2)  # lambda_D goes as 1/sqrt(n)
        yield Derived(f"{name}{at_densest(config)}", "N_D", value)
        return
    cure = more_particles(i, species, MIN_PER_DEBYE / value if value else math.inf) or "a hotter or thinner plasma"
    yield judged(
        name, "N_D", value, limit=f">= {MIN_PER_DEBYE:g}", ok=value >= MIN_PER_DEBYE, legal=True,
        source="5 % noise, Birdsall & Langdon ch. 12", cure=cure, key=("species", i, "particles"),
    )  # fmt: skip


def wave_over_noise(config: PlasmaConfig, i: int, species: Species) -> Iterator[Derived]:
    """The relative density of a wave over that of the same wave in N random places, which is 2/sqrt(N).

    The amplitude is 2/N |sum over particles of exp(-i k.x)|: that of n (1 - a cos(k.x)) is a, and in random places its
    mean square is 4/N.
    """
    assert species.particles
    if not (amplitude := started_amplitude(config, species)):
        return
    value = 0.5 * amplitude * math.sqrt(species.particles)
    ways = [*even_places(i, species), *filter(None, [more_particles(i, species, (MIN_OVER_NOISE / value) ** 2)])]
    yield judged(
        f"wave of {species.name} over noise", "a sqrt(N)/2", value, limit=f">= {MIN_OVER_NOISE:g}",
        ok=value >= MIN_OVER_NOISE, legal=True, source="2/sqrt(N) of random places",
        cure=", or ".join(ways) or "a larger amplitude", key=("species", i, "particles"),
    )  # fmt: skip


def even_places(i: int, species: Species) -> list[str]:
    """The setting by which the same species starts at even places, where there is one."""
    return [f'species[{i}].init_method = "quiet"'] if type(loader_of(species)) is Loader else []


def rounding(config: PlasmaConfig) -> Iterator[Derived]:
    """How far a wave moves a cold species in a step, in parts of a cell that single precision tells. Particles of many
    velocities are rounded in many ways, which cancel.
    """
    if config.numerics.precision != "single":
        return
    step, parts = total_plasma_frequency(config) * abs(config.simulation.time_step), 2.0 ** WHOLE_BITS[4]
    for species in config.species:
        if not (wave := species.perturbation) or any(thermal_velocities(config, species)):
            continue
        turns = [2 * math.pi * n / length for n, length in zip(wave.mode, config.simulation.space_length)]
        cells = max(abs(k) * n / length for k, n, length in zip(turns, config.points, config.simulation.space_length))
        value = started_amplitude(config, species) / math.hypot(*turns) ** 2 * cells * step * parts
        yield judged(
            f"wave of {species.name} over rounding", "wp dt a/(k dx) 2^20", value, limit=f">= {MIN_PARTS:g}",
            ok=value >= MIN_PARTS, legal=True, source="2 % off there and 10 % at 5, in the first period, measured",
            cure='numerics.precision = "double", or a larger amplitude', key=("numerics", "precision"),
        )  # fmt: skip


def cell_edges(config: PlasmaConfig) -> Iterator[Derived]:
    """How far the wave of each cold quiet species moves its particles, over the way to the nearest edge of a cell: with
    less no charge moves, and what is at rest stays so. A velocity takes them there in time.
    """
    if config.numerics.shape != "NGP":
        return
    for i, species in enumerate(config.species):
        wave = species.perturbation
        if not wave or not wave.amplitude or wave.velocity_amplitude or not plasma_frequency(config, species):
            continue
        ways = list(ways_to_edge(config, species))
        k = [2 * math.pi * n / length for n, length in zip(wave.mode, config.simulation.space_length)]
        moved = [abs(wave.amplitude * n) / math.hypot(*k) ** 2 / dx for n, dx in zip(k, spacing(config))]
        crossed = max((cells / way if way else math.inf for cells, way in zip(moved, ways) if cells), default=math.inf)
        if crossed == math.inf:
            continue
        larger = rounded_up(abs(wave.amplitude) / crossed)
        cures = [f"species[{i}].perturbation.amplitude = {larger:g}"] if larger < 1 else []
        yield judged(
            f"wave of {species.name} across cell edges", "a/(k d)", crossed, limit=">= 1", ok=crossed >= 1, legal=True,
            source="NGP sees no wave that moves no particle to another node",
            cure=", or ".join([*cures, 'numerics.shape = "CIC"']), key=("species", i, "perturbation", "amplitude"),
        )  # fmt: skip


def ways_to_edge(config: PlasmaConfig, species: Species) -> Iterator[float]:
    """Cells from the places (j + 1/2)/n of a lattice to the nearest edge between nodes, along each axis; nothing of
    what is no lattice. Places and edges are (2 j + 1) points and (2 i + 1) n in units of 1/(2 n): where both numbers
    have the same power of 2 some meet, else the nearest are their common divisor apart.
    """
    quiet = type(loader_of(species)).positions is Quiet.positions and not species.thermal_velocity
    total, points = species.particles or 0, config.points
    sides = (total,) if len(points) == 1 else lattice(total, points)
    for n, m in zip((sides or ()) if quiet else (), points):
        common = math.gcd(n, m)
        yield 0.0 if (n // common) % 2 and (m // common) % 2 else common / (2 * n)


def node_temperatures(config: PlasmaConfig) -> Iterator[Derived]:
    """By how much the temperature at nodes is low, as it is about the mean velocity of the few particles there: of N
    samples the variance is 1 - 1/N of the true one on average (Bessel).
    """
    if "T" not in {field.name for field in asked_for(config)}:
        return
    axes = sum(n > 1 for n in config.points)
    for i, species in enumerate(config.species):
        if not species.particles or not any(thermal_velocities(config, species)):
            continue
        low = min(SHAPES[config.numerics.shape].own_share(axes) * config.cells / species.particles, 1.0)
        name, cure = f"T_{species.name} is low by", more_particles(i, species, low / MOST_LOW)
        yield judged(
            name, "1 - <T>/T", low, limit=f"< {MOST_LOW:g}", ok=low < MOST_LOW, legal=True, key=("output", "fields"),
            source="about the mean velocity of the few particles of a node: 1 - 1/N of N samples", cure=", or ".join(
                filter(None, [cure, f"divide means of T_{species.name} by {1 - low:.3g}" if low < MOST_KNOWN else ""])
            ) or "fewer points",
        )  # fmt: skip


def noise_over_wave(config: PlasmaConfig, mode: tuple[int, ...]) -> float:
    """The charge of a mode that random places leave in the plasma, its root mean square, over that of the wave that the
    case starts; 0 where all places are even, infinite where it starts none.

    In equilibrium charges are shielded: (k lambda_D)^2/(1 + (k lambda_D)^2) of the square is left.
    """
    noise = wave = shield = 0.0
    size = 2 * math.pi * math.hypot(*(n / length for n, length in zip(mode, config.simulation.space_length)))
    for species in config.species:
        if not (charge := charge_density(config, species)):
            continue
        if species.perturbation and species.perturbation.mode in (mode, tuple(-n for n in mode)):
            wave += charge * started_amplitude(config, species)
        if random_places(species):
            noise += charge * charge * 4 / species.particles
        spread = max(thermal_velocities(config, species))
        shield += (plasma_frequency(config, species) / spread) ** 2 if spread else 0.0
    left = noise / (1 + shield / size**2)
    return math.sqrt(left) / abs(wave) if wave else math.inf if left else 0.0


def quiet_noise_over_wave(config: PlasmaConfig, species: Species, mode: tuple[int, ...], k: float) -> float:
    """The amplitude of a mode that a warm species comes to have by a quiet start, over that of the wave that it starts
    with there, per second; 0 of other starts.
    """
    wave = species.perturbation
    if type(loader_of(species)) is not Quiet or not wave or mode not in (wave.mode, tuple(-n for n in wave.mode)):
        return 0.0
    lengths = (ELSEWHERE if any(mode[1:]) else ALONG_X) * math.hypot(*mode)
    speed = max(thermal_velocities(config, species))
    return lengths * k * speed / (species.particles * started_amplitude(config, species)) if species.particles else 0.0


def started_amplitude(config: PlasmaConfig, species: Species) -> float:
    """The relative density of the wave that a species starts. Velocities b sin(k.x) make the amplitude k b/wp, a
    quarter of a period later than that of the places.
    """
    wave, wp = species.perturbation, total_plasma_frequency(config)
    assert wave is not None
    k = 2 * math.pi * math.hypot(*(n / length for n, length in zip(wave.mode, config.simulation.space_length)))
    return math.hypot(wave.amplitude, k * wave.velocity_amplitude / wp if wp else 0.0)


def more_particles(i: int, species: Species, factor: float) -> str:
    """Settings of so many times the particles that are the same plasma; empty where that is too many."""
    assert species.particles is not None
    if not species.particles * factor < MOST_PARTICLES:
        return ""
    n = math.ceil(species.particles * factor * (1 + 1e-9))
    made = f"species[{i}].particles = {n}"
    real = species.density or species.plasma_frequency  # charge and mass are those of a real particle, as they are
    return made if real else f"{made}, {weighted(i, species, species.particles / n)}"


def weighted(i: int, species: Species, factor: float) -> str:
    """Settings that multiply the charge and the mass of a macro-particle."""
    return ", ".join(f"species[{i}].{name} = {getattr(species, name) * factor:.8g}" for name in ("charge", "mass"))


def neutral(config: PlasmaConfig, i: int, factor: float) -> str:
    """Settings that multiply the charge density of a species."""
    species = config.species[i]
    if species.density:
        return f"species[{i}].density = {species.density * factor:.8g}"
    if species.plasma_frequency:
        return f"species[{i}].plasma_frequency = {species.plasma_frequency * math.sqrt(factor):.8g}"
    return weighted(i, species, factor)


def start_noise(config: PlasmaConfig) -> float:
    """Energy of the field of random places over that of the heat, on one axis; nan on more, 0 where places are even.

    The sum over waves of (2/sqrt(N))^2 q^2 N^2/(4 eps0 k^2 L): N q^2 L/(24 eps0), of the longest waves most. Against
    N m v^2/2 of one species it is L^2/(12 N lambda_D^2).
    """
    if field_axes(config) != 1:
        return math.nan
    axis = next(axis for axis, n in enumerate(config.points) if n > 1)
    length, field, heat = config.simulation.space_length[axis], 0.0, 0.0
    for species in config.species:
        n, thermal = species.particles or 0, thermal_velocities(config, species)[axis]
        heat += 0.5 * n * macro_mass(config, species) * thermal * thermal
        if random_places(species):
            charge = macro_charge(config, species)
            field += n * charge * charge * length / (24 * config.constants.vacuum_permittivity)
    return field / heat if heat else math.nan


def share_along(config: PlasmaConfig, start: float) -> float:
    """Share of the energy that the motion along the only axis with a field has, with `start`, see start_noise: the grid
    heats that motion alone, of all components of the velocity. 1 on more axes.
    """
    if field_axes(config) != 1:
        return 1.0
    axis, heats = next(axis for axis, n in enumerate(config.points) if n > 1), [0.0] * velocity_components(config)
    for species in config.species:
        for k in range(len(heats)):
            spread = max(part.spread for part in loader_of(species).populations(species, k))
            heats[k] += (species.particles or 0) * macro_mass(config, species) * spread * spread
    fed = heats[axis] * (1.0 + start)
    return fed / (fed + sum(heats) - heats[axis]) if fed else 1.0


def alike_per_cell(config: PlasmaConfig) -> float:
    """Particles per cell, all of one charge, that make the noise of those of the case in the same sum of |q|.

    The field of random places has the energy of sum N q^2 (Birdsall & Langdon, chapter 12): (sum N |q|)^2 over it.
    """
    total = squares = 0.0
    for species, denser in zip(config.species, densest(config)):
        n, charge = (species.particles or 0) * denser, abs(macro_charge(config, species))
        total, squares = total + n * charge, squares + n * charge * charge
    return total / squares * total / math.prod(config.points) if squares else 0.0
