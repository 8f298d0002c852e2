"""Ranks of a Python program: they make the same calls of the same cases, and none waits in silence."""

import pytest
from app_runner import launch
from seldom import seldom

import hpcpic


@pytest.mark.parametrize("ranks", [0, -2, 1.5, "2"])
def test_ranks_are_a_whole_number_from_one_on(ranks):
    case = hpcpic.Case("plasma-oscillation")
    for take in (case.check, case.estimate):
        with pytest.raises(hpcpic.ConfigError, match="ranks: a whole number, 1 or more"):
            take(ranks=ranks)


@pytest.mark.parametrize(
    ("call", "status", "told"),
    [
        ("sim.rank or sim.particles()", 1, "in one order: rank 0 calls particles(), rank 1 calls close()"),
        ("sim.fields('rho' if sim.rank else 'phi')", 1, "rank 0 calls fields('phi'), rank 1 calls fields('rho')"),
        ("sim.rank and time.sleep(1.5); sim.digest()", 0, "rank 0 of 2: digest() has waited for"),
    ],
)
def test_ranks_that_do_not_make_the_same_call_are_told_and_none_waits_in_silence(tmp_path, call, status, told):
    (tmp_path / "parts.py").write_text(f"""import time, hpcpic
from hpcpic.core.comm import meeting
meeting.TELL_SECONDS = 0.5
with hpcpic.Case("plasma-oscillation").simulation(threads=1) as sim:
    {call}
""")
    done = launch(2, "-m", "mpi4py", str(tmp_path / "parts.py"))
    assert (done.returncode != 0) == bool(status) and told in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("species", "time_step", "told"),
    [
        ('"start": {"velocity": rng.normal(0, 0.1, (64, 1))}', "0.1", "species[0].start: content"),
        seldom(
            '"start": {"velocity": np.zeros((64 + rank, 1))}', "0.1", "species[0].particles: 64 on rank 0, 65 on rank 1"
        ),
        seldom('"particles": 64', "0.1 + 0.1 * rank", "simulation.time_step: 0.1 on rank 0, 0.2 on rank 1"),
    ],
)
def test_ranks_that_do_not_make_the_same_case_are_told_the_key_on_all_ranks(tmp_path, species, time_step, told):
    (tmp_path / "parts.py").write_text(f"""import hpcpic, numpy as np, sys
from mpi4py import MPI
rank = MPI.COMM_WORLD.rank
rng = np.random.default_rng(rank)
e = {{"name": "e", "charge": -1.0, "mass": 1.0, {species}}}
case = hpcpic.Case(simulation={{"cycles": 1, "time_step": {time_step}, "space_length": [6.0]}},
    grid={{"points": [16]}}, species=[e])
for make in (case.simulation, lambda threads: case.run({str(tmp_path / "run")!r}, threads=threads)):
    try:
        make(threads=1)
    except hpcpic.ConfigError as error:
        sys.stdout.write(f"{{rank}} {{error.message}}\\n")
""")
    done = launch(2, "-m", "mpi4py", str(tmp_path / "parts.py"))
    assert done.returncode == 0 and done.stdout.count(told) == 4, done.stdout + done.stderr
    assert not (tmp_path / "run").exists()
