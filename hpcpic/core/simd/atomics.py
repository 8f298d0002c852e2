"""Atomic operations, waiting and calls by address for compiled code that runs without the GIL.

All atomics are sequentially consistent: on x86 that costs nothing over weaker orders for loads and
read-modify-write. They act on word `index` of a C-contiguous int64 array, or of the words at an address.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_I32 = ir.IntType(32)
_I64 = ir.IntType(64)
_ORDER = "seq_cst"


def _element(context: Any, builder: Any, kind: Any, words: Any, index: Any) -> Any:
    if isinstance(kind, types.Integer):
        first = builder.inttoptr(words, _I64.as_pointer())
    else:
        first = context.make_array(kind)(context, builder, words).data
    return builder.gep(first, [index])


@intrinsic
def load_word(typing_context, words, index):
    """words[index], no other thread writes it."""

    def codegen(context, builder, signature, args):
        return builder.load(_element(context, builder, signature.args[0], args[0], args[1]))

    return types.int64(words, types.int64), codegen


@intrinsic
def store_word(typing_context, words, index, value):
    """words[index] = value, no other thread reads it meanwhile."""

    def codegen(context, builder, signature, args):
        builder.store(args[2], _element(context, builder, signature.args[0], args[0], args[1]))
        return context.get_dummy_value()

    return types.void(words, types.int64, types.int64), codegen


@intrinsic
def atomic_add(typing_context, words, index, value):
    """words[index] += value; the value before."""

    def codegen(context, builder, signature, args):
        pointer = _element(context, builder, signature.args[0], args[0], args[1])
        return builder.atomic_rmw("add", pointer, args[2], _ORDER)

    return types.int64(words, types.int64, types.int64), codegen


@intrinsic
def atomic_load(typing_context, words, index):
    """words[index]."""

    def codegen(context, builder, signature, args):
        pointer = _element(context, builder, signature.args[0], args[0], args[1])
        return builder.load_atomic(pointer, _ORDER, 8)

    return types.int64(words, types.int64), codegen


@intrinsic
def atomic_store(typing_context, words, index, value):
    """words[index] = value."""

    def codegen(context, builder, signature, args):
        pointer = _element(context, builder, signature.args[0], args[0], args[1])
        builder.store_atomic(args[2], pointer, _ORDER, 8)
        return context.get_dummy_value()

    return types.void(words, types.int64, types.int64), codegen


@intrinsic
def atomic_cas(typing_context, words, index, expected, value):
    """Put value where words[index] == expected; whether it was."""

    def codegen(context, builder, signature, args):
        pointer = _element(context, builder, signature.args[0], args[0], args[1])
        swapped = builder.cmpxchg(pointer, args[2], args[3], _ORDER, _ORDER)
        return builder.extract_value(swapped, 1)

    return types.boolean(words, types.int64, types.int64, types.int64), codegen


def _call_symbol(builder: Any, name: str, result: Any, arguments: list[Any]) -> Any:
    function_type = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, function_type, name), arguments)


@intrinsic
def cpu_pause(typing_context):
    """Tell the core that this is a waiting loop."""

    def codegen(context, builder, signature, args):
        if context.codegen()._llvm_module.triple.startswith("x86_64"):
            _call_symbol(builder, "llvm.x86.sse2.pause", ir.VoidType(), [])
        return context.get_dummy_value()

    return types.void(), codegen


@intrinsic
def sched_yield(typing_context):
    """Give the core to another thread that wants it."""

    def codegen(context, builder, signature, args):
        return _call_symbol(builder, "sched_yield", _I32, [])

    return types.int32(), codegen


@intrinsic
def nanoseconds(typing_context):
    """Monotonic clock, ns."""

    def codegen(context, builder, signature, args):
        spec = cgutils.alloca_once(builder, ir.ArrayType(_I64, 2))  # struct timespec
        address = builder.ptrtoint(spec, _I64)
        _call_symbol(builder, "clock_gettime", _I32, [ir.Constant(_I32, 1), address])
        spec_value = builder.load(spec)
        seconds = builder.mul(builder.extract_value(spec_value, 0), ir.Constant(_I64, 10**9))
        return builder.add(seconds, builder.extract_value(spec_value, 1))

    return types.int64(), codegen


@intrinsic
def semaphore_wait(typing_context, address):
    """sem_wait: 0 when one was taken, -1 when a signal interrupted."""

    def codegen(context, builder, signature, args):
        return _call_symbol(builder, "sem_wait", _I32, list(args))

    return types.int32(types.int64), codegen


@intrinsic
def semaphore_post(typing_context, address):
    """sem_post."""

    def codegen(context, builder, signature, args):
        return _call_symbol(builder, "sem_post", _I32, list(args))

    return types.int32(types.int64), codegen


def _function_call(n_integers: int, result: Any, result_type: Any) -> Any:
    """Call of the function at an address with int64 arguments (callees of less read the low part)."""

    def codegen(context, builder, signature, args):
        function_type = ir.FunctionType(result, [_I64] * n_integers)
        return builder.call(builder.inttoptr(args[0], function_type.as_pointer()), args[1:])

    return result_type(*[types.int64] * (n_integers + 1)), codegen


@intrinsic
def call_address(typing_context, function, context):
    """int64 function(int64 context)."""
    return _function_call(1, _I64, types.int64)


@intrinsic
def call_message(typing_context, function, buffer, count, datatype, peer, tag, comm, request):
    """int MPI_Isend(void *buffer, int count, datatype, int peer, int tag, comm, void *request), or MPI_Irecv.

    Handles are ints (MPICH) or pointers (Open MPI): both travel in the low part of a register.
    """
    return _function_call(7, _I32, types.int32)


@intrinsic
def call_testall(typing_context, function, n, requests, flag, statuses):
    """int MPI_Testall(int n, void *requests, int *flag, void *statuses)."""
    return _function_call(4, _I32, types.int32)


@intrinsic
def load_int32(typing_context, address):
    """The int32 at an address, read anew each time."""

    def codegen(context, builder, signature, args):
        return builder.load_atomic(builder.inttoptr(args[0], _I32.as_pointer()), _ORDER, 4)

    return types.int32(types.int64), codegen
