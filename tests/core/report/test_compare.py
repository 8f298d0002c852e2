"""`compare`: runs whose steps have other lengths are compared in time."""

from hpcpic.core.files.reader import open_run
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.series import SeriesWriter
from hpcpic.core.report.compare import _series


def run_of(folder, times, rate=3.0):
    rundir = RunDir.create(folder, config="a = 1;")
    series = SeriesWriter(rundir, {"x": "m"})
    for step, time in enumerate(times):
        series.append(step * len(times), time, {"x": 1.0 + rate * time})
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
