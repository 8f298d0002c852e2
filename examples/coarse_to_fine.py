"""A coarse lattice steers a fine one: the steady flow in a cavity, from that of a coarser lattice instead of rest.

The lid drives the flow of Re = 100. The coarse lattice runs until it is steady; its velocity and pressure, interpolated
to the nodes of the fine one, are what that starts from. What is left to do is what the two differ by.

python examples/coarse_to_fine.py, or mpirun -n 2 python -m mpi4py examples/coarse_to_fine.py
"""

from typing import NamedTuple

import numpy as np
from mpi4py import MPI
from scipy.interpolate import PchipInterpolator

import lbmdem

SIDE, LID = 0.1, 1e-3  # m, m/s
COARSE, FINE = 32, 96  # nodes along a side
STEADY = 1e-3  # relative change of the kinetic energy from one look to the next
LOOK = 25.0  # s


def cavity(n: int, start: dict | None = None) -> lbmdem.Case:
    """With n x n nodes at the same relaxation time, so that both lattices have errors of second order in 1/n."""
    return lbmdem.Case(
        description="a cavity driven by its lid",
        simulation={"end_time": 1e5},
        domain={"size": [SIDE, SIDE], "spacing": SIDE / n},
        fluid={"kinematic_viscosity": 1e-6, "relaxation_time": 0.55, **({"start": start} if start else {})},
        boundary=[{"face": "y+", "type": "wall", "velocity": [LID, 0.0]}],
    )


class Flow(NamedTuple):
    """A steady flow: steps until nothing changed, kinetic energy (J/m), velocity and pressure [y, x], digest."""

    steps: int
    energy: float
    fields: dict[str, np.ndarray]
    digest: str


def steady(case: lbmdem.Case) -> Flow:
    with case.simulation(threads=1) as sim:
        before, energy = 0.0, 1.0
        while abs(energy - before) > STEADY * energy:
            before = sim.scalars()["energy_kinetic"]
            sim.advance(until=sim.time + LOOK)
            energy = sim.scalars()["energy_kinetic"]
        fields = {name: np.asarray(sim.fields(name)) for name in ("velocity", "pressure")}
        return Flow(sim.iteration, energy, fields, sim.digest())


def finer(values: np.ndarray, n: int, top: float | None) -> np.ndarray:
    """values[y, x] at n x n nodes; zero on walls, `top` on the lid; with no slope there if that is None."""
    for axis, ends in ((1, (0.0, 0.0)), (0, (0.0, top))):
        rows = np.moveaxis(values, axis, 0)
        edges = [rows[:1], rows[-1:]] if top is None else [np.full_like(rows[:1], end) for end in ends]
        x = np.concatenate([[0.0], (np.arange(len(rows)) + 0.5) / len(rows), [1.0]])
        line = PchipInterpolator(x, np.concatenate([edges[0], rows, edges[1]]))
        values = np.moveaxis(line((np.arange(n) + 0.5) / n), 0, axis)
    return values


coarse = steady(cavity(COARSE))
u, v = np.moveaxis(coarse.fields["velocity"], -1, 0)
velocity = np.stack([finer(u, FINE, LID), finer(v, FINE, 0.0)], -1)
fine = steady(cavity(FINE, {"velocity": velocity, "pressure": finer(coarse.fields["pressure"], FINE, None)}))
from_rest = steady(cavity(FINE))
work = fine.steps + coarse.steps * (COARSE / FINE) ** 2  # in steps of the fine lattice
difference = np.linalg.norm(fine.fields["velocity"] - from_rest.fields["velocity"])
apart = difference / np.linalg.norm(from_rest.fields["velocity"])
if MPI.COMM_WORLD.rank == 0:
    way = f"{coarse.steps} coarse ones and {fine.steps}"
    print(f"{from_rest.steps} steps from rest; or {way}: {from_rest.steps / work:.1f} times less work")
    print(f"velocities {100 * apart:.2f} % apart, energies {100 * abs(fine.energy / from_rest.energy - 1):.2f} %")
    print(fine.digest)
