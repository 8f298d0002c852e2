"""`compare`: runs whose steps have other lengths are compared in time, places through the sides of a periodic box."""

import math

import numpy as np
import pytest

import hpcpic
from hpcpic.core.app.app import repeating
from hpcpic.core.files.reader import open_run
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.series import SeriesWriter
from hpcpic.core.report.compare import Note, _nearest, _series, kind_of


def run_of(folder, times, rate=3.0, **columns):
    rundir = RunDir.create(folder, config="a = 1;")
    series = SeriesWriter(rundir, {"x": "m", **dict.fromkeys(columns, "V/m")})
    for step, time in enumerate(times):
        series.append(step * len(times), time, {"x": 1.0 + rate * time, **columns})
    series.flush()
    rundir.unlock()
    return open_run(folder)


def test_series_with_nothing_in_common_are_no_equal_series(tmp_path):
    """What cannot be compared is told: a regression test must not pass by runs that were killed."""
    empty, late = run_of(tmp_path / "a", []), run_of(tmp_path / "b", [2.0, 3.0])
    assert list(_series(empty, empty)) == ["series: no row in either run, so nothing to compare"]
    early = run_of(tmp_path / "c", [0.0, 1.0, 1.5])
    for pair in ((early, empty), (empty, early), (early, late), (late, early)):
        found = list(_series(*pair))
        assert found and all(isinstance(entry, str) for entry in found), found


def test_scalars_at_other_times_are_compared_where_both_runs_have_been(tmp_path):
    """A scalar linear in time is the same in both to round-off; another rate shows at the end of the shorter run."""
    a = run_of(tmp_path / "a", [0.0, 0.1, 0.25, 0.5, 0.9, 1.0])
    told, same = _series(a, run_of(tmp_path / "b", [0.0, 0.3, 0.6]))
    assert "sampled at different times (6 and 3 rows), b interpolated in time" in told
    assert same.what == "series x" and same.max < 1e-15
    _, other = _series(a, run_of(tmp_path / "c", [0.0, 0.3, 0.6], rate=4.0))
    assert abs(other.max - 0.5) < 1e-15  # at 0.5 s, the last row of a until 0.6 s


def test_samples_at_other_times_of_runs_of_one_length_are_no_difference(tmp_path):
    """What both have sampled is compared as it is, without a line between samples: a swing would not be on it."""
    a = run_of(tmp_path / "a", [0.1 * k for k in range(11)])
    for number, times in enumerate(([0.2 * k for k in range(6)], [0.0, 0.4, 0.9])):
        for pair in (a, other := run_of(tmp_path / f"b{number}", times)), (other, a):
            told, found = _series(*pair)
            assert isinstance(told, Note) and found.max < 1e-15
            assert "compared at" in told and f"{len(times)} that both have" in told
    told, found = _series(a, run_of(tmp_path / "c", [0.0, 0.33, 0.77, 1.0], rate=4.0))
    assert isinstance(told, Note) and "b interpolated" in told and abs(found.max - 1.0) < 1e-12
    told, _ = _series(a, run_of(tmp_path / "d", [0.1 * k for k in range(10)]))  # a step less: another length
    assert not isinstance(told, Note)


def test_what_lies_between_samples_is_no_difference_of_runs_that_end_in_the_same_bits(tmp_path):
    """A swing, sampled at other times before a restart: its samples lie on no straight line."""
    a, b = (
        run_of(tmp_path / f"{n}", times, swing=0.0) for n, times in enumerate(([0.0, 0.5, 1.0], [0.0, 0.3, 0.65, 1.0]))
    )
    a.series["x"][1] += 0.1
    _, *ends = _series(a, b)
    _, *same = _series(a, b, same_end=True)
    assert [isinstance(found, Note) for found in ends] == [False, False] and max(d.relative for d in ends) > 0.01
    assert all(isinstance(found, Note) for found in same) and "series x: interpolated within 0.02" in " ".join(same)


def test_a_column_is_measured_by_the_largest_of_its_kind(tmp_path):
    names = ("mode_1_0_re", "mode_1_0_im", "momentum_x", "momentum_y", "energy_field")
    a = run_of(tmp_path / "a", [0.0], **dict(zip(names, (2.0, 1e-16, 3.0, 1e-16, 1e-16))))
    b = run_of(tmp_path / "b", [0.0], **dict(zip(names, (2.0, 3e-16, 3.0, -1e-16, 3e-16))))
    relative = {found.what: found.relative for found in _series(a, b)}
    assert relative["series mode_1_0_im"] < 1e-15 and relative["series momentum_y"] < 1e-15
    assert relative["series energy_field"] > 1  # nothing of its kind is larger
    kinds = {kind_of(name) for name in ("force_disc_x", "force_disc_y", "stress_zz_1", "energy_total", "level_2")}
    assert kinds == {"force_disc", "stress_zz", "energy_total", "level"}


def test_a_momentum_that_is_rounding_is_measured_by_all_mass_at_the_kinetic_energy(tmp_path):
    """Of particles that fly both ways alike momentum is 0 but for rounding: sqrt(2 m E) is theirs. A column of the mass
    comes first.
    """
    told = []
    for mass in ({}, {"mass": 8.0}):
        a, b = (
            run_of(tmp_path / f"{p}{len(mass)}", [0.0], momentum_x=p, energy_kinetic=1.0, **mass)
            for p in (1e-17, 4e-17)
        )
        told.append(
            [{one.what: one.relative for one in _series(a, b, False, m)}["series momentum_x"] for m in (0.0, 2.0)]
        )
    assert told == [[pytest.approx(3.0), pytest.approx(1.5e-17)], [pytest.approx(0.75e-17)] * 2]


def test_places_are_compared_by_the_shortest_way_through_periodic_sides():
    """A particle just inside of one side is next to one just inside of the other; beyond a wall it is far from it."""
    a, b = np.array([[0.01, 0.2, 0.0]]), np.array([[1.99, 2.9, 0.0]])
    np.testing.assert_allclose(_nearest(a, b, repeating((2.0, 3.0), "x")), [[-0.01, 2.9, 0.0]])
    np.testing.assert_allclose(_nearest(a, b, (2.0, 3.0)), [[-0.01, -0.1, 0.0]])
    assert repeating((2.0, 3.0), "y") == (math.inf, 3.0)


def test_runs_of_a_plasma_that_cross_a_side_at_other_steps_are_alike(tmp_path):
    """Two electrons that rest but for a drift of one part in 1000: one ends on this side of the box, one beyond."""
    case = hpcpic.Case(
        simulation={"cycles": 10, "time_step": 0.1, "space_length": [4.0]}, grid={"points": [4]},
        species=[{"name": "e", "charge": -1e-9, "mass": 1.0, "start": {"position": [[2.999]], "velocity": [[1.0]]}}],
        output={"every": {"particles": 10}},
    )  # fmt: skip
    far = case.changed({"species[0].start": {"position": [[3.001]], "velocity": [[1.0]]}})
    one, other = (c.run(tmp_path / n, threads=1, quiet=True) for n, c in (("a", case), ("b", far)))
    (place,) = [d for d in one.compare(other).differences if d.what.startswith("e position")]
    assert place.max == pytest.approx(0.002) and place.relative < 1e-3
