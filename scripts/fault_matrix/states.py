"""Rows 34 to 38, 47, 48: states that are no solution, machines that are too small, clocks, odd numbers of ranks."""

from __future__ import annotations

from fault_matrix.bench import Bench, Skipped, expect
from fault_matrix.checkpoints import alone
from fault_matrix.faulty import floats
from fault_matrix.processes import told_once
from fault_matrix.rows import row
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run import checkpoint

FLIPS = 100


@row(34, "a NaN in each array of the state", "exit 4, post-mortem.txt names rank and place")
def not_a_number(bench: Bench) -> str:
    bench.digest()
    names = floats(checkpoint.newest(RunDir(bench.work / "quiet-0" / "run")))
    for k in range(len(names)):
        done = bench.run("--force", kind=f"nan {k}")
        expect(done.code == 4 and "Traceback" not in done.err, f"{names[k]}: {done}")
        told = (bench.run_folder / "post-mortem.txt").read_text()
        expect("rank" in told and "step" in told, told)
    return f"exit 4 for {', '.join(names)}"


@row(35, "a scheme beyond its stability", "refused; if it runs all the same: exit 4")
def runaway(bench: Bench) -> str:
    if not bench.runaway:
        raise Skipped("no --runaway settings")
    sets = [word for assignment in bench.runaway for word in ("--set", assignment)]
    refused = bench.run(*sets)
    expect(refused.code == 2, refused)
    done = bench.run(*sets, "--beyond-limits")
    expect(done.code == 4 and "Traceback" not in done.err, done)
    return f"exit 2; beyond limits: exit 4, {bench.facts()['reason'][:60]}"


@row(36, "one bit of an exponent flips in memory", "nine in ten of those that change the energy by 1 % are seen")
def flipped_in_memory(bench: Bench) -> str:
    found = alone(bench, "flips", FLIPS)
    harmful = FLIPS - found["harmless"]
    seen = found["caught"] + found["raised"] + found["crashed"]
    expect(seen >= 0.9 * harmful, f"{seen} of {harmful} seen: {found}")
    return f"{seen} of {harmful} seen; of {FLIPS}: {', '.join(f'{n} {what}' for what, n in found.items())}"


@row(37, "messages of another iteration", "exit 1, told once")
def misnumbered(bench: Bench) -> str:
    return told_once(bench.run(kind="misnumber"), 1, "iteration")


@row(38, "no memory on one rank (RLIMIT_AS)", "exit 1, one traceback with the rank")
def no_memory(bench: Bench) -> str:
    return told_once(bench.run(kind="no memory"), 1, "rank 1 of 2")


@row(47, "the clock jumps an hour forward and back", "exit 0, times are right, --wall holds")
def clock(bench: Bench) -> str:
    done = bench.run("--wall", "600", kind="clock", pause=0.01)
    expect(done.code == 0, done)
    expect(0 < bench.facts()["wall_seconds"] < done.seconds + 1, bench.facts()["wall_seconds"])
    expect(bench.facts()["state_digest"] == bench.digest(), "other bits")
    return f"exit 0, {bench.facts()['wall_seconds']:.1f} s"


@row(48, "more ranks than cores; more than rows", "same bits; the same or exit 2 with the most there may be")
def many_ranks(bench: Bench) -> str:
    for ranks in (3, 5):
        done = bench.run("--force", ranks=ranks)
        expect(done.code == 0 and bench.facts()["state_digest"] == bench.digest(), done)
    done = bench.run("--force", ranks=45)
    expect(done.code in (0, 2) and "Traceback" not in done.err, done)
    expect(done.code == 2 or bench.facts()["state_digest"] == bench.digest(), "other bits")
    return f"same bits on 3, 5; on 45: exit {done.code}"
