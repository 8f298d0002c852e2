"""The plasma case: its keys, its older spellings, and every refusal with the place of the key to change."""

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hpcpic.core.case.config import Tree, load, loads
from hpcpic.core.case.derived import enforce
from hpcpic.core.case.dump import dump
from hpcpic.core.case.schema import describe
from hpcpic.core.errors import ConfigError
from hpcpic.plasma.case.config import PlasmaConfig, velocity_components
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import derived

CPIC = Path(__file__).parents[2] / "data" / "cpic"

CASE = """
simulation = {
  cycles = 10;
  time_step = 0.1;
  space_length = [8.0, 4.0];
};
grid = { points = [16, 8]; };
species = (
  {
    particles = 64;
    charge = -1.0;
    mass = 1.0;
    thermal_velocity = 1.0;
    init_method = "quiet";
  }
);
"""

NONE = {"histogram": 0, "openpmd": 0, "checkpoint": 0}  # unless they are asked for


def read(text=CASE, sets=()):
    tree = loads(text, sets=sets)
    return configure(tree), tree


def faults_of(text, sets=()):
    with pytest.raises(ConfigError) as caught:
        read(text, sets)
    return caught.value.messages


@pytest.mark.parametrize("key, given", [("gradient", '"spectral"'), ("cloud_radius", "0.5")])
def test_what_needs_a_fourier_space_is_refused_with_lu(key, given):
    (told,) = faults_of(CASE, [f"numerics.{key}={given}", 'simulation.solver="LU"'])
    assert f'numerics.{key}: needs the Fourier space of simulation.solver = "MFT" (got {given} with "LU")' in told
    read(sets=[f"numerics.{key}={given}"])


def test_defaults_are_filled_in():
    config, tree = read()
    assert tree.warnings == []
    assert config.dimensions == config.simulation.dimensions == 2
    assert config.simulation.solver == "MFT" and config.numerics.shape == "CIC"
    assert config.species[0].name == "species_1" and config.species[0].drift_velocity == (0.0, 0.0, 0.0)
    assert config.periods == {"series": 1, "field": 0, "particle": 0} | NONE


def test_the_configuration_as_used_gives_the_same_run():
    for sets in (
        (),
        [
            "species[0].perturbation={mode=[1,0]; amplitude=0.1}",
            "output.path=there",
            "field.magnetic=[0,0,1]",
        ],
    ):
        config, _ = read(sets=sets)
        again, tree = read(dump(config))
        assert again == config and tree.warnings == []


def test_both_spellings_of_the_grid_are_one():
    older = CASE.replace("points = [16, 8]", "blocks = [4, 2]; blocksize = [4, 4]")
    assert read(older)[0] == read()[0]


@pytest.mark.parametrize(
    "name, points, species, ignored",
    [
        ("two-beams-1d-old", (64,), 1, "plot, constants.light_speed, constants.boltzmann_constant"),
        ("two-electrons-1d", (32,), 2, "simulation.sampling_period.particle"),
        ("two-species-2d", (32, 32), 2, "simulation.realtime_plot"),
        (
            "pair-2d",
            (16, 32),
            2,
            "simulation.enable_fftw_threads, simulation.mft_tap_workers, simulation.pblock_nmax",
        ),
    ],
)
def test_files_in_the_style_of_the_thesis_author_are_read(name, points, species, ignored):
    tree = load(CPIC / f"{name}.conf")
    config = configure(tree)
    assert config.grid.points == points and len(config.species) == species
    listing = [warning for warning in tree.warnings if warning.startswith("keys without meaning here, ignored: ")]
    assert len(listing) == 1 and ignored in listing[0]
    enforce(derived(config), tree)  # and none of them is refused


@pytest.mark.parametrize(
    "sets, told",
    [
        ((), ""),
        (("species[0].init_method=quiet", "species[0].drift_velocity=[1, 0]"), ""),
        (("species[0].init_method=random", "species[0].drift_velocity=[1, 0]"), ""),
        (('species[0].init_method="opposite beams"', "species[0].drift_velocity=[1, 0]"), ""),
        (('species[0].init_method="random position"', "species[0].drift_velocity=[1, 0]"), ""),  # and thermal
        (("species[0].init_method=default", "species[0].drift_velocity=[0, 0]"), ""),
        (("species[0].init_method=default", "species[0].drift_velocity=[1, 0]"), "makes two opposite beams"),
        (
            (
                'species[0].init_method="random position"',
                "species[0].drift_velocity=[1, 0]",
                "species[0].thermal_velocity=0",
            ),
            "makes velocities uniform in [-v, v]",
        ),
    ],
)
def test_a_drift_velocity_that_makes_no_drift_is_told(sets, told):
    _, tree = read(sets=sets)
    assert [told in warning for warning in tree.warnings] == ([True] if told else []), tree.warnings


def test_a_drift_without_a_method_is_told_once_and_the_case_as_used_says_it():
    text = CASE.replace('init_method = "quiet";', "")
    assert read(text)[1].warnings == []
    config, tree = read(text, ["species[0].drift_velocity=[0, 2]"])
    (warning,) = tree.warnings
    assert warning.startswith("species[0].init_method: not given") and '"opposite beams"' in warning
    again, tree = read(dump(config))
    assert tree.warnings == [] and again.species[0].init_method == "random"


def test_an_included_default_is_overridden_key_by_key():
    config = configure(load(CPIC / "two-species-2d.conf"))
    assert config.simulation.solver == "LU"  # `method` of the case over `solver` of the defaults
    assert config.simulation.cycles == 10 and config.simulation.random_seed == 138
    assert config.simulation.space_length == (1.0, 1.0)


def test_periods_of_the_live_plot_ask_for_no_snapshots():
    config = configure(load(CPIC / "two-electrons-1d.conf"))
    assert config.periods == {"series": 10, "field": 0, "particle": 0} | NONE
    config = configure(load(CPIC / "pair-2d.conf"))
    assert config.periods == {"series": 0, "field": 5, "particle": 25} | NONE


def test_snapshots_are_asked_for_in_either_group():
    config, _ = read(
        sets=["simulation.sampling_period={energy=2; field=3; particle=4}", "output.sampling_period.field=5"]
    )
    assert config.periods == {"series": 2, "field": 5, "particle": 4} | NONE


def test_openpmd_follows_the_snapshots_and_checkpoints_have_their_own_period():
    sets = ["output.openpmd=true", "output.checkpoint=7"]
    assert read(sets=sets)[0].periods["openpmd"] == 0
    config, _ = read(sets=[*sets, "output.sampling_period={field=5; particle=4}"])
    assert (config.periods["openpmd"], config.periods["checkpoint"]) == (4, 7)


def test_a_name_by_default_is_taken_too():
    first = '{ name = "species_2"; particles = 2; charge = 1.0; mass = 1.0; },'
    config, tree = read(CASE.replace("species = (", f"species = ( {first}"))
    assert [species.name for species in config.species] == ["species_2", "species_2_2"] and len(tree.warnings) == 1


@pytest.mark.parametrize("until, cycles", [(1.0, 10), (-3.0, 1), (1e308, 2**62)])
def test_any_time_is_a_number_of_steps_that_a_case_can_say(until, cycles):
    from hpcpic.plasma.app import APP

    config, _ = read(sets=["simulation.time_step=0.1"])
    sets = APP.until(config, until)
    assert sets == (f"simulation.cycles={cycles}",) and read(sets=sets)[0].simulation.cycles == cycles


@pytest.mark.parametrize(
    "sets, components",
    [
        ([], 2),
        (["field.magnetic=[0, 0, 1]"], 2),
        (["field.magnetic=[0, 1e-300, 1]"], 3),
        (["field.electric=[1, 1, 0]"], 2),
        (["field.electric=[0, 0, 1]"], 3),
        (["species[0].drift_velocity=[1, 1]"], 2),
        (["species[0].drift_velocity=[0, 0, 1]"], 3),
    ],
)
def test_a_third_velocity_component_only_where_something_needs_it(sets, components):
    assert velocity_components(read(sets=sets)[0]) == components


def test_one_dimension_has_one_velocity_component_without_a_magnetic_field():
    sets = ["simulation.space_length=8.0", "grid.points=16"]
    assert velocity_components(read(sets=sets)[0]) == 1
    assert velocity_components(read(sets=[*sets, "field.magnetic=[0, 0, 1]"])[0]) == 3


BAD = """
simulation = {
  cycles = -1;
  time_step = 0.1; solver = "MTF";
  space_length = [8.0, -4.0]; cycles = 5 dimensions = 4;
};
grid = { points = [16, 0]; };
species = ( { particles = -1; charge = "x"; mass = -1.0; drift_velocty = [1.0, 0.0]; particles = 2; } );
constants = { vacuum_permittivity = 1e999; };
oputput = { path = "x"; };
"""


def test_all_bad_settings_are_told_at_once_with_their_places():
    starts = [
        "case:5:31: simulation.cycles: set twice, first at case:3:3",
        "case:5:42: missing ; after the value of 'cycles'",
        "case:8:86: species[0].particles: set twice",
        "case:9:37: the number 1e999 is too large",
        "case:3:3: simulation.cycles: must be greater than or equal to 0 (got -1)",
        "case:4:20: simulation.solver: must be 'MFT' or 'LU' (got 'MTF'); did you mean 'MFT'?",
        "case:5:24: simulation.space_length[1]: must be greater than 0 (got -4.0)",
        "case:5:42: simulation.dimensions: must be 1, 2 or 3 (got 4)",
        "case:7:24: grid.points[1]: must be greater than or equal to 1 (got 0)",
        "case:8:15: species[0].particles: must be greater than or equal to 0 (got -1)",
        "case:8:31: species[0].charge: must be a number (got 'x')",
        "case:8:45: species[0].mass: must be greater than 0 (got -1.0)",
        "case:8:58: species[0].drift_velocty: unknown key; did you mean 'drift_velocity'?",
        "case:9:15: constants.vacuum_permittivity: must be greater than 0 (got 0.0)",
        "case:10:1: oputput: unknown key; did you mean 'output'?",
    ]
    messages = faults_of(BAD)
    assert len(messages) == len(starts)
    for start in starts:
        assert any(message.startswith(start) for message in messages), (start, messages)


@pytest.mark.parametrize(
    "assignment, message",
    [
        ("simulation.time_step=0", "simulation.time_step: must not be 0"),
        ("simulation.dimensions=1", "simulation.space_length: needs 1 number(s) in 1D (got 2)"),
        ("grid.points=[16]", "grid.points: needs 2 number(s) in 2D (got 1)"),
        ("grid.blocks=[16, 8]", "grid.blocks: give either points, or blocks and blocksize"),
        ("grid.points=[16, 2147483648]", "grid.points: at most 2147483647 on an axis"),
        ("species[0].particles=4294967297", "species[0].particles: must be less than or equal to 4294967296"),
        ('species[0].name="ions/hot"', "species[0].name: 'ions/hot' would be a path"),
        ('species[0].name=".."', "species[0].name: '..' would be a path"),
        ("field.magnetic=[0, 1]", "field.magnetic: needs 3 numbers"),
        ("field.electric=1.0", "field.electric: needs 3 numbers"),
        ("species[0].drift_velocity=[1.0]", "species[0].drift_velocity: needs 2 numbers in 2D, or 3 (got 1)"),
        ("species[0].drift_velocity=[1, 1, 1, 1]", "species[0].drift_velocity: needs at most 3 value(s) (got"),
        ("simulation.space_length=[]", "simulation.space_length: needs at least 1 value(s) (got"),
        ("simulation.plasma_chunks=4097", "simulation.plasma_chunks: must be less than or equal to 4096"),
        ("species[0].position_init=[1.0]", "species[0].position_init: needs 2 number(s)"),
        ('species[0].init_method="position delta"', "species[0]: position_init is missing"),
        ('species[0].init_method="harmonic two electrons"', "species[0].particles: must be 2"),
        (
            'species[0].init_method="quite"',
            "'harmonic two electrons', 'default' or 'random position' (got 'quite'); did you mean 'quiet'?",
        ),
        (
            "species[0].perturbation={mode=[1]}",
            "species[0].perturbation.mode: needs 2 number(s) in 2D (got 1)",
        ),
        ("species[0].perturbation={mode=[0, 0]}", "species[0].perturbation.mode: must not be zero"),
        (
            "species[0].perturbation={mode=[1, 0]; amplitude=1.0}",
            "species[0].perturbation.amplitude: must be less",
        ),
        ('species[0].init_method="uniform velocities"', '"uniform velocities" have a spread of their own'),
        ("species[0].thermal_velocity=-1", "species[0].thermal_velocity: must be greater than or equal to 0"),
        ("numerics.reproducible=false", "numerics.reproducible: must be true"),
        ("numerics.shape=PQS", "numerics.shape: must be 'NGP', 'CIC' or 'TSC' (got 'PQS')"),
        ("simulation.random_seed=-1", "simulation.random_seed: must be greater than or equal to 0"),
        ("simulation.boundary=open", "simulation.boundary: unknown key; the box is periodic along every axis"),
        ("walls=1", "walls: unknown key; the box is periodic along every axis"),
        ("species[0].bc=1", "species[0].bc: unknown key; the box is periodic along every axis"),
        ("species[0].collisions=1", "species[0].collisions: unknown key; particles collide with no gas"),
        ("simulation.laser=1", "simulation.laser: unknown key; the field is electrostatic"),
        ("species[0].fixed=true", "species[0].fixed: unknown key; a background that makes the box neutral"),
        ("species[0].temperature_anisotropy=2.0", "unknown key; temperatures by axis are velocities of `start`"),
        ("species[0].thermal_velocity=[1.0, 2.0]", "(got [1.0, 2.0]); temperatures by axis are velocities of `start`"),
        ("species[0].B=1", "species[0].B: unknown key; the magnetic field is field.magnetic"),
    ],
)
def test_settings_that_do_not_fit_are_refused(assignment, message):
    messages = faults_of(CASE, [assignment])
    assert any(message in fault for fault in messages), messages
    assert len(messages) <= 2


def test_points_of_another_number_are_no_fault_of_the_modes():
    """They were told to have as many numbers as the grid has points, beside the grid that has too few."""
    (message,) = faults_of(CASE, ["grid.points=[16]", "output.modes=([1, 0])"])
    assert "grid.points: needs 2 number(s) in 2D (got 1)" in message


@pytest.mark.parametrize(
    ("grid", "message"), [("", "grid: needs points"), ("blocks = [4, 4];", "grid.blocks: needs points")]
)
def test_a_grid_has_points(grid, message):
    (told,) = faults_of(re.sub(r"grid = {.*?};", f"grid = {{ {grid} }};", CASE))
    assert message in told


def test_a_charge_of_zero_has_no_plasma_frequency():
    (message,) = faults_of(CASE, ["species[0].charge=0", "species[0].plasma_frequency=1"])
    assert "species[0].charge: must not be 0 where plasma_frequency is given" in message


def test_species_of_one_name_are_told_apart_by_their_numbers():
    more = ("a", "a", "a_3", "a")
    others = "".join(f', {{ name = "{name}"; particles = 0; charge = 1; mass = 1; }}' for name in more)
    config, tree = read(CASE.replace(");\n", f"{others});\n"))
    assert [species.name for species in config.species] == ["species_1", "a", "a_4", "a_3", "a_5"]
    first, second = tree.warnings
    assert "species[2].name: 'a' is taken; called 'a_4' here" in first and "species[4].name" in second
    assert read(dump(config))[0] == config


def test_his_word_for_opposite_beams_is_that_of_his_program():
    config, _ = read(CASE.replace('init_method = "quiet"', 'velocity_method = "two-stream"'))
    assert config.species[0].init_method == "opposite beams"
    (message,) = faults_of(CASE, ['species[0].velocity_method="two-stream"'])  # beside another method
    assert "species[0].velocity_method: unknown key" in message


PERIODS = {
    "": {"field": 0, "particle": 0, "checkpoint": 0},
    "simulation.sampling_period={energy=5; field=10; particle=20}": {"series": 5, "field": 10, "particle": 20},
    "output.sampling_period={field=10; particle=20}": {"field": 10, "particle": 20},
    "output.period={field=10; particle=20}": {"field": 10, "particle": 20},
    "output.checkpoint=30": {"checkpoint": 30},
    "output.every={series=5; fields=10; particles=20; checkpoint=30}": {
        "series": 5, "field": 10, "particle": 20, "checkpoint": 30,
    },
    "output.period={series=0.5; fields=1.04; particles=2.0; checkpoint=3}": {
        "series": 5, "field": 10, "particle": 20, "checkpoint": 30,
    },
    "output.period={series=1e-9; fields=0; checkpoint=1e308}": {"series": 1, "field": 0, "checkpoint": 2**62},
    "output.every.series=0": {"series": 0},
}  # fmt: skip


@pytest.mark.parametrize("assignment", PERIODS)
def test_periods_in_steps_and_in_seconds_and_in_his_words_are_one(assignment):
    config, tree = read(sets=[assignment] if assignment else [])
    assert config.periods | PERIODS[assignment] == config.periods and tree.warnings == []
    again, _ = read(dump(config))
    assert again == config and "sampling_period" not in dump(config)


def test_the_last_of_two_words_for_one_period_counts_and_two_in_one_file_are_refused():
    asked = CASE.replace("cycles = 10;", "cycles = 10; sampling_period = { energy = 7; };")
    for setting in ("output.every.series=3", "output.period.series=0.3"):
        assert read(asked, [setting])[0].periods["series"] == 3
        assert read(asked, [setting, "output.every={series=4}"])[0].periods["series"] == 4
    (message,) = faults_of(asked + "output = { period = { series = 0.3; }; };")
    assert "give either this or" in message and "simulation.sampling_period.energy" in message
    (message,) = faults_of(asked.replace("energy", "enrgy"))
    assert "simulation.sampling_period.enrgy: unknown key; did you mean 'energy'?" in message
    assert "must be a group" in faults_of(CASE, ["simulation.sampling_period=5"])[0]


def test_no_particles_and_no_species_are_cases_too():
    assert read(sets=["species[0].particles=0"])[0].species[0].particles == 0
    assert read(CASE.partition("species")[0])[0].species == ()


def test_time_may_run_backwards():
    assert read(sets=["simulation.time_step=-0.1"])[0].simulation.time_step == -0.1


def test_checking_a_case_loads_no_heavy_library():
    import subprocess
    import sys

    code = (
        "import sys\n"
        "from hpcpic.core.case.config import load\n"
        "from hpcpic.plasma.configure import configure\n"
        "from hpcpic.plasma.forecast.derived import derived\n"
        f"derived(configure(load({str(CPIC / 'pair-2d.conf')!r})))\n"
        "print({'mpi4py', 'numba', 'h5py', 'pyfftw', 'matplotlib', 'scipy'} & set(sys.modules))\n"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert out.stdout == "set()\n", out.stderr


keys = st.sampled_from(sorted({part.strip("[]") for row in describe(PlasmaConfig) for part in row.key.split(".")}))
leaves = st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.sampled_from(["MFT_TAP", "quiet"])
anything = st.recursive(
    leaves,
    lambda inner: st.lists(inner, max_size=3) | st.lists(inner, max_size=3).map(tuple) | st.dictionaries(keys, inner),
    max_leaves=15,
)


def no_tree_breaks_the_validation(data):
    try:
        configure(Tree(data=data))
    except ConfigError as error:
        assert error.messages and all("\n" not in message for message in error.messages)


def tried(few, many, strategy, law):
    """A law of any example, of few of them and, with the validation, of many."""
    return settings(max_examples=few)(given(strategy)(law)), pytest.mark.validation(
        settings(max_examples=many)(given(strategy)(law))
    )


test_no_tree_breaks_the_validation, test_none_of_many_trees_does = tried(
    100, 300, st.dictionaries(keys | st.sampled_from(["plot", "method", "period"]), anything),
    no_tree_breaks_the_validation,
)  # fmt: skip


FULL = """
description = "all keys";
simulation = { dimensions = 2; solver = "MFT"; cycles = 10; time_step = 0.1; space_length = [8.0, 4.0];
               realtime_plot = 1; sampling_period = { energy = 1; field = 2; }; method = "LU"; };
grid = { points = [16, 8]; };
field = { magnetic = [0.0, 0.0, 1.0]; electric = [0.0, 0.0, 0.0]; };
species = ( { name = "e"; particles = 64; charge = -1.0; mass = 1.0; init_method = "quiet";
              cyclotron_frequency = 0.0; perturbation = { mode = [1, 0]; amplitude = 0.1; }; },
            { particles = 2; charge = 1.0; mass = 1.0; init_method = "harmonic two electrons"; } );
output = { path = "x"; period = { field = 1; }; };
plot = { size = [1, 2]; };
"""
PATHS = sorted(loads(FULL).places, key=str)


def no_setting_of_a_wrong_kind_breaks_the_validation(changes):
    tree = loads(FULL)
    for path, value in changes:
        parent = tree.data
        for key in path[:-1]:
            parent = parent[key] if tree.has(path[:-1]) else {}
        if isinstance(parent, (dict, list)) and tree.has(path):
            parent[path[-1]] = value
    try:
        config = configure(tree)
    except ConfigError as error:
        assert error.messages and all(message.startswith("case:") for message in error.messages)
    else:
        assert read(dump(config))[0] == config


test_no_setting_of_a_wrong_kind_breaks_the_validation, test_none_of_many_settings_does = tried(
    150, 400, st.lists(st.tuples(st.sampled_from(PATHS), anything), min_size=1, max_size=3),
    no_setting_of_a_wrong_kind_breaks_the_validation,
)  # fmt: skip


def test_fields_from_outside_keep_no_more_than_they_can():
    def kept(*sets):
        return set(read(sets=sets)[0].conserved)

    every = {"charge", "energy_total", "momentum_x", "momentum_y", "momentum_z"}
    assert kept() == every
    assert kept("field.magnetic=[0.0, 0.0, 1.0]") == every - {"momentum_x", "momentum_y"}
    assert kept("field.electric=[0.0, 1.0, 0.0]") == every - {"energy_total", "momentum_y"}
