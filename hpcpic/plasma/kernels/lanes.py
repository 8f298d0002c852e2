"""How the particle kernels are compiled, and vector operations that only they need."""

from collections.abc import Callable

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.kinds import Vec

WITHOUT_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # which would take up groups of arrays


def kernel(function: Callable) -> Callable:
    """`njit` for what allocates nothing: numba counts the owners of arrays at every use, which is half of the work
    on a particle that moves from tile to tile; without its run time it does not. For tasks and other kernels alone.
    """
    return njit(_nrt=False, **WITHOUT_WRAPPERS)(function)


def called_from_python(function: Callable) -> Callable:
    """A `kernel` that Python calls without a task."""
    return njit(_nrt=False)(function)


def inlined(function: Callable) -> Callable:
    """Compile a part of a kernel into its callers: a call would hand over arrays by dozens of numbers, and empty the
    registers.
    """
    return njit(_nrt=False, forceinline=True, **WITHOUT_WRAPPERS)(function)


@intrinsic
def bits_of(typing_context, a):
    """The lanes' bits as integers of the same size."""
    whole = Vec(a.n, types.int64 if a.dtype == types.float64 else types.int32)

    def codegen(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(whole))

    return whole(a), codegen


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
