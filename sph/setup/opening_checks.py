"""What does not fit together in the inlets and outlets of a case: each fault with the key to change."""

import itertools
from collections.abc import Iterator

from hpcpic.core.case.config import Path
from sph.case.config import AXES, SphConfig
from sph.case.openings import Inlet, Opening, Outlet
from sph.physics import stability
from sph.setup.defaults import domain_of

Fault = tuple[Path, str]


def axes(config: SphConfig) -> Iterator[Fault]:
    """Refuse axes that do not exist or are periodic."""
    known = [axis + sign for axis in AXES[: config.dimensions] if axis not in config.domain.periodic for sign in "+-"]
    for group, i, opening in _openings(config):
        if opening.axis not in known:
            yield (group, i, "axis"), f"must be one of {', '.join(known)} (got {opening.axis!r})"


def faults(config: SphConfig) -> Iterator[Fault]:
    """Everything else, of a case of which vectors have their length."""
    for group, i, opening in _openings(config):
        found = itertools.chain(_box_faults(config, opening), _kind_faults(config, opening))
        yield from (((group, i, *path), text) for path, text in found)
    if config.inlet and not config.fluid:
        yield ("fluid",), "is missing: an inlet lets in the liquid of the first fluid, whose shape may be its box"
    if config.inlet and any(fluid.acceleration for fluid in config.fluid):
        yield ("inlet",), "its particles belong to no fluid with an acceleration of its own: give none, or a body_force"


def _openings(config: SphConfig) -> Iterator[tuple[str, int, Opening]]:
    for i, inlet in enumerate(config.inlet):
        yield "inlet", i, inlet
    for i, outlet in enumerate(config.outlet):
        yield "outlet", i, outlet


def _kind_faults(config: SphConfig, opening: Opening) -> Iterator[Fault]:
    if isinstance(opening, Inlet):
        yield from _inlet_faults(config, opening)
    elif isinstance(opening, Outlet):
        yield from _outlet_faults(config, opening)


def _box_faults(config: SphConfig, opening: Opening) -> Iterator[Fault]:
    low, high, domain = opening.low, opening.high, domain_of(config)
    if any(a >= b for a, b in zip(low, high)):
        yield ("high",), f"must be above low = {list(low)} on every axis (got {list(high)})"
        return
    for a, b, (first, last) in zip(low, high, zip(*domain.corners)):
        if a < first or b > last:
            yield (), f"reaches from {a:g} to {b:g} m, beyond the domain, which goes from {first:g} to {last:g} m"
    k = AXES.index(opening.axis[0])
    forward = opening.axis[1] == "+"
    into = isinstance(opening, Inlet)
    free, end = (high[k], domain.corners[1][k]) if forward == into else (low[k], domain.corners[0][k])
    if abs(free - end) < 1e-9 * config.numerics.spacing:
        way = "fluid would flow in beyond" if into else "no fluid comes to the box from beyond"
        turned = f'"{AXES[k]}{"-" if forward else "+"}"'
        yield ("axis",), f"{way} the end of the domain at {AXES[k]} = {free:g} m: {turned}"
    support = stability.support_of(config)
    if high[k] - low[k] < support * (1 - 1e-9):
        text = f"the box is {high[k] - low[k]:g} m long along {AXES[k]}, shorter than the kernel reaches, {support:g} m"
        yield (), text
    dp = config.numerics.spacing
    across = min(b - a for j, (a, b) in enumerate(zip(low, high)) if j != k)
    if across < 0.99 * dp:
        yield (), f"the box is {across:g} m across, thinner than the spacing {dp:g} m"
    for group, i, other in _openings(config):
        ends = zip(low, high, other.low, other.high)
        if other is not opening and all(a < d - 1e-9 * dp and c < b - 1e-9 * dp for a, b, c, d in ends):
            yield (), f"overlaps {group}[{i}]"


def _level_faults(config: SphConfig, opening: Opening, levels: list[float]) -> Iterator[Fault]:
    """Levels need gravity across the axis, and lie in the box."""
    k, g = AXES.index(opening.axis[0]), config.gravity or (0.0,)
    if not any(g) or g[k]:
        without = "a velocity or discharge without it" if isinstance(opening, Inlet) else "domain.outflow"
        yield ("level",), f"needs gravity at right angles to the axis {opening.axis} (got {list(g)}), or {without}"
        return
    ends = [-sum(x * y for x, y in zip(corner, g)) / sum(x * x for x in g) ** 0.5
            for corner in itertools.product(*zip(opening.low, opening.high))]  # fmt: skip
    for level in levels:
        if not min(ends) < level <= max(ends) * (1 + 1e-9):
            yield ("level",), f"{level:g} m is not in the box, from {min(ends) + 0.0:g} to {max(ends):g} m"


def _inlet_faults(config: SphConfig, inlet: Inlet) -> Iterator[Fault]:
    times = [moment.time for moment in inlet.table]
    if any(b <= a for a, b in itertools.pairwise(times)):
        yield ("table",), "times must grow"
    for name in ("velocity", "discharge", "level"):
        given = sum(getattr(moment, name) is not None for moment in inlet.table)
        if given not in (0, len(inlet.table)):
            yield ("table",), f"gives a {name} at {given} of {len(inlet.table)} times: at all of them or at none"
        if given and getattr(inlet, name) is not None:
            yield (name,), "the table gives it too"
    flow = [name for name in ("velocity", "discharge") if inlet.over_time(name)]
    if len(flow) != 1:
        yield (), "needs a velocity or a discharge, and one of them only"
    levels = [level for _, level in inlet.over_time("level")]
    if levels:
        yield from _level_faults(config, inlet, levels)
    if levels and "discharge" in flow:
        yield ("level",), "follows from the fluid where a discharge is given"
    real = [axis for axis in AXES[: config.dimensions] if axis not in (inlet.axis[0], *config.domain.periodic)]
    if inlet.profile == "parabolic" and len(real) != 1:
        yield ("profile",), f"a parabola goes across one axis, and here are {', '.join(real) or 'none'}"
    if inlet.profile == "parabolic" and levels + inlet.over_time("discharge"):
        yield ("profile",), "a parabola is that between two walls: without a level, and with a velocity"


def _outlet_faults(config: SphConfig, outlet: Outlet) -> Iterator[Fault]:
    k, g = AXES.index(outlet.axis[0]), config.gravity or (0.0,)
    if outlet.level is not None:
        yield from _level_faults(config, outlet, [outlet.level])
        if outlet.pressure:
            yield ("pressure",), "follows from the level"
    elif any(g) and not (k < len(g) and g[k]):
        yield (), "level is missing, which an outlet needs under gravity; domain.outflow lets fall what leaves"
    elif any(g):
        yield ("axis",), "gravity pulls along it: domain.outflow lets fall what leaves"
    if outlet.waves and outlet.level is None:
        yield ("waves",), "long waves run below a level"
    if outlet.velocity and not outlet.waves:
        yield ("velocity",), "is that of the current below waves: waves = true"
