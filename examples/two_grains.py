"""Two discs fall side by side in a tall box of water and drift apart: their paths, as an observer follows them.

python examples/two_grains.py [FOLDER], or mpirun -n 2 python -m mpi4py examples/two_grains.py [FOLDER]: the figure is
FOLDER/paths.png. `lbmdem show settling-disc` lists the keys of a case.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import lbmdem

WIDTH, HEIGHT = 0.02, 0.08  # m
disc = {"diameter": 2e-3, "density": 1010.0}
case = lbmdem.Case(
    description="two discs fall side by side",
    simulation={"end_time": 1.5},
    domain={"size": [WIDTH, HEIGHT], "spacing": 2e-4},
    fluid={"density": 1000.0, "kinematic_viscosity": 1e-6, "relaxation_time": 0.6},
    grains=[
        {"name": "left", "position": [0.008, 0.07], **disc},
        {"name": "right", "position": [0.012, 0.07], **disc},
    ],
    gravity=[0.0, -9.81],
)
paths: dict[str, list[np.ndarray]] = {"left": [], "right": []}  # x, y at each look

with case.simulation(threads=1) as sim:

    @sim.every(seconds=0.02)
    def follow(sim: lbmdem.Simulation) -> None:
        for name, path in paths.items():
            path.append(sim.particles(name)["position"].values[0, :2])

    sim.advance()
    digest, rank = sim.digest(), sim.rank

if rank == 0:
    left, right = (1e3 * np.array(path) for path in paths.values())  # in mm
    mirrored = np.stack([1e3 * WIDTH - right[:, 0], right[:, 1]], axis=1)
    print(f"{right[0, 0] - left[0, 0]:.2f} mm apart at the start, {right[-1, 0] - left[-1, 0]:.2f} mm at the end")
    print(f"the paths mirror each other within {np.abs(left - mirrored).max():.1g} mm")
    print(digest)

    figure = Figure(figsize=(4.4, 3.4), layout="constrained")
    axis = figure.subplots()
    for name, path in (("left", left), ("right", right)):
        axis.plot(path[:, 0], path[:, 1], label=name)
    axis.set(xlabel="x, mm", ylabel="y, mm", xlim=(0, 1e3 * WIDTH), aspect="equal", title="two discs, side by side")
    axis.legend()
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "paths.png")
