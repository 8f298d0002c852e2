"""Rows 18 to 33: checkpoints that are half written, damaged, foreign or missing, and full disks."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from fault_matrix.bench import BEGUN, Bench, Done, Skipped, expect
from fault_matrix.rows import row
from hpcpic.core.errors import FileError
from hpcpic.core.files import sealed
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run import checkpoint

PAGE = 4096


def alone(bench: Bench, what: str, n: int, timeout: float = 300.0) -> dict[str, Any]:
    """What `fault_matrix.alone` finds, in a process of its own."""
    expect(bench.run(ranks=1).code == 0, "the run before")
    words = [sys.executable, "-P", "-m", "fault_matrix.alone", bench.program, str(bench.run_folder), what, str(n)]
    done = subprocess.run(words, env=bench.environment({}, {}), capture_output=True, text=True, timeout=timeout)
    expect(done.returncode == 0, done.stderr[-500:])
    return json.loads(done.stdout.splitlines()[-1])


def half(bench: Bench) -> None:
    """A run with two checkpoints, of the middle and of the end."""
    n = bench_steps(bench)
    done = bench.run("--checkpoint-every", str(n // 2), ranks=1)
    expect(done.code == 0 and len(bench.checkpoints()) == 2, done)


def bench_steps(bench: Bench) -> int:
    bench.digest()
    return json.loads((bench.work / "quiet-0" / "run" / "run.json").read_text())["steps"]


def seen(bench: Bench, damaged: bytes) -> bool:
    """Whether this content of the newest checkpoint is passed over for the one before."""
    before, last = bench.checkpoints()[-2:]
    sound = last.read_bytes()
    last.write_bytes(damaged)
    try:
        return checkpoint.newest(RunDir(bench.run_folder)).path == before
    except FileError:
        return False
    finally:
        last.write_bytes(sound)


@row(18, "kill -9 at 80 random moments of writing", "80 of 80 restartable, same bits")
def kills(bench: Bench) -> str:
    found = alone(bench, "kills", 80)
    expect(found["same"] and not found["refused"], found)
    return f"80 of 80, {found['halves']} left half a file; same bits at step {found['step']}"


@row(19, "power fails around a write", "what is renamed is on the disk; half a file is passed over")
def power_loss(bench: Bench) -> str:
    half(bench)
    order: list[str] = []
    replace, fsync = os.replace, os.fsync

    def noted_replace(source: Any, target: Any) -> None:
        order.append(f"rename {Path(source).name}")
        replace(source, target)

    def noted_fsync(descriptor: int) -> None:
        order.append(f"sync {Path(os.readlink(f'/proc/self/fd/{descriptor}')).name}")
        fsync(descriptor)

    os.replace, os.fsync = noted_replace, noted_fsync  # type: ignore[assignment]
    try:
        reader = checkpoint.newest(RunDir(bench.run_folder))
        shards = {name: checkpoint.Shard(reader.read(name), 0, reader.total(name)) for name in reader.names}
        written = checkpoint.write(checkpoint.ALONE, RunDir(bench.run_folder), reader.step + 1, 0.0, shards)
    finally:
        os.replace, os.fsync = replace, fsync
    at = next(k for k, what in enumerate(order) if what.startswith("rename"))
    made = order[at].removeprefix("rename ")
    expect(order[at - 1] == f"sync {made}" and f"sync {written.parent.name}" in order[at:], order)
    expect(seen(bench, written.read_bytes()[: written.stat().st_size // 2]), "half a file was taken")
    return "file synced, renamed, folder synced; half a file is passed over"


@contextmanager
def disk(bench: Bench, size: str, *options: str) -> Iterator[Path]:
    """A file system of this size."""
    made = bench.folder / "disk"
    made.mkdir()
    with mounted(made, size, *options):
        folder, bench.folder = bench.folder, made
        try:
            yield made
        finally:
            bench.folder = folder


@contextmanager
def mounted(folder: Path, size: str, *options: str) -> Iterator[None]:
    words = ["mount", "-t", "tmpfs", "-o", ",".join([f"size={size}", *options]), "tmpfs", str(folder)]
    if subprocess.run(words, capture_output=True).returncode:
        raise Skipped("mounting is not permitted here")
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def fill(folder: Path) -> Path:
    """A file that leaves no block free."""
    ballast = folder / "ballast"
    free = os.statvfs(folder)
    with open(ballast, "wb") as file:
        os.posix_fallocate(file.fileno(), 0, max(1, free.f_bavail * free.f_frsize))
    return ballast


def good_after_third(bench: Bench, done: Done, what: str) -> None:
    """Three checkpoints failed: exit 6, warnings, nothing half written."""
    expect(done.code == 6 and "Traceback" not in done.err and what in done.err, done)
    expect(done.err.count("WARNING") >= 2, done)
    expect(not list(bench.run_folder.glob("**/.*.tmp")), "a temporary file is left")


@row(20, "the disk is full at checkpoints", "two warnings, exit 6 at the third; the old one is good")
def full_disk(bench: Bench) -> str:
    with disk(bench, "24m") as folder:
        with bench.started("--checkpoint-every", "10") as running:
            running.wait_for(lambda: len(bench.checkpoints()) > 0)
            ballast = fill(folder)
            done = running.end()
        good_after_third(bench, done, "No space left on device")
        ballast.unlink()
        kept = bench.checkpoints()[-1].stem
        bench.goes_on()
    return f"exit 6 after {done.err.count('WARNING')} warnings; from {int(kept)} same bits"


@row(21, "the disk of the outputs is full", "a warning, physics and checkpoints go on; same bits, exit 6 at the end")
def full_disk_for_outputs(bench: Bench) -> str:
    with disk(bench, "24m") as folder, bench.started("--checkpoint-every", "10") as running, ExitStack() as stack:
        running.wait_for(lambda: len(bench.checkpoints()) > 0)
        stack.enter_context(mounted(bench.run_folder / "checkpoints", "24m"))  # which stay on a disk with room
        ballast = fill(folder)
        running.wait_for(lambda: len(bench.checkpoints()) == 2)
        kept = [int(path.stem) for path in bench.checkpoints()]
        ballast.unlink()  # for the end of the run
        done = running.end()
        facts = bench.facts()
        expect(done.code == 6 and "Traceback" not in done.err, done)
        expect("output from step" in done.err and "output is missing" in facts["reason"], done)
        expect(facts["status"] == "finished" and facts["state_digest"] == bench.digest(), "other bits")
    return f"exit {done.code} with a warning, checkpoints of steps {kept[0]} and {kept[1]} meanwhile, same bits"


@row(22, "files may not grow (RLIMIT_FSIZE, SIGXFSZ)", "as a full disk: exit 6, no signal")
def small_files(bench: Bench) -> str:
    done = bench.run("--checkpoint-every", "10", kind="small files")
    good_after_third(bench, done, "File too large")
    return f"exit 6 after {done.err.count('WARNING')} warnings"


@row(23, "a folder that cannot be written", "exit 6 before the first step")
def read_only(bench: Bench) -> str:
    with disk(bench, "1m", "ro"):
        done = bench.call(bench.run_words(), ranks=2)
        expect(done.code == 6 and "Traceback" not in done.err, done)
    return f"exit 6: {done.err.strip().splitlines()[-1][-60:]}"


@row(24, "the newest checkpoint cut off at 120 lengths", "120 of 120 seen")
def truncated(bench: Bench) -> str:
    half(bench)
    sound = bench.checkpoints()[-1].read_bytes()
    lengths = [0, 1, len(sound) - 1, *np.random.default_rng(3).integers(0, len(sound), 117)]
    n = sum(seen(bench, sound[:length]) for length in lengths)
    expect(n == 120, f"{n} of 120")
    return "120 of 120, the one before is taken"


@row(25, "1200 flipped bits in the newest checkpoint", "none silent")
def flipped(bench: Bench) -> str:
    half(bench)
    sound, rng = bench.checkpoints()[-1].read_bytes(), np.random.default_rng(4)
    n = len(sound)
    places = [*rng.integers(0, PAGE, 300), *(n - 1 - rng.integers(0, 2000, 300)), *rng.integers(0, n, 600)]
    silent = 0
    for place in places:
        damaged = bytearray(sound)
        damaged[place] ^= 1 << rng.integers(8)
        silent += not seen(bench, bytes(damaged))
    expect(silent == 0, f"{silent} silent")
    return "0 silent: 300 in the header, 300 in the manifest, 600 anywhere"


@row(26, "a page of zeros in the newest checkpoint", "seen")
def zeroed(bench: Bench) -> str:
    half(bench)
    sound = bench.checkpoints()[-1].read_bytes()
    pages = [k for k in range(0, len(sound) - PAGE, PAGE) if any(sound[k : k + PAGE])]
    n = sum(seen(bench, sound[:k] + bytes(PAGE) + sound[k + PAGE :]) for k in pages)
    expect(n == len(pages), f"{n} of {len(pages)}")
    return f"{n} of {n} pages"


def resealed(path: Path, **changes: Any) -> None:
    """Another manifest with a sound checksum, as another version of the program would write it."""
    manifest = sealed.manifest_of(path) | changes
    content = path.read_bytes()[: manifest["size"]]
    text = json.dumps(manifest).encode()
    path.write_bytes(content + text + sealed.FOOTER.pack(sealed.MAGIC, len(text), sealed._blake2b(text)))


@row(27, "checkpoints of a newer format", "exit 6 with both versions")
def newer(bench: Bench) -> str:
    half(bench)
    for path in bench.checkpoints():
        resealed(path, schema=99, version="77.0")
    done = bench.restart()
    expect(done.code == 6 and "version 77.0 in format 99" in done.err, done)
    return "exit 6 with both versions"


@row(28, "a checkpoint of other settings", "exit 2, what differs is listed")
def other_settings(bench: Bench) -> str:
    half(bench)
    for path in bench.checkpoints():
        attributes = sealed.manifest_of(path)["attributes"]
        key = next(iter(attributes["settings"]))
        attributes["settings"][key] = "otherwise"
        resealed(path, attributes=attributes)
    done = bench.restart()
    expect(done.code == 2 and f"{key}: otherwise then" in done.err, done)
    return f"exit 2, lists {key}"


@row(29, "the last checkpoint bad; both bad; none", "the one before; exit 6; exit 6")
def bad_checkpoints(bench: Bench) -> str:
    half(bench)
    before, last = bench.checkpoints()
    last.write_bytes(last.read_bytes()[:-1])
    bench.goes_on()
    for path in bench.checkpoints():
        path.write_bytes(b"")
    both = bench.restart()
    expect(both.code == 6 and both.err.count("no checkpoint can be used") == 1, both)
    shutil.rmtree(before.parent)
    none = bench.restart()
    expect(none.code == 6 and "no checkpoint" in none.err, none)
    return "same bits; exit 6; exit 6"


@row(30, "restart on 1, 2, 3, 4, 7 ranks", "same bits")
def other_ranks(bench: Bench) -> str:
    half(bench)
    bench.checkpoints()[-1].unlink()
    kept = bench.folder / "kept"
    shutil.copytree(bench.run_folder, kept)
    for ranks in (1, 2, 3, 4, 7):
        shutil.rmtree(bench.run_folder)
        shutil.copytree(kept, bench.run_folder)
        bench.goes_on(ranks=ranks)
    return "same bits on all"


@row(31, "a dozen parts on 1, 2 and 3 ranks in turn, each stopped", "same bits")
def chain(bench: Bench) -> str:
    step, ends = bench_steps(bench) // 14, [0]
    for k in range(1, 13):
        part = bench.run if k == 1 else bench.restart
        done = part(ranks=1 + k % 3, kind="term", rank=0, step=k * step, pause=0.5 / step)
        expect(done.code == 5, done)
        ends.append(bench.facts()["steps"])
    expect(all(a < b for a, b in itertools.pairwise(ends)), f"parts end at {ends}")
    bench.goes_on()
    parts = len(bench.facts()["history"])
    expect(parts == 13, f"{parts} parts in the history")
    return f"same bits, 13 parts in the history, on to steps {', '.join(map(str, ends[1:]))}"


@row(32, "temporary files and a lock of a dead process", "cleaned, and taken over")
def stale(bench: Bench) -> str:
    half(bench)
    (bench.run_folder / ".lock").write_text("process 999999 on elsewhere\n")
    left = [bench.run_folder / ".run.json.999999.tmp", bench.run_folder / "checkpoints/.00000001.h5.999999.tmp"]
    for path in left:
        path.write_bytes(b"x")
    bench.goes_on()
    expect(not any(path.exists() for path in left), "temporary files are left")
    return "exit 0, none left"


@row(86, "kill -9 of all at 20 random moments of a run, a restart after each", "same bits")
def kills_and_restarts(bench: Bench) -> str:
    chance, steps = np.random.default_rng(6), bench_steps(bench)
    pause, every, log = 20.0 / steps, ("--checkpoint-every", "2"), bench.run_folder / "log.txt"
    for k in range(20):
        if not bench.checkpoints():
            shutil.rmtree(bench.run_folder, ignore_errors=True)
        words = bench.restart_words(*every) if bench.run_folder.exists() else bench.run_words(*every)
        begun = len(BEGUN.findall(log.read_text())) if log.exists() else 0
        with bench.started(words=words, ranks=1 + k % 2, wait=False, pause=pause) as running:
            if k % 5:  # else while it starts
                running.wait_for(lambda: len(BEGUN.findall(running.log())) > begun)  # noqa: B023 - called at once
            time.sleep(chance.uniform(0.0, 2.0))
    reached = int(bench.checkpoints()[-1].stem)
    bench.goes_on()
    return f"same bits; killed up to step {reached} of {steps}"


@row(87, "four runs started at once in one folder", "one of them runs: same bits; the others: exit 6")
def at_once(bench: Bench) -> str:
    bench.digest()
    with ThreadPoolExecutor(4) as together:
        done = list(together.map(lambda _: bench.run(ranks=1), range(4)))
    expect(sorted(one.code for one in done) == [0, 6, 6, 6], [str(one) for one in done])
    expect(bench.facts()["state_digest"] == bench.digest(), "other bits")
    return "exit 0 with the same bits, three times exit 6"


@row(33, "two runs in one folder", "the second: exit 6; the first: same bits")
def two_runs(bench: Bench) -> str:
    with bench.started(pause=0.15) as running:
        refused = [bench.run(), bench.run("--replace"), bench.restart()]
        done = running.end()
    expect([one.code for one in refused] == [6, 6, 6], refused)
    expect(done.code == 0 and bench.facts()["state_digest"] == bench.digest(), done)
    return "exit 6 (run, run --replace, restart); the first: same bits"
