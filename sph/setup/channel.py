"""Channels: viscous fluid that a body force drives between two planes where it sticks (MP 4.2)."""

from typing import NamedTuple

import numpy as np

from sph.case import geometry
from sph.case.config import AXES, SphConfig
from sph.physics.stability import physical_viscosity
from sph.physics.wall_rules import rule_of


class Channel(NamedTuple):
    """Axis of the flow, axis across it, lower plane and width in m, force in m/s2 and viscosity in m2/s."""

    along: int
    across: int
    floor: float
    width: float
    force: float
    nu: float

    @property
    def fastest(self) -> float:
        """The largest velocity of the steady flow, F L^2 / (8 nu) of (MP 24), m/s: from rest it is never exceeded."""
        return self.force * self.width**2 / (8 * self.nu)


def channel_of(config: SphConfig) -> Channel | None:
    """The channel that a case is; None for a case that is none."""
    force, nu = np.array(config.body_force), physical_viscosity(config)
    walls = [wall for wall in config.wall if rule_of(wall.type).face_images and wall.shape.box]
    if not walls or not nu or np.count_nonzero(force) != 1 or any(config.gravity):
        return None
    along, (low, high) = int(np.flatnonzero(force)[0]), geometry.bounds(walls[0].shape)
    across = [k for k in range(config.dimensions) if AXES[k] not in config.domain.periodic]
    if along in across or len(across) != 1:
        return None
    (k,) = across
    return Channel(along, k, low[k], high[k] - low[k], abs(force[along]), nu)
