"""Cases that start from arrays in Python, and copies of cases."""

import pickle

import numpy as np
import pytest
from app_runner import launch

import hpcpic
import lbmdem
import sph


def arrays_of(n):
    return np.random.default_rng(2).uniform(0.0, 8.0, (n, 1)), np.linspace(-1.0, 1.0, n)[:, None]


def started(**start):
    return hpcpic.Case(
        simulation={"cycles": 4, "time_step": 0.1, "space_length": [8.0]}, grid={"points": [8]},
        species=[{"name": "e", "charge": -1.0, "mass": 1.0, "start": start}],
    )  # fmt: skip


def test_a_run_that_starts_from_arrays_keeps_them(tmp_path):
    """In memory, from a file beside a saved case, and after a restart when the case is gone: one digest."""
    x, v = arrays_of(64)
    case = started(position=x, velocity=v).changed({"simulation.cycles": 8})
    with case.simulation(threads=1) as sim:
        np.testing.assert_array_equal(sim.particles()["position"][:, 0], x[:, 0])
        sim.advance()
        digest = sim.digest()
    case.save(tmp_path / "mine.conf")
    short = hpcpic.Case(tmp_path / "mine.conf").changed({"simulation.cycles": 4})
    short.run(tmp_path / "run", threads=1, quiet=True)
    (tmp_path / "mine-start-1.npz").unlink()
    words = ("-m", "hpcpic", "restart", str(tmp_path / "run"), "--set", "simulation.cycles=8")
    assert launch(1, *words).returncode == 0
    assert hpcpic.open_run(tmp_path / "run").digest == digest


@pytest.mark.parametrize("speed", [3.0, 10.0, 1e10])
def test_velocities_of_arrays_are_judged_like_a_drift(speed):
    x, _ = arrays_of(64)
    given = started(position=x, velocity=np.full((64, 1), speed)).changed({"species[0].drift_velocity": [70.0]})
    drift = started(position=x).changed({"species[0].drift_velocity": [speed]})
    one, other = (next(r for r in c.check().rows if r.name == "fastest particle") for c in (given, drift))
    assert one == other and one.verdict == ("ok" if speed < 10 else "warn" if speed < 1e10 else "fail")


def test_light_judges_velocities_of_arrays():
    case = hpcpic.Case(
        units="SI", simulation={"cycles": 4, "time_step": 1e-11, "space_length": [8.0]}, grid={"points": [8]},
        species=[{"name": "e", "particle": "electron", "density": 1e6, "start": {"velocity": np.full((64, 1), 6e8)}}],
    )  # fmt: skip
    (row,) = [row for row in case.check().rows if row.name == "speed against light"]
    assert row.verdict == "warn" and row.value == pytest.approx(2.0, rel=0.01)


def test_arrays_that_the_case_would_not_read_are_refused():
    with pytest.raises(hpcpic.ConfigError, match="got 'quiet'"):
        hpcpic.Case("bump-on-tail").changed({"species[1].start": {"position": arrays_of(9)[0]}})


def test_a_case_survives_pickling_with_its_changes_and_its_arrays():
    """Also when the case that was pickled, whose files its arrays were in, is gone."""
    x, v = arrays_of(64)
    cases = [sph.Case("weir").changed({"numerics.spacing": 0.02}), started(position=x, velocity=v)]
    told = [repr(case) for case in cases]
    case, other = pickle.loads(pickle.dumps(cases.pop(0))), pickle.dumps(cases.pop())
    assert type(case) is sph.Case and case.config.numerics.spacing == 0.02
    other = pickle.loads(other).changed({"simulation.cycles": 8})
    with other.simulation(threads=1) as sim:
        np.testing.assert_array_equal(sim.particles()["position"][:, 0], x[:, 0])
    assert repr(case) == told[0] and repr(other).startswith(told[1][:-1])


def test_positions_may_have_three_components_as_they_are_read():
    x, v = arrays_of(64)
    with started(position=x, velocity=v).simulation(threads=1) as sim:
        sim.advance()
        digest = sim.digest()
    with started(position=np.pad(x, ((0, 0), (0, 2))), velocity=v).simulation(threads=1) as sim:
        np.testing.assert_array_equal(sim.particles()["position"][:, 0], x[:, 0])
        sim.advance()
        assert sim.digest() == digest


@pytest.mark.parametrize(
    ("start", "told"),
    [
        ({"position": np.zeros((4, 2))}, r"position must have the shape \[n, 1\] \(got \[4, 2\]\)"),
        ({"position": np.zeros(4)}, r"the shape \[n, 1\] \(got \[4\]\); array\[:, None\] has it"),
        ({"position": np.eye(4)[:, :3]}, "position must be 0 in y and z in this box"),
        ({"positions": np.zeros((4, 1))}, "holds an array 'positions'; there are position, velocity"),
        ({"position": np.zeros((4, 1)), "velocity": np.zeros((3, 1))}, "arrays of different lengths: 3, 4"),
        ({"velocity": [[np.nan]]}, r"velocity must hold finite numbers \(got nan at \[0, 0\]\)"),
        ({"velocity": [[1j]]}, r"velocity must hold real numbers \(got complex128\)"),
        ({"file": "nowhere.npz"}, r"species\[0\].start.file: \S+nowhere.npz: cannot be read as arrays .No such file"),
    ],
)
def test_arrays_that_cannot_be_a_start_are_told(start, told):
    with pytest.raises(hpcpic.ConfigError, match=told):
        started(**start)


def test_arrays_are_called_by_the_key_that_they_were_given_under():
    wrong = {"position": np.zeros((4, 2))}
    with pytest.raises(hpcpic.ConfigError, match=r"^hpcpic.Case: species\[0\].start: position must"):
        started(**wrong)
    with pytest.raises(hpcpic.ConfigError, match=r"^changed: species\[0\].start: position must"):
        started(position=np.zeros((4, 1))).changed({"species[0].start": wrong})


@pytest.mark.parametrize(
    ("program", "group", "others"),
    [
        (sph, "fluid", {"numerics": {"spacing": 0.1}}),
        (lbmdem, "grains", {"domain": {"size": [1.0, 1.0]}}),
    ],
)
def test_a_file_of_arrays_that_is_not_there_is_told_with_its_key_and_nothing_else_is(program, group, others):
    """Not that there is no shape, or no position: all that follows reads the arrays."""
    with pytest.raises(hpcpic.ConfigError) as told:
        program.Case(simulation={"end_time": 1.0}, **others, **{group: [{"start": {"file": "nowhere.npz"}}]})
    (message,) = told.value.messages
    assert f"{group}[0].start.file: " in message and "nowhere.npz: cannot be read as arrays (No such file" in message


def test_an_empty_list_is_no_groups_and_no_numbers():
    """Python has one kind of list; a case file has lists of groups and arrays of numbers."""
    none = lbmdem.Case("settling-disc").changed({"grains": [], "gravity": np.zeros(0), "boundary": ()}).config
    assert (none.grains, none.gravity, none.boundary) == ((), (0.0, 0.0), ())
    with pytest.raises(hpcpic.ConfigError, match="space_length: needs at least 1 value"):
        hpcpic.Case("landau-damping").changed({"simulation.space_length": []})


def handed_over(case, particles):
    """The case from these particles on."""
    arrays = {"position": particles["position"].values, "velocity_before": particles["velocity"].values}
    return case.changed({"species[0].start": arrays})


def gyrating(charge, **more):
    rng = np.random.default_rng(0)
    start = {"position": rng.random((200, 2)) * 16, "velocity": rng.normal(0, 1, (200, 2))}
    return hpcpic.Case(
        simulation={"cycles": 1000, "time_step": 0.3, "space_length": [16.0, 16.0]}, grid={"points": [16, 16]},
        species=[{"name": "e", "charge": -charge, "mass": charge, "start": start}], **more
    )  # fmt: skip


def test_twenty_handovers_in_a_magnetic_field_keep_the_energy():
    case = gyrating(1e-9, field={"magnetic": [0.0, 0.0, 1.0]})
    with case.simulation(threads=1) as sim:
        first = sim.scalars()["energy_kinetic"]
    for _ in range(20):
        with case.simulation(threads=1) as sim:
            sim.advance(steps=2)
            case = handed_over(case, sim.particles())
            last = sim.scalars()["energy_kinetic"]
    assert last == pytest.approx(first, rel=1e-3)


@pytest.mark.parametrize(
    "more",
    [
        {"field": {"magnetic": [0.0, 0.0, 1.0]}, "numerics": {"exact_phase": True}},
        {"field": {"magnetic": [0.4, -0.3, 1.0], "electric": [0.1, 0.2, 0.0]}},
        {},
    ],
)
def test_a_simulation_goes_on_from_the_particles_of_another_to_rounding(more):
    case = gyrating(0.1, **more)
    with case.simulation(threads=1) as sim:
        sim.advance(steps=3)
        with handed_over(case, sim.particles()).simulation(threads=1) as other:
            for steps in (0, 4):
                sim.advance(steps=steps)
                other.advance(steps=steps)
                one, two = sim.particles(), other.particles()
                assert np.allclose(one["velocity"], two["velocity"], rtol=0, atol=1e-10)
                assert np.allclose(one["position"], two["position"], rtol=0, atol=1e-10)


def test_velocities_are_of_the_start_or_of_half_a_step_before():
    case, v = gyrating(0.1), np.zeros((200, 2))
    with pytest.raises(hpcpic.ConfigError, match=r"start.*velocity_before, of half a step before: one of them"):
        case.changed({"species[0].start": {"velocity": v, "velocity_before": v}})


@pytest.mark.parametrize(
    "change", [{"thermal_velocity": 1.0}, {"temperature": 1.0}, {"perturbation": {"mode": [1, 0], "amplitude": 0.1}}]
)
def test_nothing_is_added_to_a_state_that_goes_on(change):
    """The deviates are those that the velocities began with: a warm plasma went on with 4.4 times its energy."""
    case = gyrating(0.1).changed({"species[0].plasma_frequency": 1.0})
    case = case.changed({"species[0].start": {"velocity_before": np.zeros((200, 2))}})
    with pytest.raises(hpcpic.ConfigError, match="velocity_before, of a state that goes on: thermal_velocity"):
        case.changed({"species[0]": change})


def test_arrays_are_refused_beside_an_older_word_for_random_places():
    """They were left out, but for their being of half a step before."""
    with pytest.raises(hpcpic.ConfigError, match='init_method "arrays" only'):
        gyrating(0.1).changed({"species[0].init_method": "random position"})
