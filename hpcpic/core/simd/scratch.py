"""Scratch arrays of compiled kernels: `empty` and `zeros` as numpy has them, without its test for overflow.

numba compiles three functions of its own for each type of np.empty and six for np.zeros, in every program that compiles
a kernel with them; here both are a few instructions of the kernel itself. What compiles arrays is imported where
something is compiled: it takes a twentieth of a start.
"""

from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic
def empty(typing_context, shape, dtype):
    """empty(n, np.float64) or empty((n, m), a.dtype): an array of no particular values."""
    return _array(shape, dtype)(shape, dtype), _allocated


@intrinsic
def zeros(typing_context, shape, dtype):
    """zeros(n, np.float64) or zeros((n, m), a.dtype)."""

    def codegen(context, builder, sig, args):
        from numba.np.arrayobj import make_array

        value = _allocated(context, builder, sig, args)
        array = make_array(sig.return_type)(context, builder, value)
        cgutils.memset(builder, array.data, builder.mul(array.nitems, array.itemsize), 0)
        return value

    return _array(shape, dtype)(shape, dtype), codegen


def _array(shape: types.Type, dtype: types.Type) -> types.Array:
    from numba.core.typing.npydecl import parse_dtype, parse_shape

    return types.Array(parse_dtype(dtype), parse_shape(shape), "C")


def _allocated(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    from numba.np.arrayobj import get_itemsize, make_array, populate_array

    kind, given = sig.return_type, sig.args[0]
    if isinstance(given, types.Integer):
        dims = [context.cast(builder, args[0], given, types.intp)]
    else:
        lengths = cgutils.unpack_tuple(builder, args[0])
        dims = [context.cast(builder, length, one, types.intp) for length, one in zip(lengths, given.types)]
    item = context.get_constant(types.intp, get_itemsize(context, kind))
    strides = [item]
    for dim in reversed(dims):
        strides.insert(0, builder.mul(strides[0], dim))
    align = context.get_preferred_array_alignment(kind.dtype)
    block = context.nrt.meminfo_alloc_aligned(builder, strides[0], align)
    start = builder.bitcast(context.nrt.meminfo_data(builder, block), context.get_data_type(kind.dtype).as_pointer())
    array = make_array(kind)(context, builder)
    populate_array(array, start, dims, strides[1:], item, block)
    return array._getvalue()
