"""What surrounds a program does not change its result: streams that are closed or full, terminals of few letters,
names of any length, and no home.
"""

import os
import shlex
import subprocess
import sys

import pytest
from toy_runner import RUN_A, environment

# a terminal and files of ASCII
NARROW = {"PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "LC_ALL": "C", "PYTHONIOENCODING": "ascii"}
LONG = "x" * 300  # no file may be called so


def shell(toy, words, streams="", **env):
    """A command with its streams led elsewhere."""
    line = f"{shlex.join(toy.words(*words))} {streams}"
    return subprocess.run(
        line, shell=True, cwd=toy.folder, env=environment(**env), capture_output=True, text=True, timeout=30
    )


@pytest.mark.parametrize("streams", [">&-", "<&- >&- 2>&-", ">/dev/full 2>&1", "| true"])
def test_a_screen_that_is_closed_or_full_or_gone_ends_no_run(toy, streams):
    done = shell(toy, RUN_A, streams)
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    facts = toy.facts("a")
    assert (facts["status"], facts["exit_code"], facts["steps"]) == ("finished", 0, 200)
    assert "finished" in (toy.folder / "a/log.txt").read_text()


@pytest.mark.parametrize("streams, code", [(">&-", 0), (">/dev/full", 6)])
def test_a_table_that_cannot_be_told_is_no_traceback(toy, streams, code):
    done = shell(toy, ("check", "ring.conf"), streams)
    assert done.returncode == code and "Traceback" not in done.stderr
    assert ("No space left" in done.stderr) == (code == 6)


def test_letters_that_a_terminal_does_not_know_end_nothing(toy):
    (toy.folder / "summer.conf").write_text("# what: été\nsteps = 3;\nrows = 5;\n", encoding="utf-8-sig")
    for words in (("run", "summer.conf", "-o", "a"), ("compare", "a", "a"), ("show", "summer.conf")):
        done = shell(toy, words, **NARROW)
        assert done.returncode == 0, done.stderr
        with open(toy.folder / "a/config.conf", "a", encoding="utf-8") as file:
            file.write("# été\n")
    assert "what:     " in done.stdout  # behind a byte order mark, too
    program = "import sys; from hpcpic.core.cli.main import mend_streams; mend_streams(); sys.stdout.write('\\xe9')"
    words = [sys.executable, "-c", program]
    assert subprocess.run(words, env=environment(**NARROW), capture_output=True).stdout == b"\\xe9"


def test_a_name_that_is_too_long_is_told_like_any_other(toy):
    for words, code, text in (
        (("run", LONG), 2, "no such file"),
        (("run", "ring.conf", "-o", LONG), 6, "File name too long"),
        (("run", "ring.conf", "-o", os.path.join(LONG, LONG)), 6, "File name too long"),
        (("restart", LONG), 6, "no such folder"),
        (("plot", LONG), 6, "no such folder"),
    ):
        done = toy(*words)
        assert done.returncode == code and text in done.stderr and "Traceback" not in done.stderr, done.stderr
    assert [path.name for path in toy.folder.iterdir()] == ["ring.conf"]
