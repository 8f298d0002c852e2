"""A tenth of the electrons are a beam: how fast the wave grows, beside the theory of cold beams.

python examples/beam_in_a_plasma.py, or mpirun -n 2 python -m mpi4py examples/beam_in_a_plasma.py
"""

import numpy as np

import hpcpic

cells = 64  # with as many particles in each, at rest and fast; omega_p = 1 rad/s, the beam's v = 1 m/s, k = 1 rad/m
even = [(np.arange(n) + 0.5) * 2 * np.pi / n for n in (cells * 90, cells * 10)]
x, v = np.concatenate(even), np.repeat([0.0, 1.0], [len(places) for places in even])
case = hpcpic.Case(
    simulation={"cycles": 800, "time_step": 0.05, "space_length": [2 * np.pi]},
    grid={"points": [cells]},
    species=[{"name": "electrons", "charge": -1.0, "mass": 1.0, "plasma_frequency": 1.0,
              "start": {"position": (x + 1e-5 * np.sin(x))[:, None], "velocity": v[:, None]}}],
)  # fmt: skip
time, wave = np.zeros(800), np.zeros(800)
with case.simulation(threads=1) as sim:
    for n in range(800):
        sim.step()
        time[n], wave[n] = sim.time, sim.scalars()["mode_1"]  # V/m, of E_x
    digest, rank = sim.digest(), sim.rank
growth = np.polyfit(time[480:], np.log(wave[480:]), 1)[0]  # while the wave is small, and the fastest one alone
rest, fast = np.poly1d([1, 0]) ** 2, np.poly1d([1, -1]) ** 2  # omega^2 and (omega - k v)^2
theory = (rest * fast - 0.9 * fast - 0.1 * rest).roots.imag.max()  # 1 = 0.9 / omega^2 + 0.1 / (omega - k v)^2
if rank == 0:
    print(f"growth {growth:.4f} 1/s, theory {theory:.4f} 1/s\n{digest}")
