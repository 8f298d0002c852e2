"""Rows 39 to 46: files that others wrote to do harm."""

from __future__ import annotations

import json
import os
import random
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from fault_matrix.bench import Bench, Done, expect
from fault_matrix.fuzz import changed
from fault_matrix.rows import row
from hpcpic.core.files.atomic import temporary, write_atomic

FUZZ = (475_000, 25_000)  # lines, whole cases, by each of two processes
PROGRAMS = 12  # whole programs beside them
START_SECONDS, SLOWER = 2.5, 2.0  # of a program that only reads a case; times as long as a sound one takes just now


def check(bench: Bench, case: Path) -> Done:
    """`check` of a case, with 1 GiB of memory and no more."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))

    return bench.call(("check", str(case)), before=limit)


def refused(bench: Bench, case: Path, what: str) -> Done:
    done = check(bench, case)
    expect(done.code == 2 and "Traceback" not in done.err, f"{what}: {done}")
    if done.seconds > START_SECONDS:
        sound = check(bench, bench.case).seconds
        expect(done.seconds < SLOWER * sound, f"{what}: {done.seconds:.1f} s, a sound case {sound:.1f} s")
    return done


@row(39, "a million cases with random changes", "read or refused within 100 ms and 100 MB, never a traceback")
def fuzz(bench: Bench) -> str:
    words = [sys.executable, "-P", "-m", "fault_matrix.fuzz", bench.program, str(bench.case)]
    workers = [
        subprocess.Popen([*words, str(seed), *map(str, FUZZ)], env=bench.environment({}, {}),
                         stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for seed in (1, 2)
    ]  # fmt: skip
    said = [worker.communicate() for worker in workers]
    expect(not any(worker.returncode for worker in workers), [err[-500:] for _, err in said])
    found = [json.loads(out.splitlines()[-1]) for out, _ in said]
    slowest, grown = (max(one[what] for one in found) for what in ("slowest", "mebibytes"))
    expect(slowest < 0.1 and grown < 100, f"{1e3 * slowest:.0f} ms, {grown:.0f} MiB for one")
    case, chance = bench.folder / "case.conf", random.Random(3)
    codes = []
    for _ in range(PROGRAMS):
        case.write_text(changed(bench.case.read_text(), chance))
        done = check(bench, case)
        expect(done.code in (0, 2, 3) and "Traceback" not in done.err, done)
        codes.append(done.code)
    n, read = (sum(one[what] for one in found) for what in ("inputs", "read"))
    return (
        f"{n} in the reader, {read} read: at most {1e3 * slowest:.0f} ms, {grown:.0f} MiB; "
        f"{PROGRAMS} in the program: exit {', '.join(map(str, sorted(set(codes))))}"
    )


@row(40, "nesting, long numbers, NUL, BOM, CRLF, bad UTF-8, bidi", "exit 2 with line and column; BOM, CRLF read")
def texts(bench: Bench) -> str:
    case = bench.folder / "case.conf"
    sound = bench.case.read_bytes()
    bad = {
        "nesting": b"x = " + b"(" * 100_000,
        "a long number": b"x = " + b"1" * 1_000_000 + b";",
        "NUL": sound + b"x = \x00;",
        "bad UTF-8": sound + b'x = "\xff\xfe";',
        "bidi": sound + "x\u202e = 1;".encode(),
    }
    for what, content in bad.items():
        case.write_bytes(content)
        done = refused(bench, case, what)
        expect("case.conf:" in done.err, f"{what}: no place: {done}")
    for content in (b"\xef\xbb\xbf" + sound, sound.replace(b"\n", b"\r\n")):
        case.write_bytes(content)
        done = check(bench, case)
        expect(done.code in (0, 3), done)
    return "exit 2 with place, five times; BOM and CRLF are read"


def includes(folder: Path) -> dict[str, str]:
    """What an @include may name."""
    (folder / "loop.conf").write_text('@include "loop.conf"\n')
    os.symlink("/etc/hostname", folder / "out.conf")
    os.mkfifo(folder / "fifo.conf")
    with open(folder / "large.conf", "wb") as file:
        file.truncate(1 << 30)
    (folder.parent / "above.conf").write_text("x = 1;\n")
    return {
        "a loop": "loop.conf", "../": "../above.conf", "absolute": "/etc/hostname", "a link out": "out.conf",
        "a FIFO": "fifo.conf", "/dev/zero": "/dev/zero", "1 GiB": "large.conf",
    }  # fmt: skip


@row(41, "@include of a loop, ../, /, a link, a FIFO, /dev/zero, 1 GiB", "exit 2 at once")
def included(bench: Bench) -> str:
    case = bench.folder / "case.conf"
    for what, name in includes(bench.folder).items():
        case.write_text(f'@include "{name}"\n')
        refused(bench, case, what)
    return "exit 2, seven times"


def refused_file(bench: Bench, name: str, change: Callable[[h5py.File], None]) -> int:
    """`export` of a run whose series was changed; exit 6 and little memory wanted."""
    path = bench.run_folder / "series.h5"
    sound = path.read_bytes()
    with h5py.File(path, "r+") as file:
        change(file)

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))

    done = bench.call(("compare", str(bench.run_folder), str(bench.run_folder)), before=limit)
    path.write_bytes(sound)
    expect(done.code == 6 and "Traceback" not in done.err, f"{name}: {done}")
    return done.code


def with_series(bench: Bench) -> str:
    """Name of a data set in the series of a run."""
    expect(bench.run(ranks=1).code == 0, "the run before")
    with h5py.File(bench.run_folder / "series.h5") as file:
        return next(name for name in file if isinstance(file[name], h5py.Dataset) and name not in ("step", "time"))


def replaced(name: str, make: Callable[[h5py.File], None]) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[name]
        make(file)

    return change


@row(42, "HDF5 that leads out of the file", "exit 6, nothing outside is read")
def links(bench: Bench) -> str:
    name = with_series(bench)
    shape = (121,)
    layout = h5py.VirtualLayout(shape, np.float64)
    layout[:] = h5py.VirtualSource("other.h5", "x", shape)
    kinds: dict[str, Callable[[h5py.File], None]] = {
        "external link": lambda file: file.__setitem__(name, h5py.ExternalLink("other.h5", "/x")),
        "soft cycle": lambda file: file.__setitem__(name, h5py.SoftLink(f"/{name}")),
        "external storage": lambda file: file.create_dataset(name, shape, "f8", external=[("/etc/hostname", 0, 968)]),
        "virtual": lambda file: file.create_virtual_dataset(name, layout),
        "filter": lambda file: file.create_dataset(name, data=np.zeros(shape), chunks=shape, compression="lzf"),
    }
    for what, make in kinds.items():
        refused_file(bench, what, replaced(name, make))
    return f"exit 6 for {', '.join(kinds)}"


@row(43, "HDF5 bombs: 8.8 TB declared, 1000:1 compressed", "exit 6 within 3 GiB of address space")
def bombs(bench: Bench) -> str:
    name = with_series(bench)
    kinds: dict[str, Callable[[h5py.File], None]] = {
        "declared": lambda file: file.create_dataset(name, (1 << 40,), "f8", chunks=(1 << 20,)),
        "compressed": lambda file: file.create_dataset(name, data=np.zeros(1 << 24), compression="gzip"),
    }
    for what, make in kinds.items():
        refused_file(bench, what, replaced(name, make))
    return "exit 6, twice"


@row(44, "HDF5 of another type, shape, or kind", "exit 6 that names the data set")
def types(bench: Bench) -> str:
    name = with_series(bench)
    kinds: dict[str, Callable[[h5py.File], None]] = {
        "single": lambda file: file.create_dataset(name, data=np.zeros(121, np.float32)),
        "two axes": lambda file: file.create_dataset(name, data=np.zeros((121, 2))),
        "texts": lambda file: file.create_dataset(name, (121,), h5py.string_dtype()),
        "lists": lambda file: file.create_dataset(name, (121,), h5py.vlen_dtype(np.float64)),
        "group": lambda file: file.create_group(name),
    }
    for what, make in kinds.items():
        refused_file(bench, what, replaced(name, make))
    return f"exit 6 for {', '.join(kinds)}"


@row(45, "a cache of compiled code that others can write", "not used, a warning")
def poisoned_cache(bench: Bench) -> str:
    def doctor(prepare: Callable[[Path], None]) -> None:
        root = bench.folder / f"cache-{len(os.listdir(bench.folder))}"
        mine = root / str(os.getuid())
        mine.mkdir(parents=True)
        prepare(mine)
        done = bench.call(("doctor",), env={"HPCPIC_CACHE_DIR": str(root)})
        refused = "written by others" in done.out or "another user" in done.out
        expect(refused and "Traceback" not in done.err, done)
        expect(not os.listdir(mine), "something was written there")

    def link(mine: Path) -> None:
        mine.rmdir()
        (mine.parent / "others").mkdir()
        (mine.parent / "others").chmod(0o777)
        mine.symlink_to("others")

    doctor(lambda mine: mine.chmod(0o777))
    doctor(link)
    if os.getuid() == 0:
        doctor(lambda mine: os.chown(mine, 12345, 12345))
    return "mode 0777, a link to such a one, another owner: not used, told"


def planted(bench: Bench, name: str, victim: Path) -> None:
    """A run in which a file or folder is a link to the victim; `run --replace` goes its own way."""
    shutil.rmtree(bench.run_folder, ignore_errors=True)
    bench.run_folder.mkdir()
    write_atomic(bench.run_folder / "run.json", '{"status": "finished", "started": ""}')
    (bench.run_folder / name).unlink(missing_ok=True)
    (bench.run_folder / name).symlink_to(victim)
    before = contents(victim)
    done = bench.run("--replace", ranks=1)
    expect(done.code in (0, 6) and "Traceback" not in done.err, f"{name}: {done}")
    expect(contents(victim) == before, f"{name}: the victim was written to")


def contents(path: Path) -> dict[str, str]:
    files = [path, *path.rglob("*")]
    return {str(file): file.read_text() for file in files if file.is_file()}


@row(46, "links where files will be written; a run folder that is a link", "what they lead to is not touched")
def planted_links(bench: Bench) -> str:
    victim, folder = bench.folder / "victim", bench.folder / "victims"
    victim.write_text("mine\n")
    folder.mkdir()
    (folder / "00000001.h5").write_text("mine\n")
    target = bench.folder / "table.csv"
    temporary(target).symlink_to(victim)
    write_atomic(target, "new\n")
    expect(victim.read_text() == "mine\n" and target.read_text() == "new\n", "the victim was written to")
    names = ("run.json", "log.txt", "series.csv", "series.h5", "histograms.h5", "config.conf", "trace-rank-0.txt",
             ".lock")  # fmt: skip
    for name in names:
        planted(bench, name, victim)
    for name in ("checkpoints", "given"):
        planted(bench, name, folder)
    shutil.rmtree(bench.run_folder)
    (folder / "run.json").write_text("{}")
    bench.run_folder.symlink_to(folder)
    before = contents(folder)
    done = bench.run()
    expect(done.code == 6 and contents(folder) == before, done)
    return f"{len(names) + 2} links in the folder and a temporary one: not followed; a linked run: exit 6"
