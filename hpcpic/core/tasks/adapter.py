"""The entry through which a task calls its kernel: compiled once for a signature, kept with the compiled kernels.

A task is int64(int64 context). The context is [kernel address, words of the arguments], and the adapter loads the
arguments from there: one adapter serves all kernels of a signature.
"""

import functools
import hashlib
import struct
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

from hpcpic.core.simd.compile import kernel_store

RAISED = np.iinfo(np.int64).min  # what an adapter returns for a kernel that raised an exception
_LENGTH = struct.Struct("<Q")  # of the machine code, behind which the bitcode stands


@functools.cache
@global_compiler_lock
def adapter(kernel_type: ir.FunctionType, result_bits: int) -> tuple[int, Any]:
    """Address of the adapter for kernels of this type whose result has so many bits (0: none), and its owner.

    numba's calling convention: status kernel(result*, exception**, flat arguments...), status 0 or -2 (None) when
    good. The owner must live as long as the code is used.
    """
    name = "task_" + hashlib.sha256(f"{kernel_type} {result_bits}".encode()).hexdigest()[:32]
    codegen = cpu_target.target_context.codegen()
    store = kernel_store()
    content = store.read(f"{name}.bin")
    if content is not None:
        library = codegen.unserialize_library((name, "object", _parts(content)))
    else:
        library = codegen.create_library(name)
        library.enable_object_caching()
        library.add_ir_module(_module(library, name, kernel_type, result_bits))
        library.finalize()
        _, _, (code, bitcode) = library.serialize_using_object_code()
        store.write(f"{name}.bin", _LENGTH.pack(len(code)) + code + bitcode)
    return library.get_pointer_to_function(name), library


def _parts(content: bytes) -> tuple[bytes, bytes]:
    (length,) = _LENGTH.unpack_from(content)
    return content[_LENGTH.size : _LENGTH.size + length], content[_LENGTH.size + length :]


def _module(library: Any, name: str, kernel_type: ir.FunctionType, result_bits: int) -> ir.Module:
    i64 = ir.IntType(64)
    module = library.create_ir_module(name)
    function = ir.Function(module, ir.FunctionType(i64, [i64]), name)
    builder = ir.IRBuilder(function.append_basic_block())

    def load(word: int, as_type: Any) -> Any:
        address = builder.add(function.args[0], ir.Constant(i64, 8 * word))
        return builder.load(builder.inttoptr(address, as_type.as_pointer()))

    result, exception = builder.alloca(i64), builder.alloca(i64)
    slots = [builder.bitcast(slot, kernel_type.args[k]) for k, slot in enumerate((result, exception))]
    arguments = [load(word, as_type) for word, as_type in enumerate(kernel_type.args[2:], start=1)]
    status = builder.call(load(0, kernel_type.as_pointer()), [*slots, *arguments])
    good = builder.or_(*[builder.icmp_signed("==", status, ir.Constant(status.type, k)) for k in (0, -2)])
    code = ir.Constant(i64, 0)
    if result_bits:
        code = builder.sext(builder.trunc(builder.load(result), ir.IntType(result_bits)), i64)
    builder.ret(builder.select(good, code, ir.Constant(i64, RAISED)))
    return module
