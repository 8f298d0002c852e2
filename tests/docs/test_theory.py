"""The tables of docs/theory: every equation and figure of the papers has a row, and what the rows cite exists."""

import ast
import functools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = {"plasma": "hpcpic/plasma", "sph": "sph", "lbmdem": "lbmdem"}  # of the sources that a page leaves out
NUMBERED = {
    "plasma": [
        *(f"(4.{n})" for n in range(1, 6)), *(f"(5.{n})" for n in range(1, 20)), "(9.1)",
        *(f"figure {n}" for n in ("1.1", "4.1", "5.1", "5.2", "9.1", "10.1a", "10.1b")),
    ],
    "sph": [
        *(f"(MP {n})" for n in range(1, 25)), *(f"MP figure {n}" for n in range(1, 8)),
        *(f"(SC {n})" for n in range(1, 13)), *(f"SC figure {n}" for n in range(1, 11)), "SC table 1",
    ],
    "lbmdem": [*(f"[{n}]" for n in range(1, 8)), *(f"figure {n}" for n in range(1, 6))],
}  # fmt: skip
CITED = re.compile(r"([\w./-]+\.(?:py|csv))(?:::([\w.]+))?")


def spans(text):
    """What stands in the letters of code, but for blocks of it."""
    return re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))


def rows(page):
    """The cells of all rows of the tables whose first column is "number"."""
    inside = False
    for line in (ROOT / f"docs/theory/{page}.md").read_text().splitlines():
        inside = line.startswith("| number |") or (inside and line.startswith("|"))
        if inside and not line.startswith(("| number |", "| --- |")):
            yield [cell.strip() for cell in line.strip("|").split("|")]


@functools.cache
def names_in(path):
    """Functions, classes, their members and constants of a module."""
    found = set()

    def add(nodes, prefix=""):
        for node in nodes:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                found.add(prefix + node.name)
                add(node.body, f"{prefix}{node.name}." if isinstance(node, ast.ClassDef) else prefix)
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                found.update(prefix + target.id for target in targets if isinstance(target, ast.Name))

    add(ast.parse(path.read_text()).body)
    return found


def missing(page, cited):
    """What is not there of a file and the name in it."""
    path, name = cited
    for folder in (FOLDERS[page], "tests", "."):
        file = ROOT / folder / path
        if file.exists():
            return [] if not name or name in names_in(file) else [f"{path} has no {name}"]
    return [f"no file {path}"]


@pytest.mark.parametrize("page", FOLDERS)
def test_files_and_names_that_a_page_cites_exist(page):
    text = (ROOT / f"docs/theory/{page}.md").read_text()
    cited = [match.groups() for span in spans(text) if (match := CITED.fullmatch(span))]
    assert len(cited) > 20
    assert [fault for each in cited for fault in missing(page, each)] == []


@pytest.mark.parametrize("page", FOLDERS)
def test_every_row_has_a_case_and_a_test_or_says_that_there_is_none(page):
    for number, _, where, case, test, _ in rows(page):
        cases = [ROOT / f"configs/{page}/{name}.conf" for name in spans(case) if "." not in name]
        assert case.startswith("none") or (cases and all(file.exists() for file in cases)), (number, case)
        assert test.startswith("none: ") or any("::test_" in span for span in spans(test)), (number, test)
        assert where, number


@pytest.mark.parametrize("page", FOLDERS)
def test_every_numbered_equation_and_figure_of_the_papers_has_a_row(page):
    given = {number for row in rows(page) for number in row[0].split(", ")}
    assert [number for number in NUMBERED[page] if number not in given] == []
