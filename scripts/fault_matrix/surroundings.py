"""Rows 70 to 79, 88, 89: what befalls a run's folder and files, its name, foreign states, signals of batch systems."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fault_matrix.bench import Bench, Skipped, expect
from fault_matrix.checkpoints import half, resealed
from fault_matrix.processes import stopped
from fault_matrix.rows import row
from hpcpic.core.files.arrays import Shard
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run import checkpoint

NAMES = ('-o it\'s "x" $HOME `id` *', "ünï→粒子\nline", "n" * 250)  # of run folders
TOO_LONG = ("n" * 256, "/".join(["n" * 200] * 25))
SIGNALS = ("SIGHUP", "SIGUSR2", "SIGXCPU")  # which batch systems and terminals send


@row(70, "the file system stands still for three times the patience", "goes on, same bits")
def stall(bench: Bench) -> str:
    done = bench.run("--patience", "3", kind="stall", rank=0, step=5, pause=0.1)
    expect(done.code == 0 and "Traceback" not in done.err, done)
    expect(bench.facts()["wall_seconds"] > 9.0, "nothing stood still")
    expect(bench.facts()["state_digest"] == bench.digest(), "other bits")
    return f"exit 0 after {done.seconds:.0f} s, same bits"


@row(71, "run --replace and --force beside files of other origin", "exit 6, all of them as before")
def not_a_run(bench: Bench) -> str:
    names = ("given/a", "checkpoints/best.h5", "openpmd/a", "report.html", "log.txt")
    for name in names:
        shutil.rmtree(bench.run_folder, ignore_errors=True)
        (bench.run_folder / name).parent.mkdir(parents=True)
        (bench.run_folder / name).write_text("mine")
        for flag in ("--force", "--replace"):
            done = bench.run(flag, ranks=1)
            expect(done.code == 6 and "Traceback" not in done.err, f"{name} {flag}: {done}")
            expect((bench.run_folder / name).read_text() == "mine", f"{name} {flag}: gone")
    shutil.rmtree(bench.run_folder)
    expect(bench.run(ranks=1).code == 0, "the run before")
    before = bench.facts()
    expect(bench.run("--force", ranks=1).code == 6 and bench.facts() == before, "--force replaced a run")
    expect(bench.run("--replace", ranks=1).code == 0, "--replace did not replace a run")
    return f"{len(names)} names: refused and as before; a run: replaced by --replace alone"


def foreign(array: np.ndarray) -> dict[str, np.ndarray]:
    """What an array of a checkpoint must not be."""
    others = {"twice": np.concatenate([array, array]), "an axis more": array[..., None]}
    others["another type"] = array.astype(np.float32 if array.dtype == np.float64 else np.float64)
    if array.dtype.kind == "f" and array.size:
        others["not a number"] = np.full_like(array, np.nan)
    return others


@row(72, "sealed checkpoints with other arrays than the scene's", "exit 6 with name, expected and found")
def foreign_arrays(bench: Bench) -> str:
    half(bench)
    reader = checkpoint.newest(RunDir(bench.run_folder))
    sound = {name: reader.read(name) for name in reader.names}
    shutil.rmtree(bench.run_folder / "checkpoints")
    name = max(sound, key=lambda name: sound[name].nbytes)
    kinds: dict[str, dict[str, np.ndarray]] = {
        what: sound | {name: array} for what, array in foreign(sound[name]).items()
    }
    kinds["missing"] = {key: array for key, array in sound.items() if key != name}
    kinds["one more"] = sound | {"more": np.zeros(3)}
    for what, arrays in kinds.items():
        write(bench.run_folder, reader, arrays)
        done = bench.restart(ranks=2)
        expect(done.code == 6 and "Traceback" not in done.err, f"{what}: {done}")
        expect("expected" in done.err or "no such array" in done.err or "no array" in done.err, f"{what}: {done}")
    write(bench.run_folder, reader, sound)
    bench.goes_on()
    return f"exit 6 for {', '.join(kinds)} of {name}; the sound one: same bits"


def write(folder: Path, reader: Any, arrays: dict[str, np.ndarray]) -> None:
    shards = {name: Shard(array, 0, len(array)) for name, array in arrays.items()}
    checkpoint.write(checkpoint.ALONE, RunDir(folder), reader.step, reader.time, shards, reader.attributes)


@row(73, "a checkpoint of another version of the program", "a warning with both versions, goes on")
def other_version(bench: Bench) -> str:
    half(bench)
    for path in bench.checkpoints():
        resealed(path, version="0.0.1")
    done = bench.restart()
    expect(done.code == 0 and "written by version 0.0.1; this is version" in done.err, done)
    return "exit 0 with a warning"


@row(74, "the series is taken away, the run folder is moved, while it runs", "no traceback, the state is kept")
def taken_away(bench: Bench) -> str:
    with bench.started() as running:
        (bench.run_folder / "series.csv").unlink()
        done = running.end()
    expect(done.code == 6 and "Traceback" not in done.err and "no series output" in done.err, done)
    expect(bench.facts()["state_digest"] == bench.digest(), "other bits")
    shutil.rmtree(bench.run_folder)
    moved = bench.folder / "moved"
    with bench.started() as running:
        bench.run_folder.rename(moved)
        done = running.end()
    expect(done.code == 0 and "Traceback" not in done.err and not bench.run_folder.exists(), done)
    moved.rename(bench.run_folder)
    expect(bench.facts()["state_digest"] == bench.digest(), "other bits")
    return "exit 6, same bits; moved: followed, exit 0, same bits"


@row(75, "run.json is damaged", "a restart goes on from the checkpoint: same bits")
def damaged_run(bench: Bench) -> str:
    half(bench)
    bench.checkpoints()[-1].unlink()
    for content in ("", "{", "[]"):
        (bench.run_folder / "run.json").write_text(content)
        bench.goes_on()
    return "same bits for an empty one, half a one, another one"


@row(76, "three checkpoints fail", "exit 6, and run.json says so")
def told_failure(bench: Bench) -> str:
    with bench.started("--checkpoint-every", "10") as running:
        folder = bench.run_folder / "checkpoints"
        running.wait_for(bench.checkpoints)
        folder.rename(bench.folder / "kept")
        folder.write_text("in the way")
        done = running.end()
    facts = bench.facts()
    expect(done.code == 6 and (facts["status"], facts["exit_code"]) == ("failed", 6), (str(done), facts["status"]))
    folder.unlink()
    (bench.folder / "kept").rename(folder)
    bench.goes_on()
    return "exit 6, status failed; same bits after restart"


@row(77, f"{', '.join(SIGNALS)} to a run", "exit 5 with a checkpoint; restart: same bits")
def batch_signals(bench: Bench) -> str:
    got = []
    for name in SIGNALS:
        shutil.rmtree(bench.run_folder, ignore_errors=True)
        with bench.started(ranks=1) as running:
            running.send(name)
            got.append(stopped(bench, running, name))
    return got[-1]


@row(78, "nohup: the terminal goes", "the run goes on, same bits")
def hangup(bench: Bench) -> str:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # which a new process inherits
    try:
        with bench.started() as running:
            for rank in running.ranks():
                os.kill(rank, signal.SIGHUP)
            time.sleep(0.5)
            done = running.end()
    finally:
        signal.signal(signal.SIGHUP, before)
    expect(done.code == 0 and bench.facts()["state_digest"] == bench.digest(), done)
    return "exit 0, same bits"


@row(88, "run folders of odd names", "the command that is told goes on: same bits; names too long: exit 6")
def odd_names(bench: Bench) -> str:
    for name in NAMES:
        words = ("run", str(bench.case), "--threads", "1", f"--output={name}")
        done = bench.call((*words, "--wall", "0"))
        expect(done.code == 5 and "Traceback" not in done.err, f"{name!r}: {done}")
        told = bench.facts(name)["reason"].partition("go on with: ")[2]
        done = bench.call((*shlex.split(told)[1:], "--threads", "1"))
        expect(done.code == 0 and bench.facts(name)["state_digest"] == bench.digest(), f"{name!r}: {done}")
    for name in TOO_LONG:
        done = bench.call(("run", str(bench.case), "-o", name))
        expect(done.code == 6 and "Traceback" not in done.err and "too long" in done.err, done)
    return "same bits after restart; too long: exit 6"


@row(89, "histograms.h5: the run is killed; the file is cut off", "rows as without; told, the state goes on")
def histograms(bench: Bench) -> str:
    bench.digest()
    file, sound = bench.run_folder / "histograms.h5", bench.work / "quiet-0/run/histograms.h5"
    if not sound.exists():
        raise Skipped("this program has none")
    with bench.started("--checkpoint-every", "12") as running:
        running.wait_for(bench.checkpoints)
        for rank in running.ranks():
            os.kill(rank, signal.SIGKILL)
        running.end()
    bench.goes_on()
    with h5py.File(file) as one, h5py.File(sound) as other:
        n = len(other["step"])
        expect(n > 20 and np.array_equal(one["step"], other["step"]), "other steps")
        expect(np.array_equal(one["fv/counts"][:n], other["fv/counts"][:n]), "other counts")
    shutil.rmtree(bench.run_folder)
    half(bench)
    file.write_bytes(file.read_bytes()[:1000])
    done = bench.restart()
    expect(done.code in (0, 6) and "Traceback" not in done.err and "histograms.h5" in done.err, done)
    file.unlink()
    bench.goes_on()
    return f"{n} rows as without a kill; cut off: exit {done.code}, told; without the file: same bits"
