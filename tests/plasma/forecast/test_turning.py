"""Orbits in a magnetic field for a time step, against a run."""

import re

import numpy as np
import pytest
from app_runner import running
from forecast_numbers import numbers

from hpcpic.core.case.config import loads
from hpcpic.plasma.configure import configure

GYRATION = """
simulation = { cycles = 4; time_step = 1.0; space_length = [1024.0, 1024.0]; };
grid = { points = [16, 16]; };
field = { magnetic = [0.0, 0.0, 1.0]; };
species = ( { name = "p"; particles = 1; charge = 1e-9; mass = 1e-9; drift_velocity = [0.1, 0.0];
              init_method = "position delta"; position_init = [512.0, 512.0]; position_delta = [0.0, 0.0]; } );
"""


@pytest.mark.parametrize("step, exact", [(0.25, False), (0.3, False), (20.0, False), (0.4, True), (3.0, True)])
def test_how_much_too_large_orbits_are_is_what_a_run_shows(world, step, exact):
    """The circle through three positions, of radius v/wc = 0.1 m in nature; told from 1 % on."""
    sets = [f"simulation.time_step={step}", f"numerics.exact_phase={str(exact).lower()}"]
    number = numbers(sets, GYRATION)[0]["wc dt"]
    at = []
    with running(world, "hpcpic", configure(loads(GYRATION, sets=sets))) as app:
        for _ in range(3):
            at.append(app.particles()["p"].position[0, :2])
            app.step()
    sides = [np.linalg.norm(at[i] - at[j]) for i, j in ((0, 1), (1, 2), (0, 2))]
    (ax, ay), (bx, by) = at[1] - at[0], at[2] - at[0]
    larger = np.prod(sides) / (2 * abs(ax * by - ay * bx)) / 0.1
    assert ("radii" in number.source) == (larger > 1.01)
    if "radii" in number.source:
        told = float(re.search(r"are (\S+) times", number.source)[1])
        assert told == pytest.approx(larger, rel=1e-3)  # four digits
