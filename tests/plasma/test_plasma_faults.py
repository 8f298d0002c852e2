"""Whatever befalls a run of the plasma, it ends clearly, and a restart ends in the state of a quiet run."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from app_runner import MPIRUN, environment, launch
from plasma_cases import PLANE

import hpcpic

STEPS = 400
FAULTY = str(Path(__file__).with_name("faulty_plasma.py"))
CASE = PLANE.replace("cycles = 20;", f"cycles = {STEPS}; sampling_period = {{ energy = 50; }};")


@pytest.fixture(scope="module")
def digest(tmp_path_factory):
    """Of the run that nothing befalls."""
    folder = tmp_path_factory.mktemp("quiet")
    done = run(folder, 2)
    assert done.returncode == 0, done.stderr
    return facts(folder)["state_digest"]


@pytest.fixture
def folder(tmp_path):
    return tmp_path


def words(folder, *more):
    (folder / "plane.conf").write_text(CASE)
    return ("run", str(folder / "plane.conf"), "-o", str(folder / "run"), "--threads", "1", *more)


def run(folder, ranks, *more, program=("-m", "hpcpic")):
    return launch(ranks, *program, *words(folder, *more))


def restart(folder, ranks):
    done = launch(ranks, "-m", "hpcpic", "restart", str(folder / "run"), "--threads", "1")
    assert done.returncode == 0, done.stderr


def with_fault(folder, kind, *more, step=110):
    """On two ranks; the second has the fault."""
    return run(folder, 2, *more, program=(FAULTY, kind, "1", str(step)))


def facts(folder):
    return json.loads((folder / "run" / "run.json").read_text())


def checkpoints(folder):
    return sorted(int(path.stem) for path in (folder / "run" / "checkpoints").glob("*.h5"))


def check_goes_on(folder, ranks, digest, **changes):
    """On one rank in this process."""
    if ranks == 1:
        hpcpic.open_run(folder / "run").restart(changes, threads=1, quiet=True)
    else:
        assert not changes
        restart(folder, ranks)
    assert facts(folder)["steps"] == STEPS and facts(folder)["state_digest"] == digest


def start(folder, arguments):
    """On two ranks, into the step loop."""
    process = subprocess.Popen(
        [str(MPIRUN), "-n", "2", sys.executable, "-m", "hpcpic", *arguments],
        env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    log, begin = folder / "run" / "log.txt", time.monotonic()
    lines = log.read_text().count(": steps ") if log.exists() else 0
    while not (log.exists() and log.read_text().count(": steps ") > lines):
        assert process.poll() is None and time.monotonic() < begin + 60, process.communicate()
        time.sleep(0.02)
    return process


def kill_one_rank(process, rank):
    ranks = [child.pid for child in psutil.Process(process.pid).children(recursive=True) if "python" in child.name()]
    assert len(ranks) == 2
    os.kill(ranks[rank], signal.SIGKILL)
    begin = time.monotonic()
    process.communicate(timeout=10)
    assert process.returncode != 0 and time.monotonic() - begin < 5


@pytest.mark.validation  # by default of the toy: tests/core/cli
def test_killed_in_the_middle_of_a_step(folder, digest):
    done = with_fault(folder, "kill", "--checkpoint-every", "25")
    assert done.returncode != 0 and checkpoints(folder) == [75, 100]
    check_goes_on(folder, 1, digest)


@pytest.mark.validation
def test_killed_in_the_middle_of_a_checkpoint(folder, digest):
    done = with_fault(folder, "kill in checkpoint", "--checkpoint-every", "25", step=124)
    assert done.returncode != 0 and checkpoints(folder) == [75, 100]
    check_goes_on(folder, 2, digest)
    assert not list((folder / "run" / "checkpoints").glob(".*"))


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.validation)])
def test_killed_at_any_moment(folder, digest, seed):
    """While checkpoints are written all the time: the run, and then its restart."""
    delay = np.random.default_rng(seed).uniform(0.1, 0.8, 2)
    every = ("--checkpoint-every", "1")
    for k, arguments in enumerate([words(folder, *every), ("restart", str(folder / "run"), *every)]):
        process = start(folder, arguments)
        while not checkpoints(folder) and process.poll() is None:
            time.sleep(0.01)
        time.sleep(delay[k])
        kill_one_rank(process, (seed + k) % 2)
    assert 0 < checkpoints(folder)[-1] < STEPS
    check_goes_on(folder, 1, digest)


# Open MPI's launcher passes SIGTERM on but leaves with 1, whatever the ranks leave with
SIGNAL = "SIGUSR1" if MPIRUN.with_name("prterun").exists() else "SIGTERM"


@pytest.mark.validation
def test_signal_to_mpirun_stops_with_a_checkpoint(folder, digest):
    process = start(folder, words(folder, "--checkpoint-every", "2"))
    process.send_signal(signal.Signals[SIGNAL])
    output, errors = process.communicate(timeout=10)
    assert process.returncode == 5, errors
    assert facts(folder)["status"] == "stopped" and SIGNAL in facts(folder)["reason"]
    assert "restart" in output
    assert 0 <= checkpoints(folder)[-1] == facts(folder)["steps"] < STEPS
    check_goes_on(folder, 1, digest)


def test_exception_on_one_rank(folder):
    begin = time.monotonic()
    done = with_fault(folder, "raise")
    assert done.returncode == 1 and time.monotonic() - begin < 15
    assert done.stderr.count("Traceback") == 1 and "rank 1 of 2 failed" in done.stderr
    assert done.stderr.count("\nZeroDivisionError: told to fail") == 1
    assert (facts(folder)["status"], facts(folder)["exit_code"]) == ("failed", 1)


def test_not_a_number_on_one_rank(folder, digest):
    done = with_fault(folder, "nan", "--checkpoint-every", "25")
    assert done.returncode == 4, done.stderr
    assert "Traceback" not in done.stderr and "not a number" in done.stderr
    assert (facts(folder)["status"], facts(folder)["exit_code"]) == ("diverged", 4)
    check_goes_on(folder, 1, digest)


@pytest.mark.validation
def test_full_disk(disk, digest):
    """Snapshots fill it; the checkpoint that was there is good, and enough for the rest with room again."""
    done = run(disk, 2, "--checkpoint-every", "1", "--set", "output.sampling_period.particle=1")
    assert done.returncode == 6, done.stderr
    assert "Traceback" not in done.stderr and "No space left on device" in done.stderr
    assert checkpoints(disk)
    (disk / "run" / "particles.vtkhdf").unlink()
    check_goes_on(disk, 1, digest, **{"output.sampling_period.particle": 0})
