"""Cases that are too large to be made, told before anything of them is: most often a unit was meant otherwise."""

from collections.abc import Iterator
from typing import Any

from hpcpic.core import memory
from hpcpic.core.case.derived import Derived
from sph.case import geometry
from sph.case.config import SphConfig
from sph.forecast.plan import MOST_PLACES, arrays, many, places

GIB = 2.0**30
LONGEST = 100.0  # a solid from a file over what else there is


def size(config: SphConfig, ranks: int) -> Iterator[Derived]:
    """Lengths, places and bytes beyond their limits."""
    yield from long_files(config)
    for name, n in places(config).items():
        if n > MOST_PLACES:
            yield Derived(f"places of {name} on the lattice", "n", n, "", f"<= {MOST_PLACES:g}", "fail",
                          "each is looked at before the run", "a larger spacing, or another unit of lengths",
                          ("numerics",), True)  # fmt: skip
    if many(config):
        needed, free = sum(array.bytes for array in arrays(config, ranks)), memory.free()
        if needed > free:
            spacing = config.numerics.spacing * (needed / free) ** (1 / config.dimensions)
            yield Derived("memory of a rank", "", needed / GIB, "GiB", f"<= {free / GIB:.3g} GiB", "fail",
                          "what is free here", f"spacing = {1.05 * spacing:.2g}, or more ranks on other machines",
                          ("numerics",), True)  # fmt: skip


def long_files(config: SphConfig) -> Iterator[Derived]:
    """Shapes from files that are far longer than all that is around them: of files in millimetres a thousand times."""
    kinds: dict[str, Any] = {"wall": config.wall, "fluid": config.fluid}
    shaped = [(kind, i, one) for kind, several in kinds.items() for i, one in enumerate(several) if not one.shape.plane]
    for kind, i, one in shaped:
        others = {other.name: longest(other) for _, _, other in shaped if other is not one and not other.shape.stl}
        if one.shape.stl and others:
            name = max(others, key=lambda other: others[other])
            if longest(one) > LONGEST * others[name]:
                yield Derived(f"length of {one.name}", "", longest(one), "m", f"<= {LONGEST:g} times that of {name}",
                              "warn", f"{name} is {others[name]:g} m long",
                              f"scale = {one.shape.stl.scale / 1000:g} for a file in millimetres",
                              (kind, i, "shape", "stl"))  # fmt: skip


def longest(one: Any) -> float:
    """Length of a fluid or wall along the axis on which it is longest, m."""
    return max(b - a for a, b in zip(*geometry.bounds(one.shape)))
