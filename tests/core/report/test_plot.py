"""`plot`: files where asked, reasons for what is left out, exit codes of the contract."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
from importlib import import_module

import numpy as np
import pytest
from click.testing import CliRunner
from plasma_reference import make_run

from hpcpic.__main__ import load_app
from hpcpic.core.app.figures import NoData, movie
from hpcpic.core.cli.main import build
from hpcpic.core.files.reader import Run, open_run
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.report import follow
from hpcpic.plasma.analysis.plots import PLOTS
from hpcpic.plasma.app import shipped_cases

SETS = ("species[0].particles=512", "species[1].particles=512", "simulation.cycles=200")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_run(shipped_cases()["two-stream-cold"], tmp_path_factory.mktemp("runs") / "a", SETS)


def hpcpic(*words):
    return CliRunner().invoke(build(load_app, "hpcpic", "plasma"), [str(word) for word in words])


def test_all_figures_go_beside_the_run(folder):
    done = hpcpic("plot", folder)
    assert done.exit_code == 0, done.output
    written = sorted(path.name for path in (folder / "plots").iterdir())
    assert {"energies.png", "fields.png", "modes.png", "phase-space.png", "timers.png"} <= set(written)
    assert "left out spectrum: needs 16 snapshots" in done.output and "spectrum.png" not in written


def test_one_figure_as_svg_elsewhere(folder, tmp_path):
    done = hpcpic("plot", folder, "phase-space", "--format", "svg", "--step", 100, "-o", tmp_path / "new")
    assert done.exit_code == 0, done.output
    (path,) = (tmp_path / "new").iterdir()
    assert path.name == "phase-space.svg" and path.read_text().startswith("<svg")


def test_who_follows_a_run_sees_each_change_until_it_ends(folder, tmp_path, monkeypatch):
    for constant in ("POLL_S", "LEAST_PAUSE_S", "PAUSES"):
        monkeypatch.setattr(follow, constant, 0.01)
    shutil.copytree(folder, copy := tmp_path / "run")
    facts = json.loads((copy / "run.json").read_text())

    def write(status: str, **more: int) -> None:  # at once, as a run does: who follows must never read half a file
        (copy / "new.json").write_text(json.dumps(facts | {"status": status, **more}))
        (copy / "new.json").replace(copy / "run.json")

    write("running")
    held = RunDir(copy)
    held.lock()
    states = follow.states_of(copy, "hpcpic", follow=True)
    assert next(states).summary["status"] == "running"
    waiting = threading.Thread(target=lambda: seen.append(next(states).summary["status"]))
    seen: list[str] = []
    waiting.start()
    waiting.join(0.2)
    assert waiting.is_alive() and not seen, "nothing has changed"
    write("finished", steps=200)
    waiting.join(10)
    assert seen == ["finished"] and next(states, None) is None
    assert len(list(follow.states_of(copy, "hpcpic", follow=False))) == 1
    write("running")
    states = follow.states_of(copy, "hpcpic", follow=True)
    state = next(states)
    held.unlock()  # as the end of the process does, which writes nothing
    assert state.summary["status"] == "running", "told before its files are read: else the end would not be drawn"
    assert next(states).summary["status"] == "killed" and next(states, None) is None


def test_one_figure_goes_to_the_file_that_is_named(folder, tmp_path):
    for name in ("one.png", "two.svg"):
        done = hpcpic("plot", folder, "phase-space", "-o", tmp_path / "new" / name)
        assert done.exit_code == 0 and done.output.split() == [str(tmp_path / "new" / name)]
    assert (tmp_path / "new/one.png").read_bytes().startswith(b"\x89PNG") and "<svg" in (
        tmp_path / "new/two.svg"
    ).read_text()
    for words in (("all", "-o", tmp_path / "x.png"), ("phase-space", "--format", "svg", "-o", tmp_path / "x.png")):
        done = hpcpic("plot", folder, *words)
        assert done.exit_code == 2 and "x.png: " in done.output and not (tmp_path / "x.png").exists()
    (tmp_path / "maps.png").mkdir()
    assert hpcpic("plot", folder, "phase-space", "-o", tmp_path / "maps.png").exit_code == 0
    assert (tmp_path / "maps.png/phase-space.png").exists()


def test_plot_and_report_that_follow_end_with_the_run(folder, tmp_path):
    done = hpcpic("plot", folder, "modes", "--follow", "-o", tmp_path)
    assert done.exit_code == 0 and "finished, step 200, t = " in done.output, done.output
    bare = shutil.copytree(folder, tmp_path / "run", ignore=shutil.ignore_patterns("*.vtkhdf"))
    done = hpcpic("report", bare, "--follow", "-o", tmp_path / "page.html")
    assert done.exit_code == 0 and "finished, step 200" in done.output, done.output
    assert 'http-equiv="refresh"' not in (tmp_path / "page.html").read_text()


def test_unknown_names_are_usage_errors(folder):
    done = hpcpic("plot", folder, "phasespace")
    assert done.exit_code == 2
    assert "did you mean 'phase-space'" in done.output


def test_what_the_run_lacks_is_a_file_error(folder, tmp_path):
    assert hpcpic("plot", folder, "spectrum").exit_code == 6
    assert hpcpic("plot", folder, "phase-space", "--step", 3).exit_code == 6
    done = hpcpic("plot", tmp_path)
    assert done.exit_code == 6 and str(tmp_path) in done.output


def test_movie_has_a_frame_for_each_snapshot(folder, tmp_path):
    imageio = pytest.importorskip("imageio.v2", reason="movies are an extra")
    done = hpcpic("plot", folder, "phase-space", "--format", "mp4", "-o", tmp_path)
    assert done.exit_code == 0, done.output
    assert imageio.get_reader(tmp_path / "phase-space.mp4").count_frames() == 3


def test_a_movie_that_ends_early_leaves_nothing(folder, tmp_path):
    pytest.importorskip("imageio.v2", reason="movies are an extra")
    run = open_run(folder)

    def frames():
        yield PLOTS["phase-space"].make(run, 0)
        raise NoData("no more")

    with pytest.raises(NoData):
        movie(frames(), tmp_path / "a.mp4")
    assert list(tmp_path.iterdir()) == []


def test_help_loads_nothing_heavy():
    code = (
        "import sys\nfrom hpcpic.__main__ import load_app\nfrom hpcpic.core.cli.main import build\n"
        "sys.argv = ['hpcpic', 'plot', '--help']\n"
        "try:\n    build(load_app, 'hpcpic', '')()\nexcept SystemExit:\n    pass\n"
        "print(sorted({'matplotlib', 'h5py', 'scipy', 'numba', 'mpi4py'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30)
    assert done.stdout.rstrip().endswith("[]"), done.stdout + done.stderr


STARTED = {  # program, where its figures read the case, a case that starts from arrays, those arrays
    "hpcpic": ("hpcpic.plasma.analysis.predictions", """
        simulation = { cycles = 4; time_step = 0.1; space_length = [8.0]; }; grid = { points = [8]; };
        species = ({ name = "e"; charge = -1.0; mass = 1.0; start = { file = "given/start.npz"; }; });
        """, {"position": np.linspace(0.5, 7.5, 8)[:, None]}),
    "sph": ("sph.analysis.run_config", """
        simulation = { dimensions = 2; end_time = 1.0; }; numerics = { spacing = 0.1; };
        domain = { low = [0.0, 0.0]; high = [1.0, 1.0]; }; eos = { sound_speed = 10.0; };
        fluid = ({ name = "w"; start = { file = "given/start.npz"; }; });
        """, {"position": np.full((1, 2), 0.5)}),
    "lbmdem": ("lbmdem.analysis.grain_plots", """
        simulation = { end_time = 1.0; }; domain = { size = [4.0e-4, 4.0e-4]; spacing = 1.0e-4; periodic = ["x"]; };
        fluid = { kinematic_viscosity = 1.0e-6; relaxation_time = 1.0; start = { file = "given/start.npz"; }; };
        """, {"velocity": np.zeros((4, 4, 2))}),
}  # fmt: skip


@pytest.mark.parametrize("program", STARTED)
def test_figures_read_the_arrays_that_the_run_folder_keeps(program, tmp_path):
    module, text, arrays = STARTED[program]
    run = Run(RunDir(tmp_path))
    run.rundir.given.mkdir()
    np.savez(run.rundir.given / "start.npz", **arrays)
    run.rundir.config.write_text(text)
    config = import_module(module).config_of(run)
    started = config.fluid if program == "lbmdem" else (config.fluid if program == "sph" else config.species)[0]
    assert started.start.file == str(run.rundir.given / "start.npz")
