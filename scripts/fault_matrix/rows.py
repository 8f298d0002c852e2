"""The table: number, fault, what is expected, and the function that tries it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fault_matrix.bench import Bench

Try = Callable[[Bench], str]


@dataclass(frozen=True, slots=True)
class Row:
    number: int
    fault: str
    expected: str
    attempt: Try  # what was got; raises Wrong or Skipped


ROWS: dict[int, Row] = {}


def row(number: int, fault: str, expected: str) -> Callable[[Try], Try]:
    """Enter a function into the table."""

    def enter(attempt: Try) -> Try:
        ROWS[number] = Row(number, fault, expected, attempt)
        return attempt

    return enter
