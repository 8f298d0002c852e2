"""Programs of a user: what a run keeps of them, and the examples."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[3] / "examples"
TYPED = """
from hpcpic.core.case.accelerations import register
def push(x, v, t):
    return 0.1, 0.0, 0.0
register("push", push)
"""


@pytest.mark.parametrize("place", ["prompt", "module", "script"])
def test_what_a_run_cannot_keep_of_a_program_is_told(tmp_path, place):
    """A function that stands in no file; that of a module which the program imports is kept."""
    run = f"""
import hpcpic
case = hpcpic.Case("plasma-oscillation").changed({{"simulation.cycles": 2, "species[0].acceleration": "push"}})
run = case.run({str(tmp_path / "run")!r}, threads=1, quiet=True)
assert list(run.summary["used"]) == {["mine.py"] if place == "module" else []}
"""
    (tmp_path / "mine.py").write_text(TYPED if place == "module" else TYPED + run)
    words = {"prompt": ["-c", TYPED + run], "module": ["-c", "import mine" + run], "script": ["mine.py"]}[place]
    done = subprocess.run([sys.executable, *words], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    told = {"prompt": "push: stands in a notebook or at the prompt", "script": "no restart can import it", "module": ""}
    assert told[place] in done.stderr and ("restart" in done.stderr) == (place != "module")
    again = subprocess.run(
        [sys.executable, "-m", "hpcpic", "restart", str(tmp_path / "run"), "--set", "simulation.cycles=4"],
        capture_output=True, text=True,
    )  # fmt: skip
    assert again.returncode == (0 if place == "module" else 2), again.stderr


def test_a_script_that_registers_a_kernel_makes_a_run_that_restarts(tmp_path):
    run = [sys.executable, str(EXAMPLES / "own_kernel.py"), str(tmp_path / "run")]
    done = subprocess.run(run, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    words = [sys.executable, "-m", "sph", "restart", str(tmp_path / "run"), "--until", "0.03"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    script = f"import sph; print(sph.open_run({str(tmp_path / 'run')!r}).restart(until=0.04, quiet=True).status)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout == "finished\n", done.stderr
    assert (tmp_path / "run/given/own_kernel.py").read_text() == (EXAMPLES / "own_kernel.py").read_text()


def test_the_beam_of_the_example_grows_as_theory_says(tmp_path):
    words = [sys.executable, str(EXAMPLES / "beam_in_a_plasma.py")]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    growth, theory = (float(part.split()[1]) for part in done.stdout.splitlines()[0].split(", "))
    assert growth == pytest.approx(theory, rel=0.01)  # of the step, the mesh and the slower waves


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", sorted(path.stem for path in EXAMPLES.glob("*.py")))
def test_examples_run_on_one_rank_and_on_two(name, tmp_path):
    """The same digests on two ranks as on one, once each: ranks that print at the same time mix their lines."""
    told = []
    for ranks in (1, 2):
        folder = tmp_path / str(ranks)
        launcher = [] if ranks == 1 else [str(Path(sys.executable).with_name("mpirun")), "-n", "2"]
        arguments = [str(folder)] if "[FOLDER]" in (EXAMPLES / f"{name}.py").read_text() else []
        words = [*launcher, sys.executable, "-m", "mpi4py", str(EXAMPLES / f"{name}.py"), *arguments]
        done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        told.append([line for line in done.stdout.splitlines() if len(line) == 64 and " " not in line])
    assert told[0] == told[1]
