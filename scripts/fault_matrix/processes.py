"""Rows 1 to 17, 37, 38: processes that die, fail, hang, or are told to stop."""

from __future__ import annotations

import math
import os
import shutil
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from threading import Semaphore

import psutil

from fault_matrix.bench import Bench, Running, crowd, expect
from fault_matrix.rows import row
from hpcpic.core.run.signals import GRACE_SECONDS

SOON = 5.0  # s, on a busy machine; a quiet one takes less than two
WALL, WALLS = 20, 100  # s, runs


def ended(running: Running, within: float = SOON) -> str:
    done = running.end(within)
    expect(done.code != 0, done)
    return f"exit {done.code} after {done.seconds:.1f} s"


def stopped(bench: Bench, running: Running, reason: str, within: float = 2 * SOON) -> str:
    """Exit 5 with a checkpoint of the step where all stopped; a restart ends in the state without the fault."""
    done = running.end(within)
    facts = bench.facts()
    expect(done.code == 5, done)
    expect(facts["status"] == "stopped" and reason in facts["reason"], facts["reason"])
    expect(int(bench.checkpoints()[-1].stem) == facts["steps"], "no checkpoint of the last step")
    bench.goes_on(ranks=1)
    return f"exit 5 after {done.seconds:.1f} s at step {facts['steps']}, same bits after restart"


def told_once(bench: Bench, kind: str, code: int, what: str) -> str:
    done = bench.run(kind=kind)
    expect(done.code == code, done)
    expect(done.err.count("Traceback") <= 1 and done.err.count(what) >= 1, done)
    return f"exit {done.code} after {done.seconds:.1f} s, told once"


@row(1, "kill -9 of one rank in a step", "all end at once; restart: same bits")
def kill_rank(bench: Bench) -> str:
    with bench.started("--checkpoint-every", "5") as running:
        running.wait_for(lambda: len(bench.checkpoints()) > 0)
        os.kill(running.ranks()[1], signal.SIGKILL)
        got = ended(running)
    bench.goes_on()
    return f"{got}, same bits after restart"


@row(2, "kill -9 of mpiexec", "the ranks end at once; restart: same bits")
def kill_launcher(bench: Bench) -> str:
    with bench.started("--checkpoint-every", "5") as running:
        running.wait_for(lambda: len(bench.checkpoints()) > 0)
        ranks = [psutil.Process(pid) for pid in running.ranks()]
        os.kill(running.process.pid, signal.SIGKILL)
        begin = time.monotonic()
        _, alive = psutil.wait_procs(ranks, timeout=SOON * crowd())
        took = time.monotonic() - begin
        for process in alive:
            process.kill()
        expect(not alive, f"{len(alive)} ranks go on")
    bench.goes_on()
    return f"gone after {took:.1f} s, same bits after restart"


@row(3, "SIGSEGV in one rank", "all end; its stack is in trace-rank-1.txt")
def segmentation_fault(bench: Bench) -> str:
    done = bench.run(kind="segv")
    trace = bench.run_folder / "trace-rank-1.txt"
    expect(done.code not in (0, 5), done)
    expect(trace.exists() and "Segmentation fault" in trace.read_text(), "no stack")
    return f"exit {done.code}, stack written"


TOLD_ONCE = (  # row, fault, its name in faulty.py, what is expected, exit code, what is told
    (4, "exception on one rank in a step", "raise", "one traceback with the rank", 1, "rank 1 of 2 failed"),
    (5, "exception on one rank at the start", "raise at start", "the same, no hang", 1, "rank 1 of 2 failed"),
    (6, "sys.exit on one rank", "exit", "all leave with its code, no hang", 3, "left by sys.exit(3)"),
    (38, "no memory on one rank (RLIMIT_AS)", "no memory", "one traceback with the rank", 1, "rank 1 of 2"),
)
for number, fault, kind, expected, code, what in TOLD_ONCE:
    row(number, fault, f"exit {code}, {expected}")(partial(told_once, kind=kind, code=code, what=what))


def watched(bench: Bench, kind: str) -> str:
    """The watchdog ends a run that stands still, and leaves the stacks."""
    done = bench.run("--patience", "5", kind=kind)
    traces = list(bench.run_folder.glob("trace-rank-*.txt"))
    expect(done.code not in (0, 5) and done.seconds < 60, done)
    expect(any("most recent call first" in trace.read_text() for trace in traces), "no stacks")
    return f"exit {done.code} after {done.seconds:.1f} s (patience 5 s), stacks of {len(traces)} ranks"


@row(7, "one rank in a collective the others do not call", "the watchdog ends all and leaves stacks")
def mismatched_collective(bench: Bench) -> str:
    return watched(bench, "collective")


row(37, "messages of another iteration", "nobody takes them: the watchdog ends all")(partial(watched, kind="misnumber"))


@row(8, "SIGSTOP of one rank for 10 s, then SIGCONT", "goes on, same bits")
def stop_and_continue(bench: Bench) -> str:
    with bench.started() as running:
        rank = running.ranks()[1]
        os.kill(rank, signal.SIGSTOP)
        time.sleep(10.0)
        os.kill(rank, signal.SIGCONT)
        done = running.end()
    expect(done.code == 0, done)
    expect(bench.facts()["state_digest"] == bench.digest(), "other bits")
    return "exit 0, same bits"


@row(9, "SIGSTOP of one rank for ever", "the watchdog ends all and leaves stacks")
def stop_for_ever(bench: Bench) -> str:
    with bench.started("--patience", "5", kind="stop", rank=1, step=12) as running:  # when the time of a step is known
        done = running.end()
    expect(done.code not in (0, 5), done)
    expect((bench.run_folder / "trace-rank-0.txt").exists(), "no stack of the rank that waited")
    return f"exit {done.code} after {done.seconds:.1f} s (patience 5 s), stack written"


@row(10, "SIGTERM to mpiexec", "exit 5 with a checkpoint; restart: same bits")
def terminate(bench: Bench) -> str:
    with bench.started() as running:
        running.send("SIGTERM")
        return stopped(bench, running, "SIGTERM")


@row(11, "SIGUSR1 to mpiexec", "exit 5 with a checkpoint; restart: same bits")
def user_signal(bench: Bench) -> str:
    with bench.started() as running:
        running.send("SIGUSR1")
        return stopped(bench, running, "SIGUSR1")


@row(12, "SIGINT once; again while the step hangs", "exit 5; at once, without a checkpoint")
def interrupt(bench: Bench) -> str:
    with bench.started(ranks=1) as running:
        running.send("SIGINT")
        got = stopped(bench, running, "SIGINT")
    shutil.rmtree(bench.run_folder)
    with bench.started(ranks=1, kind="hang", rank=0, step=1) as running:
        running.send("SIGINT")
        time.sleep(1.0)  # more than the echo of one
        running.send("SIGINT")
        done = running.end(SOON)
    expect(done.code == 1 and "second interrupt" in done.err, done)
    return f"{got}; twice: exit 1 after {done.seconds:.1f} s"


@row(13, "SIGTERM in the middle of a checkpoint", "the checkpoint is finished, then exit 5")
def terminate_in_checkpoint(bench: Bench) -> str:
    done = bench.run("--checkpoint-every", "30", kind="term in checkpoint", pause=0.005)
    expect(done.code == 5 and "Traceback" not in done.err, done)
    bench.goes_on()
    return f"exit 5 at step {bench.facts()['history'][0]['steps']}, same bits after restart"


@row(14, "SIGTERM while kernels are compiled", "exit 5 before the first step; 1, told, where that takes a minute")
def terminate_while_compiling(bench: Bench) -> str:
    cache = {"HPCPIC_CACHE_DIR": str(bench.folder / "cache")}
    with bench.started(wait=False, env=cache) as running:
        running.wait_for(lambda: "compiling" in running.log())
        running.send("SIGTERM")
        done = running.end(120.0)
    if done.code == 1:
        expect("compiling for it, did not end within" in done.err and done.seconds > GRACE_SECONDS, done)
        return f"exit 1 after {done.seconds:.0f} s: {done.err.strip().splitlines()[-1][:100]}"
    expect(done.code == 5 and bench.facts()["steps"] == 0, done)
    return f"exit 5 at step 0 after {done.seconds:.1f} s"


@row(15, "SIGTERM to one rank only", "all agree: exit 5; restart: same bits")
def terminate_one(bench: Bench) -> str:
    with bench.started() as running:
        os.kill(running.ranks()[1], signal.SIGTERM)
        return stopped(bench, running, "SIGTERM")


@row(16, "--wall 20 (longer if it is crowded), a hundred times", "exit 5 before it is over, every time; same bits")
def wall(bench: Bench) -> str:
    starting = Semaphore(2)  # what is tried is the end, not how many can start at once
    wall = math.ceil(WALL * crowd())

    def attempt(k: int) -> float:
        one = replace(bench, folder=bench.folder / str(k))
        one.folder.mkdir()
        with ExitStack() as stack:
            with starting:
                begin = time.monotonic()
                running = stack.enter_context(one.started("--wall", str(wall), ranks=1, pause=0.02 * wall))
            done = running.end()
            expect(done.code == 5, done)
            return time.monotonic() - begin

    with ThreadPoolExecutor(WALLS) as together:
        taken = list(together.map(attempt, range(WALLS)))
    expect(max(taken) < wall, f"{sum(one < wall for one in taken)} of {WALLS}, at most {max(taken):.2f} s")
    replace(bench, folder=bench.folder / "0").goes_on()
    return f"{WALLS} of {WALLS} in {wall} s, {min(taken):.1f} .. {max(taken):.1f} s from start to end; same bits"


@row(17, "--wall shorter than the start", "exit 5 with a message and a checkpoint")
def wall_too_short(bench: Bench) -> str:
    done = bench.run("--wall", "0")
    expect(done.code == 5 and "wall clock" in done.out, done)
    bench.goes_on()
    return "exit 5 at step 0, same bits after restart"
