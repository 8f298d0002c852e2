"""The same particles through hpcpic and through JAX-in-Cell (jaxincell of the package index): mode 1, energies, growth.

    python scripts/same_waves.py [--environment FOLDER]

JAX-in-Cell is a one-dimensional electromagnetic program; waves along its axis are electrostatic. Both take the same
positions and velocities, points, time step (its own: light crosses a spacing) and shape (a parabola over three
spacings), and none of its filters. What is left are the schemes: it gathers from a field at the middles between nodes
and deposits currents, we difference the potential. It is installed into an environment of its own, which is kept.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
LIGHT, CHARGE, MASS, EPS0 = 299792458.0, 1.602176634e-19, 9.1093837139e-31, 8.8541878128e-12
WP = 1.0e9  # rad/s
POINTS = 64
Arrays = dict[str, Any]  # of numpy


def electrons(n: int, length: float, velocity: NDArray, amplitude: float) -> Arrays:
    """x[n] m evenly, displaced by a wave of mode 1, and v[n] m/s."""
    x = (np.arange(n) + 0.5) * length / n
    k = 2 * np.pi / length
    return {"x": (x + amplitude / k * np.sin(k * x)) % length, "v": velocity, "length": np.array(length)}


def cold_wave() -> Arrays:
    return electrons(16384, 40.0 * LIGHT / WP / 10, np.zeros(16384), 1e-3) | {"steps": np.array(300)}


def two_stream() -> Arrays:
    """Beams of +-0.1 c at the wave number of the largest growth, sqrt(3/8) wp/v."""
    n, v = 16384, 0.1 * LIGHT
    length = 2 * np.pi * v / (np.sqrt(3 / 8) * WP)
    return electrons(n, length, v * (-1.0) ** np.arange(n), 1e-4) | {"steps": np.array(1400)}


def landau() -> Arrays:
    """k lambda_D = 0.5: 1024 velocities of equal weight at each of 32 places."""
    beams, places, spread = 1024, 32, 0.2 * LIGHT
    length = 2 * np.pi * spread / (0.5 * WP)
    speeds = np.array([NormalDist().inv_cdf((i + 0.5) / beams) for i in range(beams)])
    shifts = np.arange(beams) * 0.618034 % 1  # else all beams begin at the same places
    x = ((np.arange(places)[:, None] + shifts) / places * length).ravel()
    x += 0.02 * length / (2 * np.pi) * np.sin(2 * np.pi * x / length)
    velocity = np.tile(spread / speeds.std() * speeds, places)
    return {"x": x % length, "v": velocity, "length": np.array(length), "steps": np.array(400)}


EXPECTED = {  # of theory, without mesh and step: frequency and rate, or a rate alone
    "cold wave": (1.0, 0.0), "two-stream": (1 / np.sqrt(8),), "Landau damping": (1.415662, -0.153359)
}  # fmt: skip
HEAD = """| in wp | theory | hpcpic | JAX-in-Cell | kinetic energies differ, of their swing | takes times as long |
| --- | --- | --- | --- | --- | --- |"""
SCENES = {"cold wave": cold_wave, "two-stream": two_stream, "Landau damping": landau}


def ours(given: Arrays) -> Arrays:
    """|E_1|[samples] V/m of mode 1, kinetic energy J/m2 at the times of the steps, and seconds."""
    sys.path.insert(0, str(ROOT))
    import hpcpic

    length, n = float(given["length"]), len(given["x"])
    case = hpcpic.Case(
        units="SI",
        simulation={
            "cycles": int(given["steps"]), "time_step": length / POINTS / LIGHT, "space_length": [length],
        },
        grid={"points": [POINTS]},
        numerics={"shape": "TSC"},
        species=[
            {"name": "electrons", "charge": -CHARGE, "mass": MASS, "plasma_frequency": WP,
             "start": {"position": given["x"][:, None], "velocity": given["v"][:, None]}},
        ],
        output={"every": {"series": 1}},
    )  # fmt: skip
    mode, kinetic = [], []
    with case.simulation(threads=1) as sim:
        sim.advance(steps=1)  # compiles
        begin = time.perf_counter()
        for _ in range(int(given["steps"])):
            values = sim.scalars()
            mode.append(values["mode_1"])
            kinetic.append(values["energy_kinetic"])
            sim.advance(steps=1)
        seconds = time.perf_counter() - begin
    return {"mode": np.array(mode), "kinetic": np.array(kinetic), "seconds": np.array(seconds), "n": np.array(n)}


def theirs(given: Arrays) -> Arrays:
    """As `ours`, by JAX-in-Cell; runs in its environment."""
    import jaxincell

    length, n, steps = float(given["length"]), len(given["x"]), int(given["steps"])
    weight = EPS0 * MASS * WP**2 / CHARGE**2 * length / n
    still = {"initial_velocities": np.zeros((n, 3)), "weight": weight, "number_pseudoparticles": n}
    x = np.stack([given["x"] - length / 2, np.zeros(n), np.zeros(n)], axis=1)
    even = np.stack([(np.arange(n) + 0.5) * length / n - length / 2, np.zeros(n), np.zeros(n)], axis=1)
    v = np.stack([given["v"], np.zeros(n), np.zeros(n)], axis=1)
    simulation = jaxincell.Simulation(
        {
            "domain_parameters": {
                "length": length, "number_grid_points": POINTS, "total_steps": steps,
                "timestep_over_spatialstep_times_c": 1.0,
            },
            "species_parameters": {
                "electrons": {"electrons0": still | {"initial_positions": x, "initial_velocities": v}},
                "ions": {"ions0": still | {"initial_positions": even, "mass_over_proton_mass": 1e12}},
            },
            "solver_parameters": {"filter_passes": 0, "print_info": False},
        }
    )  # fmt: skip
    simulation.run()["electric_field"].block_until_ready()
    begin = time.perf_counter()
    out = simulation.run()
    field = np.asarray(out["electric_field"])[:, :, 0]
    seconds = time.perf_counter() - begin
    kinetic = 0.5 * MASS * weight * (np.asarray(out["velocities"])[:, :n, 0] ** 2).sum(axis=1)
    mode = 2 * np.abs(np.fft.rfft(field, axis=1)[:, 1]) / POINTS
    return {"mode": mode, "kinetic": kinetic, "seconds": np.array(seconds), "n": np.array(n)}


def fitted(name: str, done: Arrays, step: float) -> tuple[float, ...]:
    """Frequency and rate of mode 1, or the rate of the two streams, in wp."""
    from hpcpic.plasma.analysis.series_analysis import fit_oscillation, growth_rate, signed

    t = step * np.arange(1, len(done["mode"]) + 1)
    if name == "two-stream":
        return (growth_rate(t, done["mode"]).value,)
    real, imaginary = EXPECTED[name]
    window = (t > 3) & (t < 15) if imaginary else t > 0
    fit = fit_oscillation(t[window], signed(done["mode"])[window], frequency=real, rate=imaginary)
    return (fit.frequency, fit.rate) if imaginary else (fit.frequency,)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environment", type=Path, default=Path.home() / ".cache" / "hpcpic" / "peers")
    options = parser.parse_args()
    from peers import Asked

    python = Asked(1, False, False, options.environment).python("jaxincell")
    print(HEAD)
    for name, scene in SCENES.items():
        given = scene()
        with tempfile.TemporaryDirectory() as folder:
            paths = [str(Path(folder, file)) for file in ("given.npz", "done.npz")]
            np.savez(paths[0], **given)
            subprocess.run([python, __file__, "--child", *paths], check=True, capture_output=True)
            other = dict(np.load(paths[1]))
        own, step = ours(given), WP * float(given["length"]) / POINTS / LIGHT
        numbers = [EXPECTED[name], *(fitted(name, done, step) for done in (own, other))]
        cells = [", ".join(f"{value:.5f}" for value in values if value) for values in numbers]
        change = np.abs(own["kinetic"] - other["kinetic"]).max() / np.ptp(own["kinetic"])
        times = other["seconds"] / own["seconds"]
        print(f"| {name} | {' | '.join(cells)} | {100 * change:.2g} % | {times:.0f} |", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        np.savez(sys.argv[3], **theirs(dict(np.load(sys.argv[2]))))
    else:
        main()
