"""Compiled tasks of the slab transform: blocks of rows, blocks of columns, and the transpose between them.

A block of rows is transformed in a workspace that stays in cache and is written transposed straight to where
its columns live; the columns are contiguous there, are transformed in place, and are read back the same way.
"""

import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic, overload

from hpcpic.core.simd.atomics import atomic_cas, atomic_store, cpu_pause
from hpcpic.core.simd.compile import njit

# signed indices would keep the loops scalar
_0, _1, _2, _3, _4, _32 = (np.uint64(k) for k in (0, 1, 2, 3, 4, 32))


@intrinsic
def _call(typing_context, execute, plan, source, target):
    """fftw_execute_dft*(plan, source, target) by address."""

    def generate(context, builder, signature, arguments):
        i64 = ir.IntType(64)
        function = ir.FunctionType(ir.VoidType(), [i64, i64, i64])
        builder.call(builder.inttoptr(arguments[0], function.as_pointer()), arguments[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64, types.int64), generate


@njit
def _execute(plan, source, target):
    """Transform one contiguous array into another, by a plan (core.comm.fftw)."""
    _call(plan.execute, plan.plan, source.ctypes.data, target.ctypes.data)


@intrinsic
def _pointer(typing_context, address):
    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), generate


@njit
def _take(busy):
    """Number of a free workspace, now ours. busy[8 * slots] int64, a cache line each, one per worker."""
    while True:
        for slot in range(busy.size // 8):
            if atomic_cas(busy, 8 * slot, 0, 1):
                return slot
        cpu_pause()


@njit
def transpose(source, i, c, target, d, e, n, m):
    """target[d + k, e + l] = source[i + l, c + k] for l < n, k < m.

    4 x 4 tiles in registers, 32 x 32 in cache. source, target: 2D, C order; all numbers uint64.
    """
    n4, m4 = n // _4 * _4, m // _4 * _4
    for ll in range(_0, n4, _32):
        for kk in range(_0, m4, _32):
            for k in range(kk, min(m4, kk + _32), _4):
                for l in range(ll, min(n4, ll + _32), _4):
                    a, b, p, q = i + l, c + k, d + k, e + l
                    s00, s01, s02, s03 = source[a, b], source[a, b + _1], source[a, b + _2], source[a, b + _3]
                    a += _1
                    s10, s11, s12, s13 = source[a, b], source[a, b + _1], source[a, b + _2], source[a, b + _3]
                    a += _1
                    s20, s21, s22, s23 = source[a, b], source[a, b + _1], source[a, b + _2], source[a, b + _3]
                    a += _1
                    s30, s31, s32, s33 = source[a, b], source[a, b + _1], source[a, b + _2], source[a, b + _3]
                    target[p, q], target[p, q + _1], target[p, q + _2], target[p, q + _3] = s00, s10, s20, s30
                    p += _1
                    target[p, q], target[p, q + _1], target[p, q + _2], target[p, q + _3] = s01, s11, s21, s31
                    p += _1
                    target[p, q], target[p, q + _1], target[p, q + _2], target[p, q + _3] = s02, s12, s22, s32
                    p += _1
                    target[p, q], target[p, q + _1], target[p, q + _2], target[p, q + _3] = s03, s13, s23, s33
    for k in range(m4, m):
        for l in range(_0, n):
            target[d + k, e + l] = source[i + l, c + k]
    for l in range(n4, n):
        for k in range(_0, m4):
            target[d + k, e + l] = source[i + l, c + k]


@njit
def rows_forward(first, last, real, plan, workspace, busy, width, homes):
    """Transform rows first..last of real[n0, pitch] and write them transposed to the homes of their columns.

    workspace[slots, at least (last - first) * width] complex. homes int64[ranks, 5]: address of
    complex[columns, pitch], its pitch, the place of our row 0 in it, the columns lo, hi that live there.
    """
    slot = _take(busy)
    block = workspace[slot, : (last - first) * width].reshape(last - first, width)
    height = np.uint64(last - first)
    for i in range(last - first):
        _execute(plan, real[first + i], block[i])
    for h in range(homes.shape[0]):
        address, pitch, offset, lo, hi = homes[h]
        home = carray(_pointer(address), (hi - lo, pitch), block.dtype)
        transpose(block, _0, np.uint64(lo), home, _0, np.uint64(offset + first), height, np.uint64(hi - lo))
    atomic_store(busy, 8 * slot, 0)
    return 0


@njit
def rows_backward(first, last, real, plan, workspace, busy, width, homes):
    """Read rows first..last back from the homes of their columns and transform them into real[n0, pitch]."""
    slot = _take(busy)
    block = workspace[slot, : (last - first) * width].reshape(last - first, width)
    height = np.uint64(last - first)
    for h in range(homes.shape[0]):
        address, pitch, offset, lo, hi = homes[h]
        home = carray(_pointer(address), (hi - lo, pitch), block.dtype)
        transpose(home, _0, np.uint64(offset + first), block, _0, np.uint64(lo), np.uint64(hi - lo), height)
    for i in range(last - first):
        _execute(plan, block[i], real[first + i])
    atomic_store(busy, 8 * slot, 0)
    return 0


@njit
def _bring(column, c, parts):
    """Put the parts of column c that came as messages into column[N0].

    parts int64[senders, 3]: address of complex[outputs, columns, n], n rows of the sender, their place in the
    column.
    """
    for s in range(parts.shape[0]):
        address, n, offset = parts[s]
        part = carray(_pointer(address + c * n * column.itemsize), (n,), column.dtype)
        for i in range(np.uint64(n)):
            column[np.uint64(offset) + i] = part[i]


@njit
def _send(column, output, c, columns, parts):
    """Put the parts of column c of one output where the messages back take them from."""
    for s in range(parts.shape[0]):
        address, n, offset = parts[s]
        part = carray(_pointer(address + (output * columns + c) * n * column.itemsize), (n,), column.dtype)
        for i in range(np.uint64(n)):
            part[i] = column[np.uint64(offset) + i]


def _multiply(source, factor, target):
    """target = source * factor, complex[n], factor real or complex: chosen by type when compiled."""
    np.multiply(source, factor, out=target)


@overload(_multiply)
def _choose_multiply(source, factor, target):
    def by_real(source, factor, target):
        for j in range(source.size):
            target[j] = complex(source[j].real * factor[j], source[j].imag * factor[j])

    def by_complex(source, factor, target):
        for j in range(source.size):
            target[j] = source[j] * factor[j]

    return by_complex if isinstance(factor.dtype, types.Complex) else by_real


@njit
def columns_forward(first, last, spectrum, n, plan, workspace, busy, parts):
    """Transform columns first..last of spectrum[outputs, m, pitch], n points each, in place in output 0."""
    slot = _take(busy)
    for c in range(first, last):
        column = spectrum[0, c, :n]
        _bring(column, c, parts)
        _execute(plan, column, workspace[slot])
        for i in range(n):
            column[i] = workspace[slot, i]
    atomic_store(busy, 8 * slot, 0)
    return 0


@njit
def columns_backward(first, last, spectrum, n, plan, workspace, busy, parts):
    """The inverse of columns_forward (not normalised)."""
    slot = _take(busy)
    for c in range(first, last):
        column = spectrum[0, c, :n]
        _execute(plan, column, workspace[slot])
        for i in range(n):
            column[i] = workspace[slot, i]
        _send(column, 0, c, spectrum.shape[1], parts)
    atomic_store(busy, 8 * slot, 0)
    return 0


@njit
def columns_solve(first, last, spectrum, n, forward, backward, workspace, busy, parts, multiplier):
    """Columns first..last: transform, times multiplier[outputs, m, n], transform back for each output."""
    slot = _take(busy)
    half = workspace.shape[1] // 2
    transformed, product = workspace[slot, :n], workspace[slot, half : half + n]
    for c in range(first, last):
        column = spectrum[0, c, :n]
        _bring(column, c, parts)
        _execute(forward, column, transformed)
        for k in range(multiplier.shape[0]):
            result = spectrum[k, c, :n]
            _multiply(transformed, multiplier[k, c], product)
            _execute(backward, product, result)
            _send(result, k, c, spectrum.shape[1], parts)
    atomic_store(busy, 8 * slot, 0)
    return 0


@njit
def line(plan, source, target):
    """One transform."""
    _execute(plan, source, target)


@njit
def line_product(plan, source, factor, product, target):
    """The inverse of source * factor, complex[m] each, into real target."""
    _multiply(source, factor, product)
    _execute(plan, product, target)


@njit
def join():
    """Nothing: a task that waits for many, so that many can wait for one."""
    return 0
