"""sweep: every combination once, failures stop nobody, called again it repeats only what is not done."""

import csv
import os
import signal
import subprocess
import sys
from importlib import import_module
from types import SimpleNamespace

import pytest
from toy_runner import ROOT, environment, wait_until

from hpcpic.core.cli.doctor import _try_launcher
from hpcpic.core.cli.launch import _environment, launch, launcher
from hpcpic.core.errors import ConfigError
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.study.sweep import _short, _tell, expand, results_of, run_once, split


def table(toy):
    return list(csv.DictReader((toy.folder / "s/table.csv").open()))


def test_expand_is_the_product_or_the_zip():
    assert expand(["a=1,2", "b=x,y"]) == [("a=1", "b=x"), ("a=1", "b=y"), ("a=2", "b=x"), ("a=2", "b=y")]
    assert expand(["a=1,2", "b=x,y"], zipped=True) == [("a=1", "b=x"), ("a=2", "b=y")]
    assert expand([]) == [()] == expand([], zipped=True)


@pytest.mark.parametrize("value, number", [(7, 7), ("7", 7), ("1e-3", 1e-3), (0.5, 0.5), ("rk3", None), (None, None)])
def test_numbers_of_the_table_are_numbers_in_json(value, number):
    assert getattr(_short(value), "value", None) == number


def test_ranges_have_both_ends():
    assert expand(["a=0:1:5"]) == [("a=0.0",), ("a=0.25",), ("a=0.5",), ("a=0.75",), ("a=1.0",)]


def test_commas_in_brackets_and_quotes_do_not_split():
    assert split('[1,2],"a,b",3') == ["[1,2]", '"a,b"', "3"]


@pytest.mark.parametrize(
    "sets, zipped", [(["a"], False), (["a=1,2", "b=1"], True), (["a=x:y:3"], False), (["a=0:1:0"], False)]
)
def test_what_is_no_list_is_refused(sets, zipped):
    with pytest.raises(ConfigError):
        expand(sets, zipped)


def test_failures_stop_nobody_and_finished_runs_are_not_repeated(toy):
    words = ("sweep", "ring.conf", "-o", "s", "--set", "courant=0.5,2,1", "--set", "steps=20")
    done = toy(*words)
    assert done.returncode == 3, done.stderr
    assert [row["exit_code"] for row in table(toy)] == ["0", "2", "0"]
    assert [row["courant"] for row in table(toy)] == ["0.5", "2", "1"]
    shown = [name for line in done.stdout.splitlines() if line.startswith("run ") for name in line.split()]
    _, _, others = next(line for line in done.stdout.splitlines() if line.startswith("table: ")).partition(", with ")
    assert {*shown, *others.removesuffix(" too").split(", ")} - {""} == set(table(toy)[0])
    assert float(table(toy)[0]["mass"]) == pytest.approx(50.0)
    first = toy.facts("s/0000")
    again = toy(*words)
    assert again.stdout.count("done before") == 2
    assert toy.facts("s/0000") == first


def test_a_run_that_diverged_says_why_in_its_line(toy):
    """Its screen ends with the table and where to look."""
    done = toy(
        "sweep", "ring.conf", "-o", "s", "--set", "steps=20", "--set", "fault.kind=diverge", "--set", "fault.step=5"
    )
    lines = [line for line in done.stdout.splitlines() if ": exit 4" in line]
    assert len(lines) == 1 and "the toy was told to diverge" in lines[0], done.stdout


def test_exit_0_without_a_finished_run_is_a_failure(tmp_path):
    """Something else was started in the place of the program."""
    app, rundir = SimpleNamespace(program=("toy",), name="toy"), RunDir(tmp_path / "runs" / "0000")
    code, words = run_once(app, "ring.conf", (), rundir, (1, 1), start=lambda *_, **__: 0)
    assert code == 1 and "no finished run" in words


@pytest.mark.parametrize("program", ["hpcpic", "sph", "lbmdem"])
def test_what_lies_in_the_current_folder_is_not_executed(program, tmp_path, monkeypatch):
    """Of a case that somebody has sent, with modules of the names that the program imports."""
    for name in (program, "click", "numpy", "mpi4py", "json"):
        (tmp_path / f"{name}.py").write_text(f"open('executed-{name}', 'w'); raise SystemExit(0)\n")
    monkeypatch.chdir(tmp_path)
    app = import_module(f"{program}.__main__").load_app()
    with open("output", "w+") as output:
        assert launch(app.program, ("list",), 1, stdout=output, stderr=output) == 0
        output.seek(0)
        assert next(iter(app.cases())) in output.read()
    assert not list(tmp_path.glob("executed-*"))


def test_doctor_starts_nothing_from_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "mpi4py.py").write_text("open('executed', 'w'); raise SystemExit(0)\n")
    monkeypatch.chdir(tmp_path)
    assert _try_launcher(launcher()).verdict == "ok"
    assert not (tmp_path / "executed").exists()


def test_a_program_that_was_started_from_its_sources_starts_the_same(monkeypatch):
    """`python -m` in a checkout that is not installed: its runs find the packages there, too."""
    monkeypatch.delenv("PYTHONPATH", raising=False)
    monkeypatch.setattr(sys, "path", [str(ROOT), "/elsewhere"])
    assert _environment()["PYTHONPATH"] == str(ROOT)
    monkeypatch.setattr(sys, "path", ["/elsewhere", str(ROOT)])
    assert "PYTHONPATH" not in _environment()


def test_runs_of_another_sweep_are_not_replaced(toy):
    assert toy("sweep", "ring.conf", "-o", "s", "--set", "steps=20").returncode == 0
    before = toy.facts("s/0000")
    done = toy("sweep", "ring.conf", "-o", "s", "--set", "steps=10,20")
    assert done.returncode == 6 and "another sweep" in done.stderr
    assert toy.facts("s/0000") == before


def test_runs_of_a_case_that_was_changed_since_are_no_part_of_the_table(toy):
    assert toy("sweep", "ring.conf", "-o", "s", "--set", "steps=20").returncode == 0
    (toy.folder / "ring.conf").write_text("steps = 200;\nrows = 40;\n")
    done = toy("sweep", "ring.conf", "-o", "s", "--set", "steps=20")
    assert done.returncode == 6 and "before it was changed" in done.stderr


def test_runs_end_together_unless_the_user_ends_them():
    """A case that counts steps takes as many as its own time needs; one that ends at a time needs nothing."""
    from hpcpic.__main__ import load_app
    from hpcpic.core.study.sweep import with_equal_ends

    case = str(load_app().cases()["two-stream-cold"])  # 1200 steps of 0.05 s
    swept = [("simulation.time_step=0.05",), ("simulation.time_step=0.1",), ("simulation.time_step=0.025",)]
    found = with_equal_ends(load_app(), case, swept)
    assert found == [swept[0], (*swept[1], "simulation.cycles=600"), (*swept[2], "simulation.cycles=2400")]
    own = [(*sets, f"simulation.cycles={n}") for n, sets in enumerate(swept, 1)]
    assert with_equal_ends(load_app(), case, own) == own
    wrong = [("simulation.time_step=x",), swept[0]]
    assert with_equal_ends(load_app(), case, wrong) == wrong


def test_under_mpirun_nothing_is_run(toy):
    done = toy("sweep", "ring.conf", "-o", "s", "--set", "steps=20", ranks=2)
    assert done.returncode == 2 and done.stderr.count("without mpirun") == 1
    assert not (toy.folder / "s").exists()


def test_a_stopped_run_goes_on(toy):
    words = ("sweep", "ring.conf", "-o", "s", "--set", "steps=400")
    done = toy("run", "ring.conf", "-o", "s/0000", "--wall", "0", steps=400)
    assert done.returncode == 5
    assert toy(*words).returncode == 0
    assert len(toy.facts("s/0000")["history"]) == 2 and toy.facts("s/0000")["steps"] == 400


@pytest.mark.parametrize("name", ["SIGINT", "SIGHUP"])  # of a terminal; the others in ENDING take the way of SIGHUP
def test_a_signal_lets_the_run_write_its_checkpoint_and_is_exit_5(hangups, toy, name):
    words = toy.words("sweep", "ring.conf", "-o", "s", steps=5000, pause=0.002)
    sweep = subprocess.Popen(words, cwd=toy.folder, env=environment(), start_new_session=True)
    toy.started.append(sweep)
    log = toy.folder / "s/0000/log.txt"
    wait_until(lambda: log.exists() and "steps 0 to" in log.read_text())
    if name == "SIGINT":
        os.killpg(sweep.pid, signal.SIGINT)  # what a terminal does
    else:
        os.kill(sweep.pid, signal.Signals[name])  # what others do
    assert sweep.wait(timeout=20) == 5
    assert toy.facts("s/0000")["status"] == "stopped" and toy.checkpoints("s/0000")[-1] > 0


def test_the_result_of_a_case_stands_beside_its_settings(tmp_path, capsys):
    app = import_module("lbmdem.__main__").load_app()
    path = str(ROOT / "configs/lbmdem/permeability.conf")
    row = {"run": "0000", "fluid.storage": '"single"', "status": "finished", "exit_code": 0, "steps": 9, "time": 1.0}
    row |= {f"scalar_{k}": 0.0 for k in range(12)} | {"permeability": 2e-9}
    _tell([row], tmp_path, results_of(app, path, ()))
    heading, values, _ = capsys.readouterr().out.splitlines()
    assert heading.split()[:4] == ["run", "fluid.storage", "permeability", "status"]
    assert values.split()[2] == "2e-09"
