"""Elements of an array of any width as vectors, here and there or in line, and lanes side by side; see `core.simd`."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic

from hpcpic.core.simd.kinds import I1, I32, I64, KIND, constant, load_from, store_to
from hpcpic.core.simd.registers import compiled_for, has_masks

PERMUTE = "llvm.x86.avx2.permd"


@intrinsic
def gather(typing_context, kind, array, start, lists, index):
    """Lane k: array[start + lists[index + k]], floats as wide as the lanes or narrower; lists are int32.

    Both arrays are lines. Loads one by one, which is several times faster than the gather instruction.
    """
    vec = kind.instance_type
    if (lists.dtype, lists.ndim, lists.layout) != (types.int32, 1, "C"):
        raise TypingError(f"{lists} is no line of int32")

    def codegen(context, builder, sig, args):
        base = builder.gep(context.make_array(array)(context, builder, args[1]).data, [args[2]])
        first = builder.gep(context.make_array(lists)(context, builder, args[3]).data, [args[4]])
        found = ir.Constant(ir.VectorType(KIND[array.dtype], vec.n), ir.Undefined)
        for lane in range(vec.n):
            number = builder.load(builder.gep(first, [ir.Constant(I64, lane)]))
            value = builder.load(builder.gep(base, [builder.sext(number, I64)]))
            found = builder.insert_element(found, value, ir.Constant(I32, lane))
        return found if array.dtype == vec.dtype else builder.fpext(found, context.get_value_type(vec))

    return vec(kind, array, types.int64, lists, types.int64), codegen


@intrinsic
def load_wide(typing_context, kind, array, start):
    """array[start + k] in lane k, floats as wide as the lanes or narrower; the array is a line."""
    vec = kind.instance_type

    def codegen(context, builder, sig, args):
        place = builder.gep(context.make_array(array)(context, builder, args[1]).data, [args[2]])
        place = builder.ptrtoint(place, I64)
        found = load_from(builder, place, ir.VectorType(KIND[array.dtype], vec.n), array.dtype.bitwidth // 8)
        return found if array.dtype == vec.dtype else builder.fpext(found, context.get_value_type(vec))

    return vec(kind, array, types.int64), codegen


@intrinsic
def scatter(typing_context, array, start, lists, index, a):
    """array[start + lists[index + k]] = lane k of a, rounded to the array's type; the inverse of `gather`."""

    def codegen(context, builder, sig, args):
        base = builder.gep(context.make_array(array)(context, builder, args[0]).data, [args[1]])
        first = builder.gep(context.make_array(lists)(context, builder, args[2]).data, [args[3]])
        values = args[4]
        if array.dtype != a.dtype:
            values = builder.fptrunc(values, ir.VectorType(KIND[array.dtype], a.n))
        for lane in range(a.n):
            number = builder.load(builder.gep(first, [ir.Constant(I64, lane)]))
            value = builder.extract_element(values, ir.Constant(I32, lane))
            builder.store(value, builder.gep(base, [builder.sext(number, I64)]))
        return context.get_dummy_value()

    return types.void(array, types.int64, lists, types.int64, a), codegen


@intrinsic
def first_bits(typing_context, a):
    """For each lane, the number of the lowest bit set; the width of a lane for 0."""

    def codegen(context, builder, sig, args):
        kind = args[0].type
        function_type = ir.FunctionType(kind, [kind, I1])
        name = f"llvm.cttz.v{kind.count}i{kind.element.width}"
        return builder.call(cgutils.get_or_insert_function(builder.module, function_type, name), [args[0], I1(0)])

    return a(a), codegen


def _compressed(builder: Any, vector: Any, mask: Any) -> Any:
    """The lanes where the mask is true, moved to the front."""
    kind = vector.type
    function_type = ir.FunctionType(kind, [kind, mask.type, kind])
    name = f"llvm.experimental.vector.compress.v{kind.count}i{kind.element.width}"
    function = cgutils.get_or_insert_function(builder.module, function_type, name)
    return builder.call(function, [vector, mask, ir.Constant(kind, ir.Undefined)])


def _front(builder: Any, bits: Any) -> Any:
    """Numbers of the bits set of an i8, in eight lanes from the first on; from a table of 2 kB."""
    eight = ir.VectorType(ir.IntType(8), 8)
    name = ".numbers_of_bits"
    if name not in builder.module.globals:
        rows = [[k for k in range(8) if byte >> k & 1] for byte in range(256)]
        kind = ir.ArrayType(eight, 256)
        table = cgutils.global_constant(builder.module, name, kind([eight(row + [0] * (8 - len(row))) for row in rows]))
    else:
        table = builder.module.globals[name]
    row = builder.gep(table, [ir.Constant(I32, 0), builder.zext(bits, I64)])
    return builder.zext(builder.load(row, align=8), ir.VectorType(I32, 8))


@intrinsic
def store_side_by_side(typing_context, array, index, a, mask):
    """Write the lanes of a, int32, where the mask is true, one behind the other from array[index] on.

    What is written behind them, up to the width of a, means nothing. With AVX2, which has no instruction for it, eight
    lanes at a time are moved by a table; the compiler's own way is 64 instructions.
    """

    def codegen(context, builder, sig, args):
        line, at, vector, found = args
        place = builder.gep(context.make_array(array)(context, builder, line).data, [at])
        if has_masks() or not compiled_for("avx2"):
            store_to(builder, builder.ptrtoint(place, I64), _compressed(builder, vector, found), 4)
            return context.get_dummy_value()
        all_bits = builder.bitcast(found, ir.IntType(a.n))
        kind = ir.VectorType(I32, 8)
        permute = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind, kind]), PERMUTE)
        for first in range(0, a.n, 8):
            bits = builder.trunc(builder.lshr(all_bits, ir.Constant(all_bits.type, first)), ir.IntType(8))
            part = builder.shuffle_vector(vector, vector, constant(I32, list(range(first, first + 8))))
            moved = builder.call(permute, [part, _front(builder, bits)])
            store_to(builder, builder.ptrtoint(place, I64), moved, 4)
            place = builder.gep(place, [builder.zext(builder.ctpop(bits), I64)])
        return context.get_dummy_value()

    return types.void(array, types.int64, a, mask), codegen
