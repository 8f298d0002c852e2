"""Processes that compile together: whatever becomes of one of them, a run gives the same bits from the same files."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

COUNT = 4  # of kernels, beside the one that all call
KERNELS = "\n".join(
    ["from hpcpic.core.simd.compile import njit", "@njit\ndef shared(x):\n    return x * x + 1.5"]
    + [f"@njit\ndef one{k}(out):\n    for i in range(len(out)):\n        out[i] += shared(out[i] + {k}.0)"
       for k in range(COUNT)]
)  # fmt: skip
PROGRAM = f"""
import sys
import numpy as np
from hpcpic.core.simd.generate import module_from_source
from hpcpic.core.simd.team import team
from hpcpic.core.tasks.graph import Graph, Pool, bind
module = module_from_source({KERNELS!r}, "many")
team._cores = {{*range(2)}} if sys.argv[1] == "2" else team._cores
pool, out, graph = Pool(int(sys.argv[1])), np.arange(5.0), Graph()
for k in range({COUNT}):
    graph.task(bind(getattr(module, f"one{{k}}"), out=out), inouts=["out"])
print(*[helper.process.pid for helper in team._helpers], flush=True)
sys.stdin.readline()
pool.run(graph.freeze())
pool.close()
print(out.tobytes().hex(), flush=True)
"""


class Started:
    """The program above on so many threads: it says which helpers it has, and waits for a line before it runs."""

    def __init__(self, cache: Path, threads: int, **environment: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(threads)], text=True, stdin=-1, stdout=-1, stderr=-1,
            env=os.environ | {"HPCPIC_CACHE_DIR": str(cache)} | environment,
        )  # fmt: skip
        assert self.process.stdout is not None
        self.helpers = [int(pid) for pid in self.process.stdout.readline().split()]

    def end(self) -> str:
        out, err = self.process.communicate("\n", timeout=120)
        assert self.process.returncode == 0 and "Traceback" not in err, err
        return out


def kept(cache: Path) -> list[str]:
    return sorted(path.name for path in cache.rglob("*") if path.suffix in (".kernel", ".bin", ".tmp"))


def there(pid: int) -> bool:
    """Whether a process runs; one that has ended and that nobody has waited for counts."""
    return Path(f"/proc/{pid}").exists()


def gone(pid: int, seconds: float = 20.0) -> bool:
    until = time.monotonic() + seconds
    while there(pid) and time.monotonic() < until:
        time.sleep(0.02)
    return not there(pid)


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """What one process computes, and the names of the files that it keeps."""
    cache = tmp_path_factory.mktemp("alone")
    started = Started(cache, 1)
    assert not started.helpers
    return started.end(), kept(cache)


def test_a_helper_changes_neither_bits_nor_files_and_leaves_with_the_run(tmp_path, alone):
    started = Started(tmp_path, 2)
    (helper,) = started.helpers
    assert started.end() == alone[0] and gone(helper)
    of_two = Started(tmp_path, 2)
    assert not of_two.helpers and of_two.end() == alone[0]  # all is kept
    assert {*alone[1]} <= {*kept(tmp_path)} and not [name for name in kept(tmp_path) if name.endswith(".tmp")]


@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.validation), signal.SIGSTOP]
)
def test_a_run_goes_on_without_its_helper(tmp_path, alone, number):
    started = Started(tmp_path, 2)
    (helper,) = started.helpers
    os.kill(helper, number)
    try:
        assert started.end() == alone[0] and {*alone[1]} <= {*kept(tmp_path)}
        assert number == signal.SIGSTOP or not there(helper)
    finally:
        if there(helper):
            os.kill(helper, signal.SIGKILL)


def test_a_helper_ends_with_who_has_started_it_however_that_ends(tmp_path):
    started = Started(tmp_path, 2)
    (helper,) = started.helpers
    started.process.kill()
    started.process.communicate()
    assert gone(helper)


def test_two_runs_at_once_and_one_that_was_killed(tmp_path, alone):
    """The claims of who was killed are nobody's."""
    runs = [Started(tmp_path, 2) for _ in range(3)]
    runs[0].process.kill()
    runs[0].process.communicate()
    assert {run.end() for run in runs[1:]} == {alone[0]} and {*alone[1]} <= {*kept(tmp_path)}


# LLVM hands machine code to Python in a callback; what happens there is swallowed, as the interrupt of a closed pipe.
SWALLOWED = f"""
import os, sys, time
from numba import float64, types
from numba.core.codegen import CPUCodeLibrary
made, notified = [], CPUCodeLibrary._object_compiled_hook.__func__
def hook(cls, module, code):
    made.append(code)
    if len(made) == int(sys.argv[1]):
        os.close(told)
        time.sleep(1.0)
    notified(cls, module, code)
CPUCodeLibrary._object_compiled_hook = classmethod(hook)
from hpcpic.core.simd import team
from hpcpic.core.simd.generate import module_from_source
module = module_from_source({KERNELS!r}, "many")
types = (types.Array(float64, 1, "C"),)
team._compile = lambda texts, name: team.Job(getattr(module, name), types).done(0)
read, told = os.pipe()
for k in range({COUNT}):
    os.write(told, team.pickle.dumps(((), f"one{{k}}")))
os.dup2(read, 0)
made.clear()
team.serve({{0}})
"""


@pytest.mark.parametrize("number", [1, 2, pytest.param(3, marks=pytest.mark.validation), 4])
def test_a_helper_that_is_interrupted_keeps_no_kernel_without_its_parts(tmp_path, number):
    """Others would load the kernel and never make the part."""
    environment = os.environ | {"HPCPIC_CACHE_DIR": str(tmp_path)}
    subprocess.run([sys.executable, "-c", SWALLOWED, str(number)], env=environment, timeout=120, check=True)
    names = [name.partition("-")[0] for name in kept(tmp_path)]
    assert "shared" in names or not [name for name in names if name.startswith("one")]
    assert len(names) < COUNT + 1


def test_one_thread_after_two_has_no_helper(tmp_path):
    program = PROGRAM.replace("pool, out,", "Pool(2).close()\npool, out,")
    words = [sys.executable, "-c", program, "1"]
    environment = os.environ | {"HPCPIC_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(words, env=environment, input="\n", capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and done.stdout.startswith("\n"), done.stdout + done.stderr


def test_no_helper_where_nothing_can_be_kept(tmp_path, alone):
    file = tmp_path / "file"
    file.touch()
    started = Started(file / "cache", 2)
    assert not started.helpers and started.end() == alone[0]


def test_a_damaged_file_is_made_anew(tmp_path, alone):
    Started(tmp_path, 2).end()
    for path in tmp_path.rglob("*.kernel"):
        path.write_bytes(path.read_bytes()[:-7])
    assert Started(tmp_path, 2).end() == alone[0] == Started(tmp_path, 1).end()
