import time

import numpy as np
import pytest

from hpcpic.core.comm.world import World
from hpcpic.core.run import guard
from hpcpic.core.run.guard import REACTION_SECONDS, ConservedSums, Guard
from hpcpic.core.run.signals import Reason


class Clocked:
    """A world of one rank on a clock of its own; a reduction takes `seconds`."""

    rank, size = 0, 1

    def __init__(self, seconds=0.0):
        self.seconds = seconds
        self.now = 0.0

    def max_array(self, values):
        self.now += self.seconds
        return values.copy()


def looks(monkeypatch, look_seconds, step_seconds, steps):
    """The steps at which the ranks would look."""
    world = Clocked(look_seconds)
    monkeypatch.setattr(guard.time, "perf_counter", lambda: world.now)
    watch = Guard(world, lambda: None, 0)
    looked = []
    for step in range(steps + 1):
        if watch.due(step):
            looked.append(step)
            watch.agree(step, Reason.NONE, False)
        world.now += step_seconds
    return looked


def test_looks_cost_a_thousandth_of_the_time(monkeypatch):
    looked = looks(monkeypatch, 4.9e-6, 1e-3, 1000)
    assert looked[:3] == [0, 1, 6] and len(looked) == pytest.approx(200, abs=3)  # every 4.9 us / 0.1 %
    assert len(looks(monkeypatch, 1e-7, 1e-3, 1000)) == 1001
    assert len(looks(monkeypatch, 1e-3, 1e-2, 400)) == pytest.approx(400 / 20, abs=3)  # not rarer than every 0.2 s


def test_a_divergence_is_seen_within_100_steps_or_as_soon_as_a_hundredth_of_the_time_allows(monkeypatch):
    looked = looks(monkeypatch, 0.4e-4, 1e-4, 2000)  # a thousandth would be every 400 steps
    assert np.diff(looked).max() == 50 and len(looked) == pytest.approx(40, abs=3)
    looked = looks(monkeypatch, 3e-4, 1e-4, 2000)
    assert np.diff(looked).max() == pytest.approx(300, abs=1)


def test_a_reason_is_heard_within_the_reaction_time_however_dear_the_look():
    watch = Guard(Clocked(), lambda: None, 0)
    watch._plan(10, step_ns=20_000_000, cost_ns=10**9)
    assert watch._next - 10 <= REACTION_SECONDS / 0.020
    watch._plan(20, step_ns=10**10, cost_ns=10**9)
    assert watch._next == 21


def test_the_first_step_which_compiles_does_not_set_the_pace():
    watch = Guard(Clocked(), lambda: None, 7)
    time.sleep(0.01)
    watch.agree(7, Reason.NONE, False)
    assert watch.due(8) and watch.step_seconds == 0.0


def check_all_agree(world):
    last = world.size - 1
    watch = Guard(world, lambda: f"cell {world.rank} is broken" if world.rank == last else None, 0)
    reason = Reason.SIGTERM if world.rank == last else Reason.NONE
    verdict = watch.agree(0, reason, world.rank == 0)
    assert (verdict.reason, verdict.checkpoint, verdict.rank) == (Reason.SIGTERM, True, last)
    assert verdict.diverged == f"cell {last} is broken"
    for step in range(1, 40):
        time.sleep(1e-4 * world.rank)
        mine = np.array([watch.due(step), -int(watch.due(step))], np.int64)
        assert world.max_array(mine).sum() == 0, "the ranks look at different steps"
        if watch.due(step):
            assert watch.agree(step, Reason.NONE, False).reason is Reason.NONE


def test_a_single_rank_agrees_with_itself():
    check_all_agree(World.start())


@pytest.mark.mpi(min_size=2)
def test_all_ranks_agree_on_the_worst_and_on_the_next_look():
    check_all_agree(World.start())


@pytest.mark.mpi(min_size=2)
def test_the_sentence_of_one_rank_is_whole_when_several_diverge():
    world = World.start()
    verdict = Guard(world, lambda: f"rank {world.rank} is broken", 0).agree(0, Reason.NONE, False)
    assert verdict.diverged == f"rank {verdict.rank} is broken"


@pytest.mark.parametrize(
    "change, told", [(0.0, False), (0.9e-12, False), (-1.1e-12, True), (np.inf, True), (np.nan, False)]
)
def test_a_conserved_sum_may_change_by_the_rounding_of_the_steps_between(change, told):
    """Here 1e-15 of 10 in each of 100 steps; no number is told by what finds it, not by a sum."""
    sums = ConservedSums(("p",), 1e-15)
    sums.see({"p": 3.0, "other": 0.0}, 10.0, 1)
    sums.see({"p": 3.0 + change, "other": 7.0}, 1.0, 100)
    assert bool(sums.trouble) == told


def test_what_is_exact_may_not_change_at_all():
    sums = ConservedSums(("mass",), 0.0)
    for step, mass in enumerate((0.1, 0.1, np.nextafter(0.1, 1.0))):
        assert not sums.trouble
        sums.see({"mass": mass}, 1.0, step)
    assert "mass jumped" in sums.trouble and "steps 1 and 2" in sums.trouble
