"""How the particle kernels are compiled, and vector operations that only they need."""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hpcpic.core.simd.jit import njit
from hpcpic.core.simd.kinds import Vec, offset, shuffle, store_to


def kernel(function: Callable) -> Callable:
    """`njit` for what allocates nothing: numba counts the owners of arrays at every use, which is half of the work
    on a particle that moves from tile to tile; without its run time it does not.
    """
    return njit(_nrt=False)(function)


def inlined(function: Callable) -> Callable:
    """The same for a part of a kernel: a call would hand over arrays by dozens of numbers, and empty the registers."""
    return njit(_nrt=False, forceinline=True)(function)


@intrinsic
def bits_of(typing_context, a):
    """The lanes' bits as integers of the same size."""
    whole = Vec(a.n, types.int64 if a.dtype == types.float64 else types.int32)

    def codegen(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(whole))

    return whole(a), codegen


@intrinsic
def store_lines(typing_context, address, vectors):
    """Write the lanes of two or of n vectors of n lanes as n lines one after the other: lane k of all, on line k."""

    def codegen(context, builder, signature, arguments):
        rows = cgutils.unpack_tuple(builder, arguments[1])
        rows = _zipped(builder, *rows) if vectors.count == 2 else _transposed(builder, rows)
        for k, row in enumerate(rows):
            at = offset(builder, arguments[0], k * row.type.count * vectors.dtype.size)
            store_to(builder, at, row, vectors.dtype.size)
        return context.get_dummy_value()

    if vectors.count not in (2, vectors.dtype.n):
        return None
    return types.void(types.int64, vectors), codegen


def _zipped(builder: Any, a: Any, b: Any) -> list:
    """a0 b0 a1 b1 ... of two vectors."""
    n = a.type.count
    lanes = [k // 2 + (n if k % 2 else 0) for k in range(2 * n)]
    return [shuffle(builder, a, b, lanes[:n]), shuffle(builder, a, b, lanes[n:])]


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


@intrinsic
def address(typing_context, array):
    """Address of the first element of an array."""

    def codegen(context, builder, signature, arguments):
        data = context.make_array(array)(context, builder, arguments[0]).data
        return builder.ptrtoint(data, ir.IntType(64))

    return types.int64(array), codegen


@intrinsic
def last_bit(typing_context, bits):
    """Number of the highest bit set of a positive number."""

    def codegen(context, builder, signature, arguments):
        zeros = builder.ctlz(arguments[0], ir.Constant(ir.IntType(1), 1))
        return builder.sub(ir.Constant(ir.IntType(64), 63), zeros)

    return types.int64(types.int64), codegen
