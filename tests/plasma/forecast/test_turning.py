"""Orbits in a magnetic field for a time step, against a run."""

import math
import re

import numpy as np
import pytest
from app_runner import running
from forecast_numbers import numbers
from seldom import seldom

from hpcpic.core.case.accelerations import register
from hpcpic.core.case.config import loads
from hpcpic.plasma.configure import configure

GYRATION = """
simulation = { cycles = 4; time_step = 1.0; space_length = [1024.0, 1024.0]; };
grid = { points = [16, 16]; };
field = { magnetic = [0.0, 0.0, 1.0]; };
species = ( { name = "p"; particles = 1; charge = 1e-9; mass = 1e-9; drift_velocity = [0.1, 0.0];
              init_method = "position delta"; position_init = [512.0, 512.0]; position_delta = [0.0, 0.0]; } );
"""


WAVES = GYRATION.replace("1e-9; mass = 1e-9", "-1.0; mass = 1.0; plasma_frequency = 0.5")


def test_an_exact_phase_is_a_cure_only_where_the_step_resolves_waves_across_the_field():
    """They feel impulses tan(wc dt/2)/(wc dt/2) times as large: stable for wp dt below 2 over its root."""
    for turn, offered in ((0.4, True), (2.0, False)):
        sets = [f"field.magnetic=[0, 0, {turn}]", "species[0].plasma_frequency=0.49"]
        assert ("exact_phase" in numbers(sets, WAVES)[0]["wc dt"].cure) == offered
        found = numbers([*sets, "numerics.exact_phase=true"], WAVES)[0]["wp dt"]
        assert found.value == pytest.approx(0.49 * np.sqrt(np.tan(turn / 2) / (turn / 2)))
        assert (found.verdict == "ok") == offered
        assert "by numerics.exact_phase" in found.source
        along = ["grid.points=[16, 1]", f"field.magnetic=[{turn}, 0, 0]", "numerics.exact_phase=true"]
        assert numbers([*along, "species[0].plasma_frequency=0.49"], WAVES)[0]["wp dt"].value == pytest.approx(0.49)


@pytest.mark.parametrize("step, exact", [(0.19, False), (0.25, False), (1.0, False), (0.19, True), (1.0, True)])
def test_what_output_makes_of_gyrations_and_drifts_is_told_from_a_percent_on(world, step, exact):
    """The momentum of a gyration, and u_NAME of a drift along x in E along y, over the true ones."""
    sets = [f"simulation.time_step={step}", f"numerics.exact_phase={str(exact).lower()}", 'output.fields=["u"]']
    told = re.search(r"gyration (\S+) times, u_NAME of a drift (\S+) times", numbers(sets, GYRATION)[0]["wc dt"].source)
    ratios = []
    for electric in (0.0, 0.1):
        config = configure(loads(GYRATION, sets=[*sets, f"field.electric=[0.0, {electric}, 0.0]"]))
        with running(world, "hpcpic", config) as app:
            values, mass = app.scalars(), app.scene.species[0].m
            momentum = np.hypot(values["momentum_x"], values["momentum_y"])
            ratios.append((momentum / mass / 0.1, np.abs(app.fields()["u_p"].values[..., 0]).max() / 0.1))
    gyration, drift = ratios[0][0], ratios[1][1]
    assert bool(told) == (gyration**2 < 1 / 1.01)
    if told:
        assert float(told[1]) == pytest.approx(gyration, rel=1e-3)
        assert not exact or float(told[2]) == pytest.approx(drift, rel=1e-3)  # else the start leaves a gyration


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


@pytest.mark.parametrize("step, exact", [(1.0, True), (1.0, False), *(seldom(step, True) for step in (0.3, 0.5, 2.0))])
def test_a_polarisation_drift_is_as_check_tells(world, step, exact):
    """In E_x = 0.01 t, from the start with the drift m/(q B^2) dE/dt that it has in nature: the mean of the rest."""
    register("ramp", lambda x, v, t: (0.01 * t, 0.0, 0.0))
    text = GYRATION.replace("[0.1, 0.0]", '[0.01, 0.0]; acceleration = "ramp"')
    sets = [f"simulation.time_step={step}", f"numerics.exact_phase={str(exact).lower()}"]
    told = re.search(r"polarisation drifts .* are (\S+) times", numbers(sets, text)[0]["wc dt"].source)
    steps = round(200 * 2 * math.pi / step)
    with running(world, "hpcpic", configure(loads(text, sets=sets))) as app:
        for _ in range(steps):
            app.step()
        (x, _), drift = app.particles()["p"].position[0, :2], 0.01 * steps * step
    assert bool(told) == (abs((x - 512.0) / drift - 1.0) > 0.01) == (exact and step > 0.34)
    assert not told or (x - 512.0) / drift == pytest.approx(float(told[1]), abs=2e-3)
