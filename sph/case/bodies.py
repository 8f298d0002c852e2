"""What a case says of rigid bodies, of what they strike, and of what holds them."""

from typing import Annotated

from pydantic import BeforeValidator

from hpcpic.core.case.schema import REQUIRED, Section, Vector, as_tuple, setting

Names = Annotated[tuple[str, ...], BeforeValidator(as_tuple)]


class Contact(Section):
    restitution: float = setting(
        0.5, "speed after a collision over that before; of two bodies the lower one", ge=0.1, le=1
    )
    friction: float = setting(0.3, "Coulomb's coefficient; of two bodies the lower one", ge=0)
    overlap: float = setting(
        0.1, "spacings by which a corner goes into a wall that it meets at eos.max_velocity; of two bodies the lower "
        "one", gt=0, le=0.4,
    )  # fmt: skip


class Mooring(Section):
    at: Vector = setting(REQUIRED, "where it is fastened to the body, at t = 0", "m")
    anchor: Vector = setting(REQUIRED, "where it is fastened to the ground", "m")
    stiffness: float = setting(REQUIRED, "force per length that it is stretched", "N/m (2D: N/m2)", gt=0)
    length: float | None = setting(None, "without force; by default that at t = 0", "m", ge=0)
    damping: float = setting(0.0, "force per velocity with which it grows longer", "N s/m (2D: N s/m2)", ge=0)
    pushes: bool = setting(False, "a spring that pushes where it is short; by default a line, which only pulls")


class Hinge(Section):
    point: Vector = setting(REQUIRED, "point about which the body turns", "m")
    axis: Vector = setting((), "3D: direction of the axis through it")


class Body(Section):
    density: float = setting(REQUIRED, "mean density, from which mass and inertia follow", "kg/m3", gt=0)
    velocity: Vector = setting((), "of the centre of mass at t = 0", "m/s")
    angular_velocity: Vector = setting((), "at t = 0: three components, in 2D one", "rad/s")
    held: Names = setting(
        (), 'motions that no force changes, "x" along an axis, "rx" about it: it keeps the velocity of t = 0, as a '
        "driven rotor does its angular_velocity, and stays where that is 0"
    )  # fmt: skip
    contact: Contact = Contact()
    mooring: tuple[Mooring, ...] = ()
    hinge: Hinge | None = None
