"""Names of the columns of a series, each of one thing only."""

from collections.abc import Iterable, Mapping

from hpcpic.core.case.gauge import STEP, TIME
from hpcpic.core.errors import ConfigError


def joined(groups: Iterable[tuple[str, Mapping[str, str]]]) -> dict[str, str]:
    """Unit of each column, from those of groups, each with what it belongs to ("wall[0]"). Raises ConfigError where two
    groups have the same column, one of which would hide the other.
    """
    units: dict[str, str] = {}
    owners = dict.fromkeys((STEP, TIME), "every series")
    for owner, columns in groups:
        for column, unit in columns.items():
            if column in owners:
                told = f"series: {owners[column]} has a column {column}, and {owner} too"
                raise ConfigError(f"{told}: name {owner} otherwise")
            owners[column], units[column] = owner, unit
    return units
