"""What holds liquids and stands in no equation here: surface tension, and walls that pull."""

import math
from collections.abc import Iterator

import numpy as np

from hpcpic.core.case.derived import Derived, judged
from sph.case import geometry
from sph.case.config import AXES, SphConfig
from sph.setup.flows import at_rest, depth
from sph.setup.scene import Scene
from sph.setup.tanks import free_surface

WATER = 0.0728  # N/m at 20 degrees Celsius (IAPWS 1994); oils have 0.02 to 0.04
MOST, TOLD = 0.02, 0.002  # of what moves the liquid; from where it is told


def surface_tension(config: SphConfig) -> Iterator[Derived]:
    """The pressure of a surface as curved as a liquid is thin (Young and Laplace), over the largest of those of its
    weight, its speed and its viscosity: one over a number of Bond, of Weber, or a capillary one.
    """
    if not free_surface(config) and len({fluid.density for fluid in config.fluid}) < 2:
        return
    g, v = math.hypot(*config.gravity), config.eos.max_velocity or 0.0
    for i, fluid in ((i, fluid) for i, fluid in enumerate(config.fluid) if not fluid.gas):
        sizes = zip(AXES, *geometry.bounds(fluid.shape))
        least = min((b - a for axis, a, b in sizes if axis not in config.domain.periodic), default=math.inf)
        drive = max(fluid.density * max(g * least, v * v), fluid.dynamic_viscosity * v / least if least else 0.0)
        share = WATER / (least * drive) if least * drive else 0.0
        if share > TOLD:
            source = f"that of water, {WATER:g} N/m, on L = {least:.3g} m, over p = {drive:.3g} Pa that moves it"
            yield judged(f"surface tension of {fluid.name}, which is left out", "sigma/(p L)", share,
                         limit=f"<= {MOST:g}", ok=share <= MOST, legal=True, key=("fluid", i, "shape"),
                         source=source,
                         cure="a larger scale: nothing here rounds drops, holds menisci or moves ripples")  # fmt: skip


def suction(scene: Scene) -> Iterator[Derived]:
    """Polygons of fluid at rest that reach higher under walls than their free surface, as in a siphon or a cup."""
    g = float(np.linalg.norm(scene.gravity))
    for i, fluid in enumerate(scene.fluids):
        section = fluid.section
        if not (g and fluid.n and section.shape.polygon and at_rest(section)):
            continue
        x = fluid.points(fluid.first + np.arange(fluid.n))
        lowest = section.density * g * float(depth(scene, section, x).min())
        if lowest < -section.density * g * scene.spacing:
            yield Derived(f"pressure of rest in {section.name} over its free surface", "p", lowest, "Pa", "0", "warn",
                          "walls do not pull: it falls there, as it would without the air's pressure",
                          "a shape that ends at its free surface", ("fluid", i, "shape"))  # fmt: skip
