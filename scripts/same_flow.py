"""The same flow through lbmdem and through lbmpy (of the package index): velocities at every node.

    python scripts/same_flow.py [--environment FOLDER]

Both take two relaxation times on D2Q9, half-way walls and the same velocities at the start, in double. lbmpy's code is
generated, ours has another scheme of storage: what differs is rounding, and under the lid the density by which a
sliding wall multiplies what it adds (lbmpy: of the node; ours: of rest), so there by the square of the Mach number. It
is installed into an environment of its own, which is kept; a C++ compiler must be there.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
POINTS, STEPS = 64, 2000
TAU, MAGIC = 0.6, 3 / 16
SPEED = 0.02  # of the vortices, or of the lid, spacings a step
HEAD = """| scene | steps | largest velocity at the end, of that at the start or of the lid | differ, of it |
| --- | --- | --- | --- |"""


class Scene(NamedTuple):
    """periodic, without walls; else a lid slides at y+."""

    name: str
    periodic: bool


SCENES = Scene("Taylor-Green vortices", True), Scene("cavity", False)


def begun(scene: Scene) -> NDArray[np.float64]:
    """u[y, x, 2] at the start, spacings a step."""
    u = np.zeros((POINTS, POINTS, 2))
    if scene.periodic:
        x = 2 * np.pi * (np.arange(POINTS) + 0.5) / POINTS
        u[..., 0], u[..., 1] = np.outer(np.sin(x), np.cos(x)), -np.outer(np.cos(x), np.sin(x))
    return SPEED * u


def ours(scene: Scene) -> NDArray[np.float64]:
    """u[y, x, 2] at the end; spacing and step are 1 m and 1 s."""
    sys.path.insert(0, str(ROOT))
    import lbmdem

    lid = {"boundary": [{"face": "y+", "type": "wall", "velocity": [SPEED, 0.0]}]}
    case = lbmdem.Case(
        simulation={"end_time": float(STEPS), "dimensions": 2},
        domain={"size": [float(POINTS)] * 2, "spacing": 1.0, "periodic": ["x", "y"] * scene.periodic},
        fluid={
            "kinematic_viscosity": (TAU - 0.5) / 3, "relaxation_time": TAU, "collision": "TRT",
            "start": {"velocity": begun(scene), "pressure": np.zeros((POINTS, POINTS))},
        },
        **({} if scene.periodic else lid),
    )  # fmt: skip
    with case.simulation(threads=1) as sim:
        sim.advance(steps=STEPS)
        return np.asarray(sim.fields("velocity"))[..., :2]


def theirs(scene: Scene) -> NDArray[np.float64]:
    """As `ours`, by lbmpy; runs in its environment."""
    from lbmpy import LBStencil, Method, Stencil
    from lbmpy.scenarios import create_fully_periodic_flow, create_lid_driven_cavity

    rates = [1 / TAU, 1 / (MAGIC / (TAU - 0.5) + 0.5)]
    method = {"stencil": LBStencil(Stencil.D2Q9), "method": Method.TRT, "relaxation_rates": rates}
    method |= {"compressible": True, "zero_centered": True}
    if scene.periodic:
        step = create_fully_periodic_flow(begun(scene).swapaxes(0, 1), **method)
    else:
        step = create_lid_driven_cavity((POINTS, POINTS), lid_velocity=SPEED, **method)
    step.run(STEPS)
    return np.array(step.velocity[:, :]).swapaxes(0, 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environment", type=Path, default=Path.home() / ".cache" / "hpcpic" / "peers")
    options = parser.parse_args()
    from peers import Asked

    python = Asked(1, False, False, options.environment).python("lbmpy")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "done.npz")
        subprocess.run([python, __file__, "--child", path], check=True, capture_output=True)
        others = dict(np.load(path))
    print(HEAD)
    for scene in SCENES:
        own, other = ours(scene), others[scene.name]
        largest = np.abs(own).max()
        print(f"| {scene.name} | {STEPS} | {largest / SPEED:.4f} | {np.abs(own - other).max() / largest:.1e} |")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        done: dict[str, Any] = {scene.name: theirs(scene) for scene in SCENES}
        np.savez(sys.argv[2], **done)
    else:
        main()
