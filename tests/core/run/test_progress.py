import io

import pytest

from hpcpic.core.run import progress
from hpcpic.core.run.progress import Progress, clock, plain, rate


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def now(monkeypatch):
    value = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: value[0])
    return value


def lines_of(stream, now, step_seconds, steps, show=True):
    shown = Progress(stream, 0, steps, 1000, "p")
    for step in range(1, steps + 1):
        now[0] += step_seconds
        if shown.due(step):
            shown.show(step, step * 0.1, 0.1, steps * 0.1)
    return shown.lines


@pytest.mark.parametrize("total, low, high", [(1.0, 0, 0), (30.0, 10, 15), (3600.0, 18, 21)])
def test_at_most_about_twenty_lines_where_there_is_no_terminal(now, total, low, high):
    assert low <= lines_of(io.StringIO(), now, total / 1000, 1000) <= high


def test_a_long_run_says_something_every_ten_minutes(now):
    assert lines_of(io.StringIO(), now, 36.0, 24000) >= 24000 * 36 / 660


def test_a_terminal_has_one_rewritten_line(now):
    stream = Terminal()
    assert lines_of(stream, now, 0.1, 100) >= 30
    assert "\n" not in stream.getvalue() and stream.getvalue().startswith("\r")


def test_a_rewritten_line_fits_the_terminal(now, monkeypatch):
    monkeypatch.setenv("COLUMNS", "50")
    stream = Terminal()
    assert lines_of(stream, now, 0.1, 100) > 0
    lines = stream.getvalue().split("\r")[1:]
    assert 40 < max(map(len, lines)) <= 49 and all(" left " in line for line in lines)


@pytest.mark.parametrize("width", range(4, 130, 7))
def test_a_narrow_terminal_gets_fewer_items_and_never_a_part_of_a_number(now, monkeypatch, width):
    monkeypatch.setenv("COLUMNS", str(width))
    stream, whole = Terminal(), io.StringIO()
    for screen in (stream, whole):
        shown = Progress(screen, 0, 200, 1_000_000, "p")
        for energy in (1.0, 1.0 + 1.4e-8):
            shown.scalars({"energy_total": energy})
        now[0] += 10.0
        shown.show(50, 5.0, 0.1, 20.0)
    items = whole.getvalue().strip().split("  ")
    found = [item for item in stream.getvalue().strip().split("  ") if item]
    assert len(items) == 8 and "dE/E 1.4e-08" in items
    assert [item for item in items if item in found] == found and len(stream.getvalue().rstrip()) <= width
    assert (len(found) == 8) == (len(whole.getvalue().strip()) < width)


def test_the_line_says_how_far_how_fast_and_how_long(now):
    stream = io.StringIO()
    shown = Progress(stream, 0, 200, 1_000_000, "p")
    shown.scalars({"energy_total": 4.0})
    shown.scalars({"energy_total": 5.0})
    now[0] = 10.0
    shown.show(50, 5.0, 0.1, 20.0)
    line = stream.getvalue()
    for part in (
        "step 50/200",
        "t 5.000e+00/2.000e+01 s",
        "25.0 %",
        "5 step/s",
        "5 Mp/s",
        "dE/E 2.5e-01",
        "left 00:00:30",
    ):
        assert part in line


def test_the_time_left_does_not_count_the_steps_before_a_restart(now):
    stream = io.StringIO()
    shown = Progress(stream, 1000, 1100, 1, "p")
    now[0] = 10.0
    shown.show(1050, 0.0, 0.0, 0.0)
    assert "left 00:00:10" in stream.getvalue()


def test_the_time_left_does_not_count_the_first_step_which_compiles(now):
    stream = io.StringIO()
    shown = Progress(stream, 0, 100, 1, "p")
    for now[0], step in ((30.0, 1), (31.0, 11)):
        shown.due(step)
        shown.show(step, 0.0, 0.0, 0.0)
    first, second = stream.getvalue().splitlines()
    assert "left --:--:--" in first and "left 00:00:09" in second


def test_clock_and_rate():
    assert [clock(s) for s in (0, 59.6, 3661, 100 * 3600)] == [
        "00:00:00",
        "00:01:00",
        "01:01:01",
        "100:00:00",
    ]
    assert [rate(n, "p") for n in (1.0, 2.5e3, 3.25e7)] == ["1 p/s", "2.5 kp/s", "32.5 Mp/s"]
    assert [rate(n, "p") for n in (999.4, 999.9, 999.6e3)] == ["999 p/s", "1 kp/s", "1 Mp/s"]
    assert [plain(n) for n in (0.0, 0.54321, 999.4, 999.6, 12345.6)] == ["0", "0.543", "999", "1000", "12346"]


def test_where_the_number_of_steps_is_not_known_time_tells_how_far_it_is(now):
    stream = io.StringIO()
    shown = Progress(stream, 100, None, 1, "p", times=(1.0, 3.0))
    now[0] = 10.0
    shown.show(150, 1.5, 0.01, 3.0)
    line = stream.getvalue()
    for part in ("step 150  ", "50.0 %", "left 00:00:30", "5 step/s"):
        assert part in line
    assert not shown.due(160, 1.55)
    now[0] = 20.0
    assert shown.due(160, 1.75)
