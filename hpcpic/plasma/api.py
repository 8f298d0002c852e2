"""The names that `import hpcpic` offers: cases, runs and simulations in memory."""

from __future__ import annotations

import os

from hpcpic.__main__ import load_app
from hpcpic.core.api import case, tables
from hpcpic.core.api.results import Run

__all__ = ["Case", "Run", "cases", "open_run"]


class Case(case.Case):
    __doc__ = case.Case.__doc__
    load_app = staticmethod(load_app)


def cases() -> tables.Cases:
    """The shipped cases: name -> header."""
    return tables.Cases(load_app().cases())


def open_run(folder: str | os.PathLike[str]) -> Run:
    """A run folder: finished, under way, stopped or killed. Raises FileError when it is none."""
    return Run.open(folder, load_app())
