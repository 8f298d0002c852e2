"""What a body force makes of a fluid: how fast it gets, and when it is steady past grains that stay."""

import math
from collections.abc import Iterator

from hpcpic.core.case.derived import Derived, judged
from lbmdem.case.config import AXES, LbmDemConfig, seeps
from lbmdem.forecast.free_fall import PEAK, speed_through, stays
from lbmdem.forecast.relaxation import slower
from lbmdem.physics.velocity_sets import CS2


def driven(config: LbmDemConfig) -> Iterator[Derived]:
    """Speed that the body force gives the fluid: that of its whole push, or if less that of the parabola between the
    nearest walls along it. Solids that stay hold the fluid back: then these, and what grains that it must pass let
    through, are upper limits. Not told of grains that all move in a box without walls along the force.
    """
    size, nu, end = config.domain.size, config.liquid.kinematic_viscosity, config.simulation.end_time
    stay = any(stays(config, group) for group in config.grains)
    held = stay or bool(config.obstacle)
    unwalled = {face.face[0] for face in config.boundary if face.type != "wall"}.union(config.domain.periodic)
    squares = 0.0
    for along, a in zip(AXES, config.liquid.body_force):
        walls = [length for axis, length in zip(AXES, size) if axis not in unwalled and axis != along]
        if a and along in unwalled and (walls or held or not config.grains):
            limits = [abs(a) * end, *(abs(a) * height**2 / (8.0 * nu) for height in walls)]
            if stay and (not walls or along == AXES[config.dimensions - 1]):  # it cannot pass beside them
                limits.append(speed_through(config, abs(a)))
            squares += min(limits) ** 2
    if not squares:
        return
    speed = math.sqrt(squares)
    mach = speed * config.time_step / config.spacing / math.sqrt(CS2)
    name = "largest speed that the body force can make" if held else "speed that the body force makes"
    source = "a t, or a H2/(8 nu) between walls" + ("; drag of grains, Ergun 1952" if stay else "")
    yield Derived(name, "U", speed, "m/s", source=source)
    yield judged(
        "Mach number of the driven fluid" + (", at most" if held else ""), "Ma", mach, ok=mach <= 0.25,
        legal=held or mach < 0.5, forceable=True, limit="<= 0.25" if held else "<= 0.25, < 0.5 at all",
        source="Mansouri et al., section 3.2", key=("fluid", "body_force"),
        cure=f"a weaker force, or relaxation_time = {slower(config, 0.24 / mach)}",
    )  # fmt: skip


def steady(config: LbmDemConfig) -> Iterator[Derived]:
    """The end of a run in times in which a body force brings a fluid past grains that stay to its speed, u/a. Before
    three of them its permeability is too low by more than 5 %, past few grains 8. Measured are 0.3 (dense) to 1.2
    (dilute) times what is told.
    """
    a, nu, end = abs(config.liquid.body_force[-1]), config.liquid.kinematic_viscosity, config.simulation.end_time
    if not a or not seeps(config):
        return
    unwalled = {face.face[0] for face in config.boundary if face.type != "wall"}.union(config.domain.periodic)
    walls = [length for axis, length in zip(AXES, config.domain.size[:-1]) if axis not in unwalled]
    time = min([speed_through(config, a) / PEAK / a, *(height**2 / (8.0 * nu) for height in walls)])
    yield judged(
        "end over the time to a steady flow", "t a/u", end / time, ok=end >= 3.0 * time, legal=True, limit=">= 3",
        source="drag of grains, Ergun 1952; about 5 % are left", key=("simulation", "end_time"),
        cure=f"the permeability is still rising: end_time = {3.0 * time:.3g}",
    )  # fmt: skip
