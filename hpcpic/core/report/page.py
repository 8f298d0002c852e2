"""The page of `report`, and its rendering: tables and drawings, self-contained, without scripts."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from hpcpic.core.case.cases import Header

NO_HEADER = Header()
WIDE = 2.2  # times its height


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the page. Cells are texts; "ok", "warn" and "fail" become marks; `numbers`: columns."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    numbers: Sequence[int] = ()
    note: str = ""


@dataclass(frozen=True, slots=True)
class Drawn:
    title: str
    svg: str

    @property
    def wide(self) -> bool:
        """True for a figure that takes a whole row of the page."""
        found = re.search(r'viewBox="0 0 (\S+) (\S+)"', self.svg)
        return found is not None and float(found[1]) > WIDE * float(found[2])


@dataclass(frozen=True, slots=True)
class Page:
    """All that the template shows."""

    program: str
    title: str
    subtitle: str
    status: str
    mark: str
    facts: Sequence[tuple[str, str, str]]  # what, value, unit or remark
    header: Header = NO_HEADER
    figures: Sequence[Drawn] = ()
    tables: Sequence[Table] = ()
    omitted: Sequence[str] = ()
    failures: Mapping[str, Exception] = field(default_factory=dict)  # figure -> what ended it
    warnings: Sequence[str] = ()
    config: str = ""
    provenance: Mapping[str, str] = field(default_factory=dict)
    reload_s: int = 0  # after which a browser loads the page again; 0: never


def render(page: Page) -> str:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2").render(page=page)


def inline(svg: str) -> str:
    """Text and axes take the colour of the page, the size that of the column."""
    from hpcpic.core.app.figures import INK

    head, rest = svg.split(">", 1)
    head = re.sub(r' (width|height)="[^"]*"', "", head)
    return f'{head} role="img">{rest}'.replace(INK, "currentColor")
