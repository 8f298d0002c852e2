"""Programs of a user: what a run keeps of them, and the examples."""

import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from app_runner import launch
from seldom import seldom

EXAMPLES = Path(__file__).parents[3] / "examples"
TYPED = """
from hpcpic.core.case.accelerations import register
def push(x, v, t):
    return 0.1, 0.0, 0.0
register("push", push)
"""


@pytest.mark.parametrize("place", ["prompt", seldom("module"), seldom("script")])
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
    again = launch(1, "-m", "hpcpic", "restart", str(tmp_path / "run"), "--set", "simulation.cycles=4")
    assert again.returncode == (0 if place == "module" else 2), again.stderr


# What a run of an example takes less of in the default tests: the text of the script, and what stands there instead.
SMALLER = {
    "two_grains": ('"end_time": 1.5', '"end_time": 0.2'),
    "coarse_to_fine": ("COARSE, FINE = 32, 96", "COARSE, FINE = 12, 36"),
}
OTHERS = ("coarse_to_fine", "own_force", "own_loader", "own_scalar", "two_grains")  # in validation
NAMES = sorted(path.stem for path in EXAMPLES.glob("*.py"))


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """ran(name, ranks) -> what an example has printed on so many ranks, and the folder of its run; made once."""

    @cache
    def run(name, ranks=1, whole=True):
        folder = tmp_path_factory.mktemp(name)
        script, text = EXAMPLES / f"{name}.py", (EXAMPLES / f"{name}.py").read_text()
        if not whole and name in SMALLER:
            assert SMALLER[name][0] in text
            script = folder / script.name
            script.write_text(text.replace(*SMALLER[name]))
        arguments = [str(folder / "run")] if "[FOLDER]" in text else []
        done = launch(ranks, "-m", "mpi4py", str(script), *arguments, cwd=folder)
        assert done.returncode == 0, done.stderr
        return done.stdout, folder / "run"

    return run


def digests(ran, name, ranks, whole=True):
    """Lines that are digests, once each: ranks that print at the same time mix their lines."""
    output, _ = ran(name, ranks, whole)
    return [line for line in output.splitlines() if len(line) == 64 and " " not in line]


@pytest.mark.timeout(600)  # it compiles
def test_a_script_that_registers_a_kernel_makes_a_run_that_restarts(ran):
    _, run = ran("own_kernel")
    done = launch(1, "-m", "sph", "restart", str(run), "--until", "0.03")
    assert done.returncode == 0, done.stderr
    script = f"import sph; print(sph.open_run({str(run)!r}).restart(until=0.04, quiet=True).status)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout == "finished\n", done.stderr
    assert (run / "given/own_kernel.py").read_text() == (EXAMPLES / "own_kernel.py").read_text()


def test_the_beam_of_the_example_grows_as_theory_says(ran):
    output, _ = ran("beam_in_a_plasma")
    growth, theory = (float(part.split()[1]) for part in output.splitlines()[0].split(", "))
    assert growth == pytest.approx(theory, rel=0.01)  # of the step, the mesh and the slower waves


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.validation] * (name in OTHERS)) for name in NAMES]
)
def test_examples_run(ran, name):
    """Where that takes long, for a shorter time or on a coarser mesh."""
    found = digests(ran, name, 1, whole=name not in SMALLER)
    assert name == "read_a_run" or found


@pytest.mark.validation
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", NAMES)
def test_examples_give_the_same_on_one_rank_and_on_two(ran, name):
    assert digests(ran, name, 1) == digests(ran, name, 2)
