"""The lines of memory that the vector push keeps for each cell of a tile: field coefficients and sums of charge.

Lanes are particles, and each wants the line of its own cell. A line is loaded or added whole, and lanes and lines are
transposed by shuffles of words of 16 bytes and shuffles within words: those that cross words cost twice as much, and
those of two registers by an index of lanes more. Where the lines are stands in memory, written well before, so that
nothing waits for it.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hpcpic.core.simd.kinds import I32, I64, KIND, joined, llvm, load_from, offset, pointer, shuffle, splatted, store_to

FIELD, SUMS = 8, 4  # values of a line
WORDS = 4  # of a register


@intrinsic
def opaque(typing_context, number):
    """Return a number of which the compiler knows nothing: it leaves alone what is made of it in a loop."""

    def codegen(context, builder, signature, arguments):
        return builder.asm(ir.FunctionType(I64, [I64]), "", "=r,0", arguments, False)

    return types.int64(types.int64), codegen


@intrinsic
def whole_at(typing_context, address, index):
    """Element of an int32 array at an address: unlike the array, an address has no owners to be counted."""

    def codegen(context, builder, signature, arguments):
        place = builder.gep(pointer(builder, arguments[0], I32), [arguments[1]])
        return builder.sext(builder.load(place), I64)

    return types.int64(types.int64, types.int64), codegen


def _start(builder: Any, base: Any, cells: Any, vec: Any, k: int, shift: int = 0) -> Any:
    """base + (integer k, of a lane's size, at an address >> shift)."""
    found = builder.load(pointer(builder, offset(builder, cells, vec.size * k), ir.IntType(8 * vec.size)))
    found = found if vec.size == 8 else builder.sext(found, I64)
    return builder.add(base, builder.ashr(found, ir.Constant(I64, shift)) if shift else found)


def _words(builder: Any, a: Any, b: Any, words: tuple) -> Any:
    """A vector of four words: 0 to 3 of a, 4 to 7 of b."""
    n = a.type.count // WORDS
    return shuffle(builder, a, b, [n * word + k for word in words for k in range(n)])


def _within_words(builder: Any, rows: list) -> list:
    """Rows as many as values in a word: value k of a word of row r becomes value r of the word of row k."""
    n = rows[0].type.count
    size = n // WORDS

    def mixed(a: Any, b: Any, lanes: tuple) -> Any:
        return shuffle(builder, a, b, [word + (k if k < size else n + k - size)
                                       for word in range(0, n, size) for k in lanes])  # fmt: skip

    if size == 2:
        return [mixed(rows[0], rows[1], (0, 2)), mixed(rows[0], rows[1], (1, 3))]
    low, high = (0, 4, 1, 5), (2, 6, 3, 7)
    a, b, c, d = (mixed(one, other, lanes) for lanes in (low, high) for one, other in (rows[:2], rows[2:]))
    return [mixed(p, q, lanes) for p, q in ((a, b), (c, d)) for lanes in ((0, 1, 4, 5), (2, 3, 6, 7))]


@intrinsic
def gather_field(typing_context, kind, base, cells):
    """Eight vectors: lane k of vector j is value j of the line at base + (integer k at address `cells`)."""
    vec = kind.instance_type

    def codegen(context, builder, sig, args):
        line = ir.VectorType(KIND[vec.dtype], FIELD)
        starts = [_start(builder, *args[1:], vec, k) for k in range(vec.n)]
        lines = [load_from(builder, start, line, FIELD * vec.size) for start in starts]
        split = _split_f64 if vec.size == 8 else _split_f32
        found = []
        for rows in split(builder, lines):
            found += _within_words(builder, rows)
        return context.make_tuple(builder, sig.return_type, found)

    return types.UniTuple(vec, FIELD)(kind, types.int64, types.int64), codegen


@intrinsic
def gather_sides(typing_context, kind, base, cells, places):
    """Four vectors: lane k of vector j is a[j] + f b[j] of the line (a[4], b[4]) at base + (integer k at address
    `cells`), f the number k at address `places`.

    The sum is that of a line, before lines become lanes, which halves what is shuffled.
    """
    vec = kind.instance_type

    def codegen(context, builder, sig, args):
        _, base, cells, places = args
        value, half, n_bytes = KIND[vec.dtype], ir.VectorType(KIND[vec.dtype], FIELD // 2), FIELD // 2 * vec.size
        starts = [_start(builder, base, cells, vec, k) for k in range(vec.n)]

        def halves(lanes: list) -> list:
            parts = [[offset(builder, starts[k], first) for k in lanes] for first in (0, n_bytes)]
            return [joined(builder, [load_from(builder, at, half, n_bytes) for at in part]) for part in parts]

        if vec.size == 8:
            rows = []
            for k in range(vec.n):
                (a, b), place = halves([k]), pointer(builder, offset(builder, places, vec.size * k), value)
                rows.append(llvm(builder, "fma", splatted(builder, builder.load(place), FIELD // 2), b, a))
            rows = [joined(builder, [rows[k], rows[k + 2]]) for k in (0, 1, 4, 5)]
            low, high = _within_words(builder, rows[:2]), _within_words(builder, rows[2:])
            found = [_words(builder, *pair, words) for words in ((0, 2, 4, 6), (1, 3, 5, 7)) for pair in zip(low, high)]
        else:
            f, rows = load_from(builder, places, context.get_value_type(vec), vec.size), []
            for k in range(WORDS):
                a, b = halves(list(range(k, vec.n, WORDS)))
                same = shuffle(builder, f, f, [word + k for word in range(0, vec.n, WORDS) for _ in range(WORDS)])
                rows.append(llvm(builder, "fma", same, b, a))
            found = _within_words(builder, rows)
        return context.make_tuple(builder, sig.return_type, found)

    return types.UniTuple(vec, FIELD // 2)(kind, types.int64, types.int64, types.int64), codegen


@intrinsic(prefer_literal=True)
def gather_values(typing_context, kind, m, base, cells, shift):
    """m vectors, m = 1 or 2: lane k of vector j is value j at base + (integer k at address `cells` >> shift)."""
    vec, n_values = kind.instance_type, m.literal_value

    def codegen(context, builder, sig, args):
        line = ir.VectorType(KIND[vec.dtype], n_values)
        starts = [_start(builder, *args[2:4], vec, k, shift.literal_value) for k in range(vec.n)]
        lines = [load_from(builder, start, line, n_values * vec.size) for start in starts]
        rows = [joined(builder, lines[row::n_values]) for row in range(n_values)]
        if n_values == 2:
            rows = [shuffle(builder, *rows, [k + j + (k % 2) * (vec.n - 1) for k in range(vec.n)]) for j in range(2)]
        return context.make_tuple(builder, sig.return_type, rows)

    return types.UniTuple(vec, n_values)(kind, m, types.int64, types.int64, shift), codegen


def _split_f64(builder: Any, lines: list) -> list:
    """By word of a line: rows of the words of the even and of the odd lines; a line is four words."""
    quarters = []
    for p, q, r, s in (lines[0::2], lines[1::2]):
        low, high = (0, 1, 4, 5), (2, 3, 6, 7)
        pairs = [(_words(builder, p, q, half), _words(builder, r, s, half)) for half in (low, high)]
        quarters.append([_words(builder, *pair, words) for pair in pairs for words in ((0, 2, 4, 6), (1, 3, 5, 7))])
    return [list(rows) for rows in zip(*quarters)]


def _split_f32(builder: Any, lines: list) -> list:
    """By word of a line: rows of the words of lines r, r + 4, r + 8, r + 12; a line is two words."""
    pairs = [
        shuffle(builder, a, b, list(range(2 * FIELD))) for a, b in zip(lines[:4] + lines[8:12], lines[4:8] + lines[12:])
    ]
    return [
        [_words(builder, pairs[r], pairs[4 + r], words) for r in range(4)] for words in ((0, 2, 4, 6), (1, 3, 5, 7))
    ]


@intrinsic
def add_sums(typing_context, base, cells, vectors):
    """Add lane k of vector j of four or eight to value j of the line at base + (integer k at address `cells`).

    One lane after the other, so lines may coincide.
    """
    vec = vectors.dtype
    lines_of = {(4, 8): _lines_i64, (4, 4): _lines_i32, (8, 8): _long_lines_i64, (8, 4): _long_lines_i32}

    def codegen(context, builder, sig, args):
        lines = lines_of[vectors.count, vec.size](builder, cgutils.unpack_tuple(builder, args[2]))
        for k, line in enumerate(lines):
            start = _start(builder, *args[:2], vec, k)  # one by one: registers do not hold them all
            before = load_from(builder, start, line.type, vectors.count * vec.size)
            store_to(builder, start, builder.add(before, line), vectors.count * vec.size)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, vectors), codegen


@intrinsic(prefer_literal=True)
def add_whole(typing_context, base, cells, shift, a):
    """Add lane k to the integer at base + (integer k at address `cells` >> shift), one lane after the other."""

    def codegen(context, builder, sig, args):
        for k in range(a.n):
            start = _start(builder, *args[:2], a, k, shift.literal_value)
            value = builder.extract_element(args[3], ir.Constant(I32, k))
            place = pointer(builder, start, value.type)
            builder.store(builder.add(builder.load(place), value), place)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, shift, a), codegen


def _lines_i64(builder: Any, values: list) -> list:
    left, right = _within_words(builder, values[:2]), _within_words(builder, values[2:])
    lines = {}
    for odd in range(2):
        for half, words in enumerate(((0, 4, 1, 5), (2, 6, 3, 7))):
            both = _words(builder, left[odd], right[odd], words)
            for k in range(2):
                lines[4 * half + 2 * k + odd] = shuffle(builder, both, both, list(range(4 * k, 4 * k + 4)))
    return [lines[k] for k in range(8)]


def _lines_i32(builder: Any, values: list) -> list:
    rows = _within_words(builder, values)
    return [shuffle(builder, rows[k % 4], rows[k % 4], list(range(k // 4 * 4, k // 4 * 4 + 4))) for k in range(16)]


def _long_lines_i64(builder: Any, values: list) -> list:
    """Eight vectors are a square, and the way back is that of gather_field."""
    return [line for rows in _split_f64(builder, values) for line in _within_words(builder, rows)]


def _long_lines_i32(builder: Any, values: list) -> list:
    left, right = _within_words(builder, values[:4]), _within_words(builder, values[4:])
    both = [[_words(builder, a, b, words) for words in ((0, 4, 1, 5), (2, 6, 3, 7))] for a, b in zip(left, right)]
    taken = ((both[k % 4][k // 8], k // 4 % 2 * 8) for k in range(16))
    return [shuffle(builder, pair, pair, list(range(first, first + 8))) for pair, first in taken]


@intrinsic
def load_sums(typing_context, kind, address):
    """Four vectors of eight: lane k of vector j is value j of line k of eight at an address, one after the other."""
    vec = kind.instance_type

    def codegen(context, builder, sig, args):
        value = context.get_value_type(vec)
        a, b, c, d = (
            load_from(builder, offset(builder, args[1], k * vec.n * vec.size), value, SUMS * vec.size) for k in range(4)
        )
        found = []
        for first in (0, 2):
            mask = [k + first + half for half in range(2) for k in (0, 4, 8, 12)]
            low, high = shuffle(builder, a, b, mask), shuffle(builder, c, d, mask)
            found += [shuffle(builder, low, high, [k + n for n in (0, 8) for k in taken])
                      for taken in (range(4), range(4, 8))]  # fmt: skip
        return context.make_tuple(builder, sig.return_type, found)

    return types.UniTuple(vec, SUMS)(kind, types.int64), codegen


@intrinsic
def shifted_up(typing_context, a):
    """Lane k - 1 on lane k, zero on lane 0."""

    def codegen(context, builder, sig, args):
        zero = ir.Constant(args[0].type, None)
        return shuffle(builder, args[0], zero, [a.n, *range(a.n - 1)])

    return a(a), codegen


@intrinsic
def shifted_down(typing_context, a):
    """Lane k + 1 on lane k, zero on the last lane."""

    def codegen(context, builder, sig, args):
        zero = ir.Constant(args[0].type, None)
        return shuffle(builder, args[0], zero, [*range(1, a.n), a.n])

    return a(a), codegen


def _adding(lane: int) -> Callable:
    def typed(typing_context: Any, address: Any, a: Any) -> Any:
        def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            one = builder.extract_element(args[1], ir.Constant(I32, lane % a.n))
            place = pointer(builder, args[0], one.type)
            builder.store(builder.add(builder.load(place), one), place)
            return context.get_dummy_value()

        return types.void(types.int64, a), codegen

    return typed


add_first = intrinsic(_adding(0))  # add the first lane of an integer vector to the integer at an address
add_last = intrinsic(_adding(-1))
