"""A restart from Python with other outputs: nothing of what is computed is lost, and it is read as one run."""

import numpy as np

import hpcpic

CASE = hpcpic.Case("two-stream-cold").changed(
    {"simulation.cycles": 4, "output": {"every": {"fields": 2, "histograms": 2}, "fields": ["rho", "E"]},
     "histogram": [{"name": "fv", "species": "right", "of": ["vx"]}]}
)  # fmt: skip


def test_a_restart_with_other_fields_and_histograms_goes_on_and_is_read_as_one_run(tmp_path):
    run = CASE.run(tmp_path / "run", threads=1, quiet=True)
    first, opened = np.array(run.fields("rho", step=4)), run
    assert run.series.step[-1] == 4
    later = {
        "simulation.cycles": 8,
        "output.fields": ["E", "phi"],
        "histogram": [{"name": "xv", "species": "right", "of": ["x", "vx"]}],
    }
    run = run.restart(later, threads=1, quiet=True)
    assert opened.series.step[-1] == 8 and len(opened.field_times) == 5  # the one that was restarted is read anew
    assert run.status == "finished" and not run.summary.get("reason")
    assert run.summary["exit_code"] == 0 and len(run.field_times) == 5
    assert set(run.field_names) == {"rho", "E", "phi"}
    assert int(run.fields("phi").step) == int(run.fields("E").step) == 8
    assert int(run.fields("rho", time=1e9).step) == 4 and np.array_equal(run.fields("rho"), first)
    assert run.histogram("fv").step.values.tolist() == [0, 2, 4] and run.histogram("xv").step.values.tolist() == [6, 8]
    CASE.run(run.path, threads=1, quiet=True, replace=True)
    assert not [*run.path.glob("*-2.*")]
