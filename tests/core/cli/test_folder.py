"""What befalls the folder of a run: told, without a traceback, and the state is kept."""

import ctypes
import json
import os
import shutil
import subprocess

import pytest
from seldom import seldom
from toy_runner import RUN_A, environment, wait_until

from hpcpic.core.files.reader import open_run

SLOW = {"steps": 300, "pause": 0.005}


def ended(process, code):
    output, errors = process.communicate(timeout=20)
    assert process.returncode == code and "Traceback" not in errors, errors
    return output, errors


def exchange(one, other):
    """Each takes the other's name, in one step: a run that goes on would make again what was moved away, before a
    second command could put something in its place.
    """
    here, both_ways = -100, 2  # AT_FDCWD, RENAME_EXCHANGE
    done = ctypes.CDLL(None, use_errno=True).renameat2(here, bytes(one), here, bytes(other), both_ways)
    assert done == 0, os.strerror(ctypes.get_errno())


def check_goes_on(toy, name="a"):
    done = toy("restart", name, "--threads", "1", pause=0.0)
    assert done.returncode == 0, done.stderr
    assert toy.facts(name)["state_digest"] == toy.digest(steps=300)


def test_a_file_system_that_stands_still_ends_no_run(toy):
    """Longer than the patience of ranks with each other: who writes alone is waited for."""
    fault = {"fault__kind": '"stall"', "steps": 300, "pause": 0.005}
    done = toy(*RUN_A, "--patience", "2", ranks=2, **fault)
    assert done.returncode == 0, done.stderr
    assert toy.facts("a")["wall_seconds"] > 5.0 and toy.facts("a")["state_digest"] == toy.digest(steps=300)


@pytest.mark.parametrize("name, ranks", [("series.csv", 1), seldom("series.h5", 2)])
def test_a_series_that_is_taken_away_is_missing_at_the_end(toy, name, ranks):
    process = toy.start(*RUN_A, ranks=ranks, **SLOW)
    (toy.folder / "a" / name).unlink()
    _, errors = ended(process, 6)
    assert errors.count("no series output from step") == 1 and f"{name}: No such file" in errors
    facts = toy.facts("a")
    assert facts["status"] == "finished" and facts["exit_code"] == 6 and "output is missing" in facts["reason"]
    assert facts["state_digest"] == toy.digest(steps=300) and toy.checkpoints("a") == [300]


def test_a_folder_that_is_moved_is_followed(toy):
    words = ("--checkpoint-every", "50")
    output = {f"output__{kind}": 10 for kind in ("field", "particle", "openpmd")}
    process = toy.start(*RUN_A, *words, ranks=2, **SLOW, **output)
    before = toy.checkpoints("a")
    wait_until(lambda: toy.checkpoints("a") != before)
    (toy.folder / "a").rename(toy.folder / "b")  # between two checkpoints
    _, errors = ended(process, 0)
    assert errors.count("was moved: going on in") == 1
    assert not (toy.folder / "a").exists() and not [*(toy.folder / "b").glob("trace-*")]
    assert toy.facts("b")["status"] == "finished" and toy.checkpoints("b") == [250, 300]
    assert toy.facts("b")["state_digest"] == toy.digest(steps=300)
    assert (toy.folder / "b/series.csv").read_text().count("\n") == 302
    found, steps = open_run(toy.folder / "b"), [*range(0, 301, 10)]
    assert [*found.field_snapshots.steps] == [*found.particle_snapshots.steps] == steps
    assert sorted(int(path.stem[4:]) for path in (toy.folder / "b/openpmd").iterdir()) == steps


@pytest.mark.parametrize("words", [(), ("--checkpoint-every", "5")])
def test_a_run_that_was_killed_is_none_under_way(toy, words):
    """Whoever reads the folder is told, and how to go on, though run.json has nobody to write it."""
    process = toy.start(*RUN_A, *words, steps=10**6, pause=0.005)
    assert open_run(toy.folder / "a").summary["status"] == "running"
    if words:
        wait_until(lambda: toy.checkpoints("a"))
    process.kill()
    process.communicate()
    summary = open_run(toy.folder / "a").summary
    assert (toy.facts("a")["status"], summary["status"]) == ("running", "killed")
    assert (f"toy restart {toy.folder}/a" if words else "no checkpoint: start again") in summary["reason"]
    told = toy("compare", "a", "a")
    assert told.stdout.count("a is killed: it left without a word") == 2
    if words:
        done = toy("restart", "a", "--threads", "1", "--set", "pause=0", "--until", "0.5")
        assert done.returncode == 0, done.stderr
        assert open_run(toy.folder / "a").summary["status"] == "finished"


def test_a_folder_that_is_removed_is_a_file_error(toy):
    process = toy.start(*RUN_A, **SLOW)
    shutil.rmtree(toy.folder / "a")
    ended(process, 6)


def test_checkpoints_do_not_follow_a_link(toy):
    words = ("--checkpoint-every", "20")
    process = toy.start(*RUN_A, *words, **SLOW)
    (toy.folder / "elsewhere").mkdir()
    (toy.folder / "elsewhere/00000001.h5").write_text("mine")
    folder = toy.folder / "a/checkpoints"
    wait_until(lambda: toy.checkpoints("a"))
    (toy.folder / "a/old").symlink_to(toy.folder / "elsewhere")
    exchange(folder, toy.folder / "a/old")
    _, errors = ended(process, 0)
    assert errors.count("was a link to") == 1
    assert [path.read_text() for path in (toy.folder / "elsewhere").iterdir()] == ["mine"]
    assert not folder.is_symlink() and toy.checkpoints("a") == [280, 300]


def test_three_checkpoints_that_fail_are_the_end_that_run_json_tells(toy):
    words = ("--checkpoint-every", "20")
    process = toy.start(*RUN_A, *words, ranks=2, **SLOW)
    folder = toy.folder / "a/checkpoints"
    wait_until(lambda: toy.checkpoints("a"))
    (toy.folder / "a/old").write_text("a file in the way")
    exchange(folder, toy.folder / "a/old")
    _, errors = ended(process, 6)
    assert errors.count("checkpoint at step") == 2
    facts = toy.facts("a")
    assert (facts["status"], facts["exit_code"]) == ("failed", 6) and "cannot write the checkpoint" in facts["reason"]
    assert [(part["status"], part["exit_code"]) for part in facts["history"]] == [("failed", 6)]
    folder.unlink()
    (toy.folder / "a/old").rename(folder)
    check_goes_on(toy)


@pytest.mark.parametrize("content", ["{", "[]", '{"status": "stopped", "history": 3}'])
def test_a_damaged_run_json_stops_no_restart(toy, content):
    assert toy(*RUN_A, steps=100).returncode == 0
    (toy.folder / "a/run.json").write_text(content)
    done = toy("restart", "a", "--threads", "1", steps=300)
    assert done.returncode == 0, done.stderr
    assert toy.facts("a")["state_digest"] == toy.digest(steps=300)
    assert [part["first_step"] for part in toy.facts("a")["history"]] == [100]
    kept = toy.folder / "a/run.json.damaged"
    assert kept.exists() == (content[:1] != "{" or content == "{") and "Traceback" not in done.stderr
    assert not kept.exists() or kept.read_text() == content


@pytest.mark.parametrize("name", ["with spaces", "-dash", "naïve ∂t", "two\nlines", "quote's", "a%sb", ".hidden"])
def test_a_folder_of_any_name_takes_a_run_and_a_restart(toy, name):
    words = (f"--output={name}",)
    assert toy("run", "ring.conf", *words, "--threads", "1", steps=20).returncode == 0
    done = toy("restart", "--threads", "1", "--set", "steps=40", "--", name)
    assert done.returncode == 0, done.stderr
    facts = json.loads((toy.folder / name / "run.json").read_text())
    assert facts["status"] == "finished" and facts["steps"] == 40


def test_of_runs_started_at_once_in_one_folder_one_is_made(toy):
    words = toy.words(*RUN_A, steps=200, pause=0.005)
    started = [
        subprocess.Popen(words, cwd=toy.folder, env=environment(), stderr=subprocess.PIPE, stdout=subprocess.PIPE)
        for _ in range(4)
    ]
    errors = [process.communicate(timeout=30)[1].decode() for process in started]
    codes = sorted(process.returncode for process in started)
    assert codes == [0, 6, 6, 6] and not any("Traceback" in text for text in errors), errors
    assert toy.facts("a")["status"] == "finished"
