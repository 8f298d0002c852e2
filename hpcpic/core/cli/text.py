"""Tables on the screen: as wide as the terminal, and unwrapped where there is none."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

WIDE = 400
_STYLES = {"ok": "green", "warn": "yellow", "fail": "bold red"}


def table(headers: Sequence[str], rows: Iterable[Sequence[object]], right: Sequence[str] = ()) -> None:
    """Print rows under their headers; columns named in `right` are aligned there; verdicts are coloured."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    made = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for header in headers:
        made.add_column(header, justify="right" if header in right else "left", overflow="fold")
    for row in rows:
        made.add_row(*(Text(str(cell), _STYLES.get(str(cell), "")) for cell in row))
    Console(width=None if sys.stdout.isatty() else WIDE, highlight=False).print(made)


def amount(n: float) -> str:
    """1.5 MiB"""
    for prefix in ("", "Ki", "Mi", "Gi"):
        if n < 1024:
            return f"{n:.4g} {prefix}B"
        n /= 1024
    return f"{n:.4g} TiB"


def duration(seconds: float) -> str:
    """0.12 s, 3 min 20 s, 2 h 5 min"""
    if seconds < 60:
        return f"{seconds:.3g} s"
    if seconds < 3600:
        return f"{int(seconds // 60)} min {int(seconds % 60)} s"
    return f"{int(seconds // 3600)} h {int(seconds % 3600 // 60)} min"
