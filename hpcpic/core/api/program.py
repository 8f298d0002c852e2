"""Functions of the package of a simulator beside its Case: the shipped cases, and runs in folders."""

from __future__ import annotations

import os
from collections.abc import Callable

from hpcpic.core.api.results import Run
from hpcpic.core.api.tables import Cases
from hpcpic.core.app.app import App


class Program:
    """A simulator, loaded when it is first asked for something."""

    def __init__(self, load_app: Callable[[], App]) -> None:
        self._load_app = load_app

    def cases(self) -> Cases:
        """The shipped cases: name -> header."""
        return Cases(self._load_app().cases())

    def open_run(self, folder: str | os.PathLike[str]) -> Run:
        """A run folder: finished, under way, stopped or killed. Raises FileError when it is none."""
        return Run.open(folder, self._load_app())
