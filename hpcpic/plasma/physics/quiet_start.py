"""Even sequences for quiet starts: the same numbers for an id whoever asks for it.

Source: Birdsall & Langdon, Plasma Physics via Computer Simulation, chapter 16 (digit-reversed order).
"""

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.rng import normal_quantile

BASES = (2, 3, 5, 7)


def radical_inverse(index: NDArray, base: int, total: int) -> NDArray[np.float64]:
    """The digits of index[n], 0 <= index < total, mirrored at the point; centred, in (0, 1)."""
    rest = np.asarray(index, dtype=np.int64)
    mirrored, count = np.zeros(rest.shape, dtype=np.int64), 1
    while count < total:
        rest, digit = np.divmod(rest, base)
        mirrored = mirrored * base + digit
        count *= base
    return (mirrored + 0.5) / count


@cache
def strata(n: int, components: int) -> NDArray[np.float64]:
    """Normal deviates[n, components]: quantiles at the middle of n equal strata, further components in digit-reversed
    order. Each component has the mean 0 and the variance 1 to rounding.
    """
    index = np.arange(n)
    fractions = [(index + 0.5) / max(n, 1), *(radical_inverse(index, base, n) for base in BASES[: components - 1])]
    v = np.stack([normal_quantile(u) for u in fractions], axis=1)
    if n > 1:
        v -= v.mean(axis=0)
        v /= np.sqrt((v * v).mean(axis=0))
    return v


def recurrence_time(n: int, wave_number: float, thermal: float, velocity: float) -> float:
    """Time after which n strata of a Maxwellian are in phase again near a velocity: 2 pi/(k dv), dv = thermal/(n f)."""
    density = math.exp(-0.5 * (velocity / thermal) ** 2) / math.sqrt(2 * math.pi)
    return 2 * math.pi * n * density / (wave_number * thermal)


@cache
def lattice(total: int, points: tuple[int, int]) -> tuple[int, int] | None:
    """Columns and rows of a lattice of `total` points, its proportions within 4 of the grid's, or None.

    A lattice with a whole number of points per cell on both axes comes first, then the most even one.
    """
    best = None
    for columns in divisors(total):
        rows = total // columns
        uneven = max(columns * points[1], rows * points[0]) / min(columns * points[1], rows * points[0])
        rank = (columns % points[0] != 0 or rows % points[1] != 0, uneven)
        if uneven <= 4 and (best is None or rank < best[0]):
            best = (rank, (columns, rows))
    return best and best[1]


def even_places(
    index: NDArray, total: int, points: tuple[int, ...], shift: NDArray | None = None, as_lattice: bool = True
) -> NDArray[np.float64]:
    """Places[m, d] in [0, 1) of total >= 1 that fill a box evenly: in 1D equal steps; in 2D a lattice, or where none
    fits or none is wanted, equal steps along x and digit-reversed order along y.

    shift[m, d]: where each is in its part of the box, from 0 to 1; by default in the middle.
    """
    x, y = (0.5, 0.5) if shift is None else (shift[:, 0], shift[:, -1])
    even = (index + x) / max(total, 1)
    if len(points) == 1:
        return even[:, None]
    shape = lattice(total, points) if as_lattice and total else None
    if shape is None:
        return np.stack([even, (radical_inverse(index, BASES[0], total) + y - 0.5) % 1.0], axis=1)
    columns, rows = shape
    return np.stack([(index % columns + x) / columns, (index // columns + y) / rows], axis=1)


def divisors(n: int) -> list[int]:
    """The divisors of n >= 1 in rising order."""
    low = [i for i in range(1, int(n**0.5) + 1) if n % i == 0]
    return low + [n // i for i in reversed(low) if i * i != n]
