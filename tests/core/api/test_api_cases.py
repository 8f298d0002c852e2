"""What a case is made of in Python, how it is changed, and in which words it is refused."""

import numpy as np
import pytest

import hpcpic
import lbmdem
import sph
from hpcpic.core.app.read import read_case
from hpcpic.core.case.dump import dump
from hpcpic.core.case.texts import value_text
from hpcpic.core.errors import ConfigError
from sph.app import APP


def test_a_run_that_is_refused_is_told_as_the_case_of_python(tmp_path):
    """Not as the file that it is written to for the time being."""
    electrons = {"charge": -1.0, "mass": 1.0, "plasma_frequency": 1.0, "particles": 64}
    simulation = {"cycles": 2, "time_step": 5.0, "space_length": [16.0]}
    case = hpcpic.Case(simulation=simulation, grid={"points": [16]}, species=[electrons])
    for refused in (case.simulation, lambda: case.run(tmp_path / "run")):
        with pytest.raises(hpcpic.ConfigError, match=r"^hpcpic\.Case: simulation\.time_step: time step wp dt = 5 "):
            refused()


def test_a_case_made_of_keys_is_the_case_of_its_text(tmp_path):
    case = sph.Case(
        simulation={"dimensions": 2, "end_time": 0.1},
        numerics={"spacing": 0.05},
        gravity=(0.0, -9.81),
        fluid=[{"shape": {"box": {"low": np.zeros(2), "high": [0.5, np.float64(0.5)]}}}],
    )
    case.save(tmp_path / "my.conf")
    assert str(sph.Case(tmp_path / "my.conf")) == str(case) == (tmp_path / "my.conf").read_text()
    assert case.config.fluid[0].shape.box.high == (0.5, 0.5)


@pytest.mark.parametrize(
    ("case", "nested", "dotted"),
    [
        ("water-column", {"simulation": {"end_time": 0.5}}, {"simulation.end_time": 0.5}),
        (
            "water-column",
            {"numerics": {"spacing": 0.05}, "output": {"period": {"series": 0.01}}, "fluid[0]": {"name": "sea"}},
            {"numerics.spacing": 0.05, "output.period.series": 0.01, "fluid[0].name": "sea"},
        ),
        (
            "water-column",
            {"fluid[0].shape": {"sphere": {"centre": [0.3, 0.3], "radius": 0.1}}},  # in place of the box
            {"fluid[0].shape.sphere.centre": [0.3, 0.3], "fluid[0].shape.sphere.radius": 0.1},
        ),
    ],
)
def test_a_group_changes_as_its_keys_do_and_as_the_command_line_does(case, nested, dotted):
    made = sph.Case(case).changed(nested)
    sets = tuple(f"{key}={value_text(value)}" for key, value in dotted.items())
    assert str(made) == str(sph.Case(case).changed(dotted)) == dump(read_case(APP, case, sets).config)
    assert str(made) != str(sph.Case(case))


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: sph.Case("water-colum"), "did you mean 'water-column'"),
        (lambda: sph.Case("water-column").changed({"numerics.spacng": 1.0}), "did you mean 'spacing'"),
        (lambda: sph.Case(simulation={"dimensions": 2}), "simulation.end_time: missing"),
        (lambda: sph.Case(fluid=[{"shpe": 1}]), r"sph.Case: fluid\[0\].shpe: unknown key; did you mean 'shape'"),
        (lambda: sph.Case(gravity=[0.0, {1, 2}]), r"gravity\[1\]: a case holds numbers"),
        (lambda: sph.Case(gravity=[0.0, float("inf")]), r"gravity\[1\]: must be a finite number \(got inf\)"),
        (lambda: sph.Case(), "a case is made of"),
        (lambda: sph.Case({"simulation": {"dimensions": 2}}), "takes its sections by name"),
    ],
)
def test_what_is_wrong_is_raised_in_the_words_of_the_command_line(make, told):
    with pytest.raises(hpcpic.ConfigError, match=told):
        make()


def test_messages_call_a_change_as_python_does():
    case = hpcpic.Case("plasma-oscillation")
    with pytest.raises(hpcpic.ConfigError, match=r"^changed: grid.pointz=3: grid.pointz: unknown key"):
        case.changed({"grid.pointz": 3})
    with pytest.raises(hpcpic.ConfigError, match=r"^changed: simulation.time_step=100.0: simulation.time_step"):
        case.changed({"simulation.time_step": 100.0}).simulation()


def test_a_fault_that_several_sets_share_is_told_once():
    disc = {"diameter": 2e-3, "density": 1010.0}
    case = lbmdem.Case(
        simulation={"end_time": 1.0}, domain={"size": [0.02, 0.08], "spacing": 2e-4},
        fluid={"kinematic_viscosity": 1e-6}, gravity=[0.0, -9.81],
        grains=[{"position": [x, 0.07], **disc} for x in (0.008, 0.012)],
    )  # fmt: skip
    with pytest.raises(ConfigError, match=r"relaxation_time = 0\.6.* makes the time step short enough") as raised:
        case.simulation()
    assert len(raised.value.messages) == 1


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda case: hpcpic.Case(str(case)), r"text of a case: write it to a file, .*\.write_text"),
        (lambda case: case.changed("simulation.cycles=3"), "keys with their values"),
        (lambda case: hpcpic.Case(3), r"a shipped name or a path \(got 3\)"),
        (lambda case: case.changed({"species[7]": {"name": "i"}}), "to add one give the whole list, species"),
        (lambda case: case.changed({"species[0].perturbation": None}), "to leave a key out make the case anew, or"),
    ],
)
def test_what_a_case_cannot_be_made_of_is_told_with_what_it_can(make, told):
    with pytest.raises(hpcpic.ConfigError, match=told):
        make(hpcpic.Case("plasma-oscillation"))


def test_the_shipped_cases_are_told(capsys):
    for package in (hpcpic, sph, lbmdem):
        found = package.cases()
        assert len(found) > 5 and all(found[name].what for name in found)
        assert all(name in repr(found) and name in found._repr_html_() for name in found)


def test_an_estimate_reads_as_the_command_prints_it():
    forecast = sph.Case("water-column").estimate(ranks=2)
    assert forecast.seconds > 0 and sum(forecast.memory.values()) > 0
    assert "2 ranks x 1 thread" in repr(forecast)
