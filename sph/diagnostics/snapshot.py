"""The particles of an SPH run as others see them: of this rank, absolute, in physical order of axes."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.files.arrays import ParticleArray
from hpcpic.core.run.worst import worst_particles
from sph.kernels.marks import CODES

if TYPE_CHECKING:
    from sph.step import Sph

UNITS = {"velocity": "m/s", "pressure": "Pa", "density": "kg/m3", "mass": "kg"}


def particles(sph: "Sph") -> dict[str, ParticleArray]:
    """Position, velocity, pressure, density, mass of each fluid and, if asked, of the walls' particles."""
    scene, bodies = sph.scene, sph.bodies
    ids = bodies.key[bodies.fluid] // CODES
    chosen = {
        fluid.section.name: bodies.fluid[(ids >= fluid.first) & (ids < fluid.first + fluid.n)] for fluid in scene.fluids
    }
    if scene.config.output.walls:
        kind = bodies.own("wall")
        chosen |= {wall.name: bodies.rows[kind == wall.index + 1] for wall in scene.walls if wall.lattice is not None}
    background = scene.config.eos.background_pressure
    found = {}
    for name, rows in chosen.items():
        own = particles_at(sph, rows)
        columns = {
            "velocity": three(own["v"]).astype(np.float32),
            "pressure": (scene.pressure(own["drho"]) + background).astype(np.float32),
            "density": (scene.rho0 + own["drho"]).astype(np.float32),
            "mass": own["m"].astype(np.float32),
        }
        found[name] = ParticleArray(own["id"], three(own["x"]), columns, UNITS)
    return found


def worst(sph: "Sph") -> list[str]:
    """Lines on the worst particles of this rank."""
    return worst_particles(particles(sph))


def particles_at(sph: "Sph", rows: NDArray[np.int64]) -> dict[str, NDArray]:
    """Of bodies: id[n], x[n, d] m, v[n, d] m/s, drho[n] = rho - rho0 kg/m3, m[n] kg."""
    bodies = sph.bodies
    found = {"x": sph.physical("x", rows), "v": sph.physical("v", rows), "id": bodies.key[rows] // CODES}
    return found | {name: bodies.arena[name][rows] for name in ("drho", "m")}


def three(x: NDArray) -> NDArray[np.float64]:
    """[n, d] -> [n, 3]."""
    return np.pad(x, ((0, 0), (0, 3 - x.shape[1])))
