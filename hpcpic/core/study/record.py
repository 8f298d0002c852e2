"""The record of earlier searches, in the user's cache.

It says where the next search of a like scene puts its first pilots, and nothing else: errors are measured and
recommendations run as without it.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpcpic.core.app.knobs import Knob
from hpcpic.core.case.schema import Section
from hpcpic.core.case.texts import value_text
from hpcpic.core.simd.caches import Store

if TYPE_CHECKING:
    from hpcpic.core.app.knobs import Knobs, Quantity
    from hpcpic.core.app.read import Case
    from hpcpic.core.study.error_models import ErrorModel

MAX_SEARCHES = 50  # searches of one kind of scene
NAMES = ("name", "description")  # settings whose text says nothing of the kind of a scene
UNIMPORTANT_GROUPS = ("output", "gauge")  # groups that likewise do not
EXTRAPOLATION = 4.0  # times a size that was recommended: no law is followed beyond
FINEST, COARSEST, COARSEST_DRAWN = 0.5, 4.0, 64.0  # times the case's own size: levels that a record asks for
NEAR = 1.4  # times the case's own size: what lies nearer is the case itself


@dataclass(frozen=True, slots=True)
class Law:
    """One knob in an earlier search. size: recommended, in parts of the scene's (see Record.unit), where the error was
    `error`; its order, observed if `steady`; cost ~ size^-cost.
    """

    size: float
    error: float
    order: float
    steady: bool
    cost: float

    def foreseen(self, error: float) -> float:
        """The size at which the error would be so large."""
        most = EXTRAPOLATION * self.size
        return min(self.size * (error / self.error) ** (1.0 / self.order), most) if self.error else most


@dataclass(frozen=True, slots=True)
class Hint:
    """A hint of an earlier search on one knob: a factor on the case's own size, and whether the order was observed."""

    factor: float
    steady: bool

    def levels(self, noisy: bool) -> tuple[float, ...]:
        """Factors of the first levels, where the recommendation is likely to lie; none where that is the case."""
        if noisy:
            far = min(self.factor, COARSEST_DRAWN)
            return (0.25 * far, far) if far > 4.0 * NEAR else ()
        factor = min(max(self.factor, FINEST), COARSEST)
        return (factor,) if self.steady and not 1.0 / NEAR < factor < NEAR else ()


@dataclass(frozen=True, slots=True)
class PastSearch:
    """A search that certified a setting: digest of its case, tolerance, law of each knob."""

    case: str
    tolerance: float
    laws: Mapping[str, Law]


class Record:
    """Earlier searches of a kind of scene: the same program, groups, words and quantity, whatever the numbers.

    Without a folder of the user's own that nobody else can change there are none. Those of the very same case are left
    out, as their pilots are there: the same command goes on where it stopped.
    """

    def __init__(self, program: str, read: Case, knobs: Knobs, quantity: Quantity) -> None:
        self.knobs, self.time = knobs, float(quantity.time)
        self.case = digest([read.tree.files, read.tree.sets])
        kind = [program, re.sub(r"[-+]?[\d.]+", "#", quantity.name), *sorted(words(read.config))]
        self.name = f"{digest(kind)}.jsonl"
        self.store = Store("record of searches", "searches")

    @property
    def place(self) -> str:
        return str(self.store.folder.path / self.name) if self.store.folder else ""

    @cached_property
    def searches(self) -> list[PastSearch]:
        """The searches, the last one last. A damaged record is none: the log says so."""
        content = self.store.read(self.name)
        try:
            lines = [json.loads(line) for line in (content or b"").splitlines()]
            return [PastSearch(str(line["case"]), positive(line["tolerance"]), laws_of(line["laws"])) for line in lines]
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            self.store.damaged(f"{self.name} holds no searches: {error}")
            return []

    @property
    def of_other_cases(self) -> list[PastSearch]:
        """The searches of other cases."""
        return [one for one in self.searches if one.case != self.case]

    def unit(self, knob: Knob) -> float:
        """The unit of sizes in the record, so that large and small scenes compare: the box's longest side, a pilot's
        time.
        """
        seen = self.knobs.seen
        box = max((b - a for a, b in zip(seen.low, seen.high)), default=1.0) if seen else 1.0
        return {"m": box, "s": self.time}.get(knob.unit, 1.0)

    def hints(self, own: Mapping[str, float], wanted: float) -> dict[str, Hint]:
        """By knob, from the search whose tolerance was nearest, and of those the last."""
        if not self.of_other_cases:
            return {}
        laws = min(reversed(self.of_other_cases), key=lambda one: abs(math.log(one.tolerance / wanted))).laws
        share = wanted / max(len(laws), 1)
        return {
            knob.name: Hint(law.foreseen(share) * self.unit(knob) / own[knob.name], law.steady)
            for knob in self.knobs.knobs
            if (law := laws.get(knob.name))
        }

    def add(self, models: Mapping[str, ErrorModel], sizes: Mapping[str, float], tolerance: float) -> None:
        """One more search, which certified these sizes, in place of an earlier one of the same case and tolerance."""
        laws = {}
        for knob in self.knobs.knobs:
            if (model := models.get(knob.name)) is not None:
                size, steady = float(sizes[knob.name]), model.steady or model.assumed or model.idle
                laws[knob.name] = Law(size / self.unit(knob), model.bound(size), model.used, steady, model.cost)
        kept = [one for one in self.searches if (one.case, one.tolerance) != (self.case, tolerance)]
        lines = [json.dumps(asdict(one)) for one in [*kept, PastSearch(self.case, tolerance, laws)][-MAX_SEARCHES:]]
        self.store.write(self.name, "".join(f"{line}\n" for line in lines).encode())


def digest(what: Any) -> str:
    return hashlib.sha256(json.dumps(what).encode()).hexdigest()[:16]


def positive(value: Any, least: float = 1e-300) -> float:
    """The value, a finite number of at least `least`. Raises ValueError."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value < 1e300:
        raise ValueError(f"{value!r} is not possible")
    return float(value)


def laws_of(laws: Mapping[str, Mapping[str, Any]]) -> dict[str, Law]:
    """The laws in a line of the record. Raises ValueError, TypeError or KeyError where it holds none."""
    return {
        name: Law(positive(law["size"]), positive(law["error"], 0.0), positive(law["order"]), law["steady"] is True,
                  positive(law["cost"], 0.0))
        for name, law in laws.items()
    }  # fmt: skip


def words(section: Section, path: str = "") -> Iterator[str]:
    """The settings of a completed case that are not zero, those that are words with their values."""
    for name in type(section).model_fields:
        value, key = getattr(section, name), f"{path}{name}"
        groups = value if isinstance(value, tuple) else (value,)
        if name in NAMES or key in UNIMPORTANT_GROUPS:
            continue
        if any(isinstance(group, Section) for group in groups):
            for group in groups:
                yield key
                yield from words(group, f"{key}.")
        elif np.asarray(value).dtype.kind in "iuf":
            yield from [key] if np.any(value) else []
        elif value:
            yield f"{key}={value_text(value)}"
