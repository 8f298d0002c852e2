"""Forces of the thin films between grains that the lattice does not resolve.

Below a gap of a node or so no fluid node lies between two grains, and what the links miss is put in by lubrication
theory: the force at the gap less the force at the cut-off gap (Nguyen & Ladd, Phys. Rev. E 66 (2002) 046708; in this
form with a least gap, Simeonov & Calantoni, Int. J. Multiphase Flow 46 (2012) 38). SI or any other units alike.
"""

import math
from dataclasses import dataclass

CUT_OFF = 2.0 / 3.0  # nodes: where the resolved force begins to lag behind
ROUGHNESS = 1e-3  # least gap over the reduced radius: grains touch before theirs is zero


@dataclass(frozen=True, slots=True)
class Film:
    """The normal resistance of gaps below `cut_off` between grains in a fluid of dynamic viscosity `viscosity`.

    A film takes the force -resistance x (closing velocity along the normal), equal and opposite on both grains; no
    force beyond the cut-off and none while the grains overlap. 2D: per depth.
    """

    viscosity: float
    cut_off: float
    dimensions: int

    @classmethod
    def of_lattice(cls, viscosity: float, spacing: float, dimensions: int) -> "Film":
        """For a fluid on a lattice of that spacing."""
        return cls(viscosity, CUT_OFF * spacing, dimensions)

    def resistance(self, gap: float, radius: float) -> float:
        """Force over closing velocity at a gap; radius: the reduced one, a b / (a + b), or a at a plane wall.

        Spheres 6 pi mu R^2 / h, parallel cylinders 3 sqrt(2) pi mu (R / h)^(3/2), less that at the cut-off.
        """
        if not 0.0 <= gap < self.cut_off:
            return 0.0
        gap = max(gap, ROUGHNESS * radius)
        if self.dimensions == 3:
            return 6.0 * math.pi * self.viscosity * radius**2 * max(1.0 / gap - 1.0 / self.cut_off, 0.0)
        film = (radius / gap) ** 1.5 - (radius / self.cut_off) ** 1.5
        return 3.0 * math.sqrt(2.0) * math.pi * self.viscosity * max(film, 0.0)
