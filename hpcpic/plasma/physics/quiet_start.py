"""Even sequences for quiet starts: the same numbers for an id whoever asks for it.

Source: Birdsall & Langdon, Plasma Physics via Computer Simulation, chapter 16 (digit-reversed order).
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

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


def divisors(n: int) -> list[int]:
    """The divisors of n >= 1 in rising order."""
    low = [i for i in range(1, int(n**0.5) + 1) if n % i == 0]
    return low + [n // i for i in reversed(low) if i * i != n]
