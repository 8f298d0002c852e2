"""A gauge in a field of a grid, as a case says it: which field, where, and what of it goes to the series."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

from hpcpic.core.case.config import Path
from hpcpic.core.case.schema import REQUIRED, Section, Vector, setting
from hpcpic.core.case.words import unknown

AXES = "xyz"
STEP, TIME = "step", "time"  # of the rows of every series
TAKEN = f"{STEP} and {TIME} are columns of every series: another name"


class Gauge(Section):
    """The mean, the least or the greatest value of a field at a point, or on a line, a plane or a box."""

    name: str = setting("", "column of the series; by default gauge_1, gauge_2, ...")
    what: str = setting(REQUIRED, "field to read")
    at: Vector = setting(REQUIRED, "the point, or the middle of the line, plane or box", "m")
    size: Vector = setting((), "extent along each axis, 0 along those across a line or plane; by default a point", "m")
    take: Literal["mean", "minimum", "maximum"] = setting(
        "mean", "mean of the field interpolated linearly between nodes, or its least or greatest value at a node"
    )

    @property
    def names(self) -> tuple[str, ...]:
        """Names that its columns can have: its own of a scalar, one for each axis of a vector."""
        return (self.name, *(f"{self.name}_{axis}" for axis in AXES))

    def columns(self, units: Mapping[str, tuple[str, int]]) -> dict[str, str]:
        """Columns of the series with their units; units: of each field, with its number of components (0: a scalar)."""
        unit, components = units[self.what]
        ends = [f"_{axis}" for axis in AXES[:components]] or [""]
        return {self.name + end: unit for end in ends}


def gauge_columns(
    gauges: Sequence[Gauge], fields: Mapping[str, tuple[str, int]]
) -> Iterator[tuple[str, dict[str, str]]]:
    """(name in messages, columns with their units) of each gauge, as core.case.columns wants them."""
    return ((f"gauge {gauge.name!r}", gauge.columns(fields)) for gauge in named(gauges))


def named(gauges: Sequence[Gauge]) -> tuple[Gauge, ...]:
    """The gauges, each with a name."""
    return tuple(g if g.name else g.model_copy(update={"name": f"gauge_{i + 1}"}) for i, g in enumerate(gauges))


def gauge_faults(
    gauges: Sequence[Gauge], fields: Mapping[str, tuple[str, int]], lengths: Sequence[float]
) -> Iterator[tuple[Path, str]]:
    """The faults of gauges in a box of `lengths` with these fields: unit and number of components by name."""
    columns: dict[str, int] = {}
    for i, gauge in enumerate(named(gauges)):
        here: Path = ("gauge", i)
        if gauge.what not in fields:
            yield (*here, "what"), unknown(gauge.what, fields)
            continue
        if {STEP, TIME} & gauge.columns(fields).keys():
            yield (*here, "name"), TAKEN
        if len(gauge.at) != len(lengths):
            yield (*here, "at"), f"needs {len(lengths)} numbers in {len(lengths)}D (got {len(gauge.at)})"
        elif not all(0 <= x <= length for x, length in zip(gauge.at, lengths)):
            yield (*here, "at"), f"is outside the box of {' x '.join(f'{length:g}' for length in lengths)} m"
        if gauge.size and len(gauge.size) != len(lengths):
            yield (*here, "size"), f"needs {len(lengths)} numbers in {len(lengths)}D (got {len(gauge.size)})"
        elif not all(0 <= size <= length for size, length in zip(gauge.size, lengths)):
            yield (*here, "size"), "must be from 0 to the length of the box along each axis"
        for column in gauge.columns(fields):
            if column in columns:
                yield (*here, "name"), f"gauge[{columns[column]}] has a column {column} already"
            columns[column] = i
