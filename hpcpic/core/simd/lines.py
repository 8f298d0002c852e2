"""Short lines of memory, one for each lane: gathered into vectors and added from vectors, by transposition.

A lane's line is m consecutive values (the corners of its cell); a gather of lines is one load for each lane
and log2 m shuffles for each vector, several times faster than the gather instruction.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hpcpic.core.simd.kinds import I64, KIND, joined, load_from, offset, pointer, shuffle, store_to

PIECE = 32  # bytes


def _butterfly(builder: Any, rows: list, stages: list[int]) -> list:
    """Transpose blocks of len(rows) lanes: lane m g + r of output k is lane m g + k of row r, m rows."""
    rows = list(rows)
    n = rows[0].type.count
    for s in stages:
        for j in range(len(rows)):
            if j & s:
                continue
            a, b = rows[j], rows[j + s]
            rows[j] = shuffle(builder, a, b, [e if not e & s else n + e - s for e in range(n)])
            rows[j + s] = shuffle(builder, a, b, [e + s if not e & s else n + e for e in range(n)])
    return rows


def _stages(m: int) -> list[int]:
    """Largest block first: the loads of the first stage combine with the insertions of halves."""
    return [1 << k for k in reversed(range(m.bit_length() - 1))]


def _lanes(builder: Any, vector: Any, vec: Any) -> list:
    """The lanes of a vector, integers as int64, through memory: one store and n loads beat n extractions.

    In pieces of 32 bytes at most: Intel's processors let loads of single lanes wait for a store of 64.
    """
    kind, size = vector.type, vec.size
    part = min(kind.count, PIECE // size)
    found = []
    for first in range(0, kind.count, part):
        piece = shuffle(builder, vector, vector, list(range(first, first + part)))
        slot = cgutils.alloca_once(builder, piece.type)
        slot.align = part * size
        builder.store(piece, slot)
        address = builder.ptrtoint(slot, I64)  # keeps LLVM from undoing it
        places = [offset(builder, address, size * k) for k in range(part)]
        found += [builder.load(pointer(builder, place, kind.element)) for place in places]
    return found if vec.real or size == 8 else [builder.sext(lane, I64) for lane in found]


def _pieces(m: int, n: int) -> list[tuple[int, int]]:
    """Blocks (first value, values) in which m values of n lanes are transposed: at most n values at a
    time."""
    width = min(m, n)
    return [(first, width) for first in range(0, m, width)]


@intrinsic(prefer_literal=True)
def gather_lines(typing_context, kind, m, base, offsets):
    """m vectors: lane k of vector j is value j of the line at address base + offsets[k] (bytes, int vector).

    m is a literal power of two. Lines are aligned to their own size.
    """
    vec, n_values = kind.instance_type, m.literal_value

    def codegen(context, builder, sig, args):
        starts = [builder.add(args[2], word) for word in _lanes(builder, args[3], offsets)]
        found = []
        for first, width in _pieces(n_values, vec.n):
            line = ir.VectorType(KIND[vec.dtype], width)
            places = [offset(builder, start, first * vec.size) for start in starts]
            lines = [load_from(builder, place, line, width * vec.size) for place in places]
            rows = [joined(builder, lines[row::width]) for row in range(width)]
            found += _butterfly(builder, rows, _stages(width))
        return context.make_tuple(builder, sig.return_type, found)

    return types.UniTuple(vec, n_values)(kind, m, types.int64, offsets), codegen


@intrinsic
def add_lines(typing_context, base, offsets, vectors):
    """Add lane k of vector j to value j of the line at address base + offsets[k]; lane after lane, so lines
    may coincide. `vectors` is a tuple of a power of two of float or integer vectors; lines are aligned to
    their size.
    """
    vec, n_values = vectors.dtype, vectors.count

    def codegen(context, builder, sig, args):
        starts = [builder.add(args[0], word) for word in _lanes(builder, args[1], offsets)]
        values = cgutils.unpack_tuple(builder, args[2])
        add = builder.fadd if vec.real else builder.add
        blocks = [
            (first, width, _butterfly(builder, values[first : first + width], _stages(width)))
            for first, width in _pieces(n_values, vec.n)
        ]
        for lane, start in enumerate(starts):
            for first, width, rows in blocks:
                group, row = divmod(lane, width)
                line = shuffle(builder, rows[row], rows[row], list(range(group * width, group * width + width)))
                place = offset(builder, start, first * vec.size)
                before = load_from(builder, place, line.type, width * vec.size)
                store_to(builder, place, add(before, line), width * vec.size)
        return context.get_dummy_value()

    return types.void(types.int64, offsets, vectors), codegen


@intrinsic
def store_lines(typing_context, address, vectors):
    """Write m vectors as lines of m values, one after the other: lane k of all of them on line k. m is 2 or the
    number of lanes.
    """
    m, n = vectors.count, vectors.dtype.n

    def codegen(context, builder, sig, args):
        rows = cgutils.unpack_tuple(builder, args[1])
        rows = _butterfly(builder, rows, _stages(n)) if m == n else _zipped(builder, *rows)
        for k, row in enumerate(rows):
            store_to(builder, offset(builder, args[0], k * n * vectors.dtype.size), row, vectors.dtype.size)
        return context.get_dummy_value()

    return (types.void(types.int64, vectors), codegen) if m in (2, n) else None


def _zipped(builder: Any, a: Any, b: Any) -> list:
    """a0 b0 a1 b1 ... of two vectors."""
    n = a.type.count
    lanes = [k // 2 + (n if k % 2 else 0) for k in range(2 * n)]
    return [shuffle(builder, a, b, lanes[:n]), shuffle(builder, a, b, lanes[n:])]


@intrinsic
def lane_values(typing_context, a):
    """The lanes of a vector as a tuple; those of integers as int64."""

    def codegen(context, builder, sig, args):
        return context.make_tuple(builder, sig.return_type, _lanes(builder, args[0], a))

    return types.UniTuple(a.dtype if a.real else types.int64, a.n)(a), codegen
