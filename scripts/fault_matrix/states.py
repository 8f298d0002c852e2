"""Rows 34 to 36, 47, 48: states that are no solution, clocks, odd numbers of ranks."""

from __future__ import annotations

from fault_matrix.bench import Bench, expect
from fault_matrix.checkpoints import alone
from fault_matrix.faulty import floats
from fault_matrix.rows import row
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run import checkpoint

FLIPS = 200
DAMAGE = {  # numbers of the state that are finite and yet none that a run comes to
    "hpcpic": ("electrons/velocity 1e3", "electrons/position 1e6", "electrons/position -1"),
    "sph": ("v 1e12", "v 1e6", "v 3e3", "drho 300", "drho -300", "x 1e12", "reach -1", "walls/impulse 1e300"),
    "lbmdem": ("populations 10", "populations -10", "populations 1e300", "grains/row 1e12"),
}
FLAT_RANKS = 6


@row(34, "a NaN in each array of the state", "exit 4, post-mortem.txt names rank and place")
def not_a_number(bench: Bench) -> str:
    bench.digest()
    names = floats(checkpoint.newest(RunDir(bench.work / "quiet-0" / "run")))
    for k in range(len(names)):
        done = bench.run("--replace", kind=f"nan {k}")
        expect(done.code == 4 and "Traceback" not in done.err, f"{names[k]}: {done}")
        told = (bench.run_folder / "post-mortem.txt").read_text()
        expect("rank" in told and "step" in told, told)
    return f"exit 4 for {', '.join(names)}"


@row(35, "a scheme beyond its stability", "refused; if it runs all the same: exit 4")
def runaway(bench: Bench) -> str:
    refused = bench.run(*assigned(bench.runaway))
    expect(refused.code == 2, refused)
    done = bench.run(*assigned(bench.runaway), "--beyond-limits")
    expect(done.code == 4 and "Traceback" not in done.err, done)
    return f"exit 2; beyond limits: exit 4, {bench.facts()['reason'][:60]}"


@row(36, "one bit of an exponent flips in memory", "95 % of those that change the energy by 1 % are seen")
def flipped_in_memory(bench: Bench) -> str:
    found = alone(bench, "flips", FLIPS)
    harmful = FLIPS - found["harmless"]
    seen = found["caught"] + found["raised"] + found["crashed"]
    expect(seen >= 0.95 * harmful, f"{seen} of {harmful} seen: {found}")
    return f"{seen} of {harmful} seen; of {FLIPS}: {', '.join(f'{n} {what}' for what, n in found.items())}"


@row(
    49,
    "a number of the state that is finite and none that a run comes to",
    "exit 4 within 100 steps, the place is named",
)
def damaged(bench: Bench) -> str:
    for damage in DAMAGE[bench.program]:
        done = bench.run("--replace", kind=f"value {damage}")
        expect(done.code == 4 and "Traceback" not in done.err, f"{damage}: {done}")
    return f"exit 4 for {', '.join(DAMAGE[bench.program])}"


@row(47, "the clock jumps an hour forward and back", "exit 0, times are right, --wall holds")
def clock(bench: Bench) -> str:
    done = bench.run("--wall", "600", kind="clock", pause=0.01)
    expect(done.code == 0, done)
    expect(0 < bench.facts()["wall_seconds"] < done.seconds + 1, bench.facts()["wall_seconds"])
    expect(bench.facts()["state_digest"] == bench.digest(), "other bits")
    return f"exit 0, {bench.facts()['wall_seconds']:.1f} s"


@row(48, "ranks without a particle; more than cores; more than rows", "same bits or exit 2 with the most there may be")
def many_ranks(bench: Bench) -> str:
    for ranks in (3, 5):
        same(bench, ranks)
    same(bench, 3, *bench.sparse)
    done = bench.run("--replace", *assigned(bench.flat), ranks=FLAT_RANKS)
    if done.code == 2:
        expect("at most" in done.err and "Traceback" not in done.err, done)
        return f"same bits on 3, 5, and 3 with nothing on one; on {FLAT_RANKS} for fewer rows: exit 2"
    same(bench, FLAT_RANKS, *bench.flat)
    return f"same bits on 3, 5, on 3 with nothing on one, on {FLAT_RANKS} for fewer rows"


def same(bench: Bench, ranks: int, *sets: str) -> None:
    done = bench.run("--replace", *assigned(sets), ranks=ranks)
    expect(done.code == 0 and bench.facts()["state_digest"] == bench.digest(*sets), f"{ranks} ranks {sets}: {done}")


def assigned(sets: tuple[str, ...]) -> list[str]:
    return [word for assignment in sets for word in ("--set", assignment)]
