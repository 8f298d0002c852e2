"""Initial states from arrays, one of each simulator: `start` takes them in place of a file of arrays (numpy.savez).

python examples/start_from_arrays.py, or mpirun -n 2 python -m mpi4py examples/start_from_arrays.py
"""

import numpy as np

import hpcpic
import lbmdem
import sph


def tell(sim: hpcpic.Simulation, text: str) -> None:
    digest = sim.digest()  # of all ranks together
    if sim.rank == 0:
        print(f"{text}\n{digest}")


random = np.random.default_rng(1)  # every rank makes the same arrays
length, n = 16.0, 5000
bunch = hpcpic.Case(
    description="a bunch of electrons in the middle of a box flies apart",
    simulation={"cycles": 70, "time_step": 0.1, "space_length": [length, length]},
    grid={"points": [32, 32]},
    species=[
        {"name": "electrons", "charge": -1.0, "mass": 1.0, "plasma_frequency": 1.0,
         "start": {"position": random.normal(length / 2, 1.0, (n, 2)), "velocity": np.zeros((n, 2))}},
    ],
)  # fmt: skip
with bunch.simulation(threads=1) as sim:
    sim.advance()
    tell(sim, f"widths of the bunch {np.asarray(sim.particles()['position']).std(axis=0)} m")

at_rest = sph.Case("water-column").changed({"numerics.spacing": 0.02, "simulation.end_time": 0.02})
with at_rest.simulation(threads=1) as sim:  # where its particles are, in the order of their numbers
    x = np.asarray(sim.particles("water")["position"])[:, :2]
turning = at_rest.changed({"fluid[0].start": {"velocity": np.stack([x[:, 1], -x[:, 0]], axis=1)}})
with turning.simulation(threads=1) as sim:
    sim.advance()
    tell(sim, f"speeds up to {np.linalg.norm(sim.particles('water')['velocity'], axis=1).max():.2f} m/s")

height = (np.arange(40) + 0.5) / 40  # of the nodes, over that of the box
velocity = np.zeros((40, 40, 2))  # [y, x, component], as fields are read
velocity[:, :, 0] = 1e-3 * np.sin(2 * np.pi * height)[:, None]
shear = lbmdem.Case(
    description="two discs in a shear flow",
    simulation={"end_time": 0.01},
    domain={"size": [0.01, 0.01], "spacing": 0.00025, "periodic": ["x", "y"]},
    fluid={"kinematic_viscosity": 1e-6, "relaxation_time": 0.52, "start": {"velocity": velocity}},
    grains=[
        {"name": "discs", "density": 1000.0,
         "start": {"position": [[0.003, 0.003], [0.007, 0.007]], "diameter": [0.002, 0.0025],
                   "velocity": [[1e-3, 0.0], [-1e-3, 0.0]]}},
    ],
)  # fmt: skip
with shear.simulation(threads=1) as sim:
    sim.advance()
    tell(sim, f"the discs turn at {np.asarray(sim.particles()['angular_velocity'])[:, 2]} rad/s")
