"""Even sequences for quiet starts: the same numbers for an id whoever asks for it.

Source: Birdsall & Langdon, Plasma Physics via Computer Simulation, chapter 16 (digit-reversed order).
"""

import math
from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.rng import normal_quantile

BASES = (2, 3, 5, 7, 11)


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
    order, which are even along the first alone. Each component has the mean 0 and the variance 1 to rounding.
    """
    index = np.arange(n)
    fractions = [(index + 0.5) / max(n, 1), *(radical_inverse(index, base, n) for base in BASES[: components - 1])]
    v = np.stack([normal_quantile(u) for u in fractions], axis=1)
    if n > 1:
        v -= v.mean(axis=0)
        v /= np.sqrt((v * v).mean(axis=0))
    return v


def from_x_to(k: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """v[n, 1 to 3] mirrored so that what was along x is along k[d]; as they are where k is along x, or zeros.

    Their correlations, of digit-reversed orders, are taken out before: else the axes would differ in temperature.
    """
    if not k[1:].any() or len(v) <= v.shape[1]:
        return v
    v = v.copy()
    for i in range(1, v.shape[1]):
        for j in range(i):
            v[:, i] -= (v[:, i] * v[:, j]).mean() / (v[:, j] * v[:, j]).mean() * v[:, j]
        v[:, i] /= np.sqrt((v[:, i] * v[:, i]).mean())
    across = np.zeros(v.shape[1])
    across[: len(k)] = -k / np.sqrt(np.sum(k * k))
    across[0] += 1.0  # from k to x
    along = sum(v[:, i] * across[i] for i in range(len(across)))
    return v - along[:, None] * (2 * across / np.sum(across * across))


def recurrence_time(n: int, wave_number: float, thermal: float, velocity: float) -> float:
    """Time after which n strata of a Maxwellian are in phase again near a velocity: 2 pi/(k dv), dv = thermal/(n f)."""
    density = math.exp(-0.5 * (velocity / thermal) ** 2) / math.sqrt(2 * math.pi)
    return 2 * math.pi * n * density / (wave_number * thermal)


@cache
def lattice(total: int, points: tuple[int, ...]) -> tuple[int, ...] | None:
    """Columns, rows (and planes) of a lattice of `total` points, its proportions within 4 of the grid's, or None.

    A lattice with a whole number of points per cell on all axes comes first, then the most even one.
    """
    best = None
    for sides in factorisations(total, len(points)):
        dense = [side * (math.prod(points) // n) for side, n in zip(sides, points)]
        uneven = max(dense) / min(dense)
        rank = (any(side % n for side, n in zip(sides, points)), uneven)
        if uneven <= 4 and (best is None or rank < best[0]):
            best = (rank, sides)
    return best and best[1]


def even_places(
    index: NDArray, total: int, points: tuple[int, ...], shift: NDArray | None = None, as_lattice: bool = True
) -> NDArray[np.float64]:
    """Places[m, d] in [0, 1) of total >= 1 that fill a box evenly: in 1D equal steps; in 2D and 3D a lattice, or where
    none fits or none is wanted, equal steps along x and digit-reversed order along y and z.

    shift[m, d]: where each is in its part of the box, from 0 to 1; by default in the middle.
    """
    d = len(points)
    within = [0.5] * d if shift is None else list(shift.T)
    even = (index + within[0]) / max(total, 1)
    if d == 1:
        return even[:, None]
    shape = lattice(total, points) if as_lattice and total else None
    if shape is None:
        others = zip(BASES, within[1:])
        return np.stack([even, *((radical_inverse(index, base, total) + y - 0.5) % 1.0 for base, y in others)], axis=1)
    places, rest = [], index
    for n, x in zip(shape, within):
        places.append((rest % n + x) / n)
        rest = rest // n
    return np.stack(places, axis=1)


def factorisations(n: int, factors: int) -> Iterator[tuple[int, ...]]:
    """All ways to write n as a product of so many factors, in their order."""
    if factors == 1:
        yield (n,)
        return
    for first in divisors(n):
        yield from ((first, *rest) for rest in factorisations(n // first, factors - 1))


def divisors(n: int) -> list[int]:
    """The divisors of n >= 1 in rising order."""
    low = [i for i in range(1, int(n**0.5) + 1) if n % i == 0]
    return low + [n // i for i in reversed(low) if i * i != n]
