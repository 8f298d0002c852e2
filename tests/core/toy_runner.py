"""Run the toy simulator of tests/core/toy_app.py in processes of its own, as a user would."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from app_runner import MPIRUN, ROOT, TIMEOUT_S, environment

TOY = ROOT / "tests" / "core" / "toy_app.py"
DIGESTS: dict[str, str] = {}
RUN_A = ("run", "ring.conf", "-o", "a", "--threads", "1")  # the case into the folder a


class Server:
    """The process of toy_server.py that all tests of this one share; it ends when its input does."""

    process: subprocess.Popen[str] | None = None

    @classmethod
    def run(cls, words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
        if cls.process is None:
            command = [sys.executable, str(Path(__file__).with_name("toy_server.py"))]
            cls.process = subprocess.Popen(
                command, env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
        with tempfile.TemporaryDirectory() as made:
            streams = [Path(made, name) for name in ("output", "errors")]
            for path in streams:
                path.touch()
            request = {"words": words[2:], "folder": str(folder), "streams": list(map(str, streams))}
            print(json.dumps(request), file=cls.process.stdin, flush=True)
            code = int(cls.process.stdout.readline())
            return subprocess.CompletedProcess(words, code, *(path.read_text() for path in streams))


class Toy:
    """Commands run in `folder`, where ring.conf is the case."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "ring.conf").write_text("# what: a ring\n# time: 1 s\nsteps = 200;\nrows = 50;\n")
        self.started: list[subprocess.Popen[str]] = []

    def words(self, *arguments: str, ranks: int = 1, **settings: Any) -> list[str]:
        """Settings such as steps=9 or fault__kind='"raise"' become --set."""
        launcher = [str(MPIRUN), "-n", str(ranks)] if ranks > 1 else []
        sets = [word for key, value in settings.items() for word in ("--set", f"{key.replace('__', '.')}={value}")]
        return [*launcher, sys.executable, str(TOY), *arguments, *sets]

    def __call__(
        self, *arguments: str, ranks: int = 1, env: dict[str, str] | None = None, **settings: Any
    ) -> subprocess.CompletedProcess[str]:
        """To the end. The limit is for one that hangs: a busy machine may compile for minutes in an empty cache."""
        words = self.words(*arguments, ranks=ranks, **settings)
        if ranks == 1 and env is None:
            return Server.run(words, self.folder)
        return subprocess.run(
            words, cwd=self.folder, env=environment(**(env or {})), capture_output=True, text=True, timeout=TIMEOUT_S
        )

    def start(self, *arguments: str, ranks: int = 1, **settings: Any) -> subprocess.Popen[str]:
        """Into the step loop, and still running."""
        words = self.words(*arguments, ranks=ranks, **settings)
        process = subprocess.Popen(
            words,
            cwd=self.folder,
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.started.append(process)
        log = self.folder / arguments[arguments.index("-o") + 1] / "log.txt"
        wait_until(lambda: log.exists() and "steps 0 to" in log.read_text())
        time.sleep(0.2)
        return process

    def facts(self, run: str) -> dict[str, Any]:
        return json.loads((self.folder / run / "run.json").read_text())

    def checkpoints(self, run: str) -> list[int]:
        return sorted(int(path.stem) for path in (self.folder / run / "checkpoints").glob("*.h5"))

    def digest(self, **settings: Any) -> str:
        """Of an uninterrupted run with these settings; made once."""
        key = repr(settings)
        if key not in DIGESTS:
            done = self("run", "ring.conf", "-o", "whole", "--replace", "--threads", "1", **settings)
            assert done.returncode == 0, done.stderr
            DIGESTS[key] = self.facts("whole")["state_digest"]
        return DIGESTS[key]


def wait_until(condition: Any, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.02)
