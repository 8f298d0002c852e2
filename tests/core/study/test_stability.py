"""stability on a simulator whose limit is known: bracket, slow growth, exit codes, map."""

import json
import math
from types import SimpleNamespace

import pytest
from test_tradeoff import program, read_json  # noqa: F401  (program: a fixture)

from hpcpic.core.study import bisection
from hpcpic.core.study.bisection import RESOLUTION, Axis, Limit, Limits, bracketed
from hpcpic.core.study.stability import map_figure, strip


@pytest.mark.parametrize("limit", [0.4, 0.95, 1.0, 1.07, 2.5])
def test_the_bracket_closes_about_the_limit_from_any_start(limit):
    tried = []

    def probe(x):
        tried.append(x)
        return x, x > limit

    found = bracketed(probe, 1.0, 3.0)
    assert found.stable <= limit <= found.unstable <= found.stable * RESOLUTION
    assert len(tried) <= 12


def test_a_limit_out_of_reach_is_none():
    assert bracketed(lambda x: (x, False), 1.0, 3.0).unstable is None
    assert bracketed(lambda x: (x, True), 1.0, 3.0).stable is None


@pytest.mark.parametrize("most", [0.5, 1.3, 7.0, 60.0])
def test_a_bracket_ends_at_the_largest_size_of_the_scene(most):
    tried = []
    found = bracketed(lambda x: (tried.append(x) or x, False), 1.0, 64.0, most)
    assert (found.stable, found.unstable) == (most, None) and max(tried) == most
    assert bracketed(lambda x: (x, x > 0.4), 1.0, 64.0, most).x == pytest.approx(0.4, rel=0.01)


def test_sizes_that_cannot_be_met_exactly_end_the_search():
    """Steps are whole: between 0.9 and 1.1 there may be nothing."""
    found = bracketed(lambda x: (round(x, 1), round(x, 1) > 1.0), 1.0, 3.0)
    assert (found.stable, found.unstable) == (1.0, 1.1)


def test_the_strip_marks_the_case():
    place = [strip(x).splitlines()[1].index("^") for x in (0.01, 1.0, 100.0)]
    assert place == sorted(place) and place[1] - place[0] == place[2] - place[1]


def facts(folder, name="out"):
    return read_json(folder / name / "stability.json")


def test_a_sharp_limit_is_found_beside_the_theory(program, tmp_path):  # noqa: F811
    done = program("stability", "-o", "out", "--knob", "dt")
    assert done.returncode == 0, done.stderr
    found = facts(tmp_path)
    assert found["measured_over_theory"] == pytest.approx(1.0, abs=0.05)
    assert found["seeds"] == {"2": True, "3": True} and not found["slow"] and found["runs"] <= 16
    assert "measured/theory" in done.stdout
    assert "towards larger sizes, no other was run; beyond, growth: " in done.stdout
    rows = [line.split()[-1] for line in done.stdout.partition("tried")[2].splitlines()[2:]]
    assert [word for word in rows if word != "limit"] == sorted(word for word in rows if word != "limit")
    assert {"stable", "unstable"} < set(rows) and rows.count("limit") == 1  # theory's, in its place
    sizes, grown = zip(*found["tried"])
    assert max(size for size, g in found["tried"] if g is not None and g < 30) < found["limit"] < max(sizes)
    assert len(found["tried"]) + 5 == found["runs"] and min(grown[:1]) <= 30  # and four times as long, and two seeds


def answer_of(done, folder):
    """JSON of a command: one document, with the tables and no line of a pilot."""
    answer = json.loads(done.stdout)
    assert done.returncode == 0 and answer["tables"] and answer["text"]
    assert any(line.startswith("search ") and line.endswith(" by the clock") for line in answer["text"])
    assert list((folder / "out/pilots").iterdir())
    assert not any(line.startswith(("results", "step ", "look")) for line in answer["text"])
    return answer


def test_json_of_a_search_is_one_document(program, tmp_path):  # noqa: F811
    answer_of(program("tradeoff", "-o", "out", "--knobs", "dt", "--json"), tmp_path)


def test_slow_growth_is_told_by_the_longer_horizon(program, tmp_path):  # noqa: F811
    """exp(0.1 t): no blow-up in 20 s, one in 80 s. It has a table of rates."""
    answer = answer_of(program("stability", "-o", "out", "--knob", "dt", "--json", slow=0.05), tmp_path)
    assert facts(tmp_path)["slow"] and "slow growth, no limit; rate of growth:" in answer["text"]
    sizes, rates = zip(*facts(tmp_path)["rates"])
    assert rates[0] == pytest.approx(0.05 * 2 * sizes[0] / 0.5, rel=1e-3)


@pytest.mark.parametrize("late, shorter", [(79.0, "nothing grows"), (50.0, "stability ends at dt = 1.2")])
def test_what_diverges_later_than_in_the_first_runs_has_its_limit_too(program, tmp_path, late, shorter):  # noqa: F811
    """As water that starts at rest: nothing had grown until three times the limit, beside runs that had diverged; or
    as water that sloshes, which was told to be stable until then.
    """
    done = program("stability", "-o", "out", "--knob", "dt", late=late)
    assert done.returncode == 0, done.stderr
    found = facts(tmp_path)
    assert found["measured_over_theory"] == pytest.approx(1.0, abs=0.05) and found["late"]
    assert f"found by runs four times as long; in shorter ones {shorter}" in done.stdout
    assert "beyond, diverged" in done.stdout and not found["slow"]


def test_growth_of_a_size_that_cannot_be_met_is_told_once():
    """A grid of four points gets no coarser."""

    class Ended(Limits):
        def __init__(self):
            self.case_sizes, self.knobs = {"dx": 1.0}, SimpleNamespace(horizon=1.0)

        config = staticmethod(lambda sizes: sizes["dx"])
        run = staticmethod(lambda sizes, *_, **__: None)
        growth = staticmethod(lambda pilot: math.exp(8.0))

    knob = SimpleNamespace(name="dx", size=lambda dx: min(dx, 2.0), largest=math.inf)
    assert Ended().rates(Axis(knob, None, 1.0, 1.0)) == [(1.0, 2.0), (2.0, 2.0)]


def test_a_case_beyond_its_limit_and_a_limit_below_the_theory_are_exit_3(program):  # noqa: F811
    done = program("stability", "-o", "a", dt=0.6, steps=40)
    assert done.returncode == 3 and "the case itself is unstable" in done.stderr
    done = program("stability", "-o", "b", limit=0.4)
    assert done.returncode == 3 and "of the theory's" in done.stderr


def test_a_limit_beyond_the_theory_is_no_proof_against_it(program):  # noqa: F811
    """As of a cold plasma at wp dt = 2.4, whose waves warm it until they end: 1.29 times theory, without a word."""
    done = program("stability", "-o", "c", limit=0.7)
    assert done.returncode == 0 and "measured/theory = 1.4" in done.stdout
    assert "beyond the theory's limit of 0.5 s what grows ends before that in this scene; a calmer one" in done.stdout


def test_a_map_follows_the_limit_over_a_second_knob(program, tmp_path, monkeypatch):  # noqa: F811
    monkeypatch.setattr(bisection, "COLUMNS", (0.5, 1.0))
    done = program("stability", "--map", "dt,dx", "-o", "out", steps=40)
    assert done.returncode == 0, done.stderr
    columns = read_json(tmp_path / "out/map.json")["columns"]
    assert len(columns) == 2 and all(c["ratio"] == pytest.approx(1.0, abs=0.05) for c in columns)
    assert (tmp_path / "out/map.png").stat().st_size > 5000
    assert {column["found_by"] for column in columns} == {"the first runs"}
    none = program("stability", "--map", "dt,dx", "-o", "none", steps=40, limit=100)
    assert none.returncode == 3 and "no limit of dt was found" in none.stderr
    assert {column["measured"] for column in read_json(tmp_path / "none/map.json")["columns"]} == {None}
    assert "nothing grows 30 times" in program("stability", "-o", "none", "--knob", "dt", limit=100).stdout
    assert program("stability", "--map", "dt").returncode == 2
    assert program("stability", "--knob", "x").returncode == 2


def test_a_map_tells_the_limit_that_stability_tells(program, tmp_path, monkeypatch):  # noqa: F811
    """What diverges later than in the first runs: the map had a limit 1.2 times as far."""
    monkeypatch.setattr(bisection, "COLUMNS", (1.0,))
    done = program("stability", "--map", "dt,dx", "-o", "out", late=50.0)
    assert done.returncode == 0, done.stderr
    (column,) = read_json(tmp_path / "out/map.json")["columns"]
    assert column["ratio"] == pytest.approx(1.0, abs=0.05)
    assert column["found_by"] == "runs four times as long"


def test_a_map_of_what_has_no_theory_names_none(program, tmp_path, monkeypatch):  # noqa: F811
    """Its columns were headed as limits of theory, which were the case's own sizes."""
    monkeypatch.setattr(bisection, "COLUMNS", (1.0,))
    done = program("stability", "--map", "dx,dt", "-o", "out", steps=40)
    assert "the case's" in done.stdout and "theory" not in done.stdout
    assert read_json(tmp_path / "out/map.json")["columns"][0]["here"] == pytest.approx(0.1)


@pytest.mark.parametrize("power", [1.0, -2.0])
def test_a_map_draws_its_bands_by_the_sizes_not_by_what_a_case_says(power):
    """tau = 0.53 of a limit of 0.63 was drawn above 0.8 of it, as 0.53/0.63, and tau below 1/2 as stable."""
    tau = SimpleNamespace(name="tau", unit="", shown=lambda size: 0.5 + size)
    dx = SimpleNamespace(name="dx", unit="m", shown=lambda size: size)
    axis = Axis(tau, None, 0.03, power)
    columns = [(size, axis, Limit(axis.x(0.13), axis.x(0.13))) for size in (1.0, 2.0)]
    (figure,) = map_figure({"tau": 0.03, "dx": 1.0}, tau, dx, columns).axes
    bands = {area.get_label(): area.get_paths()[0].vertices[:, 1] for area in figure.collections}
    near = 0.5 + axis.size(0.8 * axis.x(0.13))
    low, high = 0.5 + 0.3 * 0.03, 0.5 + 3 * 0.13
    ends = {"stable": low, "unstable": high} if power > 0 else {"stable": high, "unstable": low}
    for label, edges in (("stable", (ends["stable"], near)), ("above 0.8 of the limit", (near, 0.63)),
                         ("unstable", (0.63, ends["unstable"]))):  # fmt: skip
        assert (bands[label].min(), bands[label].max()) == pytest.approx(sorted(edges)), label
    assert figure.get_ylim() == pytest.approx((low, high))
