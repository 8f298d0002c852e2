import pytest

from hpcpic.core.errors import ConfigError
from hpcpic.core.run.triggers import Every, EverySeconds, EveryTime, Observer, parse_interval, parse_wall


def test_every_counts_from_step_0_and_0_is_never():
    assert [step for step in range(10) if Every(4).due(step)] == [0, 4, 8]
    assert not any(Every(0).due(step) for step in range(10))


def test_seconds_count_from_the_last_time(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    trigger = EverySeconds(10.0, last=100.0)
    assert not trigger.due()
    now[0] = 110.0
    assert trigger.due()
    trigger.done()
    assert not trigger.due()
    assert not EverySeconds(0.0, last=0.0).due()


def test_an_observer_sees_each_step_once_and_the_end_always():
    seen = []
    observer = Observer("o", Every(3), lambda: seen.append(step))
    for step in (0, 1, 3, 3, 5):
        observer.look(step)
    step = 5
    observer.look(5, at_end=True)
    observer.look(5, at_end=True)
    assert seen == [0, 3, 5]


def test_an_observer_that_is_never_due_does_not_see_the_end():
    assert not Observer("o", Every(0), lambda: None).look(5, at_end=True)


def test_intervals():
    assert parse_interval("500") == Every(500) == parse_interval("500 steps")
    assert [parse_interval(text).seconds for text in ("30s", "15m", "1.5h")] == [30.0, 900.0, 5400.0]
    for text in ("", "x", "3d", "-1", "1.5", "1e3"):
        with pytest.raises(ConfigError):
            parse_interval(text)


def test_wall_times():
    assert [parse_wall(text) for text in ("90", "1:30", "01:50:00", "0:00.5")] == [90.0, 90.0, 6600.0, 0.5]
    for text in ("", "1:2:3:4", "-5", "1:-5", "abc", "1e3"):
        with pytest.raises(ConfigError):
            parse_wall(text)


def test_every_time_takes_the_first_step_at_or_after_each_multiple():
    times = [0.0, 0.04, 0.09, 0.1, 0.14, 0.31, 0.35, 0.4]
    seen = []
    observer = Observer("o", EveryTime(0.1), lambda: seen.append(time))
    for step, time in enumerate(times):
        observer.look(step, time)
    assert seen == [0.0, 0.1, 0.31, 0.4]
    later = EveryTime(0.1, since=0.31)
    assert [time for time in times[6:] if later.due(0, time)] == [0.4]


def test_every_time_counts_multiples_that_rounding_puts_just_below():
    seen, time = [], 0.0
    observer = Observer("o", EveryTime(0.3), lambda: seen.append(step))
    for step in range(31):
        observer.look(step, time)
        time = 0.1 * (step + 1)
    assert seen == list(range(0, 31, 3))
