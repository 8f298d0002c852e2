"""Cold beams that drift through the grid: what check says of them, against runs."""

import re

import pytest
from app_runner import running
from forecast_numbers import numbers

from hpcpic.core.case.config import loads
from hpcpic.plasma.configure import configure

DX = 0.1
BEAM = """
simulation = { cycles = 1000; time_step = 0.2; space_length = [6.4]; };
grid = { points = [64]; };
species = ( { name = "e"; charge = -1.0; mass = 1.0; plasma_frequency = 1.0; particles = 4096; init_method = "quiet";
              drift_velocity = [0.1]; perturbation = { mode = [3]; amplitude = 1e-3; }; } );
"""


def drifting(ratio):
    return f"species[0].drift_velocity=[{ratio * DX}]"


@pytest.mark.parametrize(
    "ratio, shape, warned", [(0.2, "CIC", True), (0.5, "CIC", True), (5.0, "CIC", False), (1.0, "TSC", False)]
)
def test_a_cold_drift_that_the_grid_heats_is_warned_of(world, ratio, shape, warned):
    sets = [drifting(ratio), f'numerics.shape="{shape}"']
    sets += ['numerics.precision="single"'] if shape == "TSC" else []  # a module that other tests compile, too
    number = numbers(sets, BEAM)[0]["u/(wp dx)"]
    assert number.value == pytest.approx(ratio) and (number.verdict == "warn") == warned
    with running(world, "hpcpic", configure(loads(BEAM, sets=sets))) as app:
        before = app.scalars()["energy_total"]
        for _ in range(1000):
            app.step()
        grown = app.scalars()["energy_total"] / before - 1
    assert (grown > 0.01) == warned
    if warned:
        assert float(re.search(r"by ([\d.]+)", number.source)[1]) == pytest.approx(grown, rel=0.15)


def test_a_cold_plasma_that_a_field_sets_moving_is_heated_too(world):
    """From rest to 0.4 wp dx by wp t = 400, which took it through the slow speeds that aliases heat: a fifth of its
    energy was heat, and no number spoke of it. A stronger field takes it through them sooner.
    """
    sets = [drifting(0.0), "simulation.cycles=2000", "field.electric=[1e-4, 0.0, 0.0]"]
    number = numbers(sets, BEAM)[0]["u/(wp dx)"]
    assert number.value == pytest.approx(0.4) and number.verdict == "warn" and "0.1 to 2 times" in number.source
    with running(world, "hpcpic", configure(loads(BEAM, sets=sets))) as app:
        for _ in range(2000):
            app.step()
        v = app.particles()["e"].columns["velocity"][:, 0]
    told = float(re.search(r"by ([\d.]+)", number.source)[1])
    assert v.var() / v.mean() ** 2 > 0.05 and 0.1 < v.var() / v.mean() ** 2 / told < 4
    assert numbers([*sets, "field.electric=[1e-3, 0.0, 0.0]"], BEAM)[0]["u/(wp dx)"].verdict == "ok"
    assert "u/(wp dx)" not in numbers([*sets, "field.magnetic=[0.0, 0.0, 1.0]"], BEAM)[0]


def test_its_cures_pass_and_what_does_not_grow_has_no_such_number():
    cure = numbers([drifting(0.8)], BEAM)[0]["u/(wp dx)"].cure
    shape, points = re.match(r"(\S+ = \S+), or (\S+ = \S+), or a spread", cure).groups()
    for setting in (shape, points):
        assert numbers([drifting(0.8), setting], BEAM)[0]["u/(wp dx)"].verdict == "ok"
    warm, short = f"species[0].thermal_velocity={0.5 * DX}", "simulation.cycles=100"
    for sets in ([drifting(0.8), warm], [drifting(0.8), short], ["species[0].drift_velocity=[0.0]"]):
        assert "u/(wp dx)" not in numbers(sets, BEAM)[0]
    streams = [drifting(0.8), "species[0].init_method=default"]
    assert numbers(streams, BEAM)[0]["u/(wp dx)"].value == pytest.approx(0.8 * 2**0.5)  # each has half of wp^2
