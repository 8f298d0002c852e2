"""Forces of one's own, as accelerations by place, velocity and time, on each simulator's particles.

python examples/own_force.py, or name `acceleration = "spring"` in a case and run it with --use examples/own_force.py
"""

import numpy as np

import hpcpic
import lbmdem
import sph
from hpcpic.core.case.accelerations import register


def spring(x, v, t):
    """Pulls towards the middle of a box of 1 m, 100 per s2 times the distance; compiled into the step."""
    return -100.0 * (x[0] - 0.5), -100.0 * (x[1] - 0.5), 0.0


def tide(x, v, t):
    """Swings along x, damped by a drag."""
    return np.sin(10.0 * t) - 0.5 * v[0], 0.0, 0.0


register("spring", spring)
register("tide", tide)


def tell(sim: hpcpic.Simulation, text: str) -> None:
    digest = sim.digest()  # of all ranks together
    if sim.rank == 0:
        print(f"{text}\n{digest}")


if __name__ == "__main__":
    ions = hpcpic.Case(
        description="two ions in a trap",
        simulation={"cycles": 200, "time_step": 0.001, "space_length": [1.0, 1.0]},
        grid={"points": [16, 16]},
        species=[{"name": "ions", "charge": 1e-9, "mass": 1.0, "acceleration": "spring",
                  "start": {"position": [[0.7, 0.5], [0.5, 0.6]], "velocity": np.zeros((2, 2))}}],
    )  # fmt: skip
    with ions.simulation(threads=1) as sim:
        sim.advance()
        x = np.asarray(sim.particles()["position"])[:, 0]
        tell(sim, f"ion at {x[0]:.4f} m, a spring has it at {0.5 + 0.2 * np.cos(10.0 * sim.time):.4f} m")

    water = sph.Case("water-column").changed(
        {"numerics.spacing": 0.02, "simulation.end_time": 0.02, "fluid[0].acceleration": "tide"}
    )
    with water.simulation(threads=1) as sim:
        sim.advance()
        tell(sim, f"the water's mean velocity is {float(sim.particles('water')['velocity'][:, 0].mean()):.4g} m/s")

    ball = lbmdem.Case(
        description="a ball on a spring",
        simulation={"end_time": 0.2},
        domain={"size": [1.0, 1.0]},
        grains=[{"name": "ball", "diameter": 0.1, "position": [0.7, 0.5], "acceleration": "spring"}],
    )
    with ball.simulation(threads=1) as sim:
        sim.advance()
        place = float(sim.particles()["position"][0, 0])
        tell(sim, f"ball at {place:.4f} m, a spring has it at {0.5 + 0.2 * np.cos(10.0 * sim.time):.4f} m")
