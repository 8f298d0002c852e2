"""A dam break written in Python: the keys are those of a case file, `sph show water-column` lists them.

python examples/build_a_case.py, or mpirun -n 2 python -m mpi4py examples/build_a_case.py
"""

import sph

spacing = 0.02
case = sph.Case(
    description="half a metre of water in a tank of a metre",
    simulation={"dimensions": 2, "end_time": 0.1},
    numerics={"spacing": spacing},
    gravity=[0.0, -9.81],
    fluid=[{"name": "water", "shape": {"box": {"low": [0.0, 0.0], "high": [0.5, 0.5]}}}],
    wall=[{"name": "tank", "shape": {"box": {"low": [0.0, 0.0], "high": [1.0, 0.8], "open": ["y+"]}}}],
)
print(case.check())

front: list[tuple[float, float]] = []  # time, farthest particle, by the observer

with case.simulation(threads=1) as sim:

    @sim.every(seconds=0.02)
    def follow_the_front(sim: sph.Simulation) -> None:
        front.append((sim.time, float(sim.particles("water")["position"][:, 0].max())))

    sim.advance()
    digest = sim.digest()
    rank = sim.rank

if rank == 0:
    for time, x in front:
        print(f"{time:.3f} s  {x:.3f} m")
    print(digest)
