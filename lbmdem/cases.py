"""The cases that come with the program."""

from pathlib import Path

from hpcpic.core.files.cases import cases_in


def shipped_cases() -> dict[str, Path]:
    """Name and file of each. `shipped` is package data, in a checkout a link to configs/lbmdem."""
    return cases_in((Path(__file__).parent / "shipped").resolve())
