"""Landau damping against trapping: a wave so large that its trough holds particles is not damped as a small one; and
against noise: one that is damped into it is seen no more.
"""

import math
from collections.abc import Iterator

from hpcpic.core.case.derived import Derived, judged
from hpcpic.plasma.case.config import Equation, PlasmaConfig
from hpcpic.plasma.forecast.cold_wave import started_fields
from hpcpic.plasma.forecast.noise import (
    MIN_OVER_NOISE,
    QUIET_UNTIL,
    even_places,
    more_particles,
    noise_over_wave,
    quiet_noise_over_wave,
)
from hpcpic.plasma.forecast.scales import plasma_frequency, total_plasma_frequency
from hpcpic.plasma.setup.loaders import loader_of

ALONE = 0.99  # of the squared plasma frequency of all, that of the species that carries the wave
DAMPED = 0.24, 0.6  # k lambda_D: below it a plasma period takes less than 1 % of a wave, beyond it it is no wave
# Powers of q = (k lambda_D)^2 in ln(gamma/wp (k lambda_D)^3) + 1/(2 q), which Landau's weak damping has as ln
# sqrt(pi/8) - 3/2; fitted to roots of the dispersion relation in DAMPED, within 4 %.
LANDAU = (-1.8222, -11.9069, 68.339, -91.273)


def trapping(config: PlasmaConfig) -> Iterator[Derived]:
    """The bounce frequency of particles in each wave that the case starts over Landau's rate, of one warm species at
    rest, and when the noise of random places, or of a quiet start, is left of it. A standing wave is two running ones
    of half the field. Not told in a magnetic field. Of another field equation, and of longer waves, no rate is known:
    their noise is told where it hides a wave that is not damped.
    """
    total = total_plasma_frequency(config)
    if not total or any(config.field.magnetic):
        return
    i, species = max(enumerate(config.species), key=lambda one: plasma_frequency(config, one[1]))
    wp = plasma_frequency(config, species)
    if wp**2 < ALONE * total**2:
        return
    for mode, field in started_fields(config).items():
        vector = [2 * math.pi * n / length for n, length in zip(mode, config.simulation.space_length)]
        k = math.hypot(*vector)
        found = [loader_of(species).populations(species, axis) for axis, component in enumerate(vector) if component]
        spreads = {part.spread for parts in found for part in parts}
        if len(spreads) > 1 or any(part.mean for parts in found for part in parts):
            continue
        speed = spreads.pop()
        ratio = k * speed / wp if config.field.equation == Equation() else 0.0
        if not field or not speed or ratio > DAMPED[1]:
            continue
        powers = sum(factor * ratio ** (2 * n) for n, factor in enumerate(LANDAU))
        rate = wp / ratio**3 * math.exp(powers - 0.5 / ratio**2) if ratio >= DAMPED[0] else 0.0
        if rate:
            bounce = math.sqrt(abs(species.charge / species.mass) * k * field / 2)
            yield Derived(
                f"bounce of {species.name} in the wave over its damping", "wB/gamma", bounce / rate,
                source="O'Neil 1965: above 1 damping is not Landau's and ends by 2 pi/wB = "
                f"{2 * math.pi / bounce:.3g} s",
            )  # fmt: skip
        end = abs(config.simulation.time_step) * config.simulation.cycles
        rising = quiet_noise_over_wave(config, species, mode, k) * MIN_OVER_NOISE
        if rate and 0 < (noise := noise_over_wave(config, mode)) < 1:
            ways, seen, needed = even_places(i, species), -math.log(noise) / rate, (noise * grown(rate * end)) ** 2
            source = f"Landau damping at {rate:.3g}/s ends there at t = {seen:.3g} s"
        elif rising and (rate or rising * (last := min(end, QUIET_UNTIL / (k * speed))) >= 1):
            seen = meeting(rate, rising) if rate else 1 / rising
            ways, needed = [], rising * (end * grown(rate * end) if rate else last)
            source = f"{MIN_OVER_NOISE:g} times that of a quiet start, which rises: until t = {seen:.3g} s, measured"
        else:
            continue
        yield judged(
            f"wave of {species.name} {'damped into' if rate else 'hidden by'} the noise", "t/T",
            seen / end if end else math.inf, limit=">= 1", ok=seen >= end, legal=True, source=source,
            key=("species", i, "init_method"),
            cure=", or ".join(filter(None, [*ways, more_particles(i, species, needed)])) or "a larger amplitude",
        )  # fmt: skip


def grown(folds: float) -> float:
    return math.exp(min(folds, 300.0))


def meeting(rate: float, rising: float) -> float:
    """The time t of exp(-rate t) = rising t, by Newton's method for w exp(w) = rate/rising, w = rate t."""
    w = math.log1p(rate / rising)
    for _ in range(20):
        w -= (w - rate / rising * math.exp(-w)) / (1.0 + w)
    return w / rate
