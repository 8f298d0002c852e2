"""Single instructions that numba has no name for."""

from llvmlite import ir
from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic
def fma(typingctx, a, b, c):
    """a b + c with one rounding; all three of one float type."""

    def codegen(context, builder, signature, arguments):
        kind = arguments[0].type
        name = "llvm.fma.f64" if isinstance(kind, ir.DoubleType) else "llvm.fma.f32"
        function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind] * 3), name)
        return builder.call(function, arguments)

    return a(a, b, c), codegen
