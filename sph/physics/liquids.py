"""Several liquids in one scene, and gases: how each differs from the reference liquid, in which pair sums compute.

The reference liquid has the largest rho0 and the largest mu of the scene. All liquids have its rho0 c0^2, so that the
pressure (MP 14) is the same function of e = rho / rho0 - 1 for all, and e goes on through an interface as pressure
does. The state holds e times the rho0 of the reference; sums take volumes at rest, m / rho0, times it for masses. What
is left of a liquid is its inertia and viscosity. A gas is softer: the state holds that e which a liquid of its pressure
has, from which its density follows (`equation_of_state.compression`).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sph.case.config import Fluid, SphConfig
from sph.physics.equation_of_state import ADIABATIC

STIFF = 2.0**-60  # fluidity of walls: the harmonic mean with theirs is twice the viscosity of the fluid


class Kind(NamedTuple):
    """What tells liquids and gases apart: rho0 in kg/m3, mu in Pa s."""

    density: float
    viscosity: float
    gas: bool


@dataclass(frozen=True)
class Liquids:
    """rho0 kg/m3 and mu Pa s of the reference liquid, and the kinds, which have the numbers 1, 2, ..; one alone has the
    number 0, which is that of walls. ambient: absolute pressure of gases at rest over rho0 c0^2 of the reference.
    """

    density: float
    viscosity: float
    kinds: tuple[Kind, ...]
    ambient: float

    @property
    def several(self) -> bool:
        return len(self.kinds) > 1

    @property
    def densities(self) -> bool:
        """Whether they differ in density, as gases and liquids do."""
        return self.gases or len({kind.density for kind in self.kinds}) > 1

    @property
    def viscosities(self) -> bool:
        """Whether they differ in viscosity."""
        return len({kind.viscosity for kind in self.kinds}) > 1

    @property
    def gases(self) -> bool:
        """Whether there is a gas beside liquids."""
        return self.several and any(kind.gas for kind in self.kinds)

    def number(self, fluid: Fluid) -> int:
        """The number of the liquid of a fluid."""
        return 1 + self.kinds.index(kind_of(fluid)) if self.several else 0

    def lightness(self, fluid: Fluid) -> float:
        """rho0 of the reference over that of a fluid."""
        return self.density / fluid.density

    @property
    def lightest(self) -> float:
        """rho0 of the reference over the smallest."""
        return self.density / min((kind.density for kind in self.kinds), default=self.density)

    @property
    def swiftest(self) -> float:
        """The largest sound speed of rest over that of the reference. That of a gas counts for as much as if it were as
        stiff as the liquids: beside them its particles are between stiff neighbours.
        """
        stiffest = max(1.0, ADIABATIC * self.ambient) if self.gases else 1.0
        return math.sqrt(stiffest * self.lightest)

    @property
    def table(self) -> NDArray[np.float64]:
        """[4, number]: rho0 of the reference over that of a liquid; its root, the sound speed over that of the
        reference of what is as stiff; fluidity 1 / mu over that of the reference; of a gas `ambient`, else 0.
        """
        rows = [(1.0, 1.0, STIFF, 0.0)]
        for kind in self.kinds if self.several else ():
            lightness = self.density / kind.density
            fluidity = self.viscosity / kind.viscosity if kind.viscosity else math.inf
            ambient = self.ambient if kind.gas else 0.0
            rows.append((lightness, math.sqrt(lightness), min(fluidity, 1 / STIFF), ambient))
        return np.ascontiguousarray(np.array(rows).T)


def kind_of(fluid: Fluid) -> Kind:
    """What a fluid is."""
    return Kind(fluid.density, fluid.dynamic_viscosity, fluid.gas)


def liquids_of(config: SphConfig) -> Liquids:
    """The liquids and gases of a case, in an order that does not depend on that of its fluids."""
    kinds = tuple(sorted({kind_of(fluid) for fluid in config.fluid}))
    density = max((kind.density for kind in kinds), default=1000.0)
    viscosity = max((kind.viscosity for kind in kinds), default=0.0)
    ambient = config.eos.ambient_pressure / (density * (config.eos.sound_speed or 1.0) ** 2)
    return Liquids(density, viscosity, kinds, ambient)
