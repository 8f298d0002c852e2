"""The particles of an SPH run as others see them: of this rank, absolute, in physical order of axes."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.files.arrays import ParticleArray
from hpcpic.core.run.worst import worst_particles
from sph.particles.storage import Slots, Storage

UNITS = {"velocity": "m/s", "pressure": "Pa", "density": "kg/m3", "mass": "kg"}


def particles(storage: Storage) -> dict[str, ParticleArray]:
    """Position, velocity, pressure, density, mass of each fluid, of what each inlet has made, and of walls if asked."""
    scene, slots = storage.scene, storage.fluid_slots
    kinds, names = scene.kinds(storage.numbers(slots)), [fluid.section.name for fluid in scene.fluids]
    names += [inlet.name for inlet in scene.inlets]
    chosen = {name: slots[kinds == k] for k, name in enumerate(names)}
    if scene.config.output.walls:
        kind = storage.own_values("wall")
        chosen |= {
            wall.name: storage.own_slots[kind == wall.index + 1] for wall in scene.walls if wall.lattice is not None
        }
    found = {}
    for name, slots in chosen.items():
        own = particles_at(storage, slots)
        columns = {
            "velocity": three(own["v"]).astype(np.float32),
            "pressure": (scene.eos.pressure(own["drho"]) + scene.eos.background).astype(np.float32),
            "density": (scene.rho0 + own["drho"]).astype(np.float32),
            "mass": own["m"].astype(np.float32),
        }
        found[name] = ParticleArray(own["id"], three(own["x"]), columns, UNITS)
    return found


def worst(storage: Storage) -> list[str]:
    """Lines on the worst particles of this rank."""
    return worst_particles(particles(storage))


def particles_at(storage: Storage, slots: Slots) -> dict[str, NDArray]:
    """The particles in some slots: id[n], x[n, d] m, v[n, d] m/s, drho[n] = rho - rho0 kg/m3, m[n] kg."""
    found = {"x": storage.physical("x", slots), "v": storage.physical("v", slots), "id": storage.numbers(slots)}
    return found | {"drho": storage.drho[slots], "m": storage.m[slots]}


def three(x: NDArray) -> NDArray[np.float64]:
    """x[n, d] with zeros behind: [n, 3]."""
    return np.pad(x, ((0, 0), (0, 3 - x.shape[1])))
