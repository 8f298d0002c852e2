import time

import pytest

from hpcpic.core.timers import Timers


def test_sections_nest_and_add_up():
    timers = Timers()
    for _ in range(3):
        with timers.section("outer"):
            time.sleep(0.002)
            with timers.section("inner"):
                time.sleep(0.004)
                with timers.section("innermost"):
                    time.sleep(0.002)
            with timers.section("inner"):
                pass
    totals = timers.totals()
    assert [totals[name][1] for name in ("innermost", "inner", "outer")] == [3, 6, 3]
    assert all(totals[name][0] >= least for name, least in (("innermost", 0.006), ("inner", 0.012), ("outer", 0.006)))
    assert sum(seconds for seconds, _ in totals.values()) <= timers.wall


def test_a_section_that_raises_is_counted():
    timers = Timers()
    with pytest.raises(KeyError), timers.section("bad"):
        raise KeyError
    assert timers.totals()["bad"][1] == 1


def test_a_section_may_contain_itself():
    timers = Timers()
    with timers.section("a"), timers.section("a"):
        pass
    assert timers.totals()["a"][1] == 2


def test_reset_forgets():
    timers = Timers()
    with timers.section("a"):
        time.sleep(0.05)
    timers.reset()
    assert timers.totals() == {}
    assert timers.wall < 0.05
