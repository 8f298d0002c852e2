#!/usr/bin/env python3
"""How fast the grid heats a thermal plasma: runs, and the rates of hpcpic/plasma/physics/heating.py from them.

python scripts/heating.py DIMENSIONS SHAPE [...]         as in 3 CIC, 1 TSC
python scripts/heating.py across SHAPE                  what a magnetic field out of the plane adds in 2D

Each run starts at random places, goes on until wp t = 875 with wp dt = 0.2 and centred differences, and tells the
energy in the end over that at the start; the rates are those with which `energy_ratio` gives these best. On a line the
field of a random start has much of the energy: its Debye length is that of both, and starts of more field are left out.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import sys
from typing import Any

import numpy as np
from scipy.optimize import least_squares

import hpcpic
from hpcpic.core.errors import Diverged
from hpcpic.plasma.physics.heating import ACROSS_DEBYE, HEATING, ONSET, Heating, energy_ratio

DEBYE = (0.03, 0.1, 0.3, 0.5, 0.7, 1.0)  # lambda_D/dx
PER_CELL = {1: (64, 256, 1024, 4096), 2: (16, 64), 3: (16, 64)}
POINTS = {1: [64], 2: [64, 64], 3: [16, 16, 16]}
STEP, STEPS = 0.2, 4375
TURNS, STEPS_ACROSS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0), 1000  # wc/wp
SEEN_ACROSS = 0.01  # growth above which it counts
SMOOTH_ACROSS = 0.05
MOST_FIELD = 3.0  # of the start over its heat, on a line
LEAST = 0.005  # growth on a line that is more than the swing of the energy
SMOOTH = 0.02  # weight of a bend against a miss


def main() -> int:
    words = sys.argv[1:]
    if not words or len(words) % 2:
        print(__doc__, file=sys.stderr)
        return 2
    for first, shape in zip(words[::2], words[1::2]):
        if first == "across":
            across(shape)
            continue
        dimensions, found = int(first), {}
        for debye in DEBYE:
            for per_cell in PER_CELL[dimensions]:
                if dimensions == 1 and POINTS[1][0] / (12 * per_cell * debye**2) > MOST_FIELD:
                    continue
                start, seen = growth(dimensions, shape, debye, per_cell)
                if dimensions > 1 or seen > LEAST:
                    found[start, per_cell] = seen
                print(f'("{shape}", {dimensions}, {start:.3g}, {per_cell}, {STEP * STEPS:g}, {1 + seen:.4g}),')
        print(*fitted(found), sep="\n", flush=True)
    return 0


def across(shape: str) -> None:
    """Growth with wc/wp by rising Debye length, and the rates above those of no magnetic field that give it best.
    Runs that diverge are left out.
    """
    for turn in TURNS:
        seen = {}
        for debye in ACROSS_DEBYE:
            with contextlib.suppress(Diverged):
                seen[debye] = growth(2, shape, debye, 32, turn, STEPS_ACROSS)[1]
        rates, grown = fitted_across(shape, seen)
        print(f"{shape}, wc = {turn} wp:", *(f"{one:.2g} ({seen[debye]:.2g})" for debye, one in grown.items()))
        print(f"{turn}: ({', '.join(f'{one:.2g}' for one in rates)}),", flush=True)


def fitted_across(shape: str, seen: dict[float, float]) -> tuple[list[float], dict[float, float]]:
    """The rates at each of ACROSS_DEBYE whose growth is nearest to that seen by Debye length, and that growth."""
    time = STEP * STEPS_ACROSS

    def foretold(logs: Any) -> dict[float, float]:
        rates = list(np.exp(logs) * time / (time + ONSET))
        return {debye: energy_ratio(HEATING[shape, 2], debye, 32, time, rates) - 1 for debye in seen}

    def misses(logs: Any) -> Any:
        found = foretold(logs).items()
        missed = [math.log((grown + SEEN_ACROSS) / (seen[debye] + SEEN_ACROSS)) for debye, grown in found]
        return np.concatenate([missed, SMOOTH_ACROSS * np.diff(logs, 2)])

    first = np.log(np.geomspace(1e-2, 1e-5, len(ACROSS_DEBYE)))
    best = least_squares(misses, first, bounds=(math.log(1e-7), 0.0), diff_step=1e-2).x
    return list(np.exp(best)), foretold(best)


def growth(
    dimensions: int, shape: str, debye: float, per_cell: int, turn: float = 0.0, steps: int = STEPS
) -> tuple[float, float]:
    """Debye length of the start, and W(end)/W(0) - 1, of a plasma of this Debye length in spacings and this wc/wp."""
    points = [32, 32] if turn else POINTS[dimensions]
    electrons = {
        "name": "electrons", "charge": -1.0, "mass": 1.0, "plasma_frequency": 1.0, "thermal_velocity": debye,
        "particles": per_cell * math.prod(points), "init_method": "random position",
    }  # fmt: skip
    case = hpcpic.Case(
        description="a thermal plasma that its grid heats",
        simulation={"cycles": steps, "time_step": STEP, "space_length": [float(n) for n in points]},
        grid={"points": points},
        numerics={"shape": shape},
        field={"magnetic": [0.0, 0.0, turn]},
        species=[electrons],
    )
    with case.simulation(threads=1) as sim:
        start = dict(sim.scalars())
        sim.advance()
        with_field = math.sqrt(start["energy_total"] / start["energy_kinetic"]) if dimensions == 1 else 1.0
        return debye * with_field, sim.scalars()["energy_total"] / start["energy_total"] - 1


def fitted(found: dict[tuple[float, int], float]) -> list[str]:
    """The rates by rising Debye length whose growth is nearest to that found, relative to it, and how near they are."""

    def rates(logs: Any) -> list[Heating]:
        noise, aliases = np.exp(logs).reshape(2, -1)
        return [Heating(debye, float(f"{n:.2g}"), float(f"{a:.2g}")) for debye, n, a in zip(DEBYE, noise, aliases)]

    def misses(logs: Any) -> list[float]:
        points = rates(logs)
        return [math.log((energy_ratio(points, *at, STEP * STEPS) - 1) / seen) for at, seen in found.items()]

    def bent(logs: Any) -> Any:
        """The misses, and what the logs of the rates bend: of rates that nothing shows, the plainest."""
        return np.concatenate([misses(logs), SMOOTH * np.diff(np.reshape(logs, (2, -1)), 2).ravel()])

    tried = []
    for noise, aliases in itertools.product((1e-3, 3e-2), (1e-2, 1e-4)):
        first = np.concatenate([np.full(len(DEBYE), noise), np.geomspace(aliases, 1e-7, len(DEBYE))])
        tried.append(least_squares(bent, np.log(first), bounds=(math.log(1e-9), 0.0), diff_step=1e-2))
    best = min(tried, key=lambda one: one.cost).x
    worst = max(abs(math.expm1(miss)) for miss in misses(best))
    return [*map(str, rates(best)), f"give the growth within {worst:.1%}"]


if __name__ == "__main__":
    sys.exit(main())
