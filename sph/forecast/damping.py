"""Resistance of a liquid to strain where all pair forces of the viscosity go along v_ij (Morris): a free surface then
bears the stress mu (grad v)^T n, which none is there to take, and energy is lost by |grad v|^2, not by twice the strain
rate squared (Colagrossi et al. 2011, https://doi.org/10.1103/PhysRevE.84.026705).
"""

import math
from collections.abc import Iterator

from hpcpic.core.case.derived import Derived
from sph.case import geometry
from sph.case.config import SphConfig
from sph.physics.stability import physical_viscosity
from sph.physics.viscosities import viscosity_of
from sph.physics.wall_rules import rule_of
from sph.setup.speeds import lost_in_a_period
from sph.setup.tanks import free_surface

MEASURED = 0.52  # of that by linear theory: a standing wave as long as it is deep, 40 spacings
MATTERS = 0.1  # 2 nu k^2 t, of a wave within its period, of a drop within the run


def damping(config: SphConfig) -> Iterator[Derived]:
    """A row where viscosity matters to a liquid with a free surface."""
    form = viscosity_of(config.numerics.viscosity_form)
    if not form.along_velocity or lost(config) <= MATTERS or not free_surface(config):
        return
    known = all(rule_of(wall.type).knows(viscosity_of("full-stress")) for wall in config.wall)
    cure = 'viscosity_form = "full-stress"'
    cure += ": 0.97" if known else ' with wall.type left out: 0.97; viscosity_form = "cleary": 1.12'
    source = "a wave as long as it is deep, measured; honey spreads by a fifth more, what spins freely is slowed down"
    yield Derived("resistance to strain at a free surface", "of theory", MEASURED, "", ">= 0.9", "warn", source, cure,
                  ("numerics", "viscosity_form"))  # fmt: skip


def lost(config: SphConfig) -> float:
    """2 nu k^2 t: within a period of a wave; without gravity within the run, of a wave as long as a fluid is thin."""
    if any(config.gravity):
        return lost_in_a_period(config)
    boxes = [geometry.bounds(fluid.shape) for fluid in config.fluid]
    least = min((b - a for low, high in boxes for a, b in zip(low, high)), default=math.inf)
    return 2.0 * physical_viscosity(config) * (2.0 * math.pi / least) ** 2 * config.simulation.end_time
