#!/usr/bin/env python3
"""Does `tradeoff` keep what it promises? Shipped cases, or other scenes, at several tolerances, against finer runs.

python scripts/tradeoff_goals.py PROGRAM [CASE ...] [-o FOLDER]
python scripts/tradeoff_goals.py PROGRAM tests/validation/scenes/PROGRAM/*.conf

A row per case and tolerance: certified, marked (met as far as pilots know) or refused, and what it was: kept, missed by
up to 1.5 times the tolerance, or wrong. The truth is a run finer in every knob, its remaining errors taken off by their
theory's order, or the exact value where there is one. Times faster: than the case as it is written. A scene says its
quantity in a line `# quantity:`. Then, for shipped cases, what each costs beside the cheapest settings whose error
bound is that of the case.
"""

from __future__ import annotations

import argparse
import json
import re
import statistics
import tempfile
import time
from collections import Counter
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from hpcpic.core.app.read import read_case
from hpcpic.core.app.text import percent, table
from hpcpic.core.errors import CheckFailed
from hpcpic.core.study.error_models import norm
from hpcpic.core.study.pilot import Pilots
from hpcpic.core.study.recommend import Recommendation, Verified
from hpcpic.core.study.record import Record
from hpcpic.core.study.search import Search
from hpcpic.core.study.tradeoff import chosen_quantity
from hpcpic.core.study.ways_out import ways

TOLERANCES = (0.05, 0.02, 0.01, 0.005)  # the last one of shipped cases only
CASES = {  # those that take seconds
    "sph": ("poiseuille", "elliptical-drop", "taylor-green", "standing-wave", "water-column"),
    "lbmdem": ("poiseuille", "couette", "taylor-green"),
}
FINER = {0.5: 4.0, 1.0: 2.0, 2.0: 2.0}  # how much finer the truth is in a knob of this order
MATTERS = 5e-4  # relative error of a knob that is worth a finer run
MOST = 12.0  # s of steps of a truth, by the estimate
NEARLY = 1.5  # times the tolerance: what is beyond is wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", choices=("hpcpic", "sph", "lbmdem"))
    parser.add_argument("cases", nargs="*", metavar="CASE")
    parser.add_argument("-o", "--output", type=Path, help="where the runs stay")
    parser.add_argument("--own-scheme", action="store_true", help="without other schemes, which are compiled first")
    parser.add_argument("--record", action="store_true", help="read and write the record of searches in the cache")
    asked = parser.parse_args()
    app = import_module(f"{asked.program}.__main__").load_app()
    found: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = asked.output or Path(scratch)
        for case in asked.cases or CASES.get(asked.program) or app.cases():
            found.append(measure(app, case, folder / Path(case).stem, asked.own_scheme, asked.record))
            if asked.output:
                (folder / f"{asked.program}-goals.json").write_text(json.dumps(found, indent=1))
            print(f"--- {case}: {found[-1]['wall']:.0f} s", flush=True)
    tell(found)
    return 0


def measure(app: Any, case: str, folder: Path, own_scheme: bool = False, recorded: bool = False) -> dict[str, Any]:
    """The row of one case."""
    read = read_case(app, case)
    said = re.search(r"^# quantity: (.*)", Path(read.path).read_text(), re.M)
    quantity = chosen_quantity(app, read.config, app.knobs(read.config), said[1] if said else None)
    started = time.perf_counter()

    def search(wanted: float, sets: tuple[str, ...] = (), trust_theory: bool = True) -> tuple[Search, Record]:
        start = read_case(app, case, sets)
        knobs = app.knobs(start.config)
        pilots = Pilots(app, start, sets, knobs, folder, (1, 1))
        record = Record(app.name, start, knobs, quantity)
        hints = record.hints(pilots.sizes_of(start.config), wanted) if recorded and trust_theory else {}
        choices = () if own_scheme else knobs.choices
        return Search(pilots, knobs.knobs, choices, quantity, wanted, trust_theory=trust_theory, hints=hints), record

    def tried(tolerance: float, sets: tuple[str, ...] = ()) -> tuple[Recommendation, Verified | None, dict[str, Any]]:
        one, record = search(tolerance, sets)
        found = verified(one, tolerance)
        if recorded and found[1] is not None and found[1].certified:
            record.add(one.laws, found[1].proposal.sizes, tolerance)
        return found

    def sought(tolerance: float) -> tuple[Recommendation, Verified | None, dict[str, Any]]:
        """As the command does: again with a start of less noise where noise hides what is asked for."""
        found = tried(tolerance)
        certified, quieter = found[1] is not None and found[1].certified, found[0].search.quieter
        if certified or not quieter:
            return found
        again = tried(tolerance, quieter)
        return *again[:2], again[2] | {key: again[2][key] + found[2][key] for key in ("pilots", "runs")}

    tolerances = TOLERANCES[:3] if said else TOLERANCES
    result: dict[str, Any] = {"case": Path(case).stem, "quantity": quantity.name}
    try:
        made = [sought(tolerance) for tolerance in tolerances]
        finest = made[-1][0].search
        truth = true_value(finest, [run.proposal.sizes for _, run, _ in made if run])
        whole = finest if said else search(tolerances[-1], trust_theory=False)[0]
        result["orders"] = {n: (w.order, w.theory, w.asymptotic) for n, w in whole.laws.items() if not w.idle}
        result["truth"], result["own_error"] = truth.tolist(), norm(finest.value - truth) / norm(truth)
        result["rows"] = [row(*one, truth, tolerance) for one, tolerance in zip(made, tolerances)]
        result["equal"] = None if said else equal(whole)
    except CheckFailed as error:
        result["rows"] = [{"tolerance": t, "what": "refused", "ways": [], "why": error.message} for t in tolerances]
    return result | {"wall": time.perf_counter() - started}


def verified(one: Search, tolerance: float) -> tuple[Recommendation, Verified | None, dict[str, Any]]:
    """What is recommended at one tolerance, or why nothing is; and what that took."""
    made = Recommendation(one)
    try:
        return made, made.verify(tolerance), spent(one)
    except CheckFailed as error:
        return made, None, {**spent(one), "why": error.message, "ways": ways(made, tolerance)}


def row(
    made: Recommendation, verified: Verified | None, told: dict[str, Any], truth: np.ndarray, tolerance: float
) -> dict[str, Any]:
    """What the recommendation of one tolerance is."""
    one = made.search
    told |= {"tolerance": tolerance, "uncertainty": one.uncertainty}
    if verified is None:
        return told | {"what": "refused"}
    error = norm(one.measured(verified.pilot) - truth) / norm(truth)
    kept = "kept" if error <= tolerance else "nearly" if error <= NEARLY * tolerance else "wrong"
    return told | {
        "what": f"{'certified' if verified.certified else 'marked'}, {kept}",
        "error": error,
        "said": verified.error,
        "field": verified.field_error,
        "seconds": one.base.seconds / verified.pilot.seconds,
        "work": one.base.work / verified.pilot.work,
        "settings": made.proposals.text(verified.proposal),
        "warnings": verified.warnings,
    }


def spent(one: Search) -> dict[str, float]:
    return {"pilots": one.budget.used, "runs": len(one.pilots.done)}


def true_value(search: Search, recommended: list[Any]) -> np.ndarray:
    """The exact value, or that of a run finer than all that is recommended, and than the case, in every knob that makes
    an error there, with what is left of its errors taken off.
    """
    if search.quantity.exact is not None:
        return np.full_like(search.value, search.quantity.exact)
    for part in (1.0, 0.7, 0.5, 0.3):  # of the way, in logs, as the run may take MOST seconds
        sizes, left = {}, np.zeros_like(search.value)
        for knob in search.knobs:
            law, name = search.laws[knob.name], knob.name
            least = min([sizes[name] for sizes in recommended], default=search.case_sizes[name])
            matters = law.bound(least) > MATTERS
            least = min(least, search.case_sizes[name]) if matters else least
            sizes[name] = least / (FINER.get(knob.order, 2.0) ** part if matters else 1.0)
            left += law.signed * (sizes[name] / law.here) ** law.used if law.asymptotic and not law.idle else 0.0
        work = search.pilots.knobs.work(search.pilots.config(sizes, search.quantity.time, {}))
        if work / search.base.work * search.base.price < MOST:
            break
    pilot = search.pilot(sizes, words="the truth")
    return search.measured(pilot) - search.scale * left


def equal(search: Search) -> dict[str, Any]:
    """The cheapest settings whose bound is that of the case, run: how much faster, how much less work."""
    made = Recommendation(search)
    bound = sum(law.bound(law.here) for law in search.laws.values()) + search.floor
    try:
        proposal = made.proposals.propose(bound)
        pilot = search.pilot(proposal.sizes, proposal.scheme.others, "as good as the case")
        while (error := search.error(search.measured(pilot))) > bound and pilot.work < search.base.work:
            proposal = made.proposals.halfway(proposal)
            pilot = search.pilot(proposal.sizes, proposal.scheme.others, "as good as the case")
    except CheckFailed as failure:
        return {"bound": bound, "refused": failure.message}
    seconds, work = search.base.seconds / pilot.seconds, search.base.work / pilot.work
    return {"bound": bound, "error": error, "seconds": seconds, "work": work}


def tell(found: list[dict[str, Any]]) -> None:
    rows: list[tuple[str, ...]] = []
    counts: Counter[str] = Counter()
    pilots: list[float] = []
    for case in found:
        for row in case["rows"]:
            counts[row["what"]] += 1
            pilots += [row["pilots"]] if "pilots" in row else []
            shares = [percent(row[key]) if key in row else "" for key in ("error", "said", "uncertainty")]
            numbers = [f"{row[key]:.3g}" if key in row else "" for key in ("seconds", "work", "pilots")]
            rows.append((case["case"], case["quantity"], percent(row["tolerance"]), row["what"], *shares, *numbers))
    heads = ("case", "quantity", "tolerance", "", "true error", "said", "known to", "faster", "less work", "pilots")
    table(heads, rows)
    shipped = [case for case in found if case.get("equal")]
    for case in shipped:
        numbers = [f"{case['equal'].get(key, np.nan):.3g}" for key in ("bound", "error", "seconds", "work")]
        print(f"{case['case']}: error bound as shipped, error, times faster, less work of the cheapest: ", *numbers)
    print()
    orders = [
        (case["case"], name, f"{order:.2f}", f"{theory:g}", "" if steady else "not asymptotic")
        for case in found
        for name, (order, theory, steady) in case.get("orders", {}).items()
    ]
    table(("case", "knob", "order", "theory", ""), orders)
    for case in found:
        for row in case["rows"]:
            if row["what"] == "refused":
                print(f"refused: {case['case']} at {percent(row['tolerance'])}: {row['why']}")
                print("\n".join(f"    way out: {way}" for way in row["ways"]))
    print(", ".join(f"{name} {count}" for name, count in counts.items()))
    if pilots:
        print(f"search, pilots of the case's own cost: median {statistics.median(pilots):.3g}, most {max(pilots):.3g}")


if __name__ == "__main__":
    raise SystemExit(main())
