"""tradeoff: speed against accuracy over the case's own knobs, measured on short runs of the same scene."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.read import Case, read_case, set_option, shape_options
from hpcpic.core.app.text import duration, percent, shown, table
from hpcpic.core.app.use import use_option
from hpcpic.core.case.cases import read_header
from hpcpic.core.cli.launch import refuse_launcher
from hpcpic.core.errors import CheckFailed, ConfigError, FileError

if TYPE_CHECKING:
    from hpcpic.core.app.knobs import Knobs, Quantity
    from hpcpic.core.study.error_models import ErrorModel
    from hpcpic.core.study.recommend import Recommendation, Verified
    from hpcpic.core.study.record import Record
    from hpcpic.core.study.search import Search

WANTED = 0.01  # the error that matters when no tolerance is asked for


class KnobsOption(click.Option):
    """An option of which the help names the knobs of the program, and loads the app for that alone."""

    def __init__(self, *words: Any, app_loader: AppLoader, **more: Any) -> None:
        super().__init__(*words, **more)
        self.app_loader = app_loader

    def get_help_record(self, context: click.Context) -> tuple[str, str] | None:
        names = ", ".join(self.app_loader().knob_names)
        self.help = f"Vary only these knobs, chosen from {names}.  [default: all that the case has]"
        return super().get_help_record(context)


def make_tradeoff_command(app_loader: AppLoader) -> click.Command:
    @click.command("tradeoff")
    @click.argument("case")
    @click.option("--knobs", "names", metavar="A,B", cls=KnobsOption, app_loader=app_loader)
    @click.option("--qoi", metavar="Q", help="What to get right, as 'mean(force_x, from=0.5)'.  [default: the scene's]")
    @click.option("--tolerance", metavar="E", help="Relative error wanted, as 0.01 or 1%: recommend and verify.")
    @click.option("--max-cost", metavar="T", help="Refuse to recommend a run longer than this: 90s, 15m, 2h.")
    @click.option(
        "--pilots",
        "allowance",
        type=click.FloatRange(3),
        metavar="N",
        help="What search and verification may cost together, in pilots of the case's own cost.  "
        "[default: 20, or 6 s, or half of the whole run, the most of these]",
    )
    @click.option("--write", "target", metavar="FILE", help="Write the recommended case there.")
    @click.option("-o", "--output", metavar="DIR", help="Folder of the pilots.  [default: tradeoffs/CASE]")
    @set_option
    @use_option
    @shape_options
    def tradeoff(**asked: Any) -> None:
        """Measure what each knob of CASE costs and gains; with --tolerance, find the cheapest setting.

        Pilots are short runs of the same scene. The recommendation is run, and settings beside it, before it is
        given. Called again it goes on where it stopped. Exit code 3 when nothing is certified, with the ways out.

        --qoi: REDUCTION(COLUMN) or REDUCTION(COLUMN, from=T, to=T) of any column of the series, REDUCTION one of mean,
        min, max, last, curve, norm, frequency, damping, growth, peak; or `field`, the norm of a field at the end.
        """
        trade(app_loader, Asked(**asked))

    return tradeoff


@dataclass(frozen=True, slots=True)
class Asked:
    """The command line."""

    case: str
    names: str | None
    qoi: str | None
    tolerance: str | None
    max_cost: str | None
    allowance: float | None
    target: str | None
    output: str | None
    sets: tuple[str, ...]
    ranks: int
    threads: int


def trade(app_loader: AppLoader, asked: Asked) -> None:
    """Raises ConfigError, and CheckFailed without a certified recommendation."""
    from hpcpic.core.study import front
    from hpcpic.core.study.recommend import Recommendation

    wanted, limit = parse_tolerance(asked.tolerance), parse_seconds(asked.max_cost)
    if asked.target:
        refuse_target(asked.target, wanted)
    while True:
        search, record, folder = searched(app_loader(), asked, wanted)
        recommendation = Recommendation(search)
        tell_laws(recommendation)
        points = front.front(recommendation)
        tell_front(search, points)
        verified, refusal = (None, "") if wanted is None else recommended(recommendation, wanted, limit)
        certified = verified is not None and verified.certified
        affordable = search.budget.left >= search.budget.used  # the same again, with less noise
        if wanted is None or certified or not (search.quieter and affordable):
            break
        sets = " ".join(f"--set '{setting}'" for setting in search.quieter)
        click.echo(f"\nnot certified: the noise of the start hides it. Again, with less noise: {sets}")
        asked = replace(asked, sets=(*asked.sets, *search.quieter), allowance=search.budget.left)
    front.write(search, points, verified, refusal, wanted, folder)
    click.echo(f"front: {folder / 'front.png'}, {folder / 'front.csv'}, {folder / 'tradeoff.json'}")
    if wanted is None:
        click.echo(f"search      {search.pilots.took}")
        return
    if verified is not None:
        tell_recommendation(recommendation, verified, wanted)
        if certified:
            record.add(search.laws, verified.proposal.sizes, wanted)
        if asked.target:
            front.write_case(search, verified, wanted, Path(asked.target))
            click.echo(f"written: {asked.target}")
    if not certified:
        raise CheckFailed(not_certified(recommendation, verified, refusal, wanted))


def refuse_target(target: str, wanted: float | None) -> None:
    """Raises ConfigError or FileError where --write cannot be done."""
    if wanted is None:
        raise ConfigError("--write needs --tolerance")
    if Path(target).exists() and not read_header(target).source.startswith("tradeoff;"):
        raise FileError(f"{target} is there, and not from tradeoff: --write another file")
    if not (folder := Path(target).parent).is_dir():
        raise FileError(f"{folder}: no such folder, for --write {target}")


def recommended(recommendation: Recommendation, wanted: float, limit: float | None) -> tuple[Verified | None, str]:
    """The recommended run; or none, and why: the cost limit or the reference is in the way."""
    search = recommendation.search
    predicted = recommendation.expected(wanted).cost * whole_seconds(search)
    if limit is not None and predicted > limit:
        way = f"--max-cost {math.ceil(predicted)}s allows it"
        takes = f"an error of {percent(wanted)} takes {duration(predicted)}"
        return None, f"{takes}, more than {duration(limit)}: {way}"
    try:
        return recommendation.verify(wanted), ""
    except CheckFailed as error:
        return None, error.message


def not_certified(recommendation: Recommendation, verified: Verified | None, refusal: str, wanted: float) -> str:
    """Why nothing is certified, and a line for each way out."""
    from hpcpic.core.study.ways_out import ways

    if verified is None:
        unknown = percent(recommendation.search.uncertainty)
        why = f"no recommendation: {refusal}; the reference is known to {unknown}, {percent(wanted)} is asked for"
    else:
        why = f"not certified: {recommendation.why_not_certified(verified, wanted)}"
    return "\n".join([why, *(f"way out: {words}" for words in ways(recommendation, wanted))])


def whole_seconds(search: Search) -> float:
    """Seconds that the steps of the whole run of the case take, by its pilot."""
    return search.base.seconds * search.pilots.knobs.time / search.quantity.time


def searched(app: App, asked: Asked, wanted: float | None) -> tuple[Search, Record, Path]:
    """All pilots that the laws need, what earlier searches said of them, and the folder where they are."""
    from hpcpic.core.study.pilot import Pilots
    from hpcpic.core.study.record import Record
    from hpcpic.core.study.search import Search

    read = read_case(app, asked.case, asked.sets)
    knobs = knobs_of(app, read)
    quantity = chosen_quantity(app, read.config, knobs, asked.qoi)
    folder = Path(asked.output or Path("tradeoffs") / Path(read.path).stem)
    click.echo(f"{quantity.name}: {quantity.text}; pilots until t = {quantity.time:.4g} of {knobs.time:.4g} s")
    if asked.qoi is None:
        others = ", ".join(q.name for q in knobs.quantities()[1:])
        click.echo(
            f"            taken as {quantity.why or 'the case is about it'}; --qoi takes another"
            f"{f': {others}' if others else ''}, or mean(COLUMN), max(COLUMN), ... (--help)"
        )
    pilots = Pilots(app, read, asked.sets, knobs, folder, (asked.ranks, asked.threads))
    listed, choices = chosen_knobs(knobs, asked.names)
    record = Record(app.name, read, knobs, quantity)
    hints = record.hints(pilots.sizes_of(read.config), wanted) if wanted else {}
    if hints:
        near = ", ".join(f"{k.name} x {hints[k.name].factor:.2g}" for k in listed if k.name in hints)
        n = len(record.of_other_cases)
        click.echo(
            f"record      {n} earlier search{'es' if n > 1 else ''} of like scenes tell where to begin: {near}\n"
            f"            ({record.place})"
        )
    search = Search(
        pilots,
        listed,
        choices,
        quantity,
        wanted or WANTED,
        asked.allowance,
        trust_theory=wanted is not None,
        hints=hints,
    )
    return search, record, folder


def parse_tolerance(text: str | None) -> float | None:
    """ "0.01" or "1%" -> 0.01. Raises ConfigError."""
    if text is None:
        return None
    found = re.fullmatch(r"\s*([0-9.]+(?:[eE][-+]?\d+)?)\s*(%?)\s*", text)
    try:
        value = float(found[1]) * (0.01 if found[2] else 1.0) if found else 0.0
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1.0:
        raise ConfigError(f"--tolerance {text}: expected a relative error such as 0.01 or 1%")
    return value


def parse_seconds(text: str | None) -> float | None:
    from hpcpic.core.run.triggers import EverySeconds, parse_interval

    if text is None:
        return None
    interval = parse_interval(text)
    if not isinstance(interval, EverySeconds):
        raise ConfigError(f"--max-cost {text}: expected a time such as 90s, 15m or 2h")
    return interval.seconds


def knobs_of(app: App, read: Case) -> Knobs:
    """Raises ConfigError for a program that has none, and under mpirun."""
    refuse_launcher()
    if app.knobs is None:
        raise ConfigError(f"{app.name} has no knobs to turn")
    knobs = app.knobs(read.config)
    if not knobs.time:
        raise ConfigError(f"{read.path}: a run of no steps shows no error and no instability")
    return knobs


def scalars_of(app: App, config: Any) -> list[str]:
    """Names of the series of a case: of a simulator that is set up and takes no step."""
    from hpcpic.core.comm.world import World
    from hpcpic.core.tasks.graph import Pool
    from hpcpic.core.timers import Timers

    pool = Pool(1)
    try:
        model = app.load()(config, World.alone(), pool, Timers())
        model.close()
        return list(model.scalar_units)
    finally:
        pool.close()


def chosen_quantity(app: App, config: Any, knobs: Knobs, name: str | None) -> Quantity:
    """By name, or the first; any reduction of a column of the series is one. Raises ConfigError."""
    from hpcpic.core.app.knobs import Quantity
    from hpcpic.core.study.quantities import parsed

    known = knobs.quantities()
    if name is None:
        return known[0]
    for quantity in known:
        if quantity.name == name:
            return replace(quantity, asked=True)
    if name == "field" and knobs.seen:
        text = f"the field {knobs.seen.name} at the end, seen through windows of a twelfth of the box"
        return Quantity(name, text, knobs.time, lambda series: math.nan, field=True, asked=True)
    return parsed(name, scalars_of(app, config), knobs)


def chosen_knobs(knobs: Knobs, names: str | None) -> tuple[list, list]:
    """Knobs and choices by name. Raises ConfigError."""
    known = [knob.name for knob in knobs.knobs] + [choice.name for choice in knobs.choices]
    asked = names.split(",") if names else known
    unknown = [name for name in asked if name not in known]
    if unknown:
        raise ConfigError(f"--knobs {','.join(unknown)}: there are {', '.join(known)}")
    listed = [knob for knob in knobs.knobs if knob.name in asked]
    if not listed:
        raise ConfigError(f"--knobs {names}: at least one of {', '.join(knob.name for knob in knobs.knobs)}")
    return listed, [choice for choice in knobs.choices if choice.name in asked]


def order_words(law: ErrorModel) -> str:
    """The observed order of a law, or why there is none."""
    if law.idle:
        return "no effect"
    if law.assumed:
        return "not seen"
    return "none" if math.isnan(law.order) else f"{law.order:.2f}"


def asymptotic_words(law: ErrorModel) -> str:
    """Whether the errors of a law fall with the size as theory says; else the order and the safety that count."""
    if law.idle:
        return ""
    if law.steady:
        return "yes"
    if law.assumed:
        return "by theory, to be checked"
    if law.asymptotic:
        return f"no: scatters about order {law.used:g}"
    if law.random:
        return f"drawn: 95 % within order {law.used:g}"
    return f"no: order {law.used:g}, safety {law.safety:g}"


def tell_laws(recommendation: Recommendation) -> None:
    search, rows = recommendation.search, []
    for knob in search.knobs:
        law = search.laws[knob.name]
        levels = ", ".join(f"{knob.shown(size):.4g}" for size in law.sizes)
        here = shown(knob.shown(law.here), ".4g", knob.unit)
        error = percent(law.bound(law.here))
        orders = order_words(law), shown(law.theory, "g"), asymptotic_words(law)
        rows.append((knob.name, here, levels, *orders, error, shown(law.cost, ".2f"), shown(knob.cost, "g")))
    click.echo()
    heads = ("knob", "here", "pilots", "order", "theory", "asymptotic", "bound here", "cost exponent", "its theory")
    table(heads, rows, right=("bound here",))
    for scheme in recommendation.proposals.schemes[1:]:
        own = f", error {percent(scheme.floor)}" if scheme.floor else ""
        click.echo(f"{scheme.words}: {scheme.cost:.2f} times the cost{own}")
    known = "" if search.quantity.exact is None else f", {percent(search.floor)} of it from no knob"
    click.echo(
        f"reference   {' '.join(f'{v:.6g}' for v in search.reference[:6])}, known to {percent(search.uncertainty)}; "
        f"the case itself is off by {percent(search.error(search.value))}{known}"
    )
    if search.left_out:
        finer = "" if search.finer else "; no pilot is finer than the case"
        taken = f"{search.budget.used:.3g} of {search.budget.share:.3g} are taken"
        click.echo(f"left out    {search.left_out}: {taken}{finer}")


def sizes_text(search: Search, sizes: Any) -> str:
    return "  ".join(f"{knob.name} = {knob.shown(sizes[knob.name]):.4g}" for knob in search.knobs)


def tell_front(search: Search, points: list) -> None:
    from hpcpic.core.study.error_models import slope

    whole = whole_seconds(search)
    click.echo()
    if not points:
        click.echo(f"front: none, as the reference is known to {percent(search.uncertainty)} only")
        return
    rows = [
        (percent(p.bound), shown(p.cost * whole, ".3g"), against(1 / p.cost),
         sizes_text(search, p.sizes), p.scheme.words)
        for p in points
    ]  # fmt: skip
    table(("error bound", "seconds", "beside the case", "settings", "scheme"), rows, right=("seconds",))
    laws = list(search.laws.values())
    click.echo(f"the case as it is: {whole:.3g} s; cost ~ error^-{slope(laws):.2f} by the laws")


def against(ratio: float, more: str = "faster", less: str = "dearer") -> str:
    """ "3 times faster", or "4 times dearer" for 0.25."""
    return f"{ratio:.3g} times {more}" if ratio >= 1.0 else f"{1 / ratio:.3g} times {less}"


def tell_recommendation(recommendation: Recommendation, verified: Verified, wanted: float) -> None:
    search = recommendation.search
    proposal, scale = verified.proposal, search.pilots.knobs.time / search.quantity.time
    click.echo()
    rows = [
        (knob.name, f"{knob.shown(search.case_sizes[knob.name]):.5g}",
         f"{knob.shown(proposal.sizes[knob.name]):.5g} {knob.unit}", percent(proposal.shares[knob.name]))
        for knob in search.knobs
    ]  # fmt: skip
    rows += [(name, "", "", percent(share)) for name, share in proposal.shares.items() if name not in search.laws]
    table(("knob", "here", "recommended", "share of the error"), rows)
    if proposal.scheme.others:
        click.echo(f"with {proposal.scheme.words}")
    seconds = verified.pilot.seconds * scale
    faster, fewer = search.base.seconds * scale / seconds, search.base.work / verified.pilot.work
    estimated = search.base.price / verified.pilot.price
    beside = [f"{words} neighbour {percent(error)}" for words, error in verified.neighbours.items()]
    dearest = recommendation.neighbour_allowance(proposal)
    left_out = " and ".join(words for words in ("coarser", "finer") if words not in verified.neighbours)
    beside += [f"{left_out} neighbour not run: dearer than {dearest:.2g} pilots, or beyond a limit"] if left_out else []
    seen, field_error = search.pilots.knobs.seen, verified.field_error
    field = f"; {seen.name} at the end off by {percent(field_error)}" if seen and field_error >= 0.0 else ""
    compared = (
        f", {against(faster)} than the case (estimated: {against(estimated)}); "
        f"{against(fewer, 'fewer', 'more')} {search.pilots.knobs.work_unit}"
    )
    compared = ": it is the case itself" if verified.pilot is search.base else compared
    head = "certified   " if verified.certified else "marked      NOT certified: "
    click.echo(
        f"{head}off by {percent(verified.error)}, from a reference known to {percent(search.uncertainty)}: together "
        f"{percent(verified.error + search.uncertainty)}, where {percent(wanted)} is allowed\n"
        f"            {', '.join(beside)}{field}\n"
        f"cost        {duration(seconds)} for the whole run{compared}\n"
        f"search      {search.pilots.took}, "
        f"{search.budget.used:.3g} of {search.budget.allowance:.3g} pilots of the case's own cost"
    )
    for warning in verified.warnings:
        click.echo(f"warning: {warning}", err=True)
