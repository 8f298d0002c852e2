import logging
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from hpcpic.core.run import signals
from hpcpic.core.run.signals import Reason, Stop, WallLimit


@pytest.fixture
def aborts():
    return []


@pytest.fixture
def stop(aborts, monkeypatch):
    monkeypatch.setattr(signals, "GRACE_SECONDS", 0.3)
    made = Stop(aborts.append)
    yield made
    made.close()


def send(number):
    os.kill(os.getpid(), number)


def wait_for(condition, seconds=2.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.002)
    return condition()


@pytest.mark.parametrize("name", ["SIGTERM", "SIGUSR1", "SIGUSR2", "SIGXCPU", "SIGHUP", "SIGINT"])
def test_a_signal_is_a_reason(hangups, stop, name):
    send(signal.Signals[name])
    assert wait_for(lambda: stop.reason is Reason[name])
    stop.acknowledge()


def test_it_is_heard_while_the_main_thread_is_inside_a_long_call(stop):
    heard = []
    begin = time.monotonic()

    def watch():
        time.sleep(0.05)
        send(signal.SIGTERM)
        while stop.reason is Reason.NONE:
            time.sleep(0.001)
        heard.append(time.monotonic() - begin)

    watcher = threading.Thread(target=watch)
    watcher.start()
    rows = np.random.default_rng(1).random(8_000_000)
    np.sort(rows, kind="stable")  # one C call without the GIL, far longer than 0.05 s
    whole = time.monotonic() - begin
    watcher.join()
    stop.acknowledge()
    assert heard[0] < 0.8 * whole


def test_the_grace_time_ends_a_run_that_does_not_answer(stop, aborts):
    send(signal.SIGTERM)
    assert wait_for(lambda: aborts) and "SIGTERM" in aborts[0]


def test_no_abort_once_the_ranks_have_agreed(stop, aborts):
    send(signal.SIGTERM)
    assert wait_for(lambda: stop.reason)
    stop.acknowledge()
    time.sleep(0.5)
    assert aborts == []


def test_a_long_step_has_twenty_steps_of_grace(stop, aborts):
    stop.step_seconds = 1.0
    send(signal.SIGTERM)
    time.sleep(0.6)
    assert aborts == []


def test_a_second_interrupt_aborts_but_its_echo_does_not(stop, aborts):
    stop.step_seconds = 1.0
    send(signal.SIGINT)
    time.sleep(0.1)
    send(signal.SIGINT)  # the launcher passes on what the terminal has sent already
    time.sleep(0.2)
    assert aborts == []
    time.sleep(0.3)
    send(signal.SIGINT)
    assert wait_for(lambda: aborts) and "second interrupt" in aborts[0]


def test_a_hangup_that_is_ignored_from_the_start_stays_so(aborts):
    """As nohup asks."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        stop = Stop(aborts.append)
        send(signal.SIGHUP)
        send(signal.SIGUSR2)
        assert wait_for(lambda: stop.reason is Reason.SIGUSR2)
        stop.close()
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_the_handlers_before_are_put_back(aborts):
    before = {name: signal.getsignal(name) for name in (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1)}
    stop = Stop(aborts.append)
    assert signal.getsignal(signal.SIGTERM) is not before[signal.SIGTERM]
    stop.close()
    assert {name: signal.getsignal(name) for name in before} == before
    assert signal.set_wakeup_fd(-1) == -1


def test_wall_limit_leaves_time_for_the_checkpoint(monkeypatch):
    monkeypatch.delenv("SLURM_JOB_END_TIME", raising=False)
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    limit = WallLimit(100.0, 0.0)
    now[0] = 70.0
    assert not limit.over(interval=1.0, checkpoint=10.0)
    assert limit.over(interval=1.0, checkpoint=20.0)  # 70 + 2 + 30 + 1 > 100
    assert limit.over(interval=15.0, checkpoint=0.0)
    assert not WallLimit(None, 0.0).over(1e9, 1e9)


def test_the_end_of_the_batch_job_counts_when_it_is_earlier(monkeypatch):
    monkeypatch.setenv("SLURM_JOB_END_TIME", str(int(time.time()) + 50))
    assert WallLimit(100.0, time.monotonic()).over(interval=30.0, checkpoint=0.0)
    assert WallLimit(None, time.monotonic()).over(interval=30.0, checkpoint=0.0)
    assert not WallLimit(None, time.monotonic()).over(interval=1.0, checkpoint=0.0)


def test_an_end_of_the_batch_job_that_nobody_can_read_is_a_warning(monkeypatch, caplog):
    monkeypatch.setattr(logging.getLogger("hpcpic"), "propagate", True)
    for text in ("soon", "", "nan"):
        monkeypatch.setenv("SLURM_JOB_END_TIME", text)
        assert WallLimit(None, 0.0).end is None and WallLimit(5.0, 0.0).end == 5.0
    assert len(caplog.messages) == 6 and "SLURM_JOB_END_TIME = 'soon'" in caplog.messages[0]


def test_the_start_of_a_process_is_when_it_was_made():
    """To the tick of a hundredth of a second in which the kernel counts; long before its first line."""
    program = "import time; from hpcpic.core.run.signals import process_start; print(process_start(), time.monotonic())"
    before = time.monotonic()
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    made, said = map(float, done.stdout.split())
    assert before - 0.02 <= made < said - 0.02
