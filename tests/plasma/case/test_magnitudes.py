"""Numbers of any magnitude in a plasma case: `check` refuses them, or the run goes on."""

import pytest
from test_extremes import HOT, at, ended

from hpcpic.core.case.config import loads
from hpcpic.core.case.derived import enforce
from hpcpic.core.errors import ConfigError
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import derived
from hpcpic.plasma.forecast.estimate import estimate

BASES = {  # the keys that each adds to the others
    "macro-particles": ("species[0].plasma_frequency=0", "species[0].charge=-0.25", "species[0].mass=1.0"),
    "plasma frequency": ("species[0].plasma_frequency=1.0",),
    "density": ("species[0].plasma_frequency=0", "species[0].density=1.0"),
    "placed": at(3.0, 2.0, n=64, step=(0.5, 0.25)),
}
KEYS = {
    "macro-particles": (
        "simulation.time_step",
        "simulation.space_length[]",
        "field.magnetic[]",
        "field.electric[]",
        "constants.vacuum_permittivity",
        "species[0].charge",
        "species[0].mass",
        "species[0].drift_velocity[]",
        "species[0].thermal_velocity",
        "species[0].perturbation.amplitude",
        "species[0].perturbation.velocity_amplitude",
        "simulation.stop_SEM",
    ),
    "plasma frequency": ("species[0].plasma_frequency", "species[0].temperature"),
    "density": ("species[0].density", "species[0].particles_per_cell", "species[0].temperature", "species[0].mass"),
    "placed": ("species[0].position_init[]", "species[0].position_delta[]"),
}
MAGNITUDES = ("1e-320", "1e-30", "1e30", "1.7e308")
EXTREMES = [(base, key, value) for base, keys in KEYS.items() for key in keys for value in MAGNITUDES]


def assigned(key, value):
    if key.endswith("[]"):
        length = 3 if key.startswith("field") else 2
        return f"{key[:-2]}=[{', '.join([value] * length)}]"
    group, _, name = key.rpartition(".")
    return f"{group}={{mode=[1, 0]; {name}={value}}}" if group.endswith("perturbation") else f"{key}={value}"


@pytest.mark.parametrize("base, key, value", EXTREMES)
def test_a_number_of_any_magnitude_is_refused_or_its_run_goes_on(world, base, key, value):
    """Nothing ends at its first step without a word of `check`; `estimate` says a time for all that is accepted."""
    case = HOT
    if key.endswith(("temperature", "particles_per_cell")):
        drop = "thermal_velocity = 1.0;" if key.endswith("temperature") else "particles = 8192;"
        case = HOT.replace(drop, "")
    sets = (*BASES[base], assigned(key, value))
    found, messages, _ = ended(world, sets, case=case, steps=3)
    assert found in "ABC", messages
    if found != "C":
        assert estimate(configure(loads(case, sets=sets)), 1, 1, {}).seconds >= 0


@pytest.mark.parametrize("count", ["0", "1", "2147483647", "4611686018427387904"])
@pytest.mark.parametrize("key", ["simulation.cycles", "species[0].particles", "grid.points", "mode"])
def test_a_count_of_any_magnitude_has_an_answer(key, count):
    words = {
        "grid.points": f"grid.points=[{count}, {count}]",
        "mode": f"species[0].perturbation={{mode=[{count}, {count}]}}",
    }
    tree = loads(HOT, sets=[words.get(key, f"{key}={count}")])
    try:
        config = configure(tree)
        enforce(derived(config), tree)
    except ConfigError as error:
        assert error.messages
    else:
        assert estimate(config, 1, 1, {}).seconds >= 0
