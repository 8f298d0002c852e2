"""The particles of an SPH run as others see them: of this rank, absolute, in physical order of axes."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.files.arrays import ParticleArray

if TYPE_CHECKING:
    from sph.step import Sph

UNITS = {"velocity": "m/s", "pressure": "Pa", "density": "kg/m3", "mass": "kg"}


def particles(sph: "Sph") -> dict[str, ParticleArray]:
    """Position, velocity, pressure, density, mass of each fluid and, if asked, of the walls' particles."""
    scene, own = sph.scene, own_particles(sph)
    chosen = {
        fluid.section.name: (own["id"] >= fluid.first) & (own["id"] < fluid.first + fluid.n) for fluid in scene.fluids
    }
    if scene.config.output.walls:
        chosen |= {wall.name: own["kind"] == wall.index + 1 for wall in scene.walls if wall.lattice is not None}
    background = scene.config.eos.background_pressure
    found = {}
    for name, mask in chosen.items():
        drho = own["drho"][mask]
        columns = {
            "velocity": three(own["v"][mask]).astype(np.float32),
            "pressure": (scene.pressure(drho) + background).astype(np.float32),
            "density": (scene.rho0 + drho).astype(np.float32),
            "mass": own["m"][mask].astype(np.float32),
        }
        found[name] = ParticleArray(own["id"][mask], three(own["x"][mask]), columns, UNITS)
    return found


def own_particles(sph: "Sph") -> dict[str, NDArray]:
    """id[n], x[n, d] m, v[n, d] m/s, drho[n] = rho - rho0 kg/m3, m[n] kg, kind[n]: 0 fluid, 1 + index of a wall."""
    bodies = sph.bodies
    found = {"x": sph.physical("x"), "v": sph.physical("v"), "kind": bodies.own("wall")}
    return found | {name: bodies.own(name) for name in ("id", "drho", "m")}


def three(x: NDArray) -> NDArray[np.float64]:
    """[n, d] -> [n, 3]."""
    return np.pad(x, ((0, 0), (0, 3 - x.shape[1])))
