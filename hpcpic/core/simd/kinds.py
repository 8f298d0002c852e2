"""The vector type of compiled kernels and its operators, as LLVM vectors; used through `simd.vector`."""

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import (
    lower_builtin,
    lower_cast,
    models,
    register_model,
)
from numba.np.numpy_support import from_dtype

I1, I32, I64 = ir.IntType(1), ir.IntType(32), ir.IntType(64)
KIND = {
    types.float64: ir.DoubleType(),
    types.float32: ir.FloatType(),
    types.int64: I64,
    types.int32: I32,
    types.boolean: I1,
}


class Vec(types.Type):
    """The type of n lanes of float64, float32, int64 or int32, or of booleans: a mask. Also its own name in
    kernels.

    n is a power of two; dtype anything that numpy takes for a dtype.
    """

    def __init__(self, n: int, dtype: Any) -> None:
        if n < 1 or n & (n - 1):
            raise ValueError(f"lanes must be a power of two, not {n}")
        self.n = n
        self.dtype: Any = dtype if isinstance(dtype, types.Type) else from_dtype(np.dtype(dtype))
        super().__init__(name=f"Vec({n}, {self.dtype})")

    @property
    def real(self) -> bool:
        return isinstance(self.dtype, types.Float)

    @property
    def size(self) -> int:
        """Bytes of a lane."""
        return self.dtype.bitwidth // 8

    def can_convert_from(self, typing_context: Any, other: types.Type) -> Conversion | None:
        if isinstance(other, types.Integer) or (isinstance(other, types.Float) and self.real):
            return Conversion.safe
        return None


@register_model(Vec)
class _VecModel(models.PrimitiveModel):
    def __init__(self, manager: Any, vec: Vec) -> None:
        super().__init__(manager, vec, ir.VectorType(KIND[vec.dtype], vec.n))


# ---- pieces of IR


def constant(kind: Any, values: list) -> ir.Constant:
    return ir.Constant(ir.VectorType(kind, len(values)), values)


def shuffle(builder: Any, a: Any, b: Any, lanes_taken: list[int]) -> Any:
    return builder.shuffle_vector(a, b, constant(I32, lanes_taken))


def joined(builder: Any, parts: list) -> Any:
    """One vector of the lanes of several."""
    while len(parts) > 1:
        n = parts[0].type.count
        parts = [shuffle(builder, a, b, list(range(2 * n))) for a, b in zip(parts[::2], parts[1::2])]
    return parts[0]


def splatted(builder: Any, value: Any, n: int) -> Any:
    undefined = ir.Constant(ir.VectorType(value.type, n), ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(I32, 0))
    return shuffle(builder, first, undefined, [0] * n)


def pointer(builder: Any, address: Any, kind: Any) -> Any:
    return builder.inttoptr(address, kind.as_pointer())


def offset(builder: Any, address: Any, n_bytes: int) -> Any:
    return builder.add(address, ir.Constant(I64, n_bytes)) if n_bytes else address


def load_from(builder: Any, address: Any, kind: Any, align: int) -> Any:
    return builder.load(pointer(builder, address, kind), align=align)


def store_to(builder: Any, address: Any, value: Any, align: int) -> Any:
    return builder.store(value, pointer(builder, address, value.type), align=align)


def llvm(builder: Any, name: str, *args: Any) -> Any:
    """Call of the LLVM intrinsic of this name on vectors or scalars, result of the operands' type."""
    kind = args[0].type
    element = kind.element if isinstance(kind, ir.VectorType) else kind
    letter = {ir.DoubleType(): "f64", ir.FloatType(): "f32"}.get(element) or f"i{element.width}"
    suffix = f"v{kind.count}{letter}" if isinstance(kind, ir.VectorType) else letter
    function_type = ir.FunctionType(kind, [arg.type for arg in args])
    function = cgutils.get_or_insert_function(builder.module, function_type, f"llvm.{name}.{suffix}")
    return builder.call(function, args)


# ---- operators


@lower_cast(types.Number, Vec)
def cast_scalar(context: Any, builder: Any, from_type: Any, to_type: Vec, value: Any) -> Any:
    return splatted(builder, context.cast(builder, value, from_type, to_type.dtype), to_type.n)


def _operator(symbol: Any, emit: Callable, accepts: Callable, result: Callable = lambda vec: vec) -> None:
    """Define an operator and its in-place form: emit(builder, vec, *operands), for the types it accepts."""

    class Template(AbstractTemplate):
        def generic(self, args: tuple, keywords: dict) -> Any:
            vec = next((arg for arg in args if isinstance(arg, Vec)), None)
            if vec is None or not accepts(vec):
                return None
            if all(arg == vec or vec.can_convert_from(None, arg) for arg in args):
                return signature(result(vec), *[vec] * len(args))
            return None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return emit(builder, sig.args[0], *args)

    for form in (symbol, getattr(operator, f"i{symbol.__name__.rstrip('_')}", None)):
        if form is not None:
            infer_global(form)(type("Template", (Template,), {}))
            for n_operands in (1, 2):
                lower_builtin(form, *[Vec] * n_operands)(lower)


def _mask_of(vec: Vec) -> Vec:
    return Vec(vec.n, types.boolean)


def _number(vec: Vec) -> bool:
    return vec.dtype is not types.boolean


def _whole(vec: Vec) -> bool:
    return not vec.real


def _integer(vec: Vec) -> bool:
    return _number(vec) and _whole(vec)


def _either(real: str, whole: str) -> Callable:
    return lambda builder, vec, *args: getattr(builder, real if vec.real else whole)(*args)


def _comparison(symbol: str) -> Callable:
    def emit(builder: Any, vec: Vec, a: Any, b: Any) -> Any:
        if not vec.real:
            return builder.icmp_signed(symbol, a, b)
        return (builder.fcmp_unordered if symbol == "!=" else builder.fcmp_ordered)(symbol, a, b)

    return emit


_operator(operator.add, _either("fadd", "add"), _number)
_operator(operator.sub, _either("fsub", "sub"), _number)
_operator(operator.mul, _either("fmul", "mul"), _number)
_operator(operator.truediv, lambda builder, vec, a, b: builder.fdiv(a, b), lambda vec: vec.real)
_operator(operator.neg, lambda builder, vec, a: (builder.fneg if vec.real else builder.neg)(a), _number)
_operator(abs, lambda builder, vec, a: llvm(builder, "fabs", a), lambda vec: vec.real)
_operator(operator.and_, lambda builder, vec, a, b: builder.and_(a, b), _whole)
_operator(operator.or_, lambda builder, vec, a, b: builder.or_(a, b), _whole)
_operator(operator.xor, lambda builder, vec, a, b: builder.xor(a, b), _whole)
_operator(operator.invert, lambda builder, vec, a: builder.not_(a), _whole)
_operator(operator.lshift, lambda builder, vec, a, b: builder.shl(a, b), _integer)
_operator(operator.rshift, lambda builder, vec, a, b: builder.ashr(a, b), _integer)
_operator(operator.lt, _comparison("<"), _number, _mask_of)
_operator(operator.le, _comparison("<="), _number, _mask_of)
_operator(operator.gt, _comparison(">"), _number, _mask_of)
_operator(operator.ge, _comparison(">="), _number, _mask_of)
_operator(operator.eq, _comparison("=="), _number, _mask_of)
_operator(operator.ne, _comparison("!="), _number, _mask_of)
