"""The ways in which a wall may act on fluid, as cases name them in wall.type."""

from dataclasses import dataclass


@dataclass(frozen=True)
class WallRule:
    """A wall shows images of the fluid, or it is made of particles.

    face_images: mirrored in its faces, with opposite velocity. layer_images: by point symmetry about a layer of
    centres. repulsive: one layer of particles pushes along its normal. own_density: layers of particles that take part
    in the sums of pressure and continuity; these may have any shape, the others need flat faces.
    """

    text: str
    face_images: bool = False
    layer_images: bool = False
    repulsive: bool = False
    own_density: bool = False

    @property
    def images(self) -> bool:
        """Whether such a wall shows images of the fluid."""
        return self.face_images or self.layer_images

    @property
    def flat(self) -> bool:
        """Whether such a wall needs flat faces."""
        return not self.own_density


WALL_RULES = {
    "mirror-no-slip": WallRule("mirrored particles of opposite velocity (Morris)", face_images=True),
    "point-symmetric-free-slip": WallRule("particles mirrored about a layer (Ferrari)", layer_images=True),
    "repulsive": WallRule("normal force (SC 8-10) and viscous term", repulsive=True),
    "pressure-continuity": WallRule("wall particles with evolving density", own_density=True),
}
