"""estimate: memory, disk and time of a run before it is started, for any ranks x threads."""

from __future__ import annotations

import math
from typing import Any

import click

from hpcpic.core import memory
from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.forecast import Estimate
from hpcpic.core.app.rates import MEASURED, rates_file, read_rates
from hpcpic.core.app.read import read_case, set_option, shape_options
from hpcpic.core.app.text import amount, duration, shown, table
from hpcpic.core.app.use import use_option
from hpcpic.core.cores import allotted, crowded
from hpcpic.core.errors import ConfigError
from hpcpic.core.run.summary import several

MIB = 2.0**20
SMALL = 0.005  # share of the memory: smaller arrays share a row


def facts(estimate: Estimate) -> dict[str, float]:
    """The estimate as run.json tells it, in its units."""
    return {
        "step_seconds": estimate.step_seconds,
        "step_ms": 1e3 * estimate.step_seconds,
        "seconds": estimate.seconds,
        "start_seconds": estimate.start,
        "memory_mib_per_rank": sum(estimate.memory.values()) / MIB,
        "disk_mib": sum(estimate.disk.values()) / MIB,
    }


def require_memory(app: App, config: Any, ranks: int, ranks_here: int, force: bool) -> list[str]:
    """A warning where the ranks on this machine need more memory than it has: the out-of-memory killer of the kernel
    would end them without a message. ConfigError without `force`.
    """
    items = app.estimate(config, ranks, 1, read_rates()).memory
    needed, free = ranks_here * sum(items.values()), memory.free() + ranks_here * memory.held()
    if needed <= free:
        return []
    largest = max(items, key=lambda name: items[name])
    text = (
        f"memory: {several(ranks_here, 'rank')} on this machine take about {amount(needed)}, most of it for "
        f"{largest}, and there are {amount(free)}: a case of {free / needed:.1%} of the size fits, or "
        f"{math.ceil(needed / free)} such machines"
    )
    if not force:
        raise ConfigError(f"{text} (--force runs it, in Python force=True)")
    return [f"{text} (refused without --force)"]


def print_estimate(app: App, config: Any, ranks: int, threads: int) -> None:
    rates = read_rates()
    estimate = app.estimate(config, ranks, threads, rates)
    total = sum(estimate.memory.values())
    large = {name: size for name, size in estimate.memory.items() if size >= SMALL * total}
    if small := len(estimate.memory) - len(large):
        large[f"{several(small, 'smaller array')}, told by check --plan"] = total - sum(large.values())
    rows = [(name, amount(size), shown(size / total, ".1%")) for name, size in large.items()]
    table(("memory per rank", "size", "share"), [*rows, ("total", amount(total), "")], right=("size", "share"))
    click.echo()
    files = [(name, amount(size)) for name, size in estimate.disk.items()]
    table(("disk", "size"), [*files, ("total", amount(sum(estimate.disk.values())))], right=("size",))
    click.echo()
    if estimate.phases:
        print_phases(estimate)
    one = app.estimate(config, 1, 1, rates)
    efficiency = one.step_seconds / (ranks * threads * estimate.step_seconds)
    whole = [("whole run", duration(estimate.seconds)), ("its start", duration(estimate.start))]
    whole += [("its samples of the series", duration(estimate.sampling))] if estimate.sampling else []
    whole += [("a step", shown(1e3 * estimate.step_seconds, ".4g", "ms"))]
    head = f"time on {several(ranks, 'rank')} x {several(threads, 'thread')}"
    table((head, "value"), [*whole, ("efficiency of 1 x 1", shown(efficiency, ".0%"))], right=("value",))
    click.echo(
        f"rates       measured on this machine ({rates_file()})"
        if MEASURED.format(app.name) in rates
        else f"rates       of the machine of the authors; `{app.name} bench --quick` measures this one"
    )
    if crowd := crowded(ranks, threads, allotted()):
        click.echo(f"cores       {crowd}")


def print_phases(estimate: Estimate) -> None:
    """Print the phases of a step; a sample may have done some of them before the step begins."""
    whole = sum(estimate.phases.values())
    rows = [
        (name, shown(1e3 * spent, ".4g", "ms"), shown(spent / whole, ".1%"))
        for name, spent in estimate.phases.items()
        if spent
    ]
    table(("a step", "time", "share"), rows, right=("time", "share"))
    click.echo()


def make_estimate_command(app_loader: AppLoader) -> click.Command:
    @click.command("estimate")
    @click.argument("case")
    @set_option
    @use_option
    @shape_options
    def estimate(case: str, sets: tuple[str, ...], ranks: int, threads: int) -> None:
        """Memory by item, disk and time of a case on any ranks x threads; works on one process."""
        app = app_loader()
        print_estimate(app, read_case(app, case, sets).config, ranks, threads)

    return estimate
