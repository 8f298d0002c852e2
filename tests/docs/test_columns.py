"""The page of the run folder says what every column of a series is."""

import re
from pathlib import Path

import pytest

import hpcpic
import lbmdem
import sph
from sph.case.columns import scalar_units

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/reference/run-folder.md"
SECTIONS = {"hpcpic": "| plasma", "sph": "| SPH", "lbmdem": "| lattice"}


def told(program: str) -> list[str]:
    """A pattern of each column that the table of a program names."""
    rows = PAGE.read_text().partition(SECTIONS[program])[2].partition("\n\n")[0].splitlines()[2:]
    columns = [name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert len(columns) > 5
    marks = (("_zz", "_[xyz]{2}"), ("_x", "_[xyz]"), ("NAME", r"\w+"), ("_N", r"_\d+"))
    for mark, pattern in marks:
        columns = [re.sub(f"{mark}(?=_|$)", lambda _: pattern, column) for column in columns]  # noqa: B023
    return columns


def unknown(program: str, columns) -> set[str]:
    return {name for name in columns if not any(re.fullmatch(pattern, name) for pattern in told(program))}


def require_told(program: str, columns) -> None:
    missing = unknown(program, columns)
    assert not missing, f"{sorted(missing)}: add a row to the table {SECTIONS[program]!r} of {PAGE.relative_to(ROOT)}"


def test_columns_of_sph_are_told():
    require_told("sph", {column for name in sph.cases() for column in scalar_units(sph.Case(name).config)})


@pytest.mark.parametrize(
    "case",
    [
        hpcpic.Case("plasma-oscillation"),
        hpcpic.Case("plasma-oscillation").changed({"output.modes": [[1], [2]]}),
        lbmdem.Case("settling-disc"),
        lbmdem.Case("settling-disc").changed({"output.stress_slices": 4}),
        lbmdem.Case("sphere-array"),
    ],
)
def test_columns_of_plasma_and_lattice_are_told(case):
    with case.simulation(threads=1) as sim:
        require_told(type(case).load_app().name, sim.scalar_units)


def test_a_column_that_no_row_names_is_found():
    assert unknown("lbmdem", ["speed", "force_disc_x", "force_disc_a"]) == {"speed", "force_disc_a"}
    with pytest.raises(AssertionError, match=r"'speed'.*add a row to the table .* of docs/reference/run-f"):
        require_told("lbmdem", ["speed"])
