"""The verbs that take no step or only look: light, quick, right exit codes."""

import csv
import json
import os
import re
import resource
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from app_runner import TIMEOUT_S, launch
from click.testing import CliRunner
from toy_app import APP as TOY
from toy_runner import ROOT, RUN_A, environment

from hpcpic.__main__ import load_app
from hpcpic.core.app.text import table
from hpcpic.core.case.config import load
from hpcpic.core.cli.main import VERBS, build
from hpcpic.core.files.reader import open_run
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.report.compare import compared
from hpcpic.core.report.export import to_csv
from sph.app import APP as SPH

HEAVY = ("mpi4py", "numba", "h5py", "pyfftw", "scipy", "matplotlib")
LOOK = """
import sys
sys.argv = ["hpcpic", *{words!r}]
from hpcpic.__main__ import load_app
from hpcpic.core.cli.main import build
try:
    build(load_app, "hpcpic", "plasma")()
except SystemExit as end:
    code = end.code
loaded = [name for name in {heavy!r} if name in sys.modules]
sys.stderr.write(f"loaded={{loaded}} code={{code}}")
"""
LIGHT = [["--help"], ["run", "--help"], ["list"], ["show", "landau-damping"], ["check", "landau-damping"],
         ["estimate", "landau-damping", "--ranks", "4"]]  # fmt: skip


@pytest.fixture(scope="module")
def libraries(tmp_path_factory):
    """Processor time of importing what every verb needs."""
    words, folder = ["-c", "import numpy, pydantic, lark"], tmp_path_factory.mktemp("libraries")
    return min(processor_seconds(words, folder)[0] for _ in range(3))


@pytest.mark.parametrize("words", LIGHT, ids=" ".join)
def test_thinking_verbs_import_nothing_heavy_and_answer_at_once(words, tmp_path, libraries):
    program = LOOK.format(words=words, heavy=(*HEAVY, "pydantic", "numpy") if words == ["--help"] else HEAVY)
    seconds, done = processor_seconds(["-c", program], tmp_path)
    assert done.stderr.endswith("loaded=[] code=0"), done.stderr
    assert done.stdout
    # Not by the clock, for a busy machine: 0.4 s on a quiet one is twice the libraries, thrice with no bytecode kept;
    # two programs on the threads of one core make it vary by half as much again.
    assert seconds < 5 * libraries


def processor_seconds(words, folder):
    """What a Python command takes, and what it said."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment(), capture_output=True, text=True, timeout=20
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done


def test_every_verb_has_help(toy):
    listed = toy("--help").stdout
    for verb, (module, sentence) in VERBS.items():
        assert f"\n  {verb} " in listed and sentence.split()[-1] in listed
        made = getattr(import_module(f"hpcpic.core.{module}"), f"make_{verb}_command")(lambda: None)
        assert made.name == verb and made.help
    assert subprocess.run(
        [sys.executable, "-m", "hpcpic", "--version"], cwd=ROOT, env=environment(), capture_output=True
    ).stdout.startswith(b"hpcpic")


def test_check_tells_limits_and_leaves_with_3_beyond_them(toy):
    assert toy("check", "ring.conf").returncode == 0
    done = toy("check", "ring.conf", courant=2)
    assert done.returncode == 3
    assert "Courant number" in done.stdout and "take courant = 1" in done.stdout and "CFL" in done.stdout
    assert re.search(r"refused by 1 of \d+ derived numbers", done.stderr)


def test_check_of_a_wrong_key_is_exit_2(toy):
    done = toy("check", "ring.conf", rowz=2)
    assert done.returncode == 2 and "did you mean 'rows'" in done.stderr


def test_show_has_every_key_and_what_the_case_says(toy):
    shown = toy("show", "ring.conf").stdout
    assert "a ring" in shown
    for key in ("steps", "rows", "fault.kind", "output.field"):
        assert f"\n{key} " in shown


@pytest.mark.parametrize("columns", [30, 60, 80, 200])
def test_a_table_cuts_no_word_on_any_terminal(columns, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    row = ("simulation.sampling_period", "3", "steps between samples of the series, 0 = never")
    table(("key", "here", "meaning"), [row, ("end", "1", "last")])
    words = capsys.readouterr().out.replace(";", "").split()
    assert [words.count(word) for word in " ".join(row).split()] == [1] * 11


def test_output_is_said_by_one_rank(toy):
    assert toy("show", "ring.conf", ranks=2).stdout.count("\nsteps ") == 1


def test_a_reader_that_goes_away_is_no_traceback(toy):
    words = [*toy.words("show", "ring.conf")]
    done = subprocess.run(
        f"{' '.join(words)} | true",
        shell=True,
        cwd=toy.folder,
        env=environment(),
        capture_output=True,
        text=True,
    )
    assert "Traceback" not in done.stderr


LATE = """
import os, sys, time
from mpi4py import MPI
from hpcpic.__main__ import load_app
from hpcpic.core.cli.main import program
rank, finalize = MPI.COMM_WORLD.rank, MPI.Finalize

def late():
    finalize()
    if rank == {slow}:
        time.sleep(0.5)
        os.write(1, b"the last word")

MPI.Finalize = late
sys.argv = ["hpcpic", *{words!r}]
program(load_app, "hpcpic", "plasma")
"""


@pytest.mark.parametrize("words, code, slow", [(["run", "nothere.conf"], 2, 1), (["check", "two-stream-cold"], 0, 0)])
def test_a_rank_that_ends_late_is_not_killed(words, code, slow):
    """A launcher that sees a rank leave without a word kills the others; at times their code is that of the whole."""
    done = launch(2, "-c", LATE.format(words=words, slow=slow))
    assert done.returncode == code and "the last word" in done.stdout, done.stdout + done.stderr


def test_estimate_adds_up(toy):
    done = toy(
        "estimate",
        "ring.conf",
        "--ranks",
        "5",
        rows=1000,
        env={"HPCPIC_CACHE_DIR": str(toy.folder / "cache")},
    )
    assert done.returncode == 0
    assert "1.562 KiB" in done.stdout  # 8 B x 1000 / 5
    assert "bench --quick" in done.stdout


def test_compare_is_exit_3_beyond_the_tolerance(toy):
    for name, courant in (("a", 0.25), ("b", 0.25), ("c", 0.250001)):
        toy(
            "run",
            "ring.conf",
            "-o",
            name,
            "--threads",
            "1",
            courant=courant,
            output__field=100,
            output__particle=100,
        )
    same = toy("compare", "a", "b")
    assert same.returncode == 0, same.stderr
    assert "config: the same" in same.stdout and "the same bits" in same.stdout
    other = toy("compare", "a", "c")
    assert other.returncode == 3 and "field u" in other.stderr and "courant" in other.stdout
    assert toy("compare", "a", "c", "--tol", "1e-3").returncode == 0


def test_a_run_under_way_says_on_what_it_runs_and_has_no_final_state_yet(toy):
    process = toy.start(*RUN_A, ranks=2, steps=10**6, pause=0.01)
    facts = toy.facts("a")
    assert (facts["status"], facts["ranks"], facts["threads"], facts["nodes"]) == ("running", 2, 1, 50)
    assert "final state: not known" in toy("compare", "a", "a").stdout
    (toy.folder / "a/STOP").touch()
    assert process.wait(20) == 5


def test_runs_of_another_program_are_not_compared(toy):
    """As in all verbs that read a run: what two programs have in common by name is nothing to compare."""
    assert toy(*RUN_A, steps=10).returncode == 0
    facts = toy.facts("a")
    shutil.copytree(toy.folder / "a", toy.folder / "b")
    (toy.folder / "b/run.json").write_text(json.dumps(facts | {"program": "other"}))
    for pair in (("a", "b"), ("b", "a")):
        done = toy("compare", *pair)
        assert done.returncode == 6 and "b: a run of other, not of toy" in done.stderr


def test_compare_of_runs_of_different_length_is_exit_3(toy):
    for name, steps in (("a", 10), ("b", 20)):
        toy("run", "ring.conf", "-o", name, "--threads", "1", steps=steps)
    done = toy("compare", "a", "b")
    assert done.returncode == 3 and "different times" in done.stderr


def test_compare_takes_last_snapshots_of_one_time_not_of_one_step(toy):
    """A run whose steps are twice as long comes to the same time: it was told to have no snapshot in common, and one
    that goes twice as far in as many steps was compared with it.
    """
    toy(*RUN_A, steps=20, output__field=20, output__particle=20)
    for name, where, factor in (("b", "step", 0.5), ("c", "VTKHDF/Steps/Values", 2.0)):
        shutil.copytree(toy.folder / "a", toy.folder / name)
        for kind in ("fields", "particles"):
            with h5py.File(toy.folder / f"{name}/{kind}.vtkhdf", "r+") as file:
                file[where][...] = file[where][...] * factor
    a, b, c = (open_run(toy.folder / name) for name in "abc")
    assert [one.what for one in compared(a, a, TOY).differences][-1] == "points u, step 20"
    assert [one.what for one in compared(a, b, TOY).differences][-1] == "points u, t = 0.0195312 s"
    apart = "last snapshot at t = 0.0195312 s (step 20) and 0.0390625 s (step 20)"
    assert compared(a, c, TOY).missing == tuple(f"{kind}: {apart}" for kind in ("fields", "particles"))


def test_compare_of_runs_without_output_looks_at_their_final_states(toy):
    for name, courant in (("a", 0.25), ("b", 0.25), ("c", 0.5)):
        toy("run", "ring.conf", "-o", name, "--threads", "1", courant=courant, steps=9, output__series=0)
    assert toy("compare", "a", "b").returncode == 0
    assert toy("compare", "a", "c").returncode == 3
    assert toy("compare", "a", "b", "--tol", "-1").returncode == 2


def test_compare_with_a_run_that_has_just_begun_is_exit_3(toy):
    for name in ("a", "b"):
        toy("run", "ring.conf", "-o", name, "--threads", "1", steps=9, output__field=3, output__particle=3)
    for name in ("fields", "particles"):
        with h5py.File(toy.folder / f"b/{name}.vtkhdf", "r+") as file:
            file["VTKHDF/Steps"].attrs.modify("NSteps", 0)
    done = toy("compare", "a", "b")
    assert done.returncode == 3 and "fields: no snapshot yet in b" in done.stderr, done.stderr


def test_export_writes_what_other_programs_read(toy):
    toy(*RUN_A, output__field=100, output__particle=200, output__openpmd=100)
    done = toy("export", "a", "--to", "csv,vtkhdf,openpmd")
    assert done.returncode == 0, done.stderr
    rows = list(csv.reader((toy.folder / "a/export/csv/points-00000200.csv").open()))
    assert rows[0] == ["id", "position_x", "position_y", "position_z", "u"]
    assert len(rows) == 51
    units = list(csv.reader((toy.folder / "a/export/csv/points.units.csv").open()))
    assert units == [["name", "unit"], *([name, "1" if name in ("id", "u") else "m"] for name in rows[0])]
    assert (toy.folder / "a/export/vtkhdf/fields.vtkhdf").exists()
    names = [f"data{step:08d}.h5" for step in (0, 100, 200)]
    assert sorted(path.name for path in (toy.folder / "a/openpmd").iterdir()) == names
    assert sorted(path.name for path in (toy.folder / "a/export/openpmd/fields").iterdir()) == names
    assert toy("export", "a", "--to", "xdmf").returncode == 2


@pytest.mark.parametrize("verb", ["export", "report"])
def test_a_place_that_cannot_be_written_is_exit_6_in_one_line(toy, verb):
    toy(*RUN_A, steps=5, output__field=5)
    (toy.folder / "file").write_text("")
    done = toy(verb, "a", "-o", "file/x/y")
    assert done.returncode == 6 and done.stderr.count("\n") == 1 and "file/x" in done.stderr


def test_the_name_of_a_species_leads_to_no_other_folder(tmp_path, monkeypatch):
    run = SimpleNamespace(path=tmp_path, rundir=RunDir(tmp_path), particles=lambda name, step: {"id": np.arange(2)})
    run.rundir.particles.write_text("")
    run.particle_snapshots = SimpleNamespace(steps=[0], species=["../a/b", "a", "electron +x"], units={})
    assert to_csv(run, tmp_path) == 6  # tables, and their units
    names = {path.name for path in tmp_path.glob("*.csv") if "units" not in path.name}
    assert names == {"..%2Fa%2Fb-00000000.csv", "a-00000000.csv", "electron +x-00000000.csv"}


def keep_rates_of_another_program(cache: Path) -> None:
    words = [sys.executable, "-c", "from hpcpic.core.app.rates import keep_rates; keep_rates({'bench another': 1.0})"]
    subprocess.run(words, env=os.environ | {"HPCPIC_CACHE_DIR": str(cache)}, check=True)


@pytest.mark.timeout(TIMEOUT_S)  # in a cache of its own, so it compiles
def test_bench_keeps_rates_that_estimate_uses(toy):
    cache = {"HPCPIC_CACHE_DIR": str(toy.folder / "cache")}
    keep_rates_of_another_program(toy.folder / "cache")
    assert "machine of the authors" in toy("estimate", "ring.conf", env=cache).stdout
    done = toy("bench", "--quick", "--threads", "1", env=cache)
    assert done.returncode == 0, done.stderr
    assert "triad" in done.stdout and "GB/s" in done.stdout
    assert "measured on this machine" in toy("estimate", "ring.conf", env=cache).stdout


def test_doctor_finds_two_ranks_of_one_mpi(toy):
    done = toy("doctor", "--threads", "1")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "launcher" in done.stdout and "HDF5" in done.stdout


def test_doctor_tells_of_a_cache_that_others_could_change_and_of_what_killed_ranks_left(toy):
    unsafe = toy.folder / "cache"
    unsafe.mkdir()
    unsafe.chmod(0o777)
    left = Path("/dev/shm/mpich_shm_hpcpic_test_0")
    left.write_bytes(bytes(1 << 20))
    try:
        done = toy("doctor", "--threads", "1", env={"HPCPIC_CACHE_DIR": str(unsafe)})
    finally:
        left.unlink()
    assert done.returncode == 0, done.stdout + done.stderr
    (cache,) = [line for line in done.stdout.splitlines() if line.startswith("kernel cache")]
    assert str(unsafe) in cache and "can be written by others (mode 777)" in cache and "warn" in cache
    (segments,) = [line for line in done.stdout.splitlines() if line.startswith("of killed ranks")]
    assert "warn" in segments and "rm /dev/shm/" in segments and not list(unsafe.iterdir())


@pytest.mark.parametrize("ranks", [1, 2])
def test_doctor_is_exit_3_when_cores_are_oversubscribed(toy, ranks):
    done = toy("doctor", "--threads", "1000", ranks=ranks)
    assert done.returncode == 3 and "not in order: load" in done.stderr


@pytest.mark.parametrize(
    ("words", "column", "first"),
    [
        ("list", "case", "bump-on-tail"),
        ("show landau-damping", "key", "description"),
        ("check landau-damping", "number", None),
        ("estimate landau-damping --ranks 2", "memory per rank", "Python and libraries"),
        ("doctor", "what", "MPI"),
    ],
)
def test_tables_as_json_hold_the_numbers_behind_their_cells(words, column, first):
    done = CliRunner().invoke(build(load_app, "hpcpic", "plasma"), [*words.split(), "--json"])
    answer = json.loads(done.output)
    row = answer["tables"][0][0]
    assert first in (None, row[column])
    numbers = [value for table in answer["tables"] for row in table for value in row.values()]
    assert any(isinstance(value, float) for value in numbers) == (words.split()[0] in ("check", "estimate"))


def test_every_number_of_an_estimate_as_json_has_its_unit():
    """A reader need not know which times are in ms; shares have none. `check` has the same form."""
    done = CliRunner().invoke(build(lambda: SPH, "sph", "x"), ["estimate", "water-column", "--json"])
    memory, disk, step, time = tables = json.loads(done.output)["tables"]
    assert all(row["size unit"] == "B" for row in memory + disk) and all(row["time unit"] == "ms" for row in step)
    assert [row["unit"] for row in time] == ["s", "s", "s", "ms", ""] and list(time[0])[1:] == ["value", "unit"]
    numbers = {key for table in tables for row in table for key, cell in row.items() if isinstance(cell, float)}
    assert numbers == {"size", "time", "value", "share"}
    assert all(isinstance(row["share"], float | str) and "share unit" not in row for row in memory + step)


@pytest.mark.parametrize("name", ["water-column", "column-impact-b"])
def test_the_text_of_a_case_is_a_case_of_its_own_elsewhere(name, tmp_path):
    """Also where the shipped one includes another."""
    done = CliRunner().invoke(build(lambda: SPH, "sph", "x"), ["show", name, "--text"])
    (tmp_path / "my.conf").write_text(done.output)
    assert SPH.configure(load(tmp_path / "my.conf")) == SPH.configure(load(SPH.cases()[name]))


def test_the_schema_of_cases_is_one_of_json():
    done = CliRunner().invoke(build(lambda: SPH, "sph", "x"), ["show", "water-column", "--schema"])
    schema = json.loads(done.output)
    assert schema["type"] == "object" and "fluid" in schema["properties"]


@pytest.mark.parametrize("words", [["show", "water-column"], ["show", "water-column", "--json"], ["--help"]])
def test_a_reader_that_has_gone_is_exit_141_without_a_word(words):
    """An output that is longer than a buffer, one that comes at once, and what click prints itself."""
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-m", "sph", *words], stdout=writer, stderr=subprocess.PIPE, env=environment(), check=False
    )
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, b"")
