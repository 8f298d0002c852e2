"""Check and estimate of a case as objects that terminals and notebooks show as tables."""

from __future__ import annotations

import html
import io
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hpcpic.core.app.app import App
    from hpcpic.core.app.forecast import Estimate
    from hpcpic.core.case.cases import Header
    from hpcpic.core.case.derived import Derived


def printed(show: Callable[[], object]) -> str:
    """The text that a function of the command line prints, without the last line end."""
    text = io.StringIO()
    with redirect_stdout(text):
        show()
    return text.getvalue().rstrip("\n")


class Table:
    """Something that is read as the table that the command line prints."""

    def _repr_html_(self) -> str:
        return f'<pre style="white-space: pre; overflow-x: auto">{html.escape(repr(self))}</pre>'


class Cases(Table, Mapping[str, "Header"]):
    """The shipped cases: name -> header (`what`, `source`, `expected`, `time`)."""

    def __init__(self, files: Mapping[str, Path]) -> None:
        self._files = files

    def __getitem__(self, name: str) -> Header:
        from hpcpic.core.case.cases import read_header

        return read_header(self._files[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)

    def __repr__(self) -> str:
        from hpcpic.core.app.text import table

        rows = [(name, header.time, header.what) for name, header in self.items()]
        return printed(lambda: table(("case", "time", "what"), rows))


@dataclass(frozen=True, slots=True, repr=False)
class Check(Table):
    """rows: the derived numbers with their limits, verdicts and sources. warnings: those of reading the case."""

    rows: tuple[Derived, ...]
    warnings: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """No number is beyond a limit that refuses the run."""
        return all(row.verdict != "fail" for row in self.rows)

    def __getitem__(self, name: str) -> Derived:
        """The number of this name, or with this symbol."""
        for row in self.rows:
            if name in (row.name, row.symbol):
                return row
        raise KeyError(f"{name}: no such number; there are {', '.join(row.name for row in self.rows)}")

    def __iter__(self) -> Iterator[Derived]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        from hpcpic.core.cli.check import print_derived

        notes = [f"warning: {warning}" for warning in self.warnings]
        notes += [f"{row.verdict}: {row}" for row in self.rows if row.verdict != "ok"]
        return "\n".join([printed(lambda: print_derived(list(self.rows))), *notes])


@dataclass(frozen=True, slots=True, repr=False)
class Forecast(Table):
    """Memory, disk and time of a run that has not begun.

    memory: item -> bytes per rank; disk: item -> bytes of the whole run; seconds of the run, step_seconds of a step.
    """

    app: App
    config: Any
    ranks: int
    threads: int
    estimate: Estimate

    @property
    def memory(self) -> Mapping[str, float]:
        return self.estimate.memory

    @property
    def disk(self) -> Mapping[str, float]:
        return self.estimate.disk

    @property
    def seconds(self) -> float:
        return self.estimate.seconds

    @property
    def step_seconds(self) -> float:
        return self.estimate.step_seconds

    def __repr__(self) -> str:
        from hpcpic.core.cli.estimate import print_estimate

        return printed(lambda: print_estimate(self.app, self.config, self.ranks, self.threads))
