"""Walls in a domain that repeats itself: what goes all through a period has no ends there, all else lies within it."""

import math
from collections.abc import Iterator

from hpcpic.core.case.config import Path
from hpcpic.core.case.schema import Section
from sph.case import geometry
from sph.case.config import AXES, Domain, SphConfig, Wall
from sph.case.motions import Motion
from sph.case.shapes import Shape

TINY = 1e-9  # of a period, for rounding


def through(shape: Shape, domain: Domain, k: int) -> bool:
    """Whether a shape reaches from end to end of the period along axis k."""
    assert domain.low and domain.high
    (low, high), tiny = geometry.bounds(shape), TINY * (domain.high[k] - domain.low[k])
    return low[k] <= domain.low[k] + tiny and high[k] >= domain.high[k] - tiny


def endless(shape: Shape, domain: Domain) -> Shape:
    """A box or a cylinder with the ends one period away that it has where it goes through a period."""
    assert domain.low and domain.high
    if shape.box is None and shape.cylinder is None:
        return shape
    for axis in domain.periodic:
        k = AXES.index(axis)
        if through(shape, domain, k):
            a, b = domain.low[k], domain.high[k]
            ends = 2 * a - b, 2 * b - a
            if shape.box:
                corners = (_with(corner, k, end) for corner, end in zip((shape.box.low, shape.box.high), ends))
                update: dict[str, Section] = {"box": shape.box.model_copy(update=dict(zip(("low", "high"), corners)))}
            else:
                assert shape.cylinder is not None
                middles = (_with(shape.cylinder.base, k, end) for end in ends)
                update = {"cylinder": shape.cylinder.model_copy(update=dict(zip(("base", "top"), middles)))}
            shape = shape.model_copy(update=update)
    return shape


def _with(x: tuple[float, ...], k: int, value: float) -> tuple[float, ...]:
    return (*x[:k], value, *x[k + 1 :])


def faults(config: SphConfig, wall: Wall) -> Iterator[tuple[Path, str]]:
    """Faults of a wall that does not fit the periods of the domain."""
    domain, shape = config.domain, wall.shape
    for axis in domain.periodic if domain.low and domain.high else ():
        k, (first, last) = AXES.index(axis), domain.corners
        if shape.plane:
            if shape.plane.normal[k]:
                yield ("shape", "plane", "normal"), f"a plane across {axis}, along which the domain repeats itself"
            continue
        period = f"the period {first[k]:g} .. {last[k]:g} m along {axis}"
        if through(shape, domain, k):
            if not (shape.box or (shape.cylinder and _along(shape, k))):
                yield ("shape",), f"only a box, or a cylinder along {axis}, can go all through {period}"
            continue
        low, high = (ends[k] for ends in geometry.bounds(shape))
        if shape.box and not wall.solid:
            text = f"a tank has no faces across {axis}, so it needs all of {period} (got {low:g} .. {high:g})"
            yield ("shape", "box"), text
            continue
        back, forth = _way(wall.motion, config.simulation.end_time, k)
        tiny = TINY * (last[k] - first[k])
        if low + back < first[k] - tiny or high + forth > last[k] + tiny:
            text = f"must lie within {period}, or go all through it (got {low + back:g} .. {high + forth:g}"
            yield ("shape",), text + (" while it moves)" if back or forth else ")")


def _along(shape: Shape, k: int) -> bool:
    assert shape.cylinder is not None
    return all(a == b for i, (a, b) in enumerate(zip(shape.cylinder.base, shape.cylinder.top)) if i != k)


def _way(motion: Motion | None, end_time: float, k: int) -> tuple[float, float]:
    """Displacements along axis k between which a wall stays until the end of a run, m."""
    if motion is None:
        return 0.0, 0.0
    stop = math.inf if motion.stop is None else motion.stop
    way = motion.velocity[k] * max(0.0, min(stop, end_time) - motion.start) if motion.velocity else 0.0
    swing = abs(motion.amplitude[k]) if motion.amplitude else 0.0
    places = [0.0, *(place.displacement[k] for place in motion.path)]
    return min(0.0, way) - swing + min(places), max(0.0, way) + swing + max(places)
