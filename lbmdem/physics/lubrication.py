"""Forces of the thin films between grains that the lattice does not resolve.

Below a gap of a node or so no fluid node lies between two grains, and what the links miss is put in by lubrication
theory: the force at the gap less the force at the cut-off gap (Nguyen & Ladd, Phys. Rev. E 66 (2002) 046708; in this
form with a least gap, Simeonov & Calantoni, Int. J. Multiphase Flow 46 (2012) 38). Links give less of the latter when
no node is left in the gap: of spheres, what they give beside a wall was measured against Brenner, Chem. Eng. Sci. 16
(1961) 242, with 10 and 20 nodes across (tests/validation). SI or any other units alike.

Two motions of the film are counted: squeezing, and for spheres shearing by surfaces that slide past each other, as
Ball & Melrose (Physica A 247 (1997) 444) separate them. At a plane what a sphere does by sliding and what by turning
are told apart (Goldman, Cox & Brenner, Chem. Eng. Sci. 22 (1967) 637): the fluid that a turning sphere pumps along
takes away three quarters of the force that its surface's velocity alone would make. Between spheres that is left out:
equal ones turn against each other too easily, with 1/8 instead of 1/5 of 8 pi mu a^3 ln(a / h).
"""

import math
from typing import Any, NamedTuple

from hpcpic.core.simd.formulas import maximum, minimum, select, sqrt

CUT_OFF = {2: 2.0 / 3.0, 3: 1.0 / 1.7}  # nodes: where the resolved force begins to lag behind
RESOLVED, GROWTH = 0.53, 0.55  # of a sphere's force at the cut-off: what links give at contact, more by gap / cut-off
SHEAR_CUT_OFF = 0.85  # of the cut-off: half a node
PLANE_COUPLING = 0.25  # of a sphere at a plane: torque by sliding over torque by turning; of the forces the inverse
STABLE = 0.2  # resistance x mobility x step: films all round a grain are stable below, as 4.5 of them count fully
MOST_SUBSTEPS = 1000  # in a step of the fluid, for films: a stiffer one is limited to what is stable
ROUGHNESS = 1e-3  # least gap over the reduced radius: grains touch before theirs is zero


class Film(NamedTuple):
    """The resistance of gaps below `cut_off` between grains in a fluid of dynamic viscosity `viscosity`.

    A film takes the force -resistance x (closing velocity along the normal), equal and opposite on both grains; no
    force beyond the cut-off and none while the grains overlap. 2D: per depth.
    """

    viscosity: float
    cut_off: float
    dimensions: int

    @classmethod
    def of_lattice(cls, viscosity: float, spacing: float, dimensions: int) -> "Film":
        """The film for a fluid on a lattice of that spacing."""
        return cls(viscosity, CUT_OFF[dimensions] * spacing, dimensions)

    def resistance(self, gap: float, radius: float) -> float:
        """Force over closing velocity at a gap; radius: the reduced one, a b / (a + b), or a at a plane wall."""
        return float(squeeze_resistance(self, gap, radius))

    def gap_of(self, resistance: float, radius: float) -> float:
        """The gap with this resistance: the inverse of `resistance` above the least gap."""
        if self.dimensions == 3:
            film = resistance / (6.0 * math.pi * self.viscosity * radius**2) * self.cut_off
            narrow = (math.hypot(RESOLVED + film, 2.0 * math.sqrt(GROWTH)) - RESOLVED - film) / (2.0 * GROWTH)
            wide = 1.0 / (1.0 + film)
            return self.cut_off * (narrow if RESOLVED + GROWTH * narrow < 1.0 else wide)
        film = resistance / (3.0 * math.sqrt(2.0) * math.pi * self.viscosity)
        return radius / ((radius / self.cut_off) ** 1.5 + film) ** (2.0 / 3.0)

    def shear_resistance(self, gap: float, first: float, second: float = math.inf) -> float:
        """Force over velocity of sliding of the surfaces of two spheres, or of one and a plane (Jeffrey & Onishi,
        J. Fluid Mech. 139 (1984) 261, the logarithm alone), less that at the cut-off; 0 in 2D. Where they touch it
        is that of the least gap, and acts at planes alone.
        """
        cut = SHEAR_CUT_OFF * self.cut_off
        if self.dimensions == 2 or not gap < cut:
            return 0.0
        size, reduced = 2.0 * first, first
        if math.isfinite(second):
            size = first * second * (2.0 * (first**2 + second**2) + first * second) / (first + second) ** 3
            reduced = first * second / (first + second)
        return max(0.0, sheared_spheres(self, size, math.log(cut / max(gap, ROUGHNESS * reduced))))


def squeeze_resistance(film: Film, gap: Any, radius: Any) -> Any:
    """Force over closing velocity at a gap; 0 beyond the cut-off and below contact. radius: see Film.resistance.

    Spheres 6 pi mu R^2 / h, parallel cylinders 3 sqrt(2) pi mu (R / h)^(3/2), less what links give of that.
    """
    h = maximum(gap, radius * ROUGHNESS)
    if film.dimensions == 2:
        near, far = radius / h, radius / film.cut_off
        found = (near * sqrt(near) - far * sqrt(far)) * (3.0 * math.sqrt(2.0) * math.pi * film.viscosity)
    else:
        given = minimum(RESOLVED + GROWTH / film.cut_off * h, 1.0)
        found = radius * radius * (6.0 * math.pi * film.viscosity) * (1.0 / h - given / film.cut_off)
    return select((gap >= 0.0) & (found > 0.0), found, 0.0)


def sheared_spheres(film: Film, size: Any, logarithm: Any) -> Any:
    """4/15 6 pi mu a ln(h_c / h) of two spheres that slide; size: a x their function of the ratio of radii."""
    return size * (4.0 / 15.0 * (6.0 * math.pi * film.viscosity)) * logarithm


def sheared_at_plane(resistance: Any, sliding: Any, turning: Any) -> Any:
    """Force of the sheared film on a sphere at a plane, and the force whose moment on its radius is the torque.

    resistance: of a sphere that slides without turning; sliding: velocity of the plane less that of the centre;
    turning: velocity of the sphere's surface against its centre where they meet; both along the plane, vectors.
    """
    c, (ux, uy, uz), (wx, wy, wz) = PLANE_COUPLING, sliding, turning
    force = resistance * (ux - c * wx), resistance * (uy - c * wy), resistance * (uz - c * wz)
    return force, (resistance * (c * ux - wx), resistance * (c * uy - wy), resistance * (c * uz - wz))
