"""What compiled code keeps of a script is not changed behind its back: in a process, in kept files, at a restart."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

import hpcpic
import lbmdem
from hpcpic.core.case import accelerations
from hpcpic.core.simd import frozen
from lbmdem.physics import wall_rules

STIFFNESS = 4.0
TABLE = np.arange(10.0)


@numba.njit
def pull(x):
    return STIFFNESS * x


def spring(x, v, t):
    return -pull(x[0]) - max(TABLE[3], 0.0), np.pi * 0.0, 0.0


def made(stiffness):
    def spring_of(x, v, t):
        return -stiffness * x[0], 0.0, 0.0

    return spring_of


@pytest.fixture
def registered(monkeypatch):
    monkeypatch.setattr(accelerations, "ACCELERATIONS", {})
    monkeypatch.setattr(frozen, "_registered", {})
    accelerations.register("spring", spring)


def ball():
    return lbmdem.Case(
        description="a ball on a spring",
        simulation={"end_time": 0.02, "time_step": 1e-4},
        domain={"size": [1.0, 1.0]},
        grains=[{"name": "ball", "diameter": 0.1, "position": [0.7, 0.5], "acceleration": "spring"}],
    )


def test_what_a_function_reads_is_found_in_what_it_calls_too():
    read = frozen.values_of(spring)
    assert read["STIFFNESS"] == "4.0" and read["TABLE"].startswith("float64[10]"), read
    assert frozen.values_of(made(2.5)) == {"stiffness": "2.5"}
    assert frozen.values_of(wall_rules.cli) == {} and frozen.digest_of(wall_rules.cli) == b""


def test_a_value_that_is_changed_before_a_simulation_or_during_one_is_refused(registered, monkeypatch):
    with ball().simulation(threads=1) as sim:
        sim.step()
        TABLE[3] = 1.0
        try:
            with pytest.raises(hpcpic.ConfigError, match="'spring' was registered with TABLE"):
                sim.step()
        finally:
            TABLE[3] = 3.0
        sim.step()
    monkeypatch.setitem(globals(), "STIFFNESS", 5.0)
    with pytest.raises(hpcpic.ConfigError, match=r"STIFFNESS = 4\.0, and it is 5.0 now"):
        ball().simulation(threads=1)
    accelerations.register("spring of 4", made(4.0))  # what the message advises
    accelerations.register("spring of 5", made(5.0))


def test_a_run_does_not_go_on_with_other_values(registered):
    before = frozen.kept()
    assert before["acceleration 'spring'"]["STIFFNESS"] == "4.0"
    frozen.require_same(before)
    with pytest.raises(hpcpic.ConfigError, match=r"STIFFNESS = 3\.0, and it is 4.0 now"):
        frozen.require_same({"acceleration 'spring'": before["acceleration 'spring'"] | {"STIFFNESS": "3.0"}})


RULE = """
import os, sys
import lbmdem
from lbmdem.physics.wall_rules import register

weight = float(os.environ["WEIGHT"])

def mine(q, gi_x, gi_y, gj_x, push):
    return (weight * q * gi_x + (1.0 - weight * q) * gi_y - push + q * gj_x) / (1.0 + q)

register("mine", mine)

if __name__ == "__main__":
    case = lbmdem.Case("couette").changed({"coupling.bounce_back": "mine", "simulation.end_time": 0.05})
    print(case.run("run", threads=1, quiet=True, replace=True).digest)
"""


@pytest.mark.validation
def test_kept_kernels_and_restarts_know_a_number_that_stands_in_no_file(tmp_path: Path):
    """One text of a rule makes two, by the environment: the second would have run with the kernels of the first."""
    (tmp_path / "rule.py").write_text(RULE)

    def run(weight: str, *words: str) -> subprocess.CompletedProcess[str]:
        environment = os.environ | {"WEIGHT": weight}
        return subprocess.run([sys.executable, *words], cwd=tmp_path, env=environment, text=True, capture_output=True)

    first, other, again = (run(weight, "rule.py").stdout for weight in ("1.0", "0.8", "1.0"))
    assert first == again and other != first and first
    refused = run("0.8", "-m", "lbmdem", "restart", "run", "--until", "0.06")
    assert refused.returncode == 2 and "'mine' was registered with weight = 1.0, and it is 0.8" in refused.stderr
    assert run("1.0", "-m", "lbmdem", "restart", "run", "--until", "0.06").returncode == 0


@pytest.mark.parametrize("one, other", [(1.0, 3.0), (2.0, 1.0), (1.0, 1.0), (2.0, 2.0)])
def test_values_of_one_name_in_two_functions_all_count(one, other):
    def constant(k):
        return lambda q, per_h: k * q * per_h

    before = frozen.digest_of(constant(1.0), constant(2.0))
    assert frozen.digest_of(constant(one), constant(other)) != before
    assert frozen.digest_of(constant(1.0), constant(2.0)) == before
