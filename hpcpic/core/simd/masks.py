"""Masks from bits and stores under a mask, beside `simd.vector`."""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hpcpic.core.simd.kinds import I32, KIND, Vec, pointer


@intrinsic
def mask_of_bits(typing_context, kind, bits):
    """The mask beside vectors `kind` whose lane k is bit k of an int64 (higher bits do not count)."""
    vec = kind.instance_type
    mask = Vec(vec.n, types.boolean)

    def codegen(context, builder, sig, args):
        return builder.bitcast(builder.trunc(args[1], ir.IntType(vec.n)), context.get_value_type(mask))

    return mask(kind, types.int64), codegen


@intrinsic(prefer_literal=True)
def store_where(typing_context, address, a, mask, align):
    """Write the lanes where the mask is true; other elements are not touched. Alignment in bytes, a literal."""

    def codegen(context, builder, sig, args):
        place = pointer(builder, args[0], args[1].type)
        letter = {"double": "f64", "float": "f32", "i64": "i64", "i32": "i32"}[str(KIND[a.dtype])]
        arguments = [args[1], place, ir.Constant(I32, align.literal_value), args[2]]
        function_type = ir.FunctionType(ir.VoidType(), [argument.type for argument in arguments])
        name = f"llvm.masked.store.v{a.n}{letter}.p0"
        builder.call(cgutils.get_or_insert_function(builder.module, function_type, name), arguments)
        return context.get_dummy_value()

    return types.void(types.int64, a, mask, align), codegen
