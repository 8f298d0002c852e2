"""The particles of an SPH run as others see them: of this rank, absolute, in physical order of axes."""

from numpy.typing import NDArray

from hpcpic.core.files.arrays import ParticleArray
from hpcpic.core.run.worst import worst_particles
from hpcpic.core.space.shapes import in_three
from sph.particles.pair_sums import PairSums
from sph.particles.storage import Slots, Storage
from sph.physics.smoothing import SMOOTHING

UNITS = {"velocity": "m/s", "pressure": "Pa", "density": "kg/m3"}


def particles(storage: Storage, sums: PairSums | None = None) -> dict[str, ParticleArray]:
    """Position, velocity, pressure, density, mass of each fluid, of what each inlet has made, and of walls if asked;
    with `sums`, which are lost, the moments of the kernel.
    """
    scene, slots = storage.scene, storage.fluid_slots
    kinds, names = scene.kinds(storage.numbers(slots)), [fluid.section.name for fluid in scene.fluids]
    names += [inlet.name for inlet in scene.inlets]
    chosen = {name: slots[kinds == k] for k, name in enumerate(names)}
    if scene.config.output.walls:
        kind = storage.own_values("wall")
        chosen |= {
            wall.name: storage.own_slots[kind == wall.index + 1] for wall in scene.walls if wall.lattice is not None
        }
    if sums:
        sums.add_moments()
    found, units = {}, UNITS | {"mass": "kg/m" if scene.dimensions == 2 else "kg"}
    for name, slots in chosen.items():
        own = particles_at(storage, slots)
        columns = {
            "velocity": in_three(own["v"]),
            "pressure": scene.eos.pressure(own["drho"]) + scene.eos.background - scene.untold,
            "density": own["relative"] * own["dense"],
            "mass": own["m"],
        }
        if sums:
            columns |= moments(storage, sums, slots, is_fluid=name in names)
        found[name] = ParticleArray(own["id"], in_three(own["x"]), columns, units, kept_single=True)
    return found


def moments(storage: Storage, sums: PairSums, slots: Slots, is_fluid: bool) -> dict[str, NDArray]:
    """Moments of the kernel in units of h, at walls those over the fluid before them: (MP 12) of W moment_0[n], 1 where
    it reproduces constants, and moment_1[n, 3], 0 where lines too; (MP 13) of its gradient slope_0[n, 3], 0, and the
    rows slope_1x .. [n, 3] of the identity.
    """
    scene, found = storage.scene, sums.moments_at(slots)
    if is_fluid:
        rest = storage.m[slots] / storage.relative_density(slots)
        own = rest / storage.compressed_density(slots) / scene.h**scene.dimensions
        found["m0"] += own * SMOOTHING[scene.kernel].value(0.0, scene.dimensions)
    rows = {f"slope_1{axis}": in_three(found["slope1"][:, k]) for k, axis in enumerate("xyz"[: scene.dimensions])}
    return {"moment_0": found["m0"], "moment_1": in_three(found["m1"]), "slope_0": in_three(found["slope0"])} | rows


def worst(storage: Storage) -> list[str]:
    """Lines on the worst particles of this rank."""
    return worst_particles(particles(storage))


def particles_at(storage: Storage, slots: Slots) -> dict[str, NDArray]:
    """The particles in some slots: id[n], x[n, d] m, v[n, d] m/s, m[n] kg; relative[n], rho0 of their liquids over that
    of the reference liquid; in terms of this one density dense[n] kg/m3 and mass rest[n] kg, and drho[n] = rho - rho0
    kg/m3 that it has at the same pressure; which are gas[n].
    """
    found: dict[str, NDArray] = {name: storage.physical(name, slots) for name in ("x", "v")}
    found["id"], relative = storage.numbers(slots), storage.relative_density(slots)
    found |= {"drho": storage.drho[slots], "m": storage.m[slots], "relative": relative}
    found |= {"dense": storage.compressed_density(slots), "gas": storage.is_gas(slots)}
    return found | {"rest": found["m"] / relative}
