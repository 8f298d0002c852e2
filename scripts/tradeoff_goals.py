#!/usr/bin/env python3
"""Does `tradeoff` keep what it promises? Shipped cases of a program, at four tolerances, against finer runs.

python scripts/tradeoff_goals.py PROGRAM [CASE ...] [-o FOLDER]

A row per case and tolerance: recommended and right, wrong, or refused. The truth is a run finer in every knob than any
pilot of the search, its remaining errors of space and time taken off by their theory's order, or the exact value where
there is one. Then what the shipped case costs beside the cheapest settings whose error bound is that of the case.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from hpcpic.core.app.read import read_case
from hpcpic.core.app.text import table
from hpcpic.core.errors import CheckFailed
from hpcpic.core.study.error_models import norm
from hpcpic.core.study.pilot import Pilots
from hpcpic.core.study.search import Search

TOLERANCES = (0.05, 0.02, 0.01, 0.005)
CASES = {  # those that take seconds
    "sph": ("poiseuille", "elliptical-drop", "taylor-green", "standing-wave", "water-column"),
    "lbmdem": ("poiseuille", "couette", "taylor-green"),
}
FINER = {0.5: 4.0, 1.0: 4.0, 2.0: 2.0}  # how much finer the truth is in a knob of this order


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", choices=("hpcpic", "sph", "lbmdem"))
    parser.add_argument("cases", nargs="*", metavar="CASE")
    parser.add_argument("-o", "--output", type=Path, help="where the runs stay")
    asked = parser.parse_args()
    app = import_module(f"{asked.program}.__main__").load_app()
    found: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = asked.output or Path(scratch)
        for case in asked.cases or CASES.get(asked.program) or app.cases():
            try:
                found.append(measure(app, case, folder / Path(case).stem))
            except CheckFailed as error:
                found.append({"case": case, "refused": error.message})
            if asked.output:
                (folder / "goals.json").write_text(json.dumps(found, indent=1))
    tell(found)
    return 0


def measure(app: Any, case: str, folder: Path) -> dict[str, Any]:
    """Of one case. Raises CheckFailed where not even the laws can be measured."""
    read = read_case(app, case)
    knobs = app.knobs(read.config)
    quantity = knobs.quantities()[0]
    started = time.perf_counter()

    def search(wanted: float) -> Search:
        return Search(Pilots(app, read, (), knobs, folder, (1, 1)), knobs.knobs, knobs.choices, quantity, wanted)

    finest = search(TOLERANCES[-1])
    truth = true_value(finest)
    rows = []
    for tolerance in TOLERANCES:
        one = search(tolerance)
        try:
            verified = one.verify(tolerance)
        except CheckFailed as error:
            rows.append({"tolerance": tolerance, "refused": error.message})
            continue
        error = norm(one.measured(verified.pilot) - truth) / norm(truth)
        rows.append(
            {
                "tolerance": tolerance,
                "error": error,
                "seconds": one.base.seconds / verified.pilot.seconds,
                "work": one.base.work / verified.pilot.work,
                "pilots": one.pilots.spent / one.base.seconds,
                "warned": bool(verified.warnings),
            }
        )
    orders = {law.name: (law.order, law.theory, law.asymptotic) for law in finest.laws.values() if not law.idle}
    return {
        "case": case,
        "quantity": quantity.name,
        "orders": orders,
        "rows": rows,
        "equal": equal(finest),
        "wall": time.perf_counter() - started,
    }


def true_value(search: Search) -> np.ndarray:
    """The exact value, or that of a finer run with what is left of its errors taken off."""
    if search.quantity.exact is not None:
        return np.full_like(search.value, search.quantity.exact)
    sizes, left = {}, np.zeros_like(search.value)
    for knob in search.knobs:
        law = search.laws[knob.name]
        factor = 1.0 if law.idle else FINER.get(knob.order, 2.0)
        sizes[knob.name] = search.own[knob.name] / factor
        left += law.signed * factor**-knob.order if law.asymptotic and not law.idle else 0.0
    pilot = search.pilot(sizes, words="the truth")
    return search.measured(pilot) - search.scale * left


def equal(search: Search) -> dict[str, Any]:
    """The cheapest settings whose bound is that of the case, run: how much faster, how much less work."""
    bound = sum(law.bound(law.here) for law in search.laws.values()) + search.floor
    try:
        proposal = search.propose(bound)
        pilot = search.pilot(proposal.sizes, proposal.scheme.others, "as good as the case")
        while (error := search.error(search.measured(pilot))) > bound and pilot.work < search.base.work:
            proposal = search.nearer(proposal, 0.5)
            pilot = search.pilot(proposal.sizes, proposal.scheme.others, "as good as the case")
    except CheckFailed as failure:
        return {"bound": bound, "refused": failure.message}
    seconds, work = search.base.seconds / pilot.seconds, search.base.work / pilot.work
    return {"bound": bound, "error": error, "seconds": seconds, "work": work}


def tell(found: list[dict[str, Any]]) -> None:
    rows, counts = [], {"met": 0, "missed": 0, "missed by 2 unwarned": 0, "refused": 0}
    for case in found:
        for row in case.get("rows", []):
            how = "refused" if "refused" in row else "met" if row["error"] <= row["tolerance"] else "missed"
            counts[how] += 1
            badly = how == "missed" and row["error"] > 2 * row["tolerance"] and not row["warned"]
            counts["missed by 2 unwarned"] += badly
            numbers = [f"{row[key]:.3g}" if key in row else "" for key in ("error", "seconds", "work", "pilots")]
            rows.append((case["case"], case["quantity"], f"{row['tolerance']:g}", how, *numbers))
        if "rows" not in case:
            rows.append((case["case"], "", "", case["refused"]))
    heads = ("case", "quantity", "tolerance", "", "true error", "times faster", "times less work", "search, pilots")
    table(heads, [(*row, *[""] * (len(heads) - len(row))) for row in rows])
    print()
    rows = []
    for case in filter(lambda case: "equal" in case, found):
        numbers = (f"{case['equal'].get(key, np.nan):.3g}" for key in ("bound", "error", "seconds", "work"))
        rows.append((case["case"], *numbers))
    table(("case", "error bound as shipped", "error of the cheapest", "times faster", "times less work"), rows)
    print()
    rows = [
        (case["case"], name, f"{order:.2f}", f"{theory:g}", "" if steady else "not asymptotic")
        for case in found
        for name, (order, theory, steady) in case.get("orders", {}).items()
    ]
    table(("case", "knob", "order", "theory", ""), rows)
    print(", ".join(f"{name} {count}" for name, count in counts.items()))


if __name__ == "__main__":
    raise SystemExit(main())
