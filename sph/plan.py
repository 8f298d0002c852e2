"""What a case makes the program do and hold: sums, arrays and messages of a step, before anything is allocated."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from sph import geometry
from sph.config import SphConfig
from sph.scene import Scene

MIB = 2.0**20
WALL_TERMS = {
    "mirror-no-slip": "mirrored particles of opposite velocity (Morris)",
    "point-symmetric-free-slip": "particles mirrored about a layer (Ferrari)",
    "repulsive": "normal force (SC 8-10) and viscous term",
    "pressure-continuity": "wall particles with evolving density",
}


@dataclass(frozen=True, slots=True)
class Array:
    """Arrays of one rank: what they are for, values per particle, particles."""

    name: str
    columns: int
    n: float
    size: int = 8

    @property
    def bytes(self) -> float:
        return self.columns * self.n * self.size


def counts(config: SphConfig) -> tuple[int, float]:
    """Fluid particles, and those of walls that touch the fluid's box at t = 0 (about)."""
    scene = Scene(config)
    d, dp = config.dimensions, config.numerics.spacing
    if not config.fluid:
        return 0, 0.0
    boxes = [geometry.bounds(fluid.shape) for fluid in config.fluid]
    wet = 0.0
    for wall in scene.walls:
        if wall.lattice is None:
            continue
        layers = wall.layers if wall.type == "pressure-continuity" else 1
        box = wall.section.shape.box
        for low, high in boxes:
            edges = [max(b - a, dp) for a, b in zip(low, high)]
            faces = 2 * d - len(box.open) if box and not wall.section.solid else 1
            area = sum(math.prod(edges) / edge for edge in edges) / d * faces
            wet += layers * area / dp ** (d - 1)
    return scene.n_fluid, wet


def sums(config: SphConfig) -> list[str]:
    """The pair sums of an evaluation: a term that a case does not have is not computed."""
    numerics, d = config.numerics, config.dimensions
    terms = [f"pressure and continuity  {d}D, {numerics.kernel}, {numerics.precision}"]
    if numerics.density_flux != "none":
        terms.append(f"density flux             {numerics.density_flux}, {numerics.flux_coefficient:g}")
    if numerics.density_flux == "delta" or numerics.gradient_correction:
        terms.append(f"renormalised gradient    {d * (d + 1) // 2} + {d} sums more")
    if numerics.viscosity_form not in ("none", "artificial", None):
        passes = ", two passes" if numerics.viscosity_form == "strain-rate" else ""
        terms.append(f"viscosity                {numerics.viscosity_form}{passes}")
    if numerics.artificial_viscosity:
        terms.append(f"artificial viscosity     alpha {numerics.artificial_viscosity:g}")
    if numerics.tensile_correction:
        terms.append(f"tensile correction       {numerics.tensile_correction:g}")
    kinds = dict.fromkeys(wall.type for wall in config.wall)
    return terms + [f"walls                    {WALL_TERMS[kind]}" for kind in kinds]


def arrays(config: SphConfig, ranks: int) -> Iterator[Array]:
    """The arrays of one rank, a fifth more for ghosts and room to grow."""
    fluid, walls = counts(config)
    d, n = config.dimensions, 1.2 * (fluid + walls) / ranks
    yield Array("state: x, v, rho, m, id, kind", 2 * d + 4, n)
    yield Array("rates: a, drho/dt", d + 1, n)
    stages = {"euler": 0, "symplectic": 0}.get(config.simulation.integrator, 2 * d + 1)
    if stages:
        yield Array("state of the step before", stages, n)
    size = 8 if config.numerics.precision == "double" else 4
    yield Array("pair sums: operands and accumulators", 4 * d + 8, n, size)
    if config.numerics.density_flux == "delta" or config.numerics.gradient_correction:
        yield Array("renormalisation", d * (d + 1) // 2 + d, n)
    yield Array("cells and order", 3, n)


def messages(config: SphConfig, ranks: int) -> list[str]:
    if ranks == 1:
        return ["none: one rank sends no messages"]
    neighbours = min(2, ranks - 1)
    return [
        f"ghosts     {neighbours} per evaluation, the layer of cells beside each cut",
        f"particles  {neighbours}, with those that left the slab",
        "step       one number agreed by all ranks",
    ]


def plan(config: SphConfig, ranks: int, threads: int) -> list[str]:
    """Lines for `check --plan`."""
    lines = ["sums of an evaluation", *(f"  {line}" for line in sums(config)), "arrays per rank"]
    lines += [
        f"  {array.name:<40}{array.columns:>3} x {array.n:<12.0f}{array.bytes / MIB:10.2f} MiB"
        for array in arrays(config, ranks)
    ]
    return [*lines, "messages of a step, per rank", *(f"  {line}" for line in messages(config, ranks))]
