"""The summary of a run: time by section and per step, memory, conserved quantities, estimate beside measurement."""

from __future__ import annotations

import math
import resource
import shlex
import statistics
import time
from array import array
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from hpcpic.core.run.progress import plain, rate

if TYPE_CHECKING:  # `estimate` uses the words below, and answers sooner without numpy
    from hpcpic.core.comm.world import World
    from hpcpic.core.timers import Timers

WARM_UP = 5  # steps left out of the statistics: compilation, first touch, cold caches
KEPT = 1 << 16
CONSERVED = ("energy_total", "charge", "mass", "mass_total", "mean_density", "momentum_x", "momentum_y", "momentum_z")


class StepTimes:
    """Seconds of the steps on this rank: mean and its standard error of all, median of an even selection of
    them.
    """

    def __init__(self) -> None:
        self.n = 0
        self.mean = 0.0
        self._square = 0.0
        self._seen = 0
        self._stride = 1
        self._kept = array("d")

    def add(self, seconds: float, steps: int = 1) -> None:
        """Add steps that were done together, each of which took so many seconds."""
        self._seen += 1
        if self._seen <= WARM_UP:
            return
        before = self.n // self._stride
        self.n += steps
        change = seconds - self.mean
        self.mean += steps * change / self.n
        self._square += steps * change * (seconds - self.mean)  # Welford
        self._kept.extend([seconds] * (self.n // self._stride - before))
        if len(self._kept) >= KEPT:
            self._kept = self._kept[1::2]
            self._stride *= 2

    @property
    def error(self) -> float:
        """Standard error of the mean; steps that were done together are one measurement."""
        measured = self._seen - WARM_UP
        return math.sqrt(self._square / (self.n - 1) / measured) if self.n > 1 else math.inf

    def known(self, fraction: float) -> bool:
        """The rule of the thesis (stop_SEM): 1.96 standard errors under this fraction of the mean, after 30
        steps.
        """
        return fraction > 0 and self.n >= 30 and 1.96 * self.error < fraction * self.mean

    def facts(self) -> dict[str, float | int]:
        median = statistics.median(self._kept) if self._kept else math.nan
        return {"n": self.n, "mean": self.mean, "standard_error": self.error, "median": median}


class Conserved:
    """First, last and largest change of the scalars that should not change: of CONSERVED, or of `names`.

    dissipated: those among them that the scheme takes energy from by design: what is lost is no error.
    """

    def __init__(self, names: Collection[str] = CONSERVED, dissipated: Collection[str] = ()) -> None:
        self.names = [name for name in CONSERVED if name in names]
        self.dissipated = dissipated
        self._found: dict[str, dict[str, float]] = {}

    def add(self, scalars: Mapping[str, float]) -> None:
        for name in self.names:
            if name in scalars:
                value = scalars[name]
                entry = self._found.setdefault(name, {"first": value, "last": value, "change": 0.0})
                entry["last"] = value
                change = abs(value - entry["first"])
                entry["change"] = max(entry["change"], change) if math.isfinite(change) else math.inf

    def facts(self) -> dict[str, dict[str, Any]]:
        """name -> first, last, change (largest), relative (to the first, of what starts away from 0), dissipated."""
        return {
            name: entry
            | ({"relative": entry["change"] / abs(entry["first"])} if _has_scale(name, entry) else {})
            | ({"dissipated": True} if name in self.dissipated else {})
            for name, entry in self._found.items()
        }


def _has_scale(name: str, entry: Mapping[str, float]) -> bool:
    """Momentum may start as the sum of noise: no measure of anything."""
    return entry["first"] != 0.0 and not name.startswith("momentum")


def sections(world: World, timers: Timers, wall: float) -> dict[str, dict[str, float]]:
    """section -> min, avg, max over ranks [s], share of `wall` [s], calls. Collective.

    Rank 0 gets them, the others {}.
    A section that some rank never entered counts as 0 s there, if rank 0 entered it.
    """
    import numpy as np

    totals = timers.totals()
    names = world.bcast("\n".join(totals).encode()).decode().split("\n")
    mine = np.array([[totals.get(name, (0.0, 0))[0] for name in names]])
    rows = world.gather_rows(mine)
    if rows is None or not totals:
        return {}
    result = {}
    for k, name in enumerate(names):
        seconds = rows[:, k]
        result[name] = {
            "min": float(seconds.min()),
            "avg": float(seconds.mean()),
            "max": float(seconds.max()),
            "share": float(seconds.mean()) / wall,
            "calls": totals[name][1],
        }
    rest = max(0.0, wall - sum(row["avg"] for row in result.values()))
    result["other"] = {"min": rest, "avg": rest, "max": rest, "share": rest / wall, "calls": 0}
    return dict(sorted(result.items(), key=lambda item: (item[0] == "other", -item[1]["avg"])))


def peak_memory_mib(world: World) -> float:
    """Largest resident memory of any rank so far. Collective."""
    return world.max(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)


def load(world: World, items: int | None) -> dict[str, int]:
    """Fewest and most work items of a rank. Collective; {} when the app does not tell."""
    import numpy as np

    if items is None:
        return {}
    most = world.max_array(np.array([items, -items], np.int64))
    return {"min": -int(most[1]), "max": int(most[0])}


def count(n: float) -> str:
    """50 000"""
    return f"{round(n):,}".replace(",", " ")


def render(facts: Mapping[str, Any]) -> str:
    """The table that ends a run, as text."""
    lines = [*_head(facts), *_section_table(facts)]
    spread = facts.get("load")
    if spread and spread["max"]:
        share = (spread["max"] - spread["min"]) / spread["max"]
        lines.append(_row("load", f"{count(spread['min'])} .. {count(spread['max'])} per rank ({share:.1%})"))
    compiled = facts.get("compiled_functions")
    peak = f"MiB per rank, peak{f', with compiling {compiled} functions' if compiled else ''}"
    lines.append(_row("memory", _beside(facts, "peak_memory_mib_per_rank", "memory_mib_per_rank", peak)))
    lines.append(_row("step", _beside(facts, "step_ms", "step_ms", "ms, median")))
    for word, lost in (("conserved", False), ("dissipated", True)):
        entries = (facts.get("conservation") or {}).items()
        changes = [f"{name} {_change(entry)}" for name, entry in entries if is_dissipation(entry) is lost]
        if changes:
            lines.append(_row(word, "   ".join(changes)))
    for k, text in enumerate(facts.get("warnings", ())):
        lines.append(_row(f"warning {k + 1}", text))
    lines.append(_row("results", str(facts["folder"])))
    if "program" in facts:
        folder = shell_word(str(facts["folder"]))
        lines.append(_row("look", f"{facts['program']} plot {folder}; {facts['program']} report {folder}"))
    return "\n".join(lines)


def shell_word(path: str) -> str:
    """A path as a word that a shell reads as it is and no command takes for an option."""
    return shlex.quote(f"./{path}" if path.startswith("-") else path)


def _head(facts: Mapping[str, Any]) -> list[str]:
    stepping = stepping_seconds(facts)
    speed = facts["steps_done"] / stepping if stepping > 0 else 0.0
    work = rate(speed * facts["work_items"], facts["work_unit"][0])
    where = f"{several(facts['ranks'], 'rank')} x {several(facts['threads'], 'thread')}"
    return [
        f"{facts['status']}: {facts['reason']}" if facts["reason"] else facts["status"],
        f"{count(facts['steps'])} steps, t = {facts['time']:.4g} s, {plain(facts['wall_seconds'])} s on {where}"
        f", {plain(stepping)} s of steps and output   {plain(speed)} step/s   {work}",
    ]


def stepping_seconds(facts: Mapping[str, Any]) -> float:
    """Seconds of the steps and their output, without the kernels that the first ones compile."""
    return max(0.0, float(facts.get("loop_seconds") or 0.0) - float(facts.get("loop_compiling_seconds") or 0.0))


def is_dissipation(entry: Mapping[str, Any]) -> bool:
    """True if a scalar is less at the end by what the scheme takes by design; a gain is no dissipation."""
    return bool(entry.get("dissipated")) and entry["last"] < entry["first"]


def several(n: int, word: str) -> str:
    return f"{n} {word}{'s' if n != 1 else ''}"


def _section_table(facts: Mapping[str, Any]) -> list[str]:
    table = facts["timers"]
    if not table:
        return []
    item_steps = facts["steps_done"] * facts["work_items"]
    lines = [
        f"{'section':<16}{'min s':>10}{'avg s':>10}{'max s':>10}{'spread':>9}{'share':>8}{'calls':>10}"
        + (f"   per {facts['work_unit']}-step" if item_steps else "")
    ]
    for name, row in table.items():
        spread = (row["max"] - row["min"]) / row["avg"] if row["avg"] else 0.0
        lines.append(
            f"{name:<16}{row['min']:>10.3f}{row['avg']:>10.3f}{row['max']:>10.3f}"
            f"{spread:>9.1%}{row['share']:>8.1%}"
            f"{count(row['calls']) if row['calls'] else '':>10}"
            + (f"   {1e9 * row['avg'] / item_steps:.3g} ns" if item_steps else "")
        )
    return lines


def _row(name: str, text: str) -> str:
    return f"{name:<12}{text}"


def _beside(facts: Mapping[str, Any], measured: str, estimated: str, unit: str) -> str:
    value = facts.get(measured)
    guess = (facts.get("estimate") or {}).get(estimated)
    text = f"{value:.4g} {unit}" if value is not None else "not measured"
    return text + (f" (estimate {guess:.4g})" if guess else "")


def _change(entry: Mapping[str, Any]) -> str:
    if is_dissipation(entry) and "relative" in entry:
        lost, first = entry["first"] - entry["last"], abs(entry["first"])
        return f"{lost / first:.1%} of that at the start" if lost <= first else f"{lost:.3g} (absolute)"
    return f"{entry['relative']:.1e}" if "relative" in entry else f"{entry['change']:.1e} (absolute)"


PART = ("first_step", "steps", "ranks", "threads", "wall_seconds", "status", "exit_code", "reason", "started")


def part(facts: Mapping[str, Any]) -> dict[str, Any]:
    """The entry of one part of a run, a `run` or a `restart`, in its history; None: not known (yet)."""
    return {key: facts.get(key) for key in PART}


def settled(history: Any) -> list[Mapping[str, Any]]:
    """The history in a run.json while no process holds the run: a part that still says "running" was killed, and the
    step that it came to is not known.
    """
    parts = [entry for entry in history if isinstance(entry, Mapping)] if isinstance(history, list) else []
    end = {"status": "killed", "reason": "it left without a word"}
    return [{**entry, **end} if entry.get("status") == "running" else entry for entry in parts]


def date(monotonic: float) -> str:
    """The date of a value of time.monotonic()."""
    return datetime.fromtimestamp(time.time() - time.monotonic() + monotonic, UTC).isoformat(timespec="seconds")
