"""Files of a run that a restart with other arrays goes on with."""

import itertools
from pathlib import Path


def part_of(path: Path, number: int) -> Path:
    """A file that a restart with other arrays does not go on with is followed by further ones: fields.vtkhdf,
    fields-2.vtkhdf, ...; `number` counts from 1.
    """
    return path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")


def parts_of(path: Path) -> list[Path]:
    """The parts of a file that are there, in the order of time."""
    every = (part_of(path, number) for number in itertools.count(1))
    return list(itertools.takewhile(Path.exists, every))
