"""`run` from outside: the folder it leaves, one result for any ranks, and refusals that leave nothing."""

import csv
import os
import re
from types import SimpleNamespace

import pytest
import toy_app
from toy_runner import RUN_A, Toy

from hpcpic.core import memory
from hpcpic.core.cli.estimate import require_memory
from hpcpic.core.cli.main import build
from hpcpic.core.errors import ConfigError
from hpcpic.core.run import progress

KEYS = {
    *("status", "exit_code", "steps", "time", "wall_seconds", "ranks", "threads", "nodes", "mlups"),
    *("peak_memory_mib_per_rank", "timers", "state_digest", "versions", "git", "derived", "estimate"),
    *("conservation", "warnings", "step_seconds", "history", "command", "host"),
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    toy = Toy(tmp_path_factory.mktemp("finished"))
    done = toy(*RUN_A, output__field=100, output__particle=100)
    assert done.returncode == 0, done.stderr
    return toy, done


def test_run_leaves_the_whole_folder(finished):
    toy, done = finished
    names = {path.name for path in (toy.folder / "a").iterdir() if not path.name.startswith(".")}
    assert names == {
        "run.json",
        "config.conf",
        "given",
        "log.txt",
        "timers.csv",
        "series.h5",
        "series.csv",
        "series.units.csv",
        "fields.vtkhdf",
        "particles.vtkhdf",
        "checkpoints",
    }
    facts = toy.facts("a")
    assert KEYS - facts.keys() == set()
    assert (facts["status"], facts["exit_code"], facts["steps"], facts["ranks"]) == ("finished", 0, 200, 1)
    assert set(facts["timers"]["advect"]) == {"min", "avg", "max", "share", "calls"}
    assert toy.checkpoints("a") == [200]
    assert (toy.folder / "a/given/ring.conf").read_text() == (toy.folder / "ring.conf").read_text()
    assert "finished" in done.stdout and "advect" in done.stdout and "advect" in (toy.folder / "a/log.txt").read_text()


def test_series_has_a_row_per_step_from_0_to_the_end(finished):
    toy, _ = finished
    rows = list(csv.reader((toy.folder / "a/series.csv").open()))
    assert rows[0][:2] == ["step", "time"]
    assert [int(row[0]) for row in rows[1:]] == list(range(201))


def test_shares_of_the_sections_add_up_to_the_whole(finished):
    toy, _ = finished
    assert sum(row["share"] for row in toy.facts("a")["timers"].values()) == pytest.approx(1.0, abs=1e-9)


def test_config_conf_runs_again_to_the_same_state(finished):
    toy, _ = finished
    done = toy("run", "a/config.conf", "-o", "again", "--threads", "1")
    assert done.returncode == 0
    assert toy.facts("again")["state_digest"] == toy.facts("a")["state_digest"]


def test_same_digest_on_any_ranks(finished):
    toy, _ = finished
    done = toy("run", "ring.conf", "-o", "on3", "--threads", "1", ranks=3, output__field=100)
    assert done.returncode == 0, done.stderr
    assert toy.facts("on3")["ranks"] == 3
    assert toy.facts("on3")["state_digest"] == toy.facts("a")["state_digest"]


def test_a_folder_that_holds_a_run_is_refused_once_without_force(finished):
    toy, _ = finished
    before = toy.facts("a")
    done = toy("run", "ring.conf", "-o", "a", ranks=2)
    assert done.returncode == 6
    assert done.stderr.count("holds a run already") == 1
    assert toy.facts("a") == before


def test_replace_replaces_a_run(toy):
    for steps in (3, 2):
        assert toy("run", "ring.conf", "-o", "a", "--replace", steps=steps).returncode == 0
    assert toy.facts("a")["steps"] == 2 and toy.checkpoints("a") == [2]


def test_who_accepts_a_limit_loses_no_run(finished):
    """And who is used to --force as that which replaces a run is told what does."""
    toy, _ = finished
    before = toy.facts("a")
    done = toy("run", "ring.conf", "-o", "a", "--force", courant=1.5)
    assert done.returncode == 6 and "--replace, in Python replace=True (force is for limits alone)" in done.stderr
    assert toy.facts("a") == before


def test_all_configuration_errors_are_told_once_and_nothing_is_made(toy):
    (toy.folder / "bad.conf").write_text("steps = -1;\nrowz = 3;\n")
    done = toy("run", "bad.conf", "-o", "bad", ranks=2)
    assert done.returncode == 2
    assert done.stderr.count("bad.conf:2:1: rowz: unknown key; did you mean 'rows'?") == 1
    assert done.stderr.count("bad.conf:1:1: steps:") == 1
    assert "Traceback" not in done.stderr and "Abort" not in done.stderr
    assert not (toy.folder / "bad").exists()


def test_usage_errors_are_told_once(toy):
    done = toy("run", "--frobnicate", ranks=2)
    assert done.returncode == 2
    assert done.stderr.count("No such option") == 1


@pytest.mark.parametrize("words", [("--wall", "1:2:3:4"), ("--checkpoint-every", "often"), ("--wall", "x", "--dry")])
def test_wrong_times_are_usage_errors(toy, words):
    done = toy("run", "ring.conf", "-o", "a", *words)
    assert done.returncode == 2 and words[1] in done.stderr
    assert not (toy.folder / "a").exists()


@pytest.mark.parametrize("words", [("run", ""), ("run", "ring.conf", "-o", ""), ("plot", "")])
def test_an_empty_argument_is_a_usage_error(toy, words):
    done = toy(*words)
    assert done.returncode == 2 and "an argument is empty" in done.stderr
    assert [path.name for path in toy.folder.iterdir()] == ["ring.conf"]


def test_a_name_that_is_no_text_is_a_usage_error(toy):
    done = toy("run", "ring.conf", "-o", os.fsdecode(b"r\xff"))
    assert done.returncode == 2 and "not text" in done.stderr
    assert [path.name for path in toy.folder.iterdir()] == ["ring.conf"]


def test_quiet_says_nothing_on_the_way(toy, monkeypatch, capfd):
    monkeypatch.setattr(progress, "LEAST_SECONDS", 0.0)
    monkeypatch.chdir(toy.folder)
    for words, lines in (((), True), (("--quiet",), False)):
        with pytest.raises(SystemExit) as end:
            build(lambda: toy_app.APP, "toy", "a ring").main(["run", "ring.conf", "-o", f"a{len(words)}", *words])
        output, errors = capfd.readouterr()
        assert not end.value.code and "finished" in output
        assert ("  left 00:" in output) == lines == bool(errors)


def test_a_limit_stops_the_run_and_force_makes_it_a_warning(toy):
    done = toy("run", "ring.conf", "-o", "a", courant=1.5, steps=3)
    assert done.returncode == 2 and "Courant number" in done.stderr and "--force" in done.stderr
    done = toy("run", "ring.conf", "-o", "a", "--force", courant=1.5, steps=3)
    assert done.returncode == 0 and re.search(r"^warning 1 +Courant number", done.stdout, re.MULTILINE)
    assert toy.facts("a")["warnings"]


def test_more_ranks_than_rows_are_refused_also_to_force_which_is_told(toy):
    done = toy("run", "ring.conf", "-o", "a", "--force", ranks=3, rows=2)
    assert done.returncode == 2 and done.stderr.count("rows per rank") == 1
    assert "does not lift this limit" in done.stderr
    assert not (toy.folder / "a").exists()


def test_a_launcher_of_another_mpi_is_found_out(toy):
    done = toy("run", "ring.conf", "-o", "a", env={"PMI_SIZE": "2", "PMI_RANK": "0"})
    assert done.returncode == 2
    assert "mpirun started 2 processes" in done.stderr
    assert not (toy.folder / "a").exists()


def test_dry_run_refuses_what_a_run_refuses(toy):
    for words in ((), ("--dry",)):
        done = toy("run", "ring.conf", "-o", "a", *words, courant=2)
        assert done.returncode == 2 and "take courant = 1" in done.stderr
    assert not (toy.folder / "a").exists()


@pytest.mark.parametrize("words, ranks", [((), 2), (("--dry",), 1)])
def test_more_memory_than_there_is_is_refused_before_anything_is_made(toy, words, ranks):
    done = toy("run", "ring.conf", "-o", "a", *words, ranks=ranks, rows=10**14)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count(f"memory: {ranks} rank") == 1 and "most of it for u, and there are" in done.stderr
    assert "--force" in done.stderr and not (toy.folder / "a").exists()


@pytest.mark.parametrize("here, fits", [(1, True), (2, True), (3, False)])
def test_the_memory_of_a_machine_is_for_all_ranks_on_it(monkeypatch, here, fits):
    """Of six ranks, those on other machines take nothing from this one."""
    wanted = SimpleNamespace(estimate=lambda *_: SimpleNamespace(memory={"u": 3e9, "v": 1e9}))
    monkeypatch.setattr(memory, "free", lambda: 8.5e9)
    monkeypatch.setattr(memory, "held", lambda: 0.1e9)
    if fits:
        assert require_memory(wanted, None, 6, here, force=False) == []
    else:
        with pytest.raises(ConfigError, match=r"3 ranks on this machine take about .* for u"):
            require_memory(wanted, None, 6, here, force=False)
        assert "2 such machines" in require_memory(wanted, None, 6, here, force=True)[0]


def test_force_runs_it_and_no_memory_ends_all_ranks_with_one_line(toy):
    done = toy("run", "ring.conf", "-o", "a", "--force", ranks=2, rows=10**14)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "refused without --force" in done.stderr and done.stderr.count("no memory: Unable to allocate") == 1
    assert toy.facts("a")["status"] == "failed"


def test_dry_run_prints_and_makes_nothing(toy):
    done = toy("run", "ring.conf", "-o", "a", "--dry")
    assert done.returncode == 0
    assert "Courant number" in done.stdout and "memory per rank" in done.stdout
    assert not (toy.folder / "a").exists()


def test_stop_sem_ends_a_run_when_the_mean_step_time_is_known(toy):
    done = toy("run", "ring.conf", "-o", "a", steps=100000, pause=0.002, stop_SEM=0.5)
    assert done.returncode == 0, done.stderr
    facts = toy.facts("a")
    assert "stop_SEM" in facts["reason"] and 30 <= facts["steps"] < 5000


def test_a_run_of_no_steps_has_its_first_state(toy):
    done = toy("run", "ring.conf", "-o", "a", steps=0, ranks=2)
    assert done.returncode == 0, done.stderr
    assert toy.checkpoints("a") == [0]
