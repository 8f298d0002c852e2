"""Several liquids in one scene: how each differs from the reference liquid, in which pair sums compute.

The reference liquid has the largest rho0 and the largest mu of the scene. All liquids have its rho0 c0^2, so that the
pressure (MP 14) is the same function of e = rho / rho0 - 1 for all, and e goes on through an interface as pressure
does. The state holds e times the rho0 of the reference; sums take volumes at rest, m / rho0, times it for masses. What
is left of a liquid is its inertia and viscosity.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sph.case.config import Fluid, SphConfig

STIFF = 2.0**-60  # fluidity of walls: the harmonic mean with theirs is twice the viscosity of the fluid


@dataclass(frozen=True)
class Liquids:
    """rho0 kg/m3 and mu Pa s of the reference liquid, and those of the liquids, which have the numbers 1, 2, ..; one
    alone has the number 0, which is that of walls.
    """

    density: float
    viscosity: float
    kinds: tuple[tuple[float, float], ...]

    @property
    def several(self) -> bool:
        return len(self.kinds) > 1

    @property
    def densities(self) -> bool:
        """Whether they differ in density."""
        return len({density for density, _ in self.kinds}) > 1

    @property
    def viscosities(self) -> bool:
        """Whether they differ in viscosity."""
        return len({viscosity for _, viscosity in self.kinds}) > 1

    def number(self, fluid: Fluid) -> int:
        """The number of the liquid of a fluid."""
        return 1 + self.kinds.index(kind_of(fluid)) if self.several else 0

    def lightness(self, fluid: Fluid) -> float:
        """rho0 of the reference over that of a fluid."""
        return self.density / fluid.density

    @property
    def swiftest(self) -> float:
        """The largest sound speed of rest over that of the reference."""
        return math.sqrt(self.density / min((density for density, _ in self.kinds), default=self.density))

    @property
    def table(self) -> NDArray[np.float64]:
        """[3, number]: rho0 of the reference over that of a liquid; its sound speed over that of the reference; its
        fluidity 1 / mu over that of the reference.
        """
        rows = [(1.0, 1.0, STIFF)]
        for density, viscosity in self.kinds if self.several else ():
            lightness = self.density / density
            fluidity = self.viscosity / viscosity if viscosity else math.inf
            rows.append((lightness, math.sqrt(lightness), min(fluidity, 1 / STIFF)))
        return np.ascontiguousarray(np.array(rows).T)


def kind_of(fluid: Fluid) -> tuple[float, float]:
    """Density and viscosity of a fluid."""
    return fluid.density, fluid.dynamic_viscosity


def liquids_of(config: SphConfig) -> Liquids:
    """The liquids of a case, in an order that does not depend on that of its fluids."""
    kinds = tuple(sorted({kind_of(fluid) for fluid in config.fluid}))
    density, viscosity = (max(column) for column in zip(*kinds)) if kinds else (1000.0, 0.0)
    return Liquids(density, viscosity, kinds)
