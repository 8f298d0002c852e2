"""Numbers that follow from a case, with limits: what `check` prints and what stops a run before it starts."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

from hpcpic.core.case.config import Path, Tree, dotted
from hpcpic.core.errors import ConfigError

Verdict = Literal["ok", "warn", "fail"]
FIRM = "--force, in Python force=True, does not lift this limit"  # said where it was tried


@dataclass(frozen=True, slots=True)
class Derived:
    """One number. limit: in words, as "< 2". cure: what to change, with a value that is legal.

    verdict "fail" refuses the run; forceable: --force turns that into a warning. key: the setting to change.
    stable_below, stable_above: where theory ends the stability of the scheme, for `stability` and `tradeoff`.
    """

    name: str
    symbol: str
    value: float
    unit: str = ""
    limit: str = ""
    verdict: Verdict = "ok"
    source: str = ""
    cure: str = ""
    key: Path = ()
    forceable: bool = False
    stable_below: float = math.inf
    stable_above: float = -math.inf

    def __str__(self) -> str:
        name = f"{self.name} {self.symbol}" if self.symbol else self.name
        unit = f" {self.unit}" if self.unit else ""
        limit = f" (limit {'; '.join(filter(None, (self.limit, self.source)))})" if self.limit else ""
        cure = f": {self.cure}" if self.cure else ""
        return f"{name} = {self.value:.4g}{unit}{limit}{cure}"


def judged(name: str, symbol: str, value: float, *, ok: bool, legal: bool = False, cure: str, **more: Any) -> Derived:
    """A number with its verdict: "ok", which needs no cure, else "warn" where it is legal, else "fail".

    more: the other fields of Derived.
    """
    verdict: Verdict = "ok" if ok else "warn" if legal else "fail"
    return Derived(name, symbol, value, verdict=verdict, cure="" if ok else cure, **more)


def rounded_up(value: float) -> float:
    """The smallest number of two digits that is not below value > 0."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / scale * (1 - 1e-12)) * scale:.2g}")


def rounded_down(value: float) -> float:
    """The largest number of two digits that is not above value > 0."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / scale * (1 + 1e-12)) * scale:.2g}")


def enforce(numbers: Iterable[Derived], tree: Tree, force: bool = False) -> list[str]:
    """The warnings of a case. Raises ConfigError with every refusal, placed at the key to change."""
    warnings, refusals = [], []
    for number in numbers:
        if number.verdict == "warn":
            warnings.append(str(number))
        elif number.verdict == "fail" and force and number.forceable:
            warnings.append(f"{number} (refused without --force)")
        elif number.verdict == "fail":
            hint = " (--force runs it, in Python force=True)" if number.forceable else f" ({FIRM})" if force else ""
            refusals.append(f"{tree.where(number.key)}: {dotted(number.key) or 'case'}: {number}{hint}")
    if refusals:
        raise ConfigError(list(dict.fromkeys(refusals)))  # several fluids or sets of grains may have the same fault
    return list(dict.fromkeys(warnings))
