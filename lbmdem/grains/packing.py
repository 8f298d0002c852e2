"""Packings: grains of a size law, put in a box at random, grown to a porosity or settled under gravity.

Made by the grains' own dynamics, so the same for any ranks and threads; random numbers belong to a grain's number and
the seed. What was made is kept in the user's cache folder, under the hash of all that it depends on.
"""

import functools
import hashlib
import json
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError
from hpcpic.core.physics.contact_law import SHEAR_RATIO, ContactLaw, stable_step
from hpcpic.core.simd.caches import Store
from hpcpic.core.space.domain import Domain
from hpcpic.core.space.products import product
from hpcpic.core.space.rng import uniforms
from hpcpic.core.tasks.graph import Pool
from lbmdem.case.config import GrainSet, LbmDemConfig, contact_law
from lbmdem.grains.contact_network import energies, greatest_overlap, wall_force
from lbmdem.grains.dem import Dem
from lbmdem.physics.plane_walls import PlaneWall
from lbmdem.setup.overlap_survey import law_diameters, packed_space, packing_area, packing_ends, solid_volume

log = logging.getLogger("hpcpic.lbmdem")

VERSION = 2  # of the method: another one makes other packings
PLACES, SIZES = 11, 12  # streams of random numbers
START = 0.3  # of the final radii
TURNS = 1000  # in which grains that a place at random puts behind a plane get another
GROWTH, RELAXATION, STAGE = 300, 1500, 20  # stages of growth, at most of relaxation, steps in a stage
CALMING = 0.2  # alpha of grains that settle, at least: without a dashpot they ring for ever
TOUCHING, TOO_DEEP = 1e-3, 1e-2  # overlap / diameter that is accepted, and that is refused


@dataclass(frozen=True, slots=True)
class Sample:
    """Where grains go: between low and high (m) along the last axis, rigid there and at sides that are not periodic.

    gravity 0: grown in this space until the radii are right. Else, after that, settled with the law of contacts.
    planes: further ones, before which grains go; area: what those across an axis leave across the last one, m2.
    """

    radius: NDArray[np.float64]
    low: float
    high: float
    seed: int
    density: float = 1.0
    gravity: float = 0.0
    law: ContactLaw | None = None
    planes: tuple[PlaneWall, ...] = ()
    area: float = 0.0


def beta_diameters(
    n: int, low: float, high: float, a: float, b: float, seed: int, dimensions: int = 3
) -> NDArray[np.float64]:
    """Diameters [n] whose volume below d is the incomplete beta function of (d - low) / (high - low).

    Voivret et al. 2007 (cumulative volume fraction, area in 2D); the seed says which grain has which.
    """
    sizes = law_diameters(n, low, high, a, b, dimensions)
    return sizes[np.argsort(uniforms(seed, SIZES, np.arange(n), 1)[:, 0])]


def _columns(sample: Sample, x: NDArray) -> dict[str, NDArray]:
    n, d = x.shape
    r = sample.radius
    mass = sample.density * (math.pi * r**2 if d == 2 else 4.0 / 3.0 * math.pi * r * r * r)
    return {
        "x": x,
        "v": np.zeros((n, d)),
        "omega": np.zeros((n, 1 if d == 2 else 3)),
        "radius": r,
        "mass": mass,
        "inertia": (0.5 if d == 2 else 0.4) * mass * r**2,
        "fixed": np.zeros(n, bool),
    }


def _walls(domain: Domain, sample: Sample) -> list[PlaneWall]:
    """Planes, and rigid sides of the sample's space; those of the last axis are the last ones."""
    d = domain.ndim
    walls = list(sample.planes)
    for axis in range(d):
        if domain.periodic[d - 1 - axis]:
            continue
        inward, length = np.eye(d)[axis], domain.lengths[d - 1 - axis]
        low, high = (sample.low, sample.high) if axis == d - 1 else (0.0, length)
        walls += [PlaneWall(tuple(low * inward), tuple(inward)), PlaneWall(tuple(high * inward), tuple(-inward))]
    return walls


def _scatter(domain: Domain, sample: Sample) -> NDArray[np.float64]:
    """Places [n, d] at random, for grains of the first size."""
    d = domain.ndim
    low, high = np.zeros(d), np.array(domain.lengths[::-1])
    low[-1], high[-1] = sample.low, sample.high
    n = len(sample.radius)
    rigid = ~np.array(domain.periodic[::-1]) * START * sample.radius[:, None]

    def places(rows: NDArray, turn: int) -> NDArray[np.float64]:
        u = uniforms(sample.seed, PLACES, rows + turn * n, d)
        return low + rigid[rows] + u * (high - low - 2.0 * rigid[rows])

    x = places(np.arange(n), 0)
    for turn in range(1, TURNS):
        gap = np.full(n, np.inf)
        for plane in sample.planes:
            gap = np.minimum(gap, product(x - plane.point, np.array(plane.normal) / math.hypot(*plane.normal)))
        behind = np.flatnonzero(gap < START * sample.radius)
        if not behind.size:
            return x
        x[behind] = places(behind, turn)
    raise ConfigError("a packing has too little space before the planes among the obstacles")


def grow(world: World, pool: Pool, domain: Domain, sample: Sample) -> NDArray[np.float64]:
    """Collective: places [n, d] of all grains at their full size, on all ranks.

    Small grains without friction grow and push each other away; then they relax. ConfigError when overlaps stay.
    """
    law = ContactLaw(1.0, damping=0.3)
    columns = _columns(replace(sample, density=1.0), _scatter(domain, sample))
    dem = Dem(world, pool, domain, columns, law, _walls(domain, sample))
    dt = 0.5 * stable_step(law, columns["radius"], columns["mass"], columns["inertia"])
    for stage in range(GROWTH + RELAXATION):
        left = max(0.0, 1.0 - (stage + 1) / GROWTH)
        own = dem.grains.columns
        own["row"][:, 4:7] *= 0.8
        if stage < GROWTH:
            own["row"][:, 3] = (1.0 - (1.0 - START) * left**1.5) * sample.radius[own["id"]]
            if stage == 0:
                own["force"][:] = 0.0
            dem.rebuild()
        dem.advance(dt, STAGE)
        if stage >= GROWTH and greatest_overlap(dem) < TOUCHING:
            break
    deepest = greatest_overlap(dem)
    if deepest > TOO_DEEP:
        raise ConfigError(
            f"the packing is denser than can be: grains overlap by {deepest:.1%} of a diameter at a porosity of "
            f"{porosity_of(domain, sample):.3f}; give them more space"
        )
    return everywhere(dem)


def settle(world: World, pool: Pool, domain: Domain, sample: Sample, x: NDArray) -> NDArray[np.float64]:
    """Collective: places [n, d] after falling from x[n, d] along the last axis until all rest, on all ranks.

    Friction has springs here whatever the law says, as the regularised law creeps, and contacts have dashpots.
    """
    assert sample.law is not None
    d, law = domain.ndim, sample.law
    law = law._replace(shear=law.shear or SHEAR_RATIO * law.stiffness, damping=max(law.damping, CALMING))
    columns = _columns(sample, x)
    down = (0.0,) * (d - 1) + (-sample.gravity,)
    dem = Dem(world, pool, domain, columns, law, _walls(domain, sample), down)
    dt = 0.3 * stable_step(law, columns["radius"], columns["mass"], columns["inertia"])
    steps = max(STAGE, math.ceil(0.1 * math.sqrt(2.0 * float(sample.radius.max()) / sample.gravity) / dt))
    small = 1e-5 * dem.total((dem.grains.mass * dem.grains.radius)[: dem.grains.n]) * sample.gravity
    fall = math.sqrt(2.0 * (sample.high - sample.low) / sample.gravity)
    for stage in range(10 * math.ceil(fall / (steps * dt)) + 100):
        dem.advance(dt, steps)
        if stage * steps * dt > 0.5 * fall:
            dem.grains.columns["row"][:, 4:7] *= 0.9
            if energies(dem)["kinetic"] < small:
                break
    if not domain.periodic[0]:
        weight = sample.gravity * dem.total(dem.grains.mass[: dem.grains.n])
        share = -float(wall_force(dem, len(dem.walls) - 2)[d - 1]) / weight
        log.info("the packing rests, its floor bears %.2f of its weight; a run begins without its friction", share)
    return everywhere(dem)


def everywhere(dem: Dem) -> NDArray[np.float64]:
    """Collective: places [number, d] of all grains in the order of ids, on all ranks."""
    grains = dem.grains
    ids = dem.world.gather_rows(grains.ids[: grains.n])
    x = dem.world.gather_rows(np.ascontiguousarray(grains.x[: grains.n]))
    content = None if ids is None or x is None else np.ascontiguousarray(x[np.argsort(ids)]).tobytes()
    return np.frombuffer(dem.world.bcast(content)).reshape(-1, grains.dimensions).copy()


def porosity_of(domain: Domain, sample: Sample) -> float:
    """Share of the sample's space that is empty."""
    d = domain.ndim
    space = (sample.area or float(np.prod(domain.lengths[1:]))) * (sample.high - sample.low)
    return 1.0 - solid_volume(sample.radius, d) / space


# ---- kept packings


def cached(
    world: World,
    facts: Mapping[str, object],
    made: Callable[[], NDArray],
    shape: Sequence[int],
    possible: Callable[[NDArray], bool],
) -> NDArray[np.float64]:
    """Collective: what `made()` (collective) gives for these facts, float64 of a shape; what was made before if that
    was kept, undamaged and possible.
    """
    text = json.dumps({"version": VERSION, **facts}, sort_keys=True)
    name = f"{hashlib.sha256(text.encode()).hexdigest()}.packing"
    content = world.bcast(_kept(name, shape, possible) if world.rank == 0 else None)
    if content:
        return np.frombuffer(content).reshape(shape).copy()
    values = np.ascontiguousarray(made(), np.float64)
    if world.rank == 0:
        _store().write(name, values.tobytes())
    return values


@functools.cache
def _store() -> Store:
    return Store("packings", "packings")


def _kept(name: str, shape: Sequence[int], possible: Callable[[NDArray], bool]) -> bytes:
    """Nothing where there is nothing to be used."""
    content = _store().read(name)
    if content is None:
        return b""
    if len(content) != 8 * math.prod(shape) or not possible(np.frombuffer(content).reshape(shape)):
        _store().damaged("no such packing can be")
        return b""
    log.info("the packing is that kept as %s", name)
    return content


def pack(world: World, pool: Pool, domain: Domain, sample: Sample) -> NDArray[np.float64]:
    """Collective: places [n, d] (m) of a sample, the same on all ranks; from the cache if it was made before."""
    facts = {
        "lengths": domain.lengths,
        "periodic": domain.periodic,
        "radii": hashlib.sha256(sample.radius.tobytes()).hexdigest(),
        "space": (sample.low, sample.high),
        "seed": sample.seed,
        "density": sample.density,
        "gravity": sample.gravity,
        "law": None if sample.law is None else list(sample.law),
    }
    if sample.planes:  # others keep the names under which they are kept
        facts["planes"] = [[*plane.point, *plane.normal] for plane in sample.planes]

    def made() -> NDArray[np.float64]:
        log.info("packing %d grains", len(sample.radius))
        x = grow(world, pool, domain, sample)
        return settle(world, pool, domain, sample, x) if sample.gravity > 0.0 else x

    def possible(x: NDArray) -> bool:
        """In the box, or just across a periodic side; not of nan."""
        across = 2.0 * float(sample.radius.max())
        return bool(np.all((x >= -across) & (x <= np.array(domain.lengths[::-1]) + across)))

    return cached(world, facts, made, (len(sample.radius), domain.ndim), possible)


def make(
    config: LbmDemConfig, grains: GrainSet, world: World, pool: Pool, domain: Domain
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Collective: places [n, d] and radii [n] (m) of a set of grains, the same on all ranks.

    With a porosity the grains fill the space from `low` to `high` (by default as high as the porosity says) without
    friction or gravity; without one they fall from a loose state and rest on each other, with the case's contacts.
    """
    assert grains.packing is not None and grains.diameters is not None
    d, law, seed = domain.ndim, grains.diameters, config.simulation.random_seed
    radius = 0.5 * beta_diameters(law.count, law.min, law.max, law.a, law.b, seed, d)
    (ends, tops), porosity = packing_ends(config, grains), grains.packing.porosity
    low, top = ends[-1], tops[-1]
    high = packed_space(config, grains, solid_volume(radius, d))
    wanted = grains.packing.high
    if porosity is not None and wanted is not None and abs(high - wanted) > 1e-3 * (high - low):
        raise ConfigError(
            f"{law.count} grains at a porosity of {porosity:g} reach up to {high:.6g} m, not to high = {wanted:g} m: "
            "leave high out, or change count or porosity"
        )
    if high > top * (1.0 + 1e-12):
        raise ConfigError(f"the packing reaches up to {high:.6g} m: its space ends at {top:g} m")
    given = [obstacle.shape.plane for obstacle in config.obstacle if obstacle.shape.plane is not None]
    planes = tuple(PlaneWall(plane.point, plane.normal) for plane in given if any(plane.normal[:-1]))
    area = packing_area(config, grains, high)
    sample = Sample(radius, low, min(high, top), seed, grains.density, planes=planes, area=area)
    if porosity is None:
        down = abs(config.gravity[-1]) or 9.81
        if config.fluid and config.liquid.density != grains.density:  # they rest under their weight less buoyancy
            down *= abs(1.0 - config.liquid.density / grains.density)
        sample = replace(sample, gravity=down, law=contact_law(config))
    return pack(world, pool, domain, sample), radius
