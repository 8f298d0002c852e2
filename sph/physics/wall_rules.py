"""The ways in which a wall may act on fluid, as cases name them in wall.type."""

from dataclasses import dataclass

from sph.physics.liquids import Liquids
from sph.physics.viscosities import Viscosity


@dataclass(frozen=True)
class WallRule:
    """A wall shows images of the fluid, or it is made of particles.

    face_images: mirrored in its faces, with opposite velocity. layer_images: by point symmetry about a layer of
    centres. repulsive: one layer of particles pushes along its normal. layered: layers of particles that take part in
    the sums of pressure and continuity; these may have any shape, the others need flat faces. extrapolated: their
    density follows from the fluid before them, and has no history of its own. slips: they have no friction.
    """

    text: str
    face_images: bool = False
    layer_images: bool = False
    repulsive: bool = False
    layered: bool = False
    extrapolated: bool = False
    slips: bool = False

    @property
    def images(self) -> bool:
        """Whether such a wall shows images of the fluid."""
        return self.face_images or self.layer_images

    def knows(self, viscosity: Viscosity) -> bool:
        """Whether walls go on with the stress of the fluid that this viscosity has."""
        return self.extrapolated or not viscosity.transposed

    def has_edges(self, rigid: bool, liquids: Liquids) -> bool:
        """Edges of such a wall let go of fluid (terms.let_go): not those of rigid bodies, nor among several fluids."""
        several = liquids.densities or liquids.viscosities or liquids.gases
        return self.extrapolated and not rigid and not several

    @property
    def flat(self) -> bool:
        """Whether such a wall needs flat faces."""
        return not self.layered


WALL_RULES = {
    "mirror-no-slip": WallRule("mirrored particles of opposite velocity (Morris)", face_images=True),
    "point-symmetric-free-slip": WallRule("particles mirrored about a layer (Ferrari)", layer_images=True),
    "repulsive": WallRule("normal force (SC 8-10) and viscous term", repulsive=True),
    "pressure-continuity": WallRule("wall particles with evolving density", layered=True),
    "extrapolated-free-slip": WallRule(
        "wall particles with the pressure of the fluid (Adami), free slip", layered=True, extrapolated=True, slips=True
    ),
    "extrapolated-no-slip": WallRule(
        "wall particles with the pressure of the fluid (Adami), no slip", layered=True, extrapolated=True
    ),
}


def rule_of(name: str | None) -> WallRule:
    """The rule of a wall of a completed case."""
    assert name is not None
    return WALL_RULES[name]
