"""Early stops: exit code 5, a checkpoint at the step where all ranks stopped, and the same end after a
restart.
"""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest
from toy_runner import MPIRUN, ROOT, RUN_A, TOY, environment

SLOW = {"steps": 300, "pause": 0.005}


def ranks_of(process) -> list[int]:
    """Process ids of the MPI ranks under the launcher."""
    children = psutil.Process(process.pid).children(recursive=True)
    return [child.pid for child in children if "python" in child.name()]


def check_stopped_and_goes_on(toy, process, reason, restart_ranks=1):
    output, errors = process.communicate(timeout=20)
    assert process.returncode == 5, errors
    facts = toy.facts("a")
    assert facts["status"] == "stopped" and facts["exit_code"] == 5 and reason in facts["reason"]
    assert 0 < facts["steps"] < 300
    assert toy.checkpoints("a")[-1] == facts["steps"]
    assert "restart a" in output
    done = toy("restart", "a", "--threads", "1", ranks=restart_ranks, pause=0.0)
    assert done.returncode == 0, done.stderr
    assert toy.facts("a")["steps"] == 300
    assert toy.facts("a")["state_digest"] == toy.digest(steps=300)


own_ending = pytest.mark.skipif(
    MPIRUN.with_name("prterun").exists(), reason="Open MPI's launcher leaves with 1 after SIGTERM, kills after SIGINT"
)


@pytest.mark.parametrize(
    "name, restart_ranks", [pytest.param("SIGTERM", 1, marks=[own_ending, pytest.mark.validation]), ("SIGUSR1", 2)]
)
def test_signal_to_mpirun(toy, name, restart_ranks):
    process = toy.start(*RUN_A, ranks=2, **SLOW)
    process.send_signal(signal.Signals[name])
    check_stopped_and_goes_on(toy, process, name, restart_ranks)


@pytest.mark.parametrize("name, restart_ranks", [("SIGINT", 2), ("SIGHUP", 1)])
def test_signal_to_a_single_process(hangups, toy, name, restart_ranks):
    process = toy.start(*RUN_A, **SLOW)
    process.send_signal(signal.Signals[name])
    check_stopped_and_goes_on(toy, process, name, restart_ranks)


def test_signal_to_one_rank_stops_all_at_one_step(toy):
    """SIGUSR2 and SIGHUP end MPICH's launcher itself: who sends them sends them to the ranks."""
    process = toy.start(*RUN_A, ranks=2, **SLOW)
    os.kill(ranks_of(process)[-1], signal.SIGUSR2)
    check_stopped_and_goes_on(toy, process, "SIGUSR2", 2)


ALONE = """
from hpcpic.core.cli.main import launcher_rank
from hpcpic.core.comm.world import World
from toy_app import APP, program

start = World.start
def fail():
    if launcher_rank():
        raise {error}
    return start()
World.start = fail
program(lambda: APP, "toy", "a toy")
"""


@pytest.mark.parametrize("error, traces", [("KeyboardInterrupt", 0), ("ZeroDivisionError", 1)])
def test_a_rank_that_leaves_before_mpi_starts_takes_the_others_along(toy, error, traces):
    words = [str(MPIRUN), "-n", "2", sys.executable, "-c", ALONE.format(error=error), "run", "ring.conf", "-o", "a"]
    env = environment() | {"PYTHONPATH": os.pathsep.join((str(ROOT), str(TOY.parent)))}
    done = subprocess.run(words, cwd=toy.folder, env=env, capture_output=True, text=True, timeout=20)
    assert done.returncode != 0 and done.stderr.count("Traceback") == traces, done.stderr
    assert not (toy.folder / "a").exists()


def test_stop_file_is_taken_away_by_the_restart(toy):
    process = toy.start(*RUN_A, **SLOW)
    (toy.folder / "a" / "STOP").touch()
    check_stopped_and_goes_on(toy, process, "STOP")
    assert not (toy.folder / "a" / "STOP").exists()


def test_stop_comes_promptly(toy):
    process = toy.start(*RUN_A, steps=100000, pause=0.001)
    begin = time.monotonic()
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=20)
    # 0.2 s to agree, the checkpoint of a tiny state, and the interpreter's exit on a busy machine
    assert process.returncode == 5 and time.monotonic() - begin < 3.0


def test_wall_limit_ends_before_it(toy):
    begin = time.monotonic()
    done = toy(*RUN_A, "--wall", "0:06", steps=100000, pause=0.005)
    assert done.returncode == 5, done.stderr
    assert "wall clock" in done.stdout
    assert toy.facts("a")["wall_seconds"] < 6.0 < time.monotonic() - begin + 6.0
    assert toy.checkpoints("a")[-1] == toy.facts("a")["steps"] > 0


def test_wall_limit_shorter_than_the_start_still_leaves_a_checkpoint(toy):
    done = toy(*RUN_A, "--wall", "0", steps=100000)
    assert done.returncode == 5, done.stderr
    assert "came before the first step: the start alone took" in done.stdout
    assert toy.checkpoints("a") == [0]


@own_ending
def test_second_interrupt_ends_at_once(toy):
    process = toy.start(*RUN_A, ranks=2, steps=50, fault__kind='"hang"', fault__step=1)
    process.send_signal(signal.SIGINT)
    time.sleep(1.0)  # more than the echo of one Ctrl-C
    for rank in ranks_of(process):
        os.kill(rank, signal.SIGINT)
    _, errors = process.communicate(timeout=10)
    assert process.returncode not in (0, 5)
    assert errors.count("second interrupt") == 1
