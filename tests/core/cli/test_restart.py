"""restart: run(2N) is run(N) + restart + run(N); only what does not belong to the state may change."""

import csv
import json
import shutil
from types import SimpleNamespace

import pytest
from seldom import seldom
from toy_runner import RUN_A, Toy

from hpcpic.core.errors import FileError
from hpcpic.core.run.checkpoint import require_same_case


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """100 steps on two ranks."""
    toy = Toy(tmp_path_factory.mktemp("half"))
    done = toy(*RUN_A, ranks=2, steps=100)
    assert done.returncode == 0, done.stderr
    return toy.folder / "a"


@pytest.fixture
def half(toy, made):
    shutil.copytree(made, toy.folder / "a")
    return toy


@pytest.mark.parametrize("ranks, words", [seldom(1, ("--until", "0.1953125")), (3, ("--set", "steps=200"))])
def test_a_finished_run_goes_on_to_the_same_state(half, ranks, words):
    done = half("restart", "a", "--threads", "1", *words, ranks=ranks)
    assert done.returncode == 0, done.stderr
    facts = half.facts("a")
    assert facts["steps"] == 200 and facts["state_digest"] == half.digest(steps=200)
    assert [(part["first_step"], part["steps"], part["ranks"]) for part in facts["history"]] == [
        (0, 100, 2),
        (100, 200, ranks),
    ]
    assert "steps = 200" in (half.folder / "a/config.conf").read_text()
    rows = list(csv.reader((half.folder / "a/series.csv").open()))
    assert [int(row[0]) for row in rows[1:]] == list(range(201))


@pytest.mark.parametrize("ranks, words", [(2, ()), (1, ("--set", "output.field=10"))])
def test_a_finished_run_that_is_not_to_end_later_stays_as_it_is(half, ranks, words):
    """Its timers above all: a part of no step has none."""

    def content():
        files = {path for path in (half.folder / "a").rglob("*") if path.is_file()}
        return {path: path.read_bytes() for path in files}

    before = content()
    done = half("restart", "a", "--quiet", *words, ranks=ranks)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("nothing to do: the run has finished, at step 100, t = 0.0976562 s; --until T")
    assert done.stdout.count("\n") == 1
    assert content() == before


def test_an_end_before_the_checkpoint_is_refused_and_changes_nothing(half):
    before, config = half.facts("a"), (half.folder / "a/config.conf").read_text()
    done = half("restart", "a", "--until", "0.01", ranks=2)
    assert done.returncode == 2 and done.stderr.count("the checkpoint is of step 100") == 1
    for wrong in ("nan", "-1"):
        done = half("restart", "a", "--until", wrong)
        assert done.returncode == 2 and "must be a time in s after the start" in done.stderr
    assert half.facts("a") == before and (half.folder / "a/config.conf").read_text() == config


def test_the_state_cannot_be_changed(half):
    done = half("restart", "a", rows=60)
    assert done.returncode == 2 and "cannot change rows" in done.stderr
    assert half.facts("a")["status"] == "finished"


def test_a_checkpoint_of_other_settings_is_refused_with_what_differs(half):
    config = half.folder / "a/config.conf"
    config.write_text(config.read_text().replace("courant = 0.25", "courant = 0.5").replace("rows = 50", "rows = 51"))
    before = half.facts("a")
    done = half("restart", "a", "--until", "1", ranks=2)
    assert done.returncode == 2 and done.stderr.count("other settings") == 1
    assert "  courant: 0.25 then, 0.5 now\n" in done.stderr and "  rows: 50 then, 51 now\n" in done.stderr
    assert half.facts("a") == before and "Traceback" not in done.stderr


def test_what_does_not_belong_to_the_state_may_be_edited(half):
    config = half.folder / "a/config.conf"
    config.write_text(config.read_text().replace("steps = 100", "steps = 200").replace("series = 1;", "series = 50;"))
    assert half("restart", "a").returncode == 0
    assert half.facts("a")["state_digest"] == half.digest(steps=200)


def test_a_checkpoint_of_another_program_is_refused():
    reader = SimpleNamespace(path="a.h5", attributes={"program": "toy", "settings": {}})
    with pytest.raises(FileError, match="a checkpoint of toy, not of other"):
        require_same_case(reader, "other", {})


def test_a_run_of_another_program_is_told_by_name(half):
    facts = half.facts("a")
    (half.folder / "a/run.json").write_text(json.dumps(facts | {"program": "other"}))
    for verb in ("restart", "plot", "report"):
        done = half(verb, "a")
        assert done.returncode == 6 and "a run of other, not of toy: say `other`" in done.stderr
    (half.folder / "a/run.json").write_text(json.dumps(facts))


def test_more_ranks_than_rows_are_refused(half):
    text = (half.folder / "a/config.conf").read_text()
    (half.folder / "a/config.conf").write_text(text.replace("rows = 50", "rows = 2"))
    assert half("restart", "a", ranks=3).returncode == 2


def test_a_forced_run_goes_on(toy):
    assert toy("run", "ring.conf", "-o", "a", "--force", courant=-0.1, steps=5).returncode == 0
    assert toy("restart", "a", steps=8).returncode == 0
    assert toy.facts("a")["steps"] == 8 and toy.facts("a")["warnings"]


def test_a_damaged_checkpoint_is_passed_over(toy):
    toy(*RUN_A, "--checkpoint-every", "50", steps=100)
    newest = toy.folder / "a/checkpoints/00000100.h5"
    content = bytearray(newest.read_bytes())
    content[len(content) // 2] ^= 1
    newest.write_bytes(content)
    done = toy("restart", "a", "--until", "0.1953125", ranks=2)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("00000100.h5: damaged") == 1
    assert toy.facts("a")["history"][-1]["first_step"] == 50
    assert toy.facts("a")["state_digest"] == toy.digest(steps=200)


def test_no_usable_checkpoint_is_exit_6_told_once(half):
    for path in (half.folder / "a/checkpoints").iterdir():
        path.write_bytes(path.read_bytes()[:-10])
    done = half("restart", "a", "--until", "1", ranks=2)
    assert done.returncode == 6
    assert done.stderr.count("no checkpoint can be used") == 1
    assert "Traceback" not in done.stderr and "Abort" not in done.stderr


def test_what_is_no_run_folder_is_exit_6(toy):
    done = toy("restart", "nowhere")
    assert done.returncode == 6 and "nowhere" in done.stderr
