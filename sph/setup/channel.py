"""Channels: viscous fluid that a body force drives between two planes where it sticks (MP 4.2)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sph.case import geometry
from sph.case.config import AXES, SphConfig
from sph.physics.liquids import kind_of, liquids_of
from sph.physics.stability import physical_viscosity
from sph.physics.wall_rules import rule_of

PLACES = 2001  # at which the largest velocity of several layers is looked for


class Layer(NamedTuple):
    """Thickness in m, density in kg/m3 and dynamic viscosity in Pa s of a layer of liquid."""

    thickness: float
    density: float
    viscosity: float


class Channel(NamedTuple):
    """Axis of the flow, axis across it, lower plane and width in m, force in m/s2 and viscosity in m2/s; the layers
    from the lower plane on, which fill it.
    """

    along: int
    across: int
    floor: float
    width: float
    force: float
    nu: float
    layers: tuple[Layer, ...]

    @property
    def fastest(self) -> float:
        """The largest velocity of the steady flow, m/s: from rest it is never exceeded. F L^2 / (8 nu) of (MP 24) for
        one liquid.
        """
        if len(self.layers) == 1:
            return self.force * self.width**2 / (8 * self.nu)
        return float(self.steady(np.linspace(0.0, self.width, PLACES)).max())

    def steady(self, z: NDArray) -> NDArray[np.float64]:
        """The steady velocity[n] in m/s at z[n] in m from the lower plane: mu v' = s falls by F rho along z, and v is 0
        at both planes.
        """
        pulls = np.array([self.force * layer.density for layer in self.layers])  # N/m3
        ease = np.array([1 / layer.viscosity for layer in self.layers])
        thickness = np.array([layer.thickness for layer in self.layers])
        ends = np.cumsum([0.0, *thickness])
        fallen = np.cumsum([0.0, *pulls * thickness])[:-1]  # of s at the lower side of each layer
        bent = (fallen + pulls * thickness / 2) * thickness
        s = bent @ ease / (thickness @ ease)
        low = np.cumsum([0.0, *ease * (s * thickness - bent)])[:-1]  # v there
        k = np.clip(np.searchsorted(ends, z, side="right") - 1, 0, len(self.layers) - 1)
        up = z - ends[k]
        return low[k] + ease[k] * up * (s - fallen[k] - pulls[k] * up / 2)


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
    layers = layers_of(config, k, low[k], high[k])
    return Channel(along, k, low[k], high[k] - low[k], abs(force[along]), nu, layers) if layers else None


def layers_of(config: SphConfig, k: int, low: float, high: float) -> tuple[Layer, ...]:
    """The layers along axis k, of which several viscous ones fill all between two planes; none, if they do not."""
    liquids = liquids_of(config)
    if not liquids.several:
        return (Layer(high - low, *liquids.kinds[0][:2]),)
    boxes = sorted(config.fluid, key=lambda fluid: geometry.bounds(fluid.shape)[0][k])
    below, above = ([geometry.bounds(fluid.shape)[side][k] for fluid in boxes] for side in (0, 1))
    meet = np.allclose([low, *above], [*below, high], rtol=0.0, atol=config.numerics.spacing / 10)
    layers = tuple(Layer(b - a, *kind_of(fluid)[:2]) for a, b, fluid in zip(below, above, boxes))
    return layers if meet and all(layer.viscosity for layer in layers) else ()
