"""Knobs of SPH: settings mean what they say, every case knows what it is about."""

import pytest
from knob_cases import made_again, reader, sizes_of

from sph.app import shipped_cases
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


@pytest.mark.parametrize("case", CASES)
def test_every_case_knows_what_it_is_about(case):
    knobs = knobs_of(read(case))
    quantities = knobs.quantities()
    assert quantities and all(0 < quantity.time <= knobs.time for quantity in quantities)
    about = {"taylor-green": "energy", "poiseuille": "middle", "water-column": "front", "standing-wave": "energy"}
    assert quantities[0].name == about.get(case, quantities[0].name)
