"""The work-precision front of a search: table, picture, and the recommended case with its comments."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from hpcpic.core.app.text import percent
from hpcpic.core.case.config import dotted
from hpcpic.core.case.dump import dump
from hpcpic.core.errors import CheckFailed
from hpcpic.core.files.atomic import write_atomic, write_json
from hpcpic.core.study.error_models import slope
from hpcpic.core.study.proposals import Proposal
from hpcpic.core.study.recommend import Recommendation, Verified
from hpcpic.core.study.search import Search

ERRORS = (0.1, 0.05, 0.02, 0.01, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4)


def front(recommendation: Recommendation) -> list[Proposal]:
    """The cheapest settings for a row of errors, down to what the reference is known to."""
    found: list[Proposal] = []
    for error in ERRORS:
        if error < 2.0 * recommendation.search.uncertainty:
            break
        try:
            proposal = recommendation.proposals.propose(error)
        except CheckFailed:
            break
        if not found or proposal.cost > 1.01 * found[-1].cost:
            found.append(proposal)
        else:
            found[-1] = proposal  # as cheap, and better
    return found


def measured(search: Search) -> list[tuple[str, float, float, float]]:
    """(folder, error, seconds, work) of every pilot whose error is larger than the uncertainty of the reference."""
    rows = []
    for pilot in search.pilots.done.values():
        try:
            error = search.error(search.measured(pilot))
        except CheckFailed:
            continue
        if error > search.uncertainty:
            rows.append((pilot.folder.name, error, pilot.seconds, pilot.work))
    return rows


def write(
    search: Search,
    points: list[Proposal],
    verified: Verified | None,
    refusal: str,
    tolerance: float | None,
    folder: Path,
) -> None:
    """front.csv, front.png and tradeoff.json."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("pilot", "error", "seconds", search.pilots.knobs.work_unit))
    writer.writerows(measured(search))
    write_atomic(folder / "front.csv", text.getvalue())
    write_json(folder / "tradeoff.json", facts(search, points, verified, refusal, tolerance))
    draw(search, points, verified, folder / "front.png")


def facts(
    search: Search, points: list[Proposal], verified: Verified | None, refusal: str, tolerance: float | None
) -> dict[str, Any]:
    """Laws, front and recommendation, as tradeoff.json holds them."""
    laws = search.laws.values()
    shown = {knob.name: knob.shown for knob in search.knobs}
    return {
        "case": search.pilots.read.path,
        "quantity": search.quantity.name,
        "reference": search.reference.tolist(),
        "uncertainty": search.uncertainty,
        "error_here": search.error(search.value),
        "floor": search.floor,
        "pilot_seconds": search.base.seconds,
        "pilot_work": search.base.work,
        "search_seconds": search.pilots.spent,
        "search_pilots": search.budget.used,
        "allowed_pilots": search.budget.allowance,
        "whole_over_pilot": search.pilots.knobs.time / search.quantity.time,
        "slope": slope(list(laws)),
        "knobs": {
            law.name: {
                "here": shown[law.name](law.here),
                "sizes": [shown[law.name](size) for size in law.sizes.tolist()],
                "errors": law.errors.tolist(),
                "order": law.order if np.isfinite(law.order) else None,
                "theory": law.theory,
                "safety": law.safety,
                "cost": law.cost,
                "idle": law.idle,
                "bound_here": law.bound(law.here),
            }
            for law in laws
        },
        "front": [_proposal(search, point) for point in points],
        "tolerance": tolerance,
        "refusal": refusal,
        "recommended": None if verified is None else _verified(search, verified),
    }


def _proposal(search: Search, proposal: Proposal) -> dict[str, Any]:
    return {
        "bound": proposal.bound,
        "cost": proposal.cost,
        "sizes": {knob.name: knob.shown(proposal.sizes[knob.name]) for knob in search.knobs},
        "shares": dict(proposal.shares),
        "others": dict(proposal.scheme.others),
    }


def _verified(search: Search, verified: Verified) -> dict[str, Any]:
    settings = search.pilots.assignments(
        verified.proposal.sizes, search.pilots.knobs.time, verified.proposal.scheme.others
    )
    return _proposal(search, verified.proposal) | {
        "error": verified.error,
        "field": verified.field_error if np.isfinite(verified.field_error) else None,
        "certified": verified.certified,
        "neighbours": dict(verified.neighbours),
        "seconds": verified.pilot.seconds,
        "work": verified.pilot.work,
        "warnings": verified.warnings,
        "settings": list(settings),
    }


def draw(search: Search, points: list[Proposal], verified: Verified | None, path: Path) -> None:
    """Error against seconds, and against counted work: pilots, the law of the front, the case, the recommendation."""
    from matplotlib.ticker import LogLocator, NullFormatter

    from hpcpic.core.app.figures import COLOURS, new_figure, save, style

    rows = measured(search)
    with style():
        fig, axes = new_figure(1, 2, size=(8.4, 3.6), sharey=True)
        here = search.error(search.value)
        columns = (
            (2, search.base.seconds, "seconds of the pilot's steps"),
            (3, search.base.work, search.pilots.knobs.work_unit),
        )
        for k, (column, own, label) in enumerate(columns):
            ax = axes[k]
            costs, errors = [row[column] for row in rows], [row[1] for row in rows]
            ax.loglog(costs, errors, "o", ms=4, color=COLOURS[6], label="pilots")
            if k == 0 and points:
                ax.loglog([own * p.cost for p in points], [p.bound for p in points], "-", color=COLOURS[0],
                          label="cheapest, error bound")  # fmt: skip
            ax.loglog([own], [here], "s", ms=7, color=COLOURS[1], label="the case as it is")
            if verified is not None:
                at = (verified.pilot.seconds, verified.pilot.work)[k]
                ax.loglog([at], [verified.error], "*", ms=13, color=COLOURS[2], label="recommended")
            if search.uncertainty:
                ax.axhspan(
                    1e-3 * search.uncertainty, search.uncertainty, color=COLOURS[6], alpha=0.15, lw=0,
                    label="uncertainty",
                )  # fmt: skip
            ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
            ax.xaxis.set_minor_formatter(NullFormatter())
            ax.set_xlabel(label)
        lowest = min([row[1] for row in rows] + [here, search.uncertainty or 1.0])
        lowest = min(lowest, verified.error if verified else lowest)
        axes[0].set_ylim(bottom=0.5 * max(lowest, 1e-14))
        axes[0].set_ylabel(f"relative error of {search.quantity.name}")
        fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=5)
        save(fig, path)


def write_case(search: Search, verified: Verified, tolerance: float, path: Path) -> None:
    """The recommended case, whole, with a comment beside each knob: its share of the error."""
    pilots, proposal, quantity = search.pilots, verified.proposal, search.quantity
    config = pilots.config(proposal.sizes, pilots.knobs.time, proposal.scheme.others)
    comments = {
        dotted(knob.key): f"{knob.name}: {proposal.shares[knob.name]:.1e} of the error {tolerance:.1e}"
        for knob in search.knobs
    }
    comments |= dict.fromkeys(proposal.scheme.others, "scheme")
    head = (
        f"# what: {Path(pilots.read.path).stem} with {quantity.text} right to {percent(tolerance)}"
        f"{'' if verified.certified else ', not certified'}\n"
        f"# source: tradeoff; off by {percent(verified.error)} from a reference known to "
        f"{percent(search.uncertainty)}, by runs until t = {quantity.time:.4g} of {pilots.knobs.time:.4g} s\n"
    )
    write_atomic(path, head + dump(config, comments))
