"""Progress of a run: one rewritten line on a terminal, otherwise few lines.

Elsewhere a line per 5 % of the run, at least 2 s apart, and one in ten minutes whatever the progress: at most
about twenty lines for a short run, and a long one is never silent.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping, Sequence
from typing import TextIO

from hpcpic.core.run.log import say

PERCENT = 5.0
LEAST_SECONDS = 2.0
MOST_SECONDS = 600.0
REWRITE_SECONDS = 0.2


def clock(seconds: float) -> str:
    """00:12:34; days are hours."""
    s = max(0, round(seconds))
    return f"{s // 3600:02d}:{s // 60 % 60:02d}:{s % 60:02d}"


def plain(value: float) -> str:
    """Three digits or all before the point, and no power of ten: 0.544, 54.4, 5444."""
    return f"{value:.0f}" if value >= 999.5 else f"{value:.3g}"


def rate(per_second: float, unit: str) -> str:
    """32.5 M<unit>/s with a prefix that keeps one to three digits before the point."""
    per_second = float(f"{per_second:.3g}")  # first, or 999.9 would be 1e+03
    for prefix, scale in (("T", 1e12), ("G", 1e9), ("M", 1e6), ("k", 1e3)):
        if per_second >= scale:
            return f"{per_second / scale:.3g} {prefix}{unit}/s"
    return f"{per_second:.3g} {unit}/s"


LAST_TO_GO = (0, 1, 2, 7, 3, 5, 6, 4)  # which items of the line matter most


def _fitting(items: Sequence[str], width: int) -> str:
    """The items that fit beside each other, the most important first; none is ever cut."""
    chosen: list[int] = []
    for k in LAST_TO_GO:
        tried = sorted([*chosen, k])
        if items[k] and len("  ".join(items[n] for n in tried)) <= width:
            chosen = tried
    return "  ".join(items[n] for n in chosen)


class Progress:
    """The progress of a run from step `first` to `last`; `items` are worked on in every step, `unit` is their letter.

    last: None where the number of steps is not known; then `times` [s], of first and last step, tell how far it is.
    """

    def __init__(
        self,
        stream: TextIO,
        first: int,
        last: int | None,
        items: int,
        unit: str,
        times: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.stream = stream
        self.first, self.last = first, last
        self.ends = (float(first), float(last)) if last is not None else times
        self.items, self.unit = items, unit
        self.live = stream.isatty()
        self.lines = 0
        self._shown = time.monotonic()
        self._from = (self._shown, self.ends[0])  # clock and place from which the time left is reckoned
        self._first = True  # step, which compiles
        self._shown_step = first
        self._shown_at = self.ends[0]
        self._width = 0
        self._energy: float | None = None
        self._change = ""

    def scalars(self, values: Mapping[str, float]) -> None:
        """Newest values of the series: the change of the total energy is shown."""
        energy = values.get("energy_total")
        if energy is None:
            return
        if self._energy is None:
            self._energy = energy
        elif self._energy:
            self._change = f"dE/E {(energy - self._energy) / abs(self._energy):.1e}"

    def _at(self, step: int, t: float) -> float:
        return t if self.last is None else float(step)

    def due(self, step: int, t: float = 0.0) -> bool:
        now = time.monotonic()
        if self._first:
            self._first, self._from = False, (now, self._at(step, t))
        since = now - self._shown
        if self.live:
            return since >= REWRITE_SECONDS
        moved = 100.0 * (self._at(step, t) - self._shown_at) >= PERCENT * (self.ends[1] - self.ends[0])
        return since >= MOST_SECONDS or (moved and since >= LEAST_SECONDS)

    def show(self, step: int, t: float, dt: float, end: float) -> None:
        """Write the line of `step` at time t [s]; a step is dt [s], the run ends at time `end` [s]."""
        now = time.monotonic()
        speed = (step - self._shown_step) / max(now - self._shown, 1e-9)
        at, last = self._at(step, t), self.ends[1]
        whole = (at - self._from[1]) / max(now - self._from[0], 1e-9)
        left = clock((last - at) / whole) if whole > 0 else "--:--:--"
        done = min(100.0 * at / last, 100.0) if last else 100.0
        of = f"/{self.last}" if self.last is not None else ""
        items = [
            f"step {step}{of}", f"{done:.1f} %", f"left {left}", f"t {t:.3e}/{end:.3e} s", f"dt {dt:.2e}",
            f"{plain(speed)} step/s", rate(speed * self.items, self.unit), self._change,
        ]  # fmt: skip
        self._shown, self._shown_step, self._shown_at = now, step, at
        self.lines += 1
        if self.live:
            line = _fitting(items, shutil.get_terminal_size().columns - 1)  # a wrapped line cannot be rewritten
            say(self.stream, "\r" + line.ljust(self._width))
            self._width = len(line)
        else:
            say(self.stream, "  ".join(filter(None, items)) + "\n")

    def clear(self) -> None:
        """Take the rewritten line away before something else is written."""
        if self.live and self._width:
            say(self.stream, "\r" + " " * self._width + "\r")
            self._width = 0
