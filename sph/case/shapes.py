"""The shapes of fluids and walls, as a case says them. SI units; vectors are in physical order (x, y(, z))."""

from hpcpic.core.case.schema import REQUIRED, Points, Section, Vector, setting
from sph.case.bodies import Names


class Box(Section):
    low: Vector = setting(REQUIRED, "lower corner", "m")
    high: Vector = setting(REQUIRED, "upper corner", "m")
    open: Names = setting((), 'faces of a wall that are left out, as "z+"')


class Sphere(Section):
    centre: Vector = setting(REQUIRED, "centre", "m")
    radius: float = setting(REQUIRED, "radius; a disc in 2D", "m", gt=0)


class Cylinder(Section):
    base: Vector = setting(REQUIRED, "middle of the lower end", "m")
    top: Vector = setting(REQUIRED, "middle of the upper end", "m")
    radius: float = setting(REQUIRED, "radius; a strip in 2D", "m", gt=0)


class Polygon(Section):
    corners: Points = setting(REQUIRED, "corners in turn, three or more, in 2D; the last is joined to the first", "m")


class Plane(Section):
    point: Vector = setting(REQUIRED, "a point of the plane", "m")
    normal: Vector = setting(REQUIRED, "direction away from the solid, into the fluid")


class Stl(Section):
    file: str = setting(REQUIRED, "closed surface in an STL file, beside the case file")
    sha256: str = setting("", "digest of the file, by which another one is refused; by default that of the file")
    scale: float = setting(1.0, "metres per unit of the file", gt=0)
    shift: Vector = setting((), "moved by this after scaling", "m")


class Shape(Section):
    box: Box | None = None
    sphere: Sphere | None = None
    cylinder: Cylinder | None = None
    polygon: Polygon | None = None
    plane: Plane | None = None
    stl: Stl | None = None

    @property
    def kind(self) -> str:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        return given[0] if len(given) == 1 else ""

    @property
    def radius(self) -> float:
        """Radius of a ball or a cylinder, m; 0 of other shapes."""
        found = self.sphere or self.cylinder
        return found.radius if found else 0.0

    @property
    def dimensions(self) -> int:
        """Components of its points; 0 where it has none."""
        points = self.box and self.box.low, self.sphere and self.sphere.centre, self.cylinder and self.cylinder.base
        found = (*points, self.polygon and (0.0, 0.0), self.plane and self.plane.point, self.stl and (0.0,) * 3)
        return next((len(point) for point in found if point), 0)
