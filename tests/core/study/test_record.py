"""The record of earlier searches: where the next one of a like scene begins, and that it decides nothing."""

import json
import logging
import math
from dataclasses import asdict, replace
from pathlib import Path

import error_app
import pytest

from hpcpic.core.app.read import read_case
from hpcpic.core.cli.main import build
from hpcpic.core.study import pilot, record
from hpcpic.core.study.record import Hint, Law, PastSearch, Record, words

B = 0.3  # of error_app: its error in dt is -B dt^2


@pytest.fixture
def case(tmp_path, monkeypatch):
    """read(settings) -> the case with them; its record lies in a cache of this test."""
    monkeypatch.setenv("HPCPIC_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(pilot, "USUAL_SECONDS", 0.0)  # these pilots cost nothing
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "case.conf"
    path.write_text("steps = 400;\ndt = 0.05;\n")

    def read(**settings):
        return read_case(error_app.APP, str(path), tuple(f"{key}={value}" for key, value in settings.items()))

    return read


def recorded(case, **settings):
    read = case(**settings)
    knobs = error_app.knobs(read.config)
    return Record("errors", read, knobs, knobs.quantities()[0])


def searched(folder, capfd, **settings):
    """(lines on pilots, what was said, the recommendation) of a search over dt at 1 %."""
    sets = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    asked = ["tradeoff", "case.conf", "-o", folder, "--knobs", "dt", "--tolerance", "1%", *sets]
    with pytest.raises(SystemExit) as end:
        build(lambda: error_app.APP, "errors", "known errors").main(asked)
    said = capfd.readouterr()
    assert not end.value.code, said.err
    lines = [line for line in said.out.splitlines() if line.startswith("  pilot ")]
    return lines, said.out, json.loads(Path(folder, "tradeoff.json").read_text())["recommended"]


def factors(lines, name):
    """Of the levels of one knob, in the order of their pilots."""
    return [float(line.split(f"{name} x ")[1].split(":")[0]) for line in lines if f"  {name} x " in line]


def test_a_search_begins_where_those_of_like_scenes_ended_and_measures_all_the_same(case, capfd):
    first, said, _ = searched("first", capfd)
    assert "record " not in said and factors(first, "dt")[0] == 2.0
    like, said, best = searched("like", capfd, dt=0.02, steps=1000)  # whose time step is far smaller
    assert "1 earlier search of like scenes" in said and f"({recorded(case).place})" in said
    assert factors(like, "dt")[0] > 3.0
    assert best["certified"] and B * best["sizes"]["dt"] ** 2 <= 0.01


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[:-3],  # cut
        lambda content: b"x" + content[1:],
        lambda content: b"",
    ],
)
def test_a_damaged_record_is_none_and_one_line_says_so(case, damage, caplog, monkeypatch):
    monkeypatch.setattr("hpcpic.core.simd.caches._warned", set())
    laws = {"dt": Law(0.01, 0.003, 2.0, True, 1.0)}
    kept = recorded(case, dt=0.01)
    kept.store.write(kept.name, line(laws))
    assert recorded(case).hints({"dt": 1.0}, 0.01)
    path = kept.store.folder.path / kept.name
    path.write_bytes(damage(path.read_bytes()))
    with caplog.at_level(logging.WARNING):
        assert recorded(case).hints({"dt": 1.0}, 0.01) == {}
        assert recorded(case).hints({"dt": 1.0}, 0.01) == {}
    assert [str(kept.store.folder.path) in told.message for told in caplog.records] == [True]


def line(laws, tolerance=0.01):
    found = PastSearch("other", tolerance, laws)
    return json.dumps(asdict(found)).encode() + b"\n"


@pytest.mark.parametrize(
    "wrong",
    [
        {"size": -1.0}, {"size": 0.0}, {"size": math.inf}, {"order": 0.0}, {"error": math.nan}, {"cost": "1"},
        {"size": True},
    ],
)  # fmt: skip
def test_what_cannot_be_found_by_a_search_is_no_record(case, wrong, monkeypatch):
    monkeypatch.setattr("hpcpic.core.simd.caches._warned", set())
    law = Law(0.01, 0.003, 2.0, True, 1.0)
    kept = recorded(case)
    kept.store.write(kept.name, line({"dt": replace(law, **wrong)}))
    assert recorded(case).hints({"dt": 1.0}, 0.01) == {}
    kept.store.write(kept.name, b"[1]\n")
    assert recorded(case).hints({"dt": 1.0}, 0.01) == {}
    kept.store.write(kept.name, line({"dt": law}, tolerance=0.0))
    assert recorded(case).hints({"dt": 1.0}, 0.01) == {}


def test_a_folder_that_others_can_write_in_holds_no_record(case, tmp_path):
    folder = recorded(case).store.folder.path
    folder.chmod(0o777)
    kept = recorded(case)
    assert kept.store.folder is None and kept.place == "" and kept.hints({"dt": 1.0}, 0.01) == {}


def test_a_kind_of_scene_is_what_it_contains_and_not_its_numbers(case):
    kind = set(words(case().config))
    assert kind == set(words(case(dt=0.01, dx=0.3).config))
    assert kind != set(words(case(noise=0.1).config)) and "exact=true" in set(words(case(exact="true").config))
    assert recorded(case).name == recorded(case, dt=0.01).name != recorded(case, noise=0.1).name


@pytest.mark.parametrize(
    ("factor", "steady", "noisy", "levels"),
    [
        (3.0, True, False, (3.0,)), (100.0, True, False, (4.0,)), (0.1, True, False, (0.5,)),
        (1.1, True, False, ()), (0.8, True, False, ()), (3.0, False, False, ()),
        (40.0, False, True, (10.0, 40.0)), (1e6, True, True, (16.0, 64.0)), (3.0, True, True, ()),
    ],
)  # fmt: skip
def test_first_levels_lie_where_the_recommendation_is_expected(factor, steady, noisy, levels):
    assert Hint(factor, steady).levels(noisy) == levels


def test_a_law_foretells_the_size_of_an_error_and_no_more_than_was_seen():
    law = Law(0.1, 0.01, 2.0, True, 1.0)
    assert law.foreseen(0.01) == pytest.approx(0.1) and law.foreseen(0.0025) == pytest.approx(0.05)
    assert law.foreseen(1.0) == pytest.approx(record.EXTRAPOLATION * 0.1)
    assert replace(law, error=0.0).foreseen(0.01) == pytest.approx(record.EXTRAPOLATION * 0.1)
