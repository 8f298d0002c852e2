"""Products of matrices whose bits do not depend on the number of rows.

Those of BLAS do, and on how the rows lie in memory; and how many rows a rank has depends on the number of ranks.
"""

from typing import Any

from numpy.typing import NDArray


def product(x: NDArray, m: NDArray) -> Any:
    """x[n, d] or x[d] @ m[d] or m[d, k], summed in the order of d."""
    columns = x.T if m.ndim == 1 else x.T[..., None]
    total = columns[0] * m[0]
    for column, factor in zip(columns[1:], m[1:]):
        total = total + column * factor
    return total
