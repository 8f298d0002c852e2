import math
import shlex
import time
from pathlib import Path

import numpy as np
import pytest

from hpcpic.core.comm.world import World
from hpcpic.core.run import compiling, summary
from hpcpic.core.run.summary import KEPT, WARM_UP, Conserved, StepTimes
from hpcpic.core.timers import Timers


def times_of(values):
    times = StepTimes()
    for value in [1e9] * WARM_UP + list(values):
        times.add(value)
    return times


def test_mean_error_and_median_are_those_of_the_samples_after_the_warm_up():
    values = np.random.default_rng(1).exponential(size=1001)
    facts = times_of(values).facts()
    assert facts["n"] == 1001
    assert facts["mean"] == pytest.approx(values.mean(), rel=1e-12)
    assert facts["standard_error"] == pytest.approx(values.std(ddof=1) / math.sqrt(1001), rel=1e-9)
    assert facts["median"] == np.median(values)


def test_memory_is_bounded_and_the_median_still_right():
    n = 3 * KEPT
    times = times_of(np.arange(n, dtype=float))
    assert len(times._kept) <= KEPT
    assert times.facts()["median"] == pytest.approx(n / 2, rel=1e-3)  # an even selection of a ramp


def test_stop_rule_needs_thirty_steps_and_a_small_error():
    assert not times_of([1.0] * 29).known(0.1)
    assert times_of([1.0] * 30).known(0.1)
    assert not times_of([1.0] * 30).known(0.0)
    wide = [0.0, 2.0] * 50  # 1.96 SEM = 0.197 of the mean 1
    assert times_of(wide).known(0.2) and not times_of(wide).known(0.19)


def test_conserved_keeps_the_largest_change_and_does_not_lose_a_nan():
    conserved = Conserved()
    for value in (2.0, 2.5, 2.1):
        conserved.add({"energy_total": value, "momentum_x": value - 2.0, "other": value})
    facts = conserved.facts()
    assert set(facts) == {"energy_total", "momentum_x"}
    assert facts["energy_total"] == {"first": 2.0, "last": 2.1, "change": 0.5, "relative": 0.25}
    assert facts["momentum_x"]["change"] == 0.5 and "relative" not in facts["momentum_x"]
    some = Conserved(("mass", "momentum_x"))
    some.add({"energy_total": 1.0, "momentum_x": 0.0})
    assert set(some.facts()) == {"momentum_x"}
    conserved.add({"energy_total": math.nan})

    conserved.add({"energy_total": 2.0})
    assert conserved.facts()["energy_total"]["change"] == math.inf


def test_a_run_without_particles_tells_times_and_no_share_of_a_particle():
    """As one that waits for its inlet to open."""
    row = {"min": 1.0, "avg": 1.0, "max": 1.0, "share": 1.0, "calls": 3}
    for items, told in ((0, False), (10, True)):
        text = summary.render({**FACTS, "work_items": items, "work_unit": "particle", "timers": {"pairs": row}})
        assert ("per particle-step" in text) == told and "pairs" in text


def test_dissipation_is_told_as_what_it_is_and_a_gain_is_not():
    conserved = Conserved(("energy_total", "mass"), ("energy_total",))
    for value in (50.0, 40.0, 30.0):
        conserved.add({"energy_total": value, "mass": 2.0})
    told = summary.render({**FACTS, "conservation": conserved.facts()})
    assert "conserved   mass 0.0e+00\n" in told and "dissipated  energy_total 40.0% of that at the start\n" in told
    conserved.add({"energy_total": -40.0})
    told = summary.render({**FACTS, "conservation": conserved.facts()})
    assert "dissipated  energy_total 90 (absolute)\n" in told  # more than there was: no share of that
    conserved.add({"energy_total": 60.0})
    told = summary.render({**FACTS, "conservation": conserved.facts()})
    assert "dissipated" not in told and "energy_total 1.8e+00" in told


def test_compiling_is_a_section_of_its_own():
    """The time of the section around it is without that of the compiler, which a kernel calls for others too."""
    timers = Timers()
    with compiling.watched(timers) as watch:
        with timers.section("first call"):
            for depth in (1, 2):
                watch.on_start(None)
                assert watch.any and watch.depth == depth
            time.sleep(0.05)
            watch.on_end(None)
            watch.on_end(None)
        found = timers.totals()
        assert found["compiling"][0] >= 0.05 > found["first call"][0] and watch.seconds >= 0.05
        assert compiling.Compiling(timers).any is False


def test_the_speed_is_that_of_steps_without_the_compiler():
    timers = {"compiling": {"min": 0.0, "avg": 20.0, "max": 20.0, "share": 1 / 3, "calls": 9}}
    told = summary.render({**FACTS, "timers": timers, "loop_compiling_seconds": 20.0})
    assert "61.4 s on 4 ranks x 1 thread, 40 s of steps and output   1250 step/s" in told


def timers_of(world):
    timers = Timers()
    for name in ("a", "b"):
        with timers.section(name):
            time.sleep(0.01 * (1 + world.rank))
    return timers


def check_sections(world):
    timers = timers_of(world)
    wall = 10.0
    table = summary.sections(world, timers, wall)
    if world.rank:
        assert table == {}
        return
    assert list(table)[-1] == "other"
    assert sum(row["share"] for row in table.values()) == pytest.approx(1.0)
    for name in ("a", "b"):
        row = table[name]
        assert row["min"] <= row["avg"] <= row["max"] and row["calls"] == 1
        assert row["min"] == pytest.approx(timers.totals()[name][0])  # rank 0 sleeps least
        assert row["max"] >= 0.01 * world.size


def test_sections_add_up_to_the_wall_time():
    check_sections(World.start())


@pytest.mark.mpi(min_size=2)
def test_sections_are_over_all_ranks():
    check_sections(World.start())


@pytest.mark.mpi(min_size=2)
def test_load_is_of_the_fullest_and_the_emptiest_rank():
    world = World.start()
    assert summary.load(world, 10 * world.rank) == {"min": 0, "max": 10 * (world.size - 1)}
    assert summary.peak_memory_mib(world) > 10


FACTS = {
    "status": "finished",
    "reason": "",
    "steps": 50_000,
    "steps_done": 50_000,
    "time": 5e-3,
    "wall_seconds": 61.4,
    "loop_seconds": 60.0,
    "ranks": 4,
    "threads": 1,
    "work_items": 40_000,
    "work_unit": "particle",
    "timers": {"push": {"min": 1.0, "avg": 2.0, "max": 3.0, "share": 0.5, "calls": 50_000}},
    "load": {"min": 9_000, "max": 10_000},
    "peak_memory_mib_per_rank": 412.0,
    "step_ms": 1.2,
    "estimate": {"memory_mib_per_rank": 398.0},
    "conservation": {"energy_total": {"first": 1.0, "last": 1.0, "change": 2e-6, "relative": 2e-6}},
    "warnings": ["too coarse"],
    "folder": "runs/x",
}


def test_the_table_has_what_a_user_looks_for():
    text = summary.render(FACTS)
    for part in (
        "finished\n50 000 steps, t = 0.005 s, 61.4 s on 4 ranks x 1 thread",
        "33.3 Mp/s",
        "9 000 .. 10 000 per rank (10.0%)",
        "412 MiB per rank, peak (estimate 398)",
        "energy_total 2.0e-06",
        "warning 1   too coarse",
        "runs/x",
        "1 ns",  # 2 s over 50 000 x 40 000
        "100.0%",  # spread: (3 - 1) / 2
    ):
        assert part in text
    told = summary.render({**FACTS, "compiled_functions": 7})
    assert "412 MiB per rank, peak, with compiling 7 functions (estimate 398)" in told
    told = summary.render({**FACTS, "program": "sph", "folder": "a b"})
    assert told.endswith("sph plot 'a b'; sph report 'a b'")


@pytest.mark.parametrize("history", [5, None, "running", {"status": "running"}, [7, {"status": "running"}]])
def test_the_history_of_a_file_that_anybody_wrote(history):
    assert [part["status"] for part in summary.settled(history)] == ["killed"] * isinstance(history, list)


def test_a_path_is_one_word_of_the_shell_and_no_option():
    for path in ("/a/b", "-o", 'it\'s "x" $HOME `id` *', "a\nb"):
        (word,) = shlex.split(summary.shell_word(path))
        assert Path(word) == Path(path) and not word.startswith("-")
