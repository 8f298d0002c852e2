"""check: is the case sound? No step is taken."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import reduce
from typing import Any

import click

from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.rates import read_rates
from hpcpic.core.app.read import Case, read_case, set_option, shape_options
from hpcpic.core.app.text import shown, table
from hpcpic.core.app.use import use_option
from hpcpic.core.case.config import dotted
from hpcpic.core.case.derived import Derived, rounded_down
from hpcpic.core.cli.cures import cures
from hpcpic.core.cores import allotted, crowded
from hpcpic.core.errors import CheckFailed

DAY = 86400.0  # s
LONGEST = 30.0  # days of a run that needs no warning


def print_derived(numbers: list[Derived]) -> None:
    rows = [
        (n.name, n.symbol, shown(n.value + 0.0, ".5g"), n.unit, n.limit, n.verdict if n.limit else "", n.source)
        for n in numbers
    ]
    table(("number", "symbol", "value", "unit", "limit", "verdict", "source"), rows, right=("value",))


def numbers_of(app: App, config: Any, ranks: int) -> list[Derived]:
    """The derived numbers of a case, its outputs that would begin after its end, and its time beyond LONGEST."""
    time = whole_run(app, config, ranks)
    return [*app.derived(config, ranks), *late_outputs(app, config), *([time] if time.verdict != "ok" else [])]


def late_outputs(app: App, config: Any) -> Iterator[Derived]:
    """Periods of outputs that are longer than the run: nothing between its start and its end is seen."""
    output = getattr(config, "output", None)
    steps = config.n_steps or (config.end_time / app.time_step(config) if app.time_step else math.inf)
    for group, end, unit in (("period", config.end_time, "s"), ("every", steps, "steps")):
        for name, period in getattr(output, group, ()):
            if name != "checkpoint" and (period or 0) > end > 0:
                key, cure = ("output", group, name), rounded_down(end / 20)
                limit, source = f"<= {end:.4g} {unit}, the whole run", "only the start and the end"
                yield Derived(f"time between outputs of {name}", "", period, unit, limit, "warn", source,
                              f"{dotted(key)} = {max(1, int(cure)) if unit == 'steps' else cure:g}", key)  # fmt: skip


def whole_run(app: App, config: Any, ranks: int) -> Derived:
    """The estimated time of a run; a slip in a unit can make it centuries."""
    estimate = app.estimate(config, ranks, 1, read_rates())
    days, steps = estimate.seconds / DAY, estimate.seconds / max(estimate.step_seconds, 1e-300)
    key, cure = app.until(config, 1.0)[0].partition("=")[0], ""
    if days > LONGEST:
        end = reduce(getattr, key.split("."), config)
        enough = type(end)(float(f"{end / days:.3g}"))
        cure = f"about {steps:.2g} steps; a day is enough for {key} = {enough!r}"
    limit, words, path = f"<= {LONGEST:g}", "estimate, one thread a rank", tuple(key.split("."))
    return Derived("time of the whole run", "", days, "days", limit, "warn" if cure else "ok", words, cure, path)


def print_check(app: App, read: Case, ranks: int) -> list[Derived]:
    """Print warnings, derived numbers and what to change; returns the numbers."""
    for warning in read.tree.warnings:
        click.echo(f"warning: {warning}", err=True)
    numbers = numbers_of(app, read.config, ranks)
    print_derived(numbers)
    for number in numbers:
        if number.verdict != "ok":
            click.echo(f"{number.verdict}: {number}")
        if number.verdict == "fail":
            for line in cures(app, read, read.tree.sets, number, ranks):
                click.echo(f"  {line}")
    return numbers


def make_check_command(app_loader: AppLoader) -> click.Command:
    @click.command("check")
    @click.argument("case")
    @set_option
    @use_option
    @shape_options
    @click.option("--plan", is_flag=True, help="Also list kernels, arrays and messages of a step, and imports.")
    @click.option("--kernel", metavar="NAME", help="Print the source of a kernel written for CASE; list: their names.")
    def check(case: str, sets: tuple[str, ...], ranks: int, threads: int, plan: bool, kernel: str | None) -> None:
        """Validate a case; print every derived number with its limit, verdict and source.

        Exit code 2 when a key is wrong, 3 when a number is beyond its limit.
        """
        app = app_loader()
        read = read_case(app, case, sets)
        if kernel is not None:
            from hpcpic.core.cli.kernels import print_kernel

            print_kernel(app, read.config, kernel)
            return
        numbers = print_check(app, read, ranks)
        if crowd := crowded(ranks, threads, allotted()):
            click.echo(f"cores: {crowd}")
        if plan and app.plan:
            click.echo()
            for line in app.plan(read.config, ranks, threads):
                click.echo(line)
        verdicts = [number.verdict for number in numbers]
        if failed := verdicts.count("fail"):
            warned = f", {verdicts.count('warn')} more warn" if "warn" in verdicts else ""
            raise CheckFailed(f"refused by {failed} of {len(numbers)} derived numbers{warned}")

    return check
