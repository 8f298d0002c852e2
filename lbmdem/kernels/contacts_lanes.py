"""A vector operation that only the contact kernels need."""

from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hpcpic.core.simd.kinds import offset, shuffle, store_to


@intrinsic
def store_lines(typing_context, address, vectors):
    """Write n vectors of n lanes as n lines, one after the other: lane k of all of them on line k."""

    def codegen(context, builder, signature, arguments):
        rows = _transposed(builder, cgutils.unpack_tuple(builder, arguments[1]))
        for k, row in enumerate(rows):
            at = offset(builder, arguments[0], k * row.type.count * vectors.dtype.size)
            store_to(builder, at, row, vectors.dtype.size)
        return context.get_dummy_value()

    return types.void(types.int64, vectors), codegen


def _transposed(builder: Any, rows: list) -> list:
    """Rows of a square matrix to its columns, by exchanging blocks of halved size."""
    n, step = len(rows), len(rows) // 2
    while step:
        for j in (j for j in range(n) if not j & step):
            a, b = rows[j], rows[j + step]
            rows[j] = shuffle(builder, a, b, [e if not e & step else n + e - step for e in range(n)])
            rows[j + step] = shuffle(builder, a, b, [e + step if not e & step else n + e for e in range(n)])
        step //= 2
    return rows
