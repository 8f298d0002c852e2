"""What a case makes the program do and hold: sums, arrays and messages of a step, before anything is allocated."""

import math

import numpy as np

from hpcpic.core.app.forecast import imports, listed
from hpcpic.core.space.declared import Array
from sph.case import config as case
from sph.case import geometry
from sph.case.config import SphConfig, shapes_of
from sph.particles.arrays import arrays_of
from sph.physics.fluxes import FLUXES
from sph.physics.integrators import INTEGRATORS
from sph.physics.stability import support_of
from sph.physics.viscosities import viscosity_of
from sph.physics.wall_rules import rule_of
from sph.setup.pair_numbers import pair_spec_of
from sph.setup.scene import AHEAD, Scene, Wall

MIB = 2.0**20
MOST_PLACES = 1e9  # of a lattice, which are looked at before a run: of triangles half an hour
MOST_COUNTED = 5e7  # beyond, particles are not counted one by one
FIXED_BYTES = 272_000  # of graphs, tables and heads of arrays: what runs of 10, 20 and 40 thousand particles have alike


def cell(config: SphConfig) -> float:
    """Room of a particle, m3, in 2D m2."""
    return config.numerics.spacing**config.dimensions


def places(config: SphConfig) -> dict[str, float]:
    """Places of lattices that are looked at to make fluids and walls, by name, without looking at any."""
    walls = [wall for wall in config.wall if not wall.shape.plane and (wall.body or not wall.shape.box)]
    filled: list[case.Fluid | case.Wall] = [*config.fluid, *walls]
    edges = {one.name: [b - a for a, b in zip(*geometry.bounds(one.shape))] for one in filled}
    return {name: math.prod(max(1.0, edge / config.numerics.spacing) for edge in ends) for name, ends in edges.items()}


def many(config: SphConfig) -> bool:
    """True if there are so many particles, or places for them, that counting them takes long."""
    n = places(config)
    return max(n.values(), default=0.0) > MOST_PLACES or sum(n[fluid.name] for fluid in config.fluid) > MOST_COUNTED


def counts(config: SphConfig) -> tuple[int, float]:
    """Fluid particles, at the end where they only come in, and those of the walls that are made around the fluid at t =
    0 (about).
    """
    if not config.fluid:
        return 0, 0.0
    if many(config):
        fluid = sum(geometry.volume(fluid.shape) for fluid in config.fluid)
        rigid = sum(geometry.volume(wall.shape) for wall in config.wall if wall.body)
        return round(fluid / cell(config)), rigid / cell(config)
    scene = Scene(config)
    low, high = _around_fluid(scene, AHEAD)
    made = [(wall, wall.layers if wall.rule.layered else 1) for wall in scene.walls if not wall.rule.images]
    grows = config.inlet and not (config.outlet or config.domain.outflow)
    n = round(scene.most_particles(config.simulation.end_time if grows else 0.0)) if config.inlet else scene.n_fluid
    return n, sum(layers * _of_faces(scene, wall, low, high) for wall, layers in made)


def images(config: SphConfig) -> float:
    """Images of the fluid at t = 0 in mirrors and periodic sides (about)."""
    if not config.fluid or many(config):
        return 0.0
    scene, reach = Scene(config), support_of(config) / config.numerics.spacing
    low, high = _around_fluid(scene, 1.0)
    faces = sum(_of_faces(scene, wall, low, high) for wall in scene.walls if wall.rule.images)
    edges = (high - low) / scene.spacing
    return reach * (faces + 2 * sum(math.prod(np.delete(edges, k)) for k in np.flatnonzero(scene.periodic)))


def _around_fluid(scene: Scene, supports: float) -> tuple[np.ndarray, np.ndarray]:
    """The box around the fluid and so many supports more."""
    boxes = np.array([geometry.bounds(fluid.shape) for fluid in scene.config.fluid])
    margin = supports * scene.support
    return boxes[:, 0].min(axis=0) - margin, boxes[:, 1].max(axis=0) + margin


def _of_faces(scene: Scene, wall: Wall, low: np.ndarray, high: np.ndarray) -> float:
    """Particles of one layer on the faces of a wall in a box."""
    d, box = scene.dimensions, wall.corners
    edges = np.minimum(high, box[1]) - np.maximum(low, box[0])
    faces = [k for k in range(d) for sign, at in (("-", box[0][k]), ("+", box[1][k]))
             if case.AXES[k] + sign in wall.closed and low[k] < at < high[k]]  # fmt: skip
    if wall.shape.plane:
        faces = faces[:1]
    return sum(math.prod(np.delete(edges, k).clip(0.0)) / scene.spacing ** (d - 1) for k in faces)


def sums(config: SphConfig) -> list[str]:
    """The pair sums of an evaluation: a term that a case does not have is not computed."""
    numerics, d = config.numerics, config.dimensions
    terms = [f"pressure and continuity  {d}D, {numerics.kernel}, {numerics.precision}"]
    flux = FLUXES[numerics.density_flux]
    if flux.formula:
        terms.append(f"density flux             {numerics.density_flux}, {numerics.flux_coefficient:g}")
    if "g" in flux.columns or numerics.gradient_correction:
        terms.append(f"renormalised gradient    {d * (d + 1) // 2} + {d} sums more")
    viscosity = viscosity_of(numerics.viscosity_form)
    if viscosity.physical:
        passes = ", two passes" if viscosity.sees_strain else ""
        terms.append(f"viscosity                {numerics.viscosity_form}{passes}")
    if numerics.artificial_viscosity:
        terms.append(f"artificial viscosity     alpha {numerics.artificial_viscosity:g}")
    if numerics.tensile_correction:
        terms.append(f"tensile correction       {numerics.tensile_correction:g}")
    kinds = dict.fromkeys(rule_of(wall.type).text for wall in config.wall)
    return terms + [f"walls                    {text}" for text in kinds]


def arrays(config: SphConfig, ranks: int) -> list[Array]:
    """The arrays of one rank that grow with its particles, an eighth more for ghosts and room to grow. Those of sorting
    are left out: they share the larger memory of the pair sums.
    """
    n = math.ceil(1.125 * (sum(counts(config)) + images(config)) / ranks)
    spec = pair_spec_of(config, bool(config.wall or config.domain.periodic))
    declared = arrays_of(spec, INTEGRATORS[config.simulation.integrator].staged)
    return [
        *(array.sized({"slots": n}) for array in declared if "slots" in array.shape and array.phase != "sort"),
        Array("objects of Python and libraries", (FIXED_BYTES,), "uint8"),
        Array("state in order, for files and gauges", (2 * config.dimensions + 3, n), "float64"),
    ]


def messages(ranks: int) -> list[str]:
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
    lines = [*listed("sums of an evaluation", sums(config)), "arrays per rank"]
    for array in arrays(config, ranks):
        *columns, n = map(int, array.shape)
        name = f"{array.name:<12}{array.text[:60]}" if array.text else array.name
        lines.append(f"  {name:<74}{math.prod(columns):>3} x {n:<12}{array.bytes / MIB:10.2f} MiB")
    lines += listed("messages of a step, per rank", messages(ranks))
    solids = any(shape.stl for shape in shapes_of(config))
    return lines + imports(*["trimesh"] * solids)
