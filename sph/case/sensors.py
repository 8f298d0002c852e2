"""Areas of walls whose mean pressure a case asks for."""

import math

from sph.case.config import AXES, Gauge, SphConfig


def sensors_of(config: SphConfig) -> list[Gauge]:
    """The gauges of a case that are areas of walls."""
    return [gauge for gauge in config.gauge if gauge.what == "wall-pressure"]


def area_of(gauge: Gauge, spacing: float) -> float:
    """Area of a sensor, m2 (2D: length of a strip, m); along axes of which nothing is said it is a spacing wide."""
    d = len(gauge.at)
    if gauge.radius:
        return math.pi * gauge.radius**2 if d == 3 else 2 * gauge.radius
    return math.prod(extent for extent in extents_of(gauge, spacing) if extent)


def extents_of(gauge: Gauge, spacing: float) -> list[float]:
    """Extent of a sensor along each axis, m; 0 along its normal."""
    assert gauge.axis is not None
    size = gauge.size or (0.0,) * len(gauge.at)
    return [0.0 if AXES[k] == gauge.axis[0] else extent or spacing for k, extent in enumerate(size)]
