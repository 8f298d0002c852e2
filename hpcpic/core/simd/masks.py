"""Masks from bits, loads and stores under a mask, beside `simd.vector`.

AVX-512 has instructions for all of them. Without it a masked store of 64 bytes takes two instructions of 42
micro-operations on AMD Zen 3, 6 to 10 ns, so a loop goes over the lanes that are meant, most often few: 0.4 to 4 ns.
An expansion, a branch for each lane, is passed by where no lane is meant.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hpcpic.core.simd.kinds import I1, I32, I64, KIND, Vec, pointer
from hpcpic.core.simd.registers import has_masks


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


def _any(builder: Any, mask: Any) -> Any:
    bits = builder.bitcast(mask, ir.IntType(mask.type.count))
    return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))


@contextmanager
def _each_lane(builder: Any, mask: Any) -> Iterator[Any]:
    """A loop over the numbers of the true lanes of a mask that has some."""
    bits = builder.zext(builder.bitcast(mask, ir.IntType(mask.type.count)), I64)
    before, body = builder.block, builder.append_basic_block()
    builder.branch(body)
    builder.position_at_end(body)
    left = builder.phi(I64)
    left.add_incoming(bits, before)
    yield builder.cttz(left, ir.Constant(I1, 1))
    rest = builder.and_(left, builder.sub(left, ir.Constant(I64, 1)))
    left.add_incoming(rest, builder.block)
    after = builder.append_basic_block()
    builder.cbranch(builder.icmp_unsigned("!=", rest, ir.Constant(I64, 0)), body, after)
    builder.position_at_end(after)


def _store_lanes(builder: Any, address: Any, vector: Any, mask: Any) -> None:
    """Store one lane after the other."""
    copy, kind = cgutils.alloca_once(builder, vector.type), vector.type.element
    with builder.if_then(_any(builder, mask)):
        builder.store(vector, copy)
        source, target = builder.bitcast(copy, kind.as_pointer()), pointer(builder, address, kind)
        with _each_lane(builder, mask) as lane:
            builder.store(builder.load(builder.gep(source, [lane])), builder.gep(target, [lane]))


@intrinsic(prefer_literal=True)
def store_where(typing_context, address, a, mask, align):
    """Write the lanes where the mask is true; other elements are not touched. Alignment in bytes, a literal."""

    def codegen(context, builder, sig, args):
        if not has_masks():
            _store_lanes(builder, args[0], args[1], args[2])
            return context.get_dummy_value()
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
        arguments = [pointer(builder, args[0], ir.IntType(8)), args[1], args[2]]
        if has_masks():
            return _masked(builder, "expandload", other, arguments)
        before = builder.block
        with builder.if_then(_any(builder, args[1])):
            expanded, some = _masked(builder, "expandload", other, arguments), builder.block
        result = builder.phi(args[2].type)
        result.add_incoming(args[2], before)
        result.add_incoming(expanded, some)
        return result

    return other(types.int64, mask, other), codegen
