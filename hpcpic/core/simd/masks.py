"""Masks from bits, loads and stores under a mask, beside `simd.vector`."""

from typing import Any

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


def _masked(builder: Any, name: str, vec: Vec, arguments: list) -> Any:
    """Call of llvm.masked.<name>; `arguments` in its order."""
    letter = {"double": "f64", "float": "f32", "i64": "i64", "i32": "i32"}[str(KIND[vec.dtype])]
    suffix = f"v{vec.n}{letter}" + ("" if name == "expandload" else ".p0")
    result = ir.VoidType() if name == "store" else arguments[-1].type
    function_type = ir.FunctionType(result, [argument.type for argument in arguments])
    function = cgutils.get_or_insert_function(builder.module, function_type, f"llvm.masked.{name}.{suffix}")
    return builder.call(function, arguments)


@intrinsic(prefer_literal=True)
def store_where(typing_context, address, a, mask, align):
    """Write the lanes where the mask is true; other elements are not touched. Alignment in bytes, a literal."""

    def codegen(context, builder, sig, args):
        place = pointer(builder, args[0], args[1].type)
        _masked(builder, "store", a, [args[1], place, ir.Constant(I32, align.literal_value), args[2]])
        return context.get_dummy_value()

    return types.void(types.int64, a, mask, align), codegen


@intrinsic(prefer_literal=True)
def load_where(typing_context, address, mask, other, align):
    """The elements at an address where the mask is true, the lanes of `other` elsewhere. Alignment in bytes."""

    def codegen(context, builder, sig, args):
        place = pointer(builder, args[0], args[2].type)
        arguments = [place, ir.Constant(I32, align.literal_value), args[1], args[2]]
        return _masked(builder, "load", other, arguments)

    return other(types.int64, mask, other, align), codegen


@intrinsic
def expand_at(typing_context, address, mask, other):
    """Successive elements from an address on, in the lanes where the mask is true; the lanes of `other` elsewhere."""

    def codegen(context, builder, sig, args):
        place = pointer(builder, args[0], ir.IntType(8))
        return _masked(builder, "expandload", other, [place, args[1], args[2]])

    return other(types.int64, mask, other), codegen
