"""Even sequences for quiet starts: the same numbers for an id whoever asks for it.

Source: Birdsall & Langdon, Plasma Physics via Computer Simulation, section 16-3 (bit-reversed order).
"""

import numpy as np
from numpy.typing import NDArray

BASES = (2, 3, 5, 7)

# Wichura, Algorithm AS 241, Applied Statistics 37 (1988) 477: numerator and denominator, high powers first
CENTRE = (
    (2.5090809287301226727e3, 3.3430575583588128105e4, 6.7265770927008700853e4,
     4.5921953931549871457e4, 1.3731693765509461125e4, 1.9715909503065514427e3,
     1.3314166789178437745e2, 3.387132872796366608),
    (5.2264952788528545610e3, 2.8729085735721942674e4, 3.9307895800092710610e4,
     2.1213794301586595867e4, 5.3941960214247511077e3, 6.8718700749205790830e2,
     4.2313330701600911252e1, 1.0),
)  # fmt: skip
MIDDLE = (
    (7.74545014278341407640e-4, 2.27238449892691845833e-2, 2.41780725177450611770e-1,
     1.27045825245236838258, 3.64784832476320460504, 5.76949722146069140550,
     4.63033784615654529590, 1.42343711074968357734),
    (1.05075007164441684324e-9, 5.47593808499534494600e-4, 1.51986665636164571966e-2,
     1.48103976427480074590e-1, 6.89767334985100004550e-1, 1.67638483018380384940,
     2.05319162663775882187, 1.0),
)  # fmt: skip
TAIL = (
    (2.01033439929228813265e-7, 2.71155556874348757815e-5, 1.24266094738807843860e-3,
     2.65321895265761230930e-2, 2.96560571828504891230e-1, 1.78482653991729133580,
     5.46378491116411436990, 6.65790464350110377720),
    (2.04426310338993978564e-15, 1.42151175831644588870e-7, 1.84631831751005468180e-5,
     7.86869131145613259100e-4, 1.48753612908506148525e-2, 1.36929880922735805310e-1,
     5.99832206555887937690e-1, 1.0),
)  # fmt: skip


def radical_inverse(index: NDArray, base: int, total: int) -> NDArray[np.float64]:
    """The digits of index[n], 0 <= index < total, mirrored at the point; centred, in (0, 1)."""
    rest = np.asarray(index, dtype=np.int64)
    mirrored, count = np.zeros(rest.shape, dtype=np.int64), 1
    while count < total:
        rest, digit = np.divmod(rest, base)
        mirrored = mirrored * base + digit
        count *= base
    return (mirrored + 0.5) / count


def inverse_normal(u: NDArray) -> NDArray[np.float64]:
    """The standard normal deviate below which the fraction u[n], 0 < u < 1, lies; error 1e-16 (AS 241)."""
    u = np.ascontiguousarray(u, dtype=np.float64)
    q = u - 0.5
    centre = q * quotient(CENTRE, 0.180625 - q * q)
    r = np.sqrt(-np.log(np.minimum(u, 1 - u)))
    outside = np.where(r <= 5, quotient(MIDDLE, r - 1.6), quotient(TAIL, r - 5))
    return np.where(np.abs(q) <= 0.425, centre, np.copysign(outside, q))


def quotient(coefficients: tuple, x: NDArray) -> NDArray:
    numerator, denominator = coefficients
    return np.polyval(numerator, x) / np.polyval(denominator, x)


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
