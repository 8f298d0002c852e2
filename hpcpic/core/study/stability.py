"""stability: where the scheme stops being stable, found by bisection, beside the theory's limit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.read import read_case, set_option, shape_options
from hpcpic.core.app.text import shown, table
from hpcpic.core.app.use import use_option
from hpcpic.core.case.config import dotted
from hpcpic.core.errors import CheckFailed, ConfigError
from hpcpic.core.files.atomic import write_json

if TYPE_CHECKING:
    from hpcpic.core.app.knobs import Knob, Knobs
    from hpcpic.core.study.bisection import Axis, Limit, Limits

STRIP = 61  # characters from a third of the limit to three times it
SAFE = 0.8  # of the limit: beyond it a size is nearly unstable


def make_stability_command(app_loader: AppLoader) -> click.Command:
    @click.command("stability")
    @click.argument("case")
    @click.option("--knob", "name", metavar="K", help="What to turn.  [default: the first one with a limit]")
    @click.option("--map", "pair", metavar="A,B", help="The limit of A over sizes of B, as a picture.")
    @click.option("-o", "--output", metavar="DIR", help="Folder of the runs.  [default: stability/CASE]")
    @set_option
    @use_option
    @shape_options
    def stability(**asked: Any) -> None:
        """Bisect for the largest stable size of a knob of CASE; compare with the theory's limit.

        Two horizons tell a limit from slow growth, and three seeds tell it from luck where the scene draws random
        numbers. Exit code 3 when the case itself is unstable, or when the measured limit is more than 5 % below the
        theory's.
        """
        find(app_loader(), **asked)

    return stability


def find(
    app: App,
    case: str,
    name: str | None,
    pair: str | None,
    output: str | None,
    sets: tuple[str, ...],
    ranks: int,
    threads: int,
) -> None:
    """The limit of one knob, or the map of two. Raises ConfigError and CheckFailed."""
    from hpcpic.core.study.bisection import Limits
    from hpcpic.core.study.pilot import Pilots
    from hpcpic.core.study.tradeoff import knobs_of

    read = read_case(app, case, sets)
    knobs = knobs_of(app, read)
    folder = Path(output or Path("stability") / Path(read.path).stem)
    limits = Limits(Pilots(app, read, sets, knobs, folder, (ranks, threads)), knobs)
    if pair:
        first, second = two(knobs, pair)
        draw_map(limits, first, second, folder)
        return
    knob = one(knobs, name) if name else limited(limits)
    if knob.overruled:
        raise ConfigError(f"{read.path}: {dotted(knob.key)} cannot be turned to the end of stability: {knob.overruled}")
    axis = limits.axis(knob)
    limit = limits.found(axis)
    if math.isfinite(limit.x) and not limit.slow and not limit.late:
        limits.other_seeds(axis, limit)
    rates = limits.rates(axis) if limit.slow or not math.isfinite(limit.x) else []
    write_json(folder / "stability.json", facts(limits, axis, limit, rates))
    click.echo(f"search      {limits.pilots.took}")
    tell(limits, axis, limit, rates)
    judge(limits, axis, limit)


def limited(limits: Limits) -> Knob:
    """The first knob whose stability theory ends somewhere, or the first."""
    knobs = limits.knobs.knobs
    return next((knob for knob in knobs if limits.number(knob, {}) is not None), knobs[0])


def one(knobs: Knobs, name: str) -> Knob:
    """Raises ConfigError."""
    known = {knob.name: knob for knob in knobs.knobs}
    if name not in known:
        raise ConfigError(f"--knob {name}: there are {', '.join(known)}")
    return known[name]


def two(knobs: Knobs, pair: str) -> tuple[Knob, Knob]:
    names = pair.split(",")
    if len(names) != 2 or names[0] == names[1]:
        raise ConfigError(f"--map {pair}: expected two knobs, as dt,dx")
    return one(knobs, names[0]), one(knobs, names[1])


def tell(limits: Limits, axis: Axis, limit: Limit, rates: list[tuple[float, float]]) -> None:
    from hpcpic.core.study.bisection import AGREE, BLOWUP, RESOLUTION

    knob, own = axis.knob, limits.case_sizes[axis.knob.name]
    if math.isfinite(limit.x):
        size = axis.size(limit.x)
        ends = " .. ".join(f"{knob.shown(axis.size(x)):.4g}" for x in (limit.stable, limit.unstable) if x)
        click.echo(f"measured    stability ends at {knob.name} = {ends} {knob.unit}".rstrip())
        if axis.number is not None:
            number = axis.number
            ratio = limit.x if axis.theory == number.stable_below else 1.0 / limit.x
            click.echo(
                f"            {number.symbol} = {ratio * axis.theory:.4g}, theory {axis.theory:g} ({number.source}): "
                f"measured/theory = {ratio:.3f}"
            )
            if limit.x > AGREE:
                click.echo(saturated(axis))
        click.echo(f"            {confirmed(limits, axis, limit)}")
        click.echo(f"the case    {knob.name} = {knob.shown(own):.4g} {knob.unit} is {own / size:.3g} of it")
        click.echo(strip(axis.x(own) / limit.x))
        side = "larger" if axis.power > 0.0 else "smaller"
        click.echo(f"it ends     towards {side} sizes, no other was run; beyond, {limit.ended}")
    elif limit.stable is not None:
        last = f"{knob.name} = {knob.shown(axis.size(limit.stable)):.4g} {knob.unit}".rstrip()
        click.echo(f"measured    nothing grows {BLOWUP:g} times as large until {last}")
        if axis.size(limit.stable) * RESOLUTION >= knob.largest:
            click.echo(f"            larger ones are no sizes of this case: {knob.beyond}")
        if axis.number is not None:
            click.echo(saturated(axis))
    else:
        last = f"{knob.name} = {knob.shown(axis.size(limit.unstable or 0.0)):.4g} {knob.unit}"
        click.echo(f"measured    unstable down to {last}")
        click.echo(
            f"            what grows does so at any {knob.name} tried: see `check`; a calmer scene shows the limit"
        )
    tell_tried(axis, limit)
    if any(rate > 0.0 for _, rate in rates):  # none of what diverges without growth before
        click.echo("slow growth, no limit; rate of growth:" if limit.slow else "rate of growth:")
        table((with_unit(knob), "1/s"), [(shown(knob.shown(s)), shown(rate, ".3g")) for s, rate in rates])


def saturated(axis: Axis) -> str:
    """A sentence on a scene in which less grows than what counts as unstable, beyond the limit of theory."""
    theory = f"{axis.knob.shown(axis.size(1.0)):.4g} {axis.knob.unit}".strip()
    return (
        f"            beyond the theory's limit of {theory} what grows ends before that in this scene; "
        "a calmer one, as of a single small wave, shows the limit"
    )


def confirmed(limits: Limits, axis: Axis, limit: Limit) -> str:
    """A sentence on longer runs and other seeds at a limit."""
    if limit.late:
        knob = axis.knob
        end = f"stability ends at {knob.name} = {knob.shown(axis.size(limit.shorter)):.4g} {knob.unit}".rstrip()
        shorter = end if math.isfinite(limit.shorter) else "nothing grows"
        moves = "; it moves with the length of the run" if limit.slow else ""
        return f"found by runs four times as long; in shorter ones {shorter}{moves}"
    seeds = ", ".join(f"seed {seed} {'agrees' if same else 'differs'}" for seed, same in limit.seeds.items())
    if not limits.knobs.seed:
        seeds = "nothing in the scene is random, so no other seed was run"
    return f"{seeds}; four times as long {'something grows below it' if limit.slow else 'the same'}"


def tell_tried(axis: Axis, limit: Limit) -> None:
    """A table of the sizes that bisection tried, in order, with the end of stability that theory gives between them."""
    from hpcpic.core.study.bisection import BLOWUP

    rows = [(x, "diverged" if math.isinf(grown) else shown(grown, ".3g"), "unstable" if grown > BLOWUP else "stable")
            for x, grown in limit.tried.items()]  # fmt: skip
    if axis.number is not None:
        rows.append((1.0, "", "theory's limit"))
    cells = [(shown(axis.knob.shown(axis.size(x))), shown(x, ".3f"), *words) for x, *words in sorted(rows)]
    over = "over theory's limit" if axis.number is not None else "over the case's"
    click.echo(f"tried, stable where nothing grows {BLOWUP:g} times as large:")
    table((with_unit(axis.knob), over, "growth", "verdict"), cells)


def with_unit(knob: Knob) -> str:
    return f"{knob.name}, {knob.unit}" if knob.unit else knob.name


def strip(place: float) -> str:
    """A third of the limit to three times it: green, yellow from 0.8, red beyond; ^ marks the case."""
    cells = []
    for k in range(STRIP):
        x = 3.0 ** (2.0 * k / (STRIP - 1) - 1.0)
        colour = "green" if x < SAFE else "yellow" if x < 1.0 else "red"
        cells.append(click.style({"green": ".", "yellow": "!", "red": "#"}[colour], fg=colour))
    mark = round((math.log(min(max(place, 1 / 3), 3.0), 3.0) + 1.0) / 2.0 * (STRIP - 1))
    return f"            {''.join(cells)}\n            {' ' * mark}^"


def judge(limits: Limits, axis: Axis, limit: Limit) -> None:
    """Raises CheckFailed."""
    from hpcpic.core.study.bisection import AGREE

    if limit.stable is None:
        raise CheckFailed(f"no {axis.knob.name} that was tried is stable")
    if not math.isfinite(limit.x):
        return
    if axis.x(limits.case_sizes[axis.knob.name]) >= limit.x:
        raise CheckFailed(f"the case itself is unstable: {axis.knob.name} is beyond the measured limit")
    if axis.number is not None and not limit.slow and limit.x < 1.0 / AGREE:
        raise CheckFailed(f"the measured limit is {limit.x:.3f} of the theory's")


def facts(limits: Limits, axis: Axis, limit: Limit, rates: list[tuple[float, float]]) -> dict[str, Any]:
    number = axis.number
    known = math.isfinite(limit.x)
    return {
        "case": limits.pilots.read.path,
        "knob": axis.knob.name,
        "here": limits.case_sizes[axis.knob.name],
        "limit": axis.size(limit.x) if known else None,
        "measured_over_theory": limit.x if known and number is not None else None,
        "number": None if number is None else {"symbol": number.symbol, "limit": axis.theory, "source": number.source},
        "slow": limit.slow,
        "late": limit.late,
        "seeds": {str(seed): same for seed, same in limit.seeds.items()},
        "tried": [(axis.size(x), grown if math.isfinite(grown) else None) for x, grown in sorted(limit.tried.items())],
        "rates": rates,
        "runs": len(limits.pilots.done),
    }


def draw_map(limits: Limits, first: Knob, second: Knob, folder: Path) -> None:
    """map.png, map.json and a table."""
    from hpcpic.core.app.figures import save

    columns = limits.march(first, second)
    rows = [
        (second.shown(size), first.shown(axis.size(1.0)), first.shown(axis.size(limit.x)), limit.x, horizon(limit))
        for size, axis, limit in columns
    ]
    cells = [[*(shown(value) for value in row[:-1]), row[-1]] for row in rows]
    measured = f"measured, {first.unit}" if first.unit else "measured"
    theory = columns[0][1].number is not None
    beside = ("theory's limit", measured, "measured/theory") if theory else ("the case's", measured, "measured/case's")
    table((with_unit(second), *beside, "found by"), cells)
    names = ("second", "theory" if theory else "here", "measured", "ratio", "found_by")
    found = {"first": first.name, "over": second.name, "columns": [dict(zip(names, row)) for row in rows]}
    write_json(folder / "map.json", found)
    limited = [column for column in columns if math.isfinite(column[2].x)]
    if not limited:
        raise CheckFailed(f"no limit of {first.name} was found at any {second.name}: there is nothing to draw")
    save(map_figure(limits.case_sizes, first, second, limited), folder / "map.png")
    click.echo(f"map: {folder / 'map.png'}, {folder / 'map.json'}")


def horizon(limit: Limit) -> str:
    """Which runs a limit of a map is of."""
    moves = "; it moves with the length of the run" if limit.slow else ""
    return ("runs four times as long" if limit.late else "the first runs") + moves


def map_figure(
    here: Mapping[str, float], first: Knob, second: Knob, columns: Sequence[tuple[float, Axis, Limit]]
) -> Any:
    """Stable, nearly unstable and unstable sizes of the first knob over those of the second, as a case says them."""
    from matplotlib.ticker import NullFormatter

    from hpcpic.core.app.figures import COLOURS, new_figure, style

    across = [second.shown(size) for size, _, _ in columns]
    safe, measured = ([first.shown(axis.size(share * limit.x)) for _, axis, limit in columns] for share in (SAFE, 1.0))
    sizes = [here[first.name], *(axis.size(limit.x) for _, axis, limit in columns)]
    ends = [first.shown(0.3 * min(sizes)), first.shown(3.0 * max(sizes))]
    calm, wild = ends if columns[0][1].power > 0.0 else ends[::-1]
    with style():
        fig, ax = new_figure(size=(6.0, 4.0))
        ax.fill_between(across, calm, safe, color=COLOURS[2], alpha=0.35, lw=0, label="stable")
        ax.fill_between(across, safe, measured, color=COLOURS[4], alpha=0.5, lw=0, label="above 0.8 of the limit")
        ax.fill_between(across, measured, wild, color=COLOURS[1], alpha=0.35, lw=0, label="unstable")
        ax.loglog(across, measured, "o-", color="black", ms=4, label="measured")
        if columns[0][1].number is not None:
            theory = [first.shown(axis.size(1.0)) for _, axis, _ in columns]
            ax.loglog(across, theory, "--", color=COLOURS[0], label="theory")
        ax.plot(second.shown(here[second.name]), first.shown(sizes[0]), "*", ms=13, color=COLOURS[3], label="the case")
        ax.set(xlabel=with_unit(second), ylabel=with_unit(first), ylim=sorted(ends))
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.yaxis.set_minor_formatter(NullFormatter())
        ax.legend()
        return fig
