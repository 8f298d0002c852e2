"""What another field equation than Poisson's, and charges that are clouds, do to waves, with their limits."""

import math
from collections.abc import Iterator

from hpcpic.core.case.derived import Derived, judged, rounded_down
from hpcpic.core.errors import ConfigError
from hpcpic.plasma.case.config import Equation, PlasmaConfig
from hpcpic.plasma.forecast.scales import MOST_WITHOUT_FIELD, field_axes
from hpcpic.plasma.physics.poisson import green, operator_of, strongest_response

EQUATION = ("field", "equation")
MOST_POINTS_TRIED = 2**22
POINTS = ("grid", "points")
CLOUD_RADIUS = ("numerics", "cloud_radius")


def field_strength(config: PlasmaConfig) -> float:
    """The largest factor of the squared plasma frequency of a wave by the field equation; 1 where it has no limit."""
    most = strongest_response(operator_of(config), config.points, config.simulation.space_length)
    return most if most < math.inf else 1.0


def field_equation(config: PlasmaConfig) -> Iterator[Derived]:
    """Whether there is a field, whether those of all waves end, whether forces are mutual, and whether clouds leave one
    in the box.
    """
    if not field_axes(config):
        yield judged(
            "most points of an axis", "N", max(config.points), limit=f"> {MOST_WITHOUT_FIELD}", ok=False, legal=True,
            source="(5.13): differences over two cells", cure="there is no field: more points", key=POINTS,
        )  # fmt: skip
    equation, radius = config.field.equation, config.numerics.cloud_radius
    source = "thesis (5.7)"
    if equation != Equation():
        most = strongest_response(operator_of(config), config.points, config.simulation.space_length)
        legal = most < math.inf or not _resonant(config)
        wrong = "charges of one sign attract" if legal else "a wave of this box has a field without a charge"
        yield judged(
            "largest field", "K^2/symbol", most, limit="finite", ok=most < math.inf, legal=legal, source=source,
            cure=f"c + f < 0 and a, d > 0: {wrong}", key=EQUATION,
        )  # fmt: skip
    if equation.b or equation.e:
        cure = "b = 0 and e = 0: charges act on each other unequally, so energy and momentum are not kept"
        yield judged(
            "first derivatives", "b, e", max(abs(equation.b), abs(equation.e)), limit="0", ok=False, legal=True,
            source=source, cure=cure, key=EQUATION,
        )  # fmt: skip
    if radius:
        share = max(radius / length for length in config.simulation.space_length)
        cure = "a smaller cloud: no field is left in the box"
        yield judged(
            "radius of the clouds", "R/L", share, limit="< 0.25", ok=share < 0.25, legal=True, source="exp(-(k R)^2)",
            cure=cure, key=CLOUD_RADIUS,
        )  # fmt: skip


def _resonant(config: PlasmaConfig) -> bool:
    """Whether the solver would refuse the equation; not looked for on large grids, where it does so at the start."""
    points, lengths = config.points[::-1], config.simulation.space_length[::-1]
    if math.prod(points) > MOST_POINTS_TRIED:
        return False
    spacing, spectral = tuple(length / n for n, length in zip(points, lengths)), config.numerics.gradient == "spectral"
    try:
        green(operator_of(config), points, spacing, slice(0, None), spectral=spectral)
    except ConfigError:
        return True
    return False


def slowed_by_clouds(config: PlasmaConfig, i: int) -> Derived:
    """The radius of the clouds against the wave that a species starts with."""
    wave, radius = config.species[i].perturbation, config.numerics.cloud_radius
    assert wave is not None
    k = 2 * math.pi * math.hypot(*(n / length for n, length in zip(wave.mode, config.simulation.space_length)))
    cure = f"more than 1 % slow; numerics.cloud_radius = {rounded_down(math.sqrt(0.02) / k):g}"
    return judged(
        "clouds on the wave", "k R", k * radius, limit="< 0.14", ok=(k * radius) ** 2 / 2 < 0.01, legal=True,
        source="exp(-(k R)^2/2)", cure=cure, key=CLOUD_RADIUS,
    )  # fmt: skip
