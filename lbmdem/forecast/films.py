"""The films between grains that the lattice does not resolve: how stiff they get, and the substeps that they want."""

import math
from functools import lru_cache
from typing import NamedTuple

from hpcpic.core.case.derived import Derived, judged
from lbmdem.case.config import AXES, LbmDemConfig, grain_mass
from lbmdem.forecast.node_shares import fluid_share
from lbmdem.physics.lubrication import MOST_SUBSTEPS, ROUGHNESS, STABLE, Film
from lbmdem.physics.velocity_sets import LATTICES
from lbmdem.physics.wall_rules import impedance
from lbmdem.setup.overlap_survey import starts

DILUTE = 0.1  # share of grains in the box up to which few are so near to each other that their films want substeps


class Grain(NamedTuple):
    """The smallest grain that moves: radius (m), mass with what the fluid adds (kg, in 2D kg/m); its film."""

    radius: float
    mass: float
    film: Film


def smallest(config: LbmDemConfig) -> Grain:
    """The smallest grain that moves, of a case with fluid."""
    d, dx, fluid = config.dimensions, config.spacing, config.liquid
    film = Film.of_lattice(fluid.kinematic_viscosity * fluid.density, dx, d)
    group = min((group for group in config.grains if group.moving), key=lambda group: group.smallest_diameter)
    radius, mass = 0.5 * group.smallest_diameter, grain_mass(group, group.smallest_diameter, d)
    if config.coupling.inertia == "implicit":
        lattice, rule = LATTICES[config.lattice], config.coupling.bounce_back
        mass = max(mass, float(impedance(lattice, rule, radius / dx)[0]) * fluid.density * dx**d)
    return Grain(radius, mass, film)


def films(config: LbmDemConfig) -> Derived:
    """The gap at a plane wall, over the radius, below which the film of the smallest grain is limited: steps of the
    contacts take care of stiffer ones up to MOST_SUBSTEPS, or not where their number is given."""
    radius, mass, film = smallest(config)
    n = config.coupling.substeps or max(config.substeps, MOST_SUBSTEPS)
    gap = film.gap_of(STABLE * n * mass / config.time_step, radius) / radius
    least, limit = gap if gap > ROUGHNESS else 0.0, 0.01
    wanted = math.ceil(film.resistance(limit * radius, radius) * config.time_step / (STABLE * mass))
    return judged(
        "gap of limited films", "h/R", least, ok=least <= limit, legal=True, limit=f"<= {limit:g}",
        source="stability of lubrication forces", key=("coupling", "substeps"),
        cure=f"coupling.substeps = {wanted} holds to {limit:g}; a smaller relaxation_time needs fewer",
    )  # fmt: skip


@lru_cache(maxsize=8)  # places of many grains take a while to look at
def expected_substeps(config: LbmDemConfig) -> int:
    """The substeps of a step: where grains fill more than a little of the box two of the smallest nearly touch, or are
    as near as given positions bring them where nothing presses grains together."""
    given, coupling = config.substeps, config.coupling
    quiet = not config.fluid or coupling.frozen or not coupling.lubrication or coupling.substeps
    if quiet or 1.0 - fluid_share(config) <= DILUTE:
        return given
    radius, mass, film = smallest(config)
    gap = ROUGHNESS * 0.5 * radius
    if not pressed(config):
        gap = max(gap, starts(config)[0] - 2.0 * radius)
    resistance = film.resistance(gap, 0.5 * radius)
    wanted = config.time_step * resistance * 2.0 / mass / STABLE
    return max(given, math.ceil(min(wanted, MOST_SUBSTEPS)))


def pressed(config: LbmDemConfig) -> bool:
    """True where grains lie on each other: of a packing, or with a weight that a side of the box or a solid holds."""
    moving = [group for group in config.grains if group.moving]
    stays = bool(config.obstacle) or len(moving) < len(config.grains)
    axes = [axis for axis, g in zip(AXES, config.gravity) if g]
    held = bool(axes) and (stays or any(axis not in config.domain.periodic for axis in axes))
    heavy = not config.fluid or any(group.density != config.liquid.density for group in moving)
    return any(group.packing is not None for group in moving) or (held and heavy)
