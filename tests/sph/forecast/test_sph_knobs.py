"""Knobs of SPH: settings mean what they say, every case knows what it is about."""

import re

import numpy as np
import pytest
from knob_cases import made_again, reader, sizes_of

from hpcpic.core.case.config import loads
from hpcpic.core.cli.main import build
from sph.app import APP, shipped_cases
from sph.case.columns import gauge_units
from sph.case.config import name_of
from sph.configure import configure
from sph.forecast.knobs import knobs_of, mach

CASES = sorted(name for name in shipped_cases() if name in ("column-impact-a", "poiseuille") or "-impact" not in name)


read = reader(configure, shipped_cases)


@pytest.mark.parametrize("case", CASES)
def test_its_own_sizes_are_the_case_itself(case):
    config, again = made_again(read, knobs_of, case)
    assert again == config


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("factor", [1.5, 0.7])
def test_settings_are_valid_and_never_coarser_than_asked(case, factor):
    config = read(case)
    knobs = knobs_of(config)
    for knob in knobs.knobs:
        own = sizes_of(knobs, config)
        made = read(case, knobs.settings({**own, knob.name: factor * own[knob.name]}, knobs.time))
        found = sizes_of(knobs, made)
        assert found[knob.name] <= factor * own[knob.name] * (1 + 1e-9)
        if knob.name == "mach":  # what to expect stays, the sound speed goes
            assert made.sound_speed == pytest.approx(config.sound_speed / factor, rel=1e-9)
        elif knob.name == "cfl":
            assert made.numerics == config.numerics and mach(made) == mach(config)


class Columns(dict):
    time = np.linspace(0.0, 100.0, 50)


@pytest.mark.parametrize("case", [case for case in CASES if read(case).gauge])
def test_every_gauge_of_a_case_can_be_asked_for(case):
    """By its name, of a column that the series has."""
    config = read(case)
    known = {quantity.name: quantity for quantity in knobs_of(config).quantities()}
    series = Columns(dict.fromkeys(gauge_units(config), Columns.time + 1.0))
    for i, gauge in enumerate(config.gauge):
        quantity = known[name_of("gauge", i, gauge)]
        assert np.isfinite(quantity.measure(series)).all() and gauge.name in quantity.why


def test_a_case_that_has_a_gauge_is_not_said_to_have_none():
    for what, at in (("elevation", "[0.5, 0.0]"), ("velocity", "[0.5, 0.5]")):
        config = read("still-tank", (f'gauge=({{ name = "g"; what = "{what}"; at = {at}; }})',))
        first, energy = knobs_of(config).quantities()
        assert (first.name, energy.name) == ("g", "energy") and "no gauge" not in energy.why


@pytest.mark.parametrize("case", CASES)
def test_every_case_knows_what_it_is_about(case):
    knobs = knobs_of(read(case))
    quantities = knobs.quantities()
    assert quantities and all(0 < quantity.time <= knobs.time for quantity in quantities)
    about = {"taylor-green": "energy", "poiseuille": "middle", "water-column": "front", "standing-wave": "energy"}
    assert quantities[0].name == about.get(case, quantities[0].name)


OIL = """
simulation = { dimensions = 2; end_time = 3.0; };
domain = { low = [0.0, 0.0]; high = [0.01, 0.024]; periodic = ["x"]; };
body_force = [0.02, 0.0];
eos = { max_velocity = 0.015; };
fluid = ({ shape = { box = { low = [0.0, 0.0]; high = [0.01, 0.024]; }; }; density = 900.0; dynamic_viscosity = %s;
           initial_pressure = "zero"; });
numerics = { spacing = 0.001; viscosity_form = "cleary"; density_flux = "none"; };
wall = ({ name = "planes"; shape = { box = { low = [0.0, 0.0]; high = [0.01, 0.024]; }; }; type = "mirror-no-slip"; });
"""


def cfl_of(viscosity, *sets):
    """The knob of the oil with another viscosity, Pa s."""
    config = configure(loads(OIL % viscosity, "oil.conf", sets))
    return next(knob for knob in knobs_of(config).knobs if knob.name == "cfl")


def test_stability_refuses_a_knob_that_another_criterion_overrules_and_names_it(tmp_path, monkeypatch, capfd):
    """The step of oil follows its viscosity: the largest cfl was called stable, at 3.7 times theory's limit."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "oil.conf").write_text(OIL % 0.09)
    with pytest.raises(SystemExit) as end:
        build(lambda: APP, "sph", "fluids").main(["stability", "oil.conf"])
    told = capfd.readouterr().err
    assert end.value.code == 2 and not (tmp_path / "stability").exists()
    assert "oil.conf: simulation.cfl cannot be turned" in told and "sets no step here, as viscosity" in told
    speed = re.search(r"--set (eos.sound_speed=[\d.]+) cfl has its limit", told)
    assert speed and cfl_of(0.09).overruled and not cfl_of(0.09, speed[1]).overruled
    assert not cfl_of(0.001).overruled  # water
    assert "acceleration" in cfl_of(0.001, "body_force=[50.0, 0.0]").overruled
