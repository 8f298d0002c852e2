"""--use: a file of the user is imported before the case is read, kept in the run folder, and used by a restart."""

import hashlib
import json
import os

import pytest
from app_runner import launch

from hpcpic.core.app.use import import_kept, use
from hpcpic.core.errors import ConfigError

LOADER = """
import numpy as np

from hpcpic.plasma.setup.loaders import Loader, register


class Middle(Loader):
    name = "middle"

    def positions(self, batch):
        return np.full((len(batch.ids), len(batch.lengths)), 0.5) * batch.lengths


register(Middle())
"""
CASE = """
simulation = { cycles = 4; time_step = 0.1; space_length = [8.0]; };
grid = { points = [8]; };
species = ( { name = "e"; particles = 64; charge = -1.0; mass = 1.0; init_method = "middle"; } );
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "own.py").write_text(LOADER)
    (tmp_path / "own.conf").write_text(CASE)
    return tmp_path


def hpcpic(folder, *words):
    return launch(1, "-m", "hpcpic", *words, cwd=folder)


DRAW = "import hpcpic; run = hpcpic.open_run('a'); run.plot('modes')"


def python(folder, program):
    (folder / "program.py").write_text(program)
    return launch(1, "program.py", cwd=folder)


def test_a_loader_from_a_file_runs_is_kept_and_goes_on_without_the_file(folder):
    assert "init_method" in hpcpic(folder, "check", "own.conf").stderr
    done = hpcpic(folder, "run", "own.conf", "-o", "a", "--use", "own.py", "--threads", "1")
    assert done.returncode == 0, done.stderr
    assert json.loads((folder / "a/run.json").read_text())["used"] == {
        "own.py": hashlib.sha256(LOADER.encode()).hexdigest()
    }
    (folder / "own.py").unlink()
    drawn = hpcpic(folder, "report", "a")
    assert drawn.returncode == 0, drawn.stderr
    drawn = python(folder, DRAW)
    assert drawn.returncode == 0, drawn.stderr
    more = hpcpic(folder, "restart", "a", "--set", "simulation.cycles=6", "--threads", "1")
    assert more.returncode == 0, more.stderr
    (folder / "a/given/own.py").write_text(LOADER + "\n")
    for words in (("restart", "a", "--set", "simulation.cycles=8"), ("report", "a")):
        refused = hpcpic(folder, *words)
        assert refused.returncode == 2 and "own.py: not the file that the run was started with" in refused.stderr
    refused = python(folder, DRAW)
    assert "ConfigError" in refused.stderr and "not the file that the run was started with" in refused.stderr


@pytest.mark.parametrize(
    "text, line, told",
    [("x = 1\n\nx = (\n", 3, "SyntaxError"), ("x = 1\n1 / 0\n", 2, "ZeroDivisionError"), ("exit()\n", 1, "SystemExit")],
)
def test_a_file_that_cannot_be_imported_is_told_with_its_line(folder, monkeypatch, text, line, told):
    (folder / "own.py").write_text(text)
    monkeypatch.chdir(folder)
    with pytest.raises(ConfigError, match=f"^own.py:{line}: {told}"):
        use("own.py")


POSITIONS = "return np.full((len(batch.ids), len(batch.lengths)), 0.5) * batch.lengths"
SCALAR = """
from hpcpic.plasma.diagnostics import scalars
from hpcpic.plasma.physics.moments import Moment

FACTOR = 2.0


def scaled(vx, vy, vz, square):
    return FACTOR * square


"""


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (LOADER.replace(POSITIONS, "return nothing"), "own.py:11: positions: NameError: name 'nothing' is not defined"),
        (LOADER.replace(POSITIONS, "pass"), "'middle': positions must return finite numbers [n, 1] for n = "),
        (LOADER.replace("), len(batch.lengths)), 0.5)", "),), 0.5)"), "finite numbers [n, 1]"),
        (LOADER.replace("0.5", "np.nan"), "(got some that are not finite)"),
        (LOADER.replace("Middle())", "Middle)"), "own.py:14: TypeError: register takes an object"),
        (
            LOADER + SCALAR + 'scalars.register(scalars.Scalar("mine", "J", lambda sample: sample.nothing))',
            "own.py:26: <lambda>: AttributeError: 'Sample' object has no attribute 'nothing'",
        ),
        (
            LOADER + SCALAR + 'scalars.register(scalars.Scalar("mine", "J", float, (Moment(scaled, 2),)))',
            "own.py:26: ValueError: scalar 'mine': own.py:22: scaled: is to be arithmetic of its arguments alone",
        ),
    ],
)
def test_a_mistake_in_a_class_or_function_of_the_user_is_told_without_a_traceback(folder, text, told):
    (folder / "own.py").write_text(text)
    done = hpcpic(folder, "run", "own.conf", "-o", "a", "--use", "own.py", "--threads", "1", "--quiet")
    assert done.returncode == 2 and told in done.stderr and "Traceback" not in done.stderr, done.stderr


def test_a_file_that_is_not_there_is_told():
    with pytest.raises(ConfigError, match=r"^--use other\.py: cannot read: No such file or directory$"):
        use("other.py")


def test_all_ranks_and_all_runs_of_a_sweep_use_the_file(folder):
    words = ("-m", "hpcpic", "run", "own.conf", "-o", "two", "--use", "own.py", "--threads", "1")
    done = launch(2, *words, cwd=folder)
    assert done.returncode == 0, done.stderr
    swept = hpcpic(folder, "sweep", "own.conf", "--use", "own.py", "--set", "simulation.time_step=0.1,0.2")
    assert swept.returncode == 0, swept.stdout + swept.stderr


def test_python_of_another_user_does_not_run_as_ours(tmp_path, monkeypatch):
    (tmp_path / "own.py").write_text("raise SystemExit")
    monkeypatch.setattr(os, "geteuid", lambda: (tmp_path / "own.py").stat().st_uid + 1)
    with pytest.raises(ConfigError, match="belongs to another user"):
        import_kept({"used": {"own.py": ""}}, tmp_path)
