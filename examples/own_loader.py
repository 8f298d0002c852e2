"""A loader of one's own: a ring of velocities about a magnetic field, which has no thermal spread and is not stable.

python examples/own_loader.py, or mpirun -n 2 python -m mpi4py examples/own_loader.py
"""

import numpy as np

import hpcpic
from hpcpic.plasma.case.config import Species
from hpcpic.plasma.setup.loaders import Batch, Loader, Population, register


class Ring(Loader):
    """Speeds equal to the drift along x, in directions spread evenly over the circle, by the golden angle."""

    name = "ring"

    def mean_velocities(self, batch: Batch) -> np.ndarray:
        angle = np.pi * (3.0 - np.sqrt(5.0)) * batch.index
        return batch.drift[0] * np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def populations(self, section: Species, axis: int) -> tuple[Population, ...]:
        return (Population(1.0, 0.0, section.drift_velocity[0] / np.sqrt(2.0)),)


register(Ring())

if __name__ == "__main__":
    case = hpcpic.Case(
        description="electrons on a ring of velocities across a magnetic field",
        simulation={"cycles": 100, "time_step": 0.1, "space_length": [16.0, 16.0]},
        grid={"points": [32, 32]},
        field={"magnetic": [0.0, 0.0, 2.0]},
        species=[
            {"name": "electrons", "particles": 20000, "charge": -1.0, "mass": 1.0, "plasma_frequency": 1.0,
             "init_method": "ring", "drift_velocity": [1.0, 0.0]},
        ],
    )  # fmt: skip

    with case.simulation(threads=1) as sim:
        sim.advance()
        v = np.asarray(sim.particles("electrons")["velocity"])
        energy, digest, rank = sim.scalars()["energy_kinetic"], sim.digest(), sim.rank

    if rank == 0:
        speed = np.hypot(v[:, 0], v[:, 1])
        print(f"kinetic energy {energy:.4g} J, speeds from {speed.min():.3f} to {speed.max():.3f} m/s")
        print(digest)
