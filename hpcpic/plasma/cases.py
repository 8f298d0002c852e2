"""The cases that come with the program."""

from pathlib import Path

from hpcpic.core.files.cases import cases_in

PACKAGE = Path(__file__).parent


def shipped_cases() -> dict[str, Path]:
    """Name and file of each: configs/plasma in a checkout, the folder `cases` of an installed package."""
    return cases_in(PACKAGE.parents[1] / "configs" / "plasma", PACKAGE / "cases")
