"""Vectors of one register's width for compiled kernels, so that a kernel reads like its formula.

    F = Vec(lanes(np.float64), np.float64)      # a global of the kernel's module

    @njit
    def push(x, v, e, n):
        for p in range(0, n, 8):
            store(x, p, fma(load(F, e, p), 0.5, load(F, x, p)))

LLVM vectorises neither gathers nor scatters by itself; here each operation is one instruction on every lane,
with the rounding of IEEE 754 and no reordering, so that results do not depend on the width. Scalars in
formulas become vectors of the other operand's type. A vector wider than the machine's registers works, in
parts.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic, overload

from hpcpic.core.simd import formulas
from hpcpic.core.simd.kinds import (
    I1,
    I32,
    I64,
    KIND,
    Vec,
    cast_scalar,
    constant,
    llvm,
    load_from,
    pointer,
    shuffle,
    store_to,
)
from hpcpic.core.simd.lines import add_lines, gather_lines, lane_values, store_lines
from hpcpic.core.simd.registers import lanes

__all__ = [
    "Vec",
    "add_lines",
    "address_of",
    "bitmask",
    "bits",
    "convert",
    "count_bits",
    "exchange",
    "first_bit",
    "floor",
    "fma",
    "gather_lines",
    "halves",
    "lane_numbers",
    "lane_values",
    "lanes",
    "largest_lane",
    "last_bit",
    "load",
    "load_at",
    "maximum",
    "minimum",
    "prefetch",
    "prefetch_to_write",
    "rint",
    "select",
    "smallest_lane",
    "splat",
    "sqrt",
    "store",
    "store_at",
    "store_lines",
    "stream_at",
    "to_fixed",
    "total",
]

_MAGIC = 1.5 * 2.0**52  # adding it leaves the nearest integer in the low bits of a float64


# ---- arithmetic


@intrinsic
def splat(typing_context, kind, value):
    """Every lane = value (splat(F, 0.0))."""
    vec = kind.instance_type

    def codegen(context, builder, sig, args):
        return cast_scalar(context, builder, sig.args[1], vec, args[1])

    return vec(kind, value), codegen


@intrinsic
def lane_numbers(typing_context, kind):
    """0, 1, 2, ..."""
    vec = kind.instance_type

    def codegen(context, builder, sig, args):
        return constant(KIND[vec.dtype], list(range(vec.n)))

    return vec(kind), codegen


@intrinsic
def fma(typing_context, a, b, c):
    """a b + c with one rounding; vectors or scalars of a float type, scalars beside vectors."""
    kind = next((arg for arg in (a, b, c) if isinstance(arg, Vec)), a)

    def codegen(context, builder, sig, args):
        return llvm(builder, "fma", *args)

    return kind(kind, kind, kind), codegen


def _of_each_lane(name: str) -> Callable:
    return lambda typing_context, a: (a(a), lambda context, builder, sig, args: llvm(builder, name, args[0]))


sqrt = intrinsic(_of_each_lane("sqrt"))  # correctly rounded
floor = intrinsic(_of_each_lane("floor"))  # the largest whole number not above, as a float
rint = intrinsic(_of_each_lane("rint"))  # the nearest whole number, ties to even, as a float


def _pick(symbol: str) -> Callable:
    def typed(typing_context: Any, a: Any, b: Any) -> Any:
        kind = a if isinstance(a, Vec) else b

        def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            real = kind.real if isinstance(kind, Vec) else isinstance(kind, types.Float)
            compare = builder.fcmp_ordered if real else builder.icmp_signed
            return builder.select(compare(symbol, *args), *args)

        return kind(kind, kind), codegen

    return typed


minimum = intrinsic(_pick("<"))  # a < b ? a : b
maximum = intrinsic(_pick(">"))


@intrinsic
def select(typing_context, mask, a, b):
    """a where the mask is true, else b; one of them may be a scalar. With a number as mask, a number."""
    kind = a if isinstance(a, Vec) else b
    if isinstance(mask, Vec) and not isinstance(kind, Vec):
        raise TypingError("one choice of select must be a vector: splat it")
    return kind(mask, kind, kind), lambda context, builder, sig, args: builder.select(*args)


overload(formulas.fma)(lambda a, b, c: lambda a, b, c: fma(a, b, c))  # type: ignore[call-arg]
overload(formulas.minimum)(lambda a, b: lambda a, b: minimum(a, b))
overload(formulas.maximum)(lambda a, b: lambda a, b: maximum(a, b))
overload(formulas.sqrt)(lambda a: lambda a: sqrt(a))
overload(formulas.select)(lambda mask, a, b: lambda mask, a, b: select(mask, a, b))  # type: ignore[call-arg]


@intrinsic
def bitmask(typing_context, mask):
    """Lane k of a mask as bit k of an int64."""

    def codegen(context, builder, sig, args):
        return builder.zext(builder.bitcast(args[0], ir.IntType(sig.args[0].n)), I64)

    return types.int64(mask), codegen


def _of_bits(emit: Callable) -> Callable:
    """An operation on the bits of an int64: emit(builder, bits)."""
    int64 = types.int64
    return lambda typing_context, bits: (int64(int64), lambda context, builder, sig, args: emit(builder, args[0]))


_FALSE, _63 = ir.Constant(I1, 0), ir.Constant(I64, 63)
first_bit = intrinsic(_of_bits(lambda builder, bits: builder.cttz(bits, _FALSE)))  # of those set; 64 for 0
last_bit = intrinsic(_of_bits(lambda builder, bits: builder.sub(_63, builder.ctlz(bits, _FALSE))))  # -1 for 0
count_bits = intrinsic(_of_bits(lambda builder, bits: builder.ctpop(bits)))  # that are set


# ---- conversions


@intrinsic
def convert(typing_context, kind, a):
    """Lanes as another type: float to float rounds, integer to integer keeps the low bits, integer to float
    rounds, float to integer drops the fraction (float64 to int64 is one instruction with AVX-512 only:
    to_fixed(x, 1.0) does the same for whole numbers everywhere)."""
    vec = kind.instance_type

    def codegen(context, builder, sig, args):
        to, bits = context.get_value_type(vec), vec.dtype.bitwidth - a.dtype.bitwidth
        if a.real and vec.real:
            return (builder.fpext if bits > 0 else builder.fptrunc)(args[1], to) if bits else args[1]
        if a.real or vec.real:
            return (builder.fptosi if a.real else builder.sitofp)(args[1], to)
        return (builder.sext if bits > 0 else builder.trunc)(args[1], to) if bits else args[1]

    return vec(kind, a), codegen


@intrinsic
def halves(typing_context, a):
    """The lower and the upper lanes."""
    half = Vec(a.n // 2, a.dtype)

    def codegen(context, builder, sig, args):
        parts = [shuffle(builder, args[0], args[0], list(range(k, k + half.n))) for k in (0, half.n)]
        return context.make_tuple(builder, sig.return_type, parts)

    return types.UniTuple(half, 2)(a), codegen


@intrinsic
def total(typing_context, a):
    """Sum of the lanes, halves first: ((a0 + a4) + (a2 + a6)) + ((a1 + a5) + (a3 + a7)) of eight."""

    def codegen(context, builder, sig, args):
        vector, n = args[0], a.n // 2
        while n:
            parts = [shuffle(builder, vector, vector, list(range(k, k + n))) for k in (0, n)]
            vector, n = (builder.fadd if a.real else builder.add)(*parts), n // 2
        return builder.extract_element(vector, ir.Constant(I32, 0))

    return a.dtype(a), codegen


def _fold(symbol: str) -> Callable:
    """Halve a vector, from each pair of lanes keeping the one that compares so, until one lane is left."""

    def typed(typing_context: Any, a: Any) -> Any:
        def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            vector, n = args[0], a.n // 2
            compare = builder.fcmp_ordered if a.real else builder.icmp_signed
            while n:
                parts = [shuffle(builder, vector, vector, list(range(k, k + n))) for k in (0, n)]
                vector, n = builder.select(compare(symbol, *parts), *parts), n // 2
            return builder.extract_element(vector, ir.Constant(I32, 0))

        return a.dtype(a), codegen

    return typed


smallest_lane = intrinsic(_fold("<"))
largest_lane = intrinsic(_fold(">"))


@intrinsic
def bits(typing_context, a):
    """The bits of a float64, or of each such lane, as int64."""
    to = Vec(a.n, types.int64) if isinstance(a, Vec) else types.int64
    return to(a), lambda context, builder, sig, args: builder.bitcast(args[0], context.get_value_type(to))


@intrinsic(prefer_literal=True)
def exchange(typing_context, a, distance):
    """Lane k gets lane k ^ distance: a literal power of two exchanges neighbours, pairs, halves of halves and so on."""
    other = distance.literal_value

    def codegen(context, builder, sig, args):
        return shuffle(builder, args[0], args[0], [k ^ other for k in range(a.n)])

    return a(a, distance), codegen


@intrinsic
def to_fixed(typing_context, a, scale):
    """rint(a scale) as int64 lanes, ties to even; float64 lanes, scale a power of two, |a scale| <= 2^51.

    Adding 1.5 2^52 leaves the integer in the low bits: one fused operation and one subtraction, without the
    conversion instruction that only AVX-512DQ has.
    """
    whole = Vec(a.n, types.int64)

    def codegen(context, builder, sig, args):
        magic = constant(ir.DoubleType(), [_MAGIC] * a.n)
        words = ir.VectorType(I64, a.n)
        moved = builder.bitcast(llvm(builder, "fma", args[0], args[1], magic), words)
        return builder.sub(moved, builder.bitcast(magic, words))

    if a.dtype != types.float64:
        raise TypingError(f"to_fixed takes float64 lanes, not {a}")
    return whole(a, a), codegen


# ---- memory; addresses are int64, alignment in bytes, array indices count elements of a 1D array


def _element_address(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.ptrtoint(builder.gep(data, [index]), I64)


def _check_elements(array: types.Array, vec: Any) -> None:
    if not isinstance(vec, Vec) or (array.dtype, array.ndim, array.layout) != (vec.dtype, 1, "C"):
        raise TypingError(f"{vec} is not made of elements of the contiguous line {array}")


@intrinsic
def address_of(typing_context, array, index):
    """Address of an element of a 1D array."""

    def codegen(context, builder, sig, args):
        return _element_address(context, builder, array, *args)

    return types.int64(array, types.int64), codegen


@intrinsic
def load(typing_context, kind, array, index):
    """n elements of a 1D array from an index on."""
    vec = kind.instance_type

    def codegen(context, builder, sig, args):
        address = _element_address(context, builder, array, *args[1:])
        return load_from(builder, address, context.get_value_type(vec), vec.size)

    _check_elements(array, vec)
    return vec(kind, array, types.int64), codegen


@intrinsic
def store(typing_context, array, index, a):
    """Write n elements of a 1D array from an index on."""

    def codegen(context, builder, sig, args):
        address = _element_address(context, builder, array, *args[:2])
        store_to(builder, address, args[2], a.size)
        return context.get_dummy_value()

    _check_elements(array, a)
    return types.void(array, types.int64, a), codegen


@intrinsic(prefer_literal=True)
def load_at(typing_context, kind, address, align):
    """n elements at an address of known alignment (a literal)."""
    vec = kind.instance_type

    def codegen(context, builder, sig, args):
        return load_from(builder, args[1], context.get_value_type(vec), align.literal_value)

    return vec(kind, types.int64, align), codegen


@intrinsic(prefer_literal=True)
def store_at(typing_context, address, a, align):
    """Write n elements at an address of known alignment (a literal)."""

    def codegen(context, builder, sig, args):
        store_to(builder, *args[:2], align.literal_value)
        return context.get_dummy_value()

    return types.void(types.int64, a, align), codegen


@intrinsic
def stream_at(typing_context, address, a):
    """Write past the caches; the address is a multiple of the vector's size."""

    def codegen(context, builder, sig, args):
        written = store_to(builder, *args, a.n * a.size)
        written.set_metadata("nontemporal", builder.module.add_metadata([ir.Constant(I32, 1)]))
        return context.get_dummy_value()

    return types.void(types.int64, a), codegen


def _prefetching(to_write: int) -> Callable:
    def typed(typing_context: Any, address: Any) -> Any:
        def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            place = pointer(builder, args[0], ir.IntType(8))
            flags = [ir.Constant(I32, flag) for flag in (to_write, 3, 1)]  # all cache levels, data
            function_type = ir.FunctionType(ir.VoidType(), [place.type, I32, I32, I32])
            function = cgutils.get_or_insert_function(builder.module, function_type, "llvm.prefetch.p0")
            builder.call(function, [place, *flags])
            return context.get_dummy_value()

        return types.void(types.int64), codegen

    return typed


prefetch = intrinsic(_prefetching(0))  # prefetch(address): the cache line will be read
prefetch_to_write = intrinsic(_prefetching(1))
