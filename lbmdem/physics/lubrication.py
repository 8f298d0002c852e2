"""Forces of the thin films between grains that the lattice does not resolve.

Below a gap of a node or so no fluid node lies between two grains, and what the links miss is put in by lubrication
theory: the force at the gap less the force at the cut-off gap (Nguyen & Ladd, Phys. Rev. E 66 (2002) 046708; in this
form with a least gap, Simeonov & Calantoni, Int. J. Multiphase Flow 46 (2012) 38). Links give less of the latter when
no node is left in the gap. What they give beside a wall was measured with 10 and 20 nodes across (tests/validation):
of spheres against Brenner, Chem. Eng. Sci. 16 (1961) 242, of discs against Jeffrey & Onishi (below), in the mean of
places of the wall between nodes, of which it depends. SI or any other units alike.

Three motions of a film are counted: it is squeezed, it is sheared by surfaces that slide past each other, and it is
pumped along by surfaces that go the same way, each seen from where they meet. Without the first a film turns
R (s^2 + c p^2) into heat, with the velocity s of one surface against the other and the sum p of both; R and c follow
from Reynolds' equation: R = 2 pi mu r ln(1 / h) and c = 3/5 between spheres, pi mu (2 r / h)^(1/2) and 1 between discs,
with the reduced radius r. Of spheres these are the logarithms of Jeffrey & Onishi (J. Fluid Mech. 139 (1984) 261) for
any radii and of Goldman, Cox & Brenner (Chem. Eng. Sci. 22 (1967) 637) at a plane, of discs the limits of Jeffrey &
Onishi (Q. J. Mech. Appl. Math. 34 (1981) 129) at a plane.
"""

import math
from typing import Any, NamedTuple

from hpcpic.core.simd.formulas import maximum, minimum, select, sqrt

CUT_OFF = {2: 0.857, 3: 1.0 / 1.7}  # nodes: where the resolved force begins to lag behind
RESOLVED, GROWTH = 0.53, 0.55  # of a sphere's force at the cut-off: what links give at contact, more by gap / cut-off;
# of a disc's they give the share gap / cut-off
SHEAR_CUT_OFF, SHEAR_OF_DISCS = 0.85, 0.66  # of the cut-off: half a node, of discs 0.57 node
PUMPED = {2: 1.0, 3: 0.6}  # c: resistance to the sum of both surfaces' velocities, over that to their difference
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
        film = resistance / (3.0 * math.sqrt(2.0) * math.pi * self.viscosity * radius**1.5)
        gap = self.cut_off
        for _ in range(80):  # each is nearer by a third at least
            gap = (film + gap / self.cut_off * self.cut_off**-1.5) ** (-2.0 / 3.0)
        return gap

    def shear_resistance(self, gap: float, radius: float) -> float:
        """Force over velocity of surfaces that slide past each other and pump nothing; where grains touch that of the
        least gap. radius: the reduced one."""
        least = max(gap, ROUGHNESS * radius)
        if self.dimensions == 2:
            return max(0.0, float(sheared_discs(self, least, radius)))
        return max(0.0, sheared_spheres(self, radius, math.log(SHEAR_CUT_OFF * self.cut_off / least)))


def squeeze_resistance(film: Film, gap: Any, radius: Any) -> Any:
    """Force over closing velocity at a gap; 0 beyond the cut-off and below contact. radius: see Film.resistance.

    Spheres 6 pi mu R^2 / h, parallel cylinders 3 sqrt(2) pi mu (R / h)^(3/2), less what links give of that.
    """
    h = maximum(gap, radius * ROUGHNESS)
    if film.dimensions == 2:
        given, near, far = 1.0 / film.cut_off * h, radius / h, radius / film.cut_off
        found = (near * sqrt(near) - given * far * sqrt(far)) * (3.0 * math.sqrt(2.0) * math.pi * film.viscosity)
    else:
        given = minimum(RESOLVED + GROWTH / film.cut_off * h, 1.0)
        found = radius * radius * (6.0 * math.pi * film.viscosity) * (1.0 / h - given / film.cut_off)
    return select((gap >= 0.0) & (found > 0.0), found, 0.0)


def sheared_spheres(film: Film, radius: Any, logarithm: Any) -> Any:
    """2 pi mu r ln(h_c / h), given the logarithm; less than 0 beyond the cut-off h_c of shear."""
    return radius * (2.0 * math.pi * film.viscosity) * logarithm


def sheared_discs(film: Film, gap: Any, radius: Any) -> Any:
    """pi mu (2 r)^(1/2) (1 / h^(1/2) - 1 / h_c^(1/2)); less than 0 beyond the cut-off h_c of shear."""
    near, far = sqrt(2.0 * radius / gap), sqrt(2.0 / (SHEAR_OF_DISCS * film.cut_off) * radius)
    return (near - far) * (math.pi * film.viscosity)


def shear_mobility(c: float, d: Any, inverse: Any, turning: Any) -> Any:
    """What times the resistance R is not below the rate (1/s) at which s and p decay. c: PUMPED; d: see `sheared`;
    inverse: sum of the inverse masses; turning: of radius^2 / moment of inertia."""
    return (c * d * d + 1.0) * inverse + (c + 1.0) * turning


def sheared(resistance: Any, c: float, d: Any, s: Any, p: Any) -> Any:
    """Force on the first grain; lever and couple, whose moments at the radius give the torques; power turned into heat.

    s: velocity of the second surface less that of the first, p: the sum of both, in the frame that turns with the line
    of centres, vectors; c: PUMPED; d: (b - a)/(a + b) of the radii, 1 at a plane. With the normal n from the first to
    the second the torques are a n x (lever - couple) and b n x (lever + couple).
    """
    k = c * resistance
    f = k * d
    lever, couple = (resistance * s[0], resistance * s[1], resistance * s[2]), (k * p[0], k * p[1], k * p[2])
    force = lever[0] + f * p[0], lever[1] + f * p[1], lever[2] + f * p[2]
    heat = lever[0] * s[0] + lever[1] * s[1] + lever[2] * s[2]
    return force, lever, couple, couple[0] * p[0] + couple[1] * p[1] + couple[2] * p[2] + heat
