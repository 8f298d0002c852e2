"""Tables: on the screen as wide as the terminal, unwrapped where there is none, no word ever cut; or, where --json
asks for it, as one object with all tables of a command.
"""

from __future__ import annotations

import io
import json
import math
import os
import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import click

COLUMNS_WITHOUT_TERMINAL = 400
_COLOURS = {"ok": ("green", False), "warn": ("yellow", False), "fail": ("red", True)}
_STYLES = {"ok": "green", "warn": "yellow", "fail": "bold red"}


class Shown(str):
    """A cell of a table: what people read, and the number behind it, with its unit."""

    value: float | int | bool
    unit: str = ""


def shown(value: float, form: str = ".4g", unit: str = "") -> Shown:
    """A number as a cell, in a format of Python and with its unit."""
    cell = Shown(f"{value:{form}} {unit}".rstrip())
    cell.value, cell.unit = value, unit
    return cell


class Answer:
    """The output of a command as JSON: {"tables": [[{column: value}]], "text": [line]}."""

    def __init__(self) -> None:
        self.tables: list[list[dict[str, Any]]] = []
        self._screen, sys.stdout = sys.stdout, io.StringIO()

    def close(self, silent: bool) -> None:
        lines = sys.stdout.getvalue().splitlines() if isinstance(sys.stdout, io.StringIO) else []
        sys.stdout = self._screen
        if not silent:
            print(json.dumps({"tables": self.tables, "text": [line for line in lines if line]}, indent=1))


answer: Answer | None = None  # where --json has asked for one


@contextmanager
def answering(silent: bool) -> Iterator[None]:
    """Within it --json opens an answer, which is printed at its end, unless `silent`; one that is open stays so."""
    global answer
    outer, answer = answer, None
    try:
        yield
    finally:
        inner, answer = answer, outer
        if inner:
            inner.close(silent)


def ask_for_json(context: click.Context, option: click.Parameter, wanted: bool) -> None:
    """The callback of --json."""
    global answer
    if wanted:
        answer = Answer()


def _plain(cell: object) -> Any:
    value = getattr(cell, "value", cell)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, bool | int | float) else str(value)


def _objects(headers: Sequence[str], rows: Sequence[Sequence[object]]) -> list[dict[str, Any]]:
    """The rows of a table for JSON. A column of numbers with units has a column of units beside it: "unit" beside
    "value", as tables for people have it, else "COLUMN unit".
    """
    named = {
        k: "unit" if header == "value" else f"{header} unit"
        for k, header in enumerate(headers)
        if any(getattr(row[k], "unit", "") for row in rows)
    }
    return [
        {
            key: content
            for k, (header, cell) in enumerate(zip(headers, row))
            for key, content in ((header, _plain(cell)), (named.get(k), getattr(cell, "unit", "")))
            if key
        }
        for row in rows
    ]


def table(headers: Sequence[str], rows: Iterable[Sequence[object]], right: Sequence[str] = ()) -> None:
    """Print rows under their headers; columns named in `right` are aligned there; verdicts are coloured."""
    rows = list(rows)
    if answer:
        answer.tables.append(_objects(headers, rows))
        return
    cells = [list(map(str, row)) for row in rows]
    widths = [max(map(len, column)) for column in zip(headers, *cells)]
    shown = sys.stdout.isatty()
    room = shutil.get_terminal_size().columns if shown else COLUMNS_WITHOUT_TERMINAL
    if sum(widths) + 2 * (len(widths) - 1) > room or not all(cell.isascii() for row in cells for cell in row):
        words = [max(_longest_word(cell) for cell in column) for column in zip(headers, *cells)]
        if sum(words) + 2 * (len(words) - 1) > room:
            _stacked(headers, cells, room)
        else:
            _folded(headers, cells, right, words)
        return
    coloured = shown and "NO_COLOR" not in os.environ
    for k, row in enumerate([list(headers), *cells]):
        padded = [
            cell.rjust(width) if header in right else cell.ljust(width)
            for cell, width, header in zip(row, widths, headers)
        ]
        if coloured:
            padded = [_styled(text, cell, k == 0) for text, cell in zip(padded, row)]
        click.echo("  ".join(padded).rstrip())


def _styled(padded: str, cell: str, header: bool) -> str:
    colour, bold = _COLOURS.get(cell, (None, False))
    return click.style(padded, fg=colour, bold=header or bold) if header or colour else padded


def _longest_word(text: str) -> int:
    return max(map(len, text.split()), default=0)


def _stacked(headers: Sequence[str], rows: Sequence[Sequence[str]], room: int) -> None:
    """Print a paragraph per row, where not even the words fit beside each other."""
    for first, *others in rows:
        click.echo(first)
        cells = "; ".join(f"{name} {cell}".strip() for name, cell in zip(headers[1:], others) if cell)
        lines = textwrap.wrap(cells, max(room - 4, 20), break_long_words=False, break_on_hyphens=False)
        click.echo(textwrap.indent("\n".join(lines), "    "))


def _folded(headers: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[str], least: Sequence[int]) -> None:
    """Print a table with folded lines, or characters two columns wide; no column is narrower than `least`."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    made = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for header, width in zip(headers, least):
        made.add_column(header, justify="right" if header in right else "left", overflow="fold", min_width=width)
    for row in rows:
        made.add_row(*(Text(cell, _STYLES.get(cell, "")) for cell in row))
    Console(width=None if sys.stdout.isatty() else COLUMNS_WITHOUT_TERMINAL, highlight=False).print(made)


def amount(n: float) -> Shown:
    """1.5 MiB, of bytes"""
    k = next((k for k in range(4) if n < 1024 ** (k + 1)), 4)
    cell = Shown(f"{n / 1024**k:.4g} {('', 'Ki', 'Mi', 'Gi', 'Ti')[k]}B")
    cell.value, cell.unit = n, "B"
    return cell


def duration(seconds: float) -> Shown:
    """0.12 s, 3 min 20 s, 2 h 5 min"""
    minutes, hours = f"{seconds // 60:.0f} min {int(seconds % 60)} s", f"{seconds // 3600:.0f} h"
    longer = minutes if seconds < 3600 else f"{hours} {int(seconds % 3600 // 60)} min"
    cell = Shown(f"{seconds:.3g} s" if seconds < 60 else longer)
    cell.value, cell.unit = seconds, "s"
    return cell


def number(value: Any, digits: int = 4) -> str:
    """A number as people read it; words as they are; nothing for None."""
    if value is None:
        return "—"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if isinstance(value, int):
        return count(value)
    if 10**digits <= abs(value) < 1e7:
        return count(float(f"{value:.{digits}g}"))
    return f"{value:.{digits}g}" if math.isfinite(value) else str(value)


def count(n: float) -> str:
    return f"{round(n):,}".replace(",", "\u202f")


def percent(share: float) -> Shown:
    """0.0123 -> "1.2 %", 1.7 -> "170 %"."""
    digits = 1 - math.floor(math.log10(100.0 * share)) if share > 0.0 else 0
    cell = Shown(f"{100.0 * share:.{min(max(digits, 0), 8)}f} %" if share < 1e4 else "over a million %")
    cell.value = share
    return cell
