"""Whatever fails on whichever rank: told once, all ranks leave with its code, what was saved stays good."""

import csv
import re
import time

import pytest
from toy_runner import RUN_A

from hpcpic.core.files.reader import open_run


def run_with_fault(toy, kind, ranks=2, step=20, **settings):
    fault = {"fault__kind": f'"{kind}"', "fault__rank": ranks - 1, "fault__step": step}
    begin = time.monotonic()
    done = toy(*RUN_A, *settings.pop("words", ()), ranks=ranks, **fault, **settings)
    assert time.monotonic() - begin < 15
    return done


@pytest.fixture
def temporary(toy):
    """The environment of programs whose temporary files go to a folder, in which nothing may be left."""
    folder = toy.folder / "tmp"
    folder.mkdir()
    yield {"TMPDIR": str(folder)}
    assert [path.name for path in folder.glob("hpcpic*")] == []


@pytest.mark.parametrize("kind", ["raise", "raise everywhere", "thread"])
def test_one_traceback_and_exit_1(toy, kind, temporary):
    done = run_with_fault(toy, kind, env=temporary)
    assert done.returncode == 1
    assert done.stderr.count("Traceback") == 1
    assert done.stderr.count("\nZeroDivisionError: ") == 1
    assert "MPI_Abort" not in done.stderr  # nothing is told beside the cause
    facts = toy.facts("a")
    assert facts["status"] == "failed" and facts["exit_code"] == 1
    assert [(part["status"], part["exit_code"]) for part in facts["history"]] == [("failed", 1)]


def test_one_traceback_without_mpirun(toy):
    done = run_with_fault(toy, "raise", ranks=1)
    assert done.returncode == 1 and done.stderr.count("Traceback") == 1


def test_exit_on_one_rank_ends_all(toy):
    done = run_with_fault(toy, "exit")
    assert done.returncode == 3 and "rank 1 of 2 left by sys.exit(3)" in done.stderr


def test_not_a_number_is_exit_4_with_a_reason_and_the_last_checkpoint(toy):
    done = run_with_fault(toy, "nan", step=50, words=("--checkpoint-every", "20"))
    assert done.returncode == 4
    facts = toy.facts("a")
    assert facts["status"] == "diverged" and "u is not finite in row" in facts["reason"]
    assert toy.checkpoints("a") == [20, 40]
    told = (toy.folder / "a" / "post-mortem.txt").read_text()
    assert "rank 1 of 2" in told and "checkpoint of step 40" in told and "restart a" in told
    step = int(re.search(r"seen at step (\d+)", told)[1])
    assert f"t = {step / 1024!r} s" in told  # a plain number
    assert "Traceback" not in done.stderr
    assert toy("restart", "a", fault__kind='"none"').returncode == 0
    assert toy.facts("a")["state_digest"] == toy.digest()


def test_a_divergence_before_any_checkpoint_offers_no_restart(toy):
    assert run_with_fault(toy, "nan", step=50).returncode == 4
    told = (toy.folder / "a" / "post-mortem.txt").read_text()
    assert "none: start again" in told and "restart" not in told and "run a/config.conf -o a-again" in told


def test_a_divergence_that_one_rank_raises_leaves_a_post_mortem_too(toy):
    done = run_with_fault(toy, "diverge", step=50, words=("--checkpoint-every", "20"))
    assert done.returncode == 4 and "Traceback" not in done.stderr
    told = (toy.folder / "a" / "post-mortem.txt").read_text()
    assert "the toy was told to diverge" in told and "rank 1 of 2" in told and "step 50," in told
    assert "checkpoint of step 40" in told and "restart a" in told
    (part,) = toy.facts("a")["history"]
    assert (part["status"], part["exit_code"]) == ("diverged", 4)
    assert part["steps"] == toy.facts("a")["steps"] == int(re.search(r"step (\d+),", told)[1])


def test_snapshots_that_wait_are_in_the_files_when_a_checkpoint_is(toy):
    """One in every step: a run that is killed has those up to its checkpoint, one that ends has all."""
    every = {"output__field": 1, "output__particle": 1}
    toy(*RUN_A, "--checkpoint-every", "25", ranks=2,
        fault__kind='"kill"', fault__rank=1, fault__step=110, **every)  # fmt: skip
    for name in ("field", "particle"):
        steps = getattr(open_run(toy.folder / "a"), f"{name}_snapshots").steps
        assert steps.tolist() == list(range(len(steps))) and len(steps) >= 101
    assert toy("restart", "a", fault__kind='"none"').returncode == 0
    for name in ("field", "particle"):
        assert getattr(open_run(toy.folder / "a"), f"{name}_snapshots").steps.tolist() == list(range(201))


# on more ranks: tests/core/cli/test_restart.py
@pytest.mark.parametrize("restart_ranks", [1, pytest.param(3, marks=pytest.mark.validation)])
def test_killed_in_mid_step_goes_on_to_the_same_state(toy, restart_ranks, temporary):
    done = run_with_fault(toy, "kill", step=110, words=("--checkpoint-every", "25"), env=temporary)
    assert done.returncode != 0
    assert toy.checkpoints("a") == [75, 100]
    done = toy("restart", "a", ranks=restart_ranks, fault__kind='"none"')
    assert done.returncode == 0, done.stderr
    assert toy.facts("a")["state_digest"] == toy.digest()
    parts = [(p["status"], p["first_step"], p["steps"], p["ranks"]) for p in toy.facts("a")["history"]]
    assert parts == [("killed", 0, None, 2), ("finished", 100, 200, restart_ranks)]
    toy("run", "ring.conf", "-o", "whole", "--replace", "--threads", "1")
    rows = [list(csv.DictReader((toy.folder / name / "series.csv").open())) for name in ("a", "whole")]
    assert rows[0] == rows[1]  # every step once


def test_killed_in_the_middle_of_a_checkpoint_goes_on_from_the_one_before(toy):
    done = run_with_fault(toy, "kill in checkpoint", step=90, words=("--checkpoint-every", "25"))
    assert done.returncode != 0
    assert toy.checkpoints("a") == [50, 75]
    done = toy("restart", "a", fault__kind='"none"')
    assert done.returncode == 0, done.stderr
    assert toy.facts("a")["state_digest"] == toy.digest()
    assert [path.name for path in (toy.folder / "a" / "checkpoints").glob(".*")] == []
