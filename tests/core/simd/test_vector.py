import re
from fractions import Fraction

import numba
import numpy as np
import pytest
from llvmlite import binding

from hpcpic.core.simd.generate import module_from_source
from hpcpic.core.simd.vector import Vec, lanes

HEADER = """
import numpy as np
from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import *

F = Vec({n}, np.{dtype})
I = Vec({n}, np.int64)
D = Vec({n}, np.float64)
"""
WIDTHS = [2, 4, 8, 16]
FEATURES = binding.get_host_cpu_features()


def in_widths(*dtypes):
    """Each type in all widths, by default in the least and in that of a register."""
    return [
        pytest.param(dtype, n, marks=[] if n in (2, 64 // np.dtype(dtype).itemsize) else pytest.mark.validation)
        for dtype in dtypes
        for n in WIDTHS
    ]


def kernels(text, n, dtype="float64"):
    return module_from_source(HEADER.format(n=n, dtype=dtype) + text, "vector_test")


def aligned(size, dtype, values=None):
    """An array on a cache line, of the values if any."""
    dtype = np.dtype(dtype)
    raw = np.zeros(size * dtype.itemsize + 64, np.uint8)
    array = raw[-raw.ctypes.data % 64 :][: size * dtype.itemsize].view(dtype)
    if values is not None:
        array[:] = values
    return array


def same_bits(a, b):
    """Equal in every bit, where any not-a-number equals any other."""
    return (
        a.dtype == b.dtype
        and np.array_equal(a, b, equal_nan=True)
        and np.array_equal(np.signbit(a)[~np.isnan(a)], np.signbit(b)[~np.isnan(b)])
    )


def specials(dtype):
    """Pairs of numbers in which ties, signed zeros, infinities, subnormals and not-a-number meet."""
    tiny = np.finfo(dtype).smallest_subnormal
    some = np.array(
        [0.0, -0.0, 1.0, -1.0, 0.5, 1.5, 2.5, -2.5, np.inf, -np.inf, np.nan, tiny, -tiny, 3e30, 1 / 3], dtype
    )
    rng = np.random.default_rng(3)
    a, b = (np.concatenate([grid.ravel(), rng.normal(size=31).astype(dtype)]) for grid in np.meshgrid(some, some))
    return a, b  # 256 pairs


OPERATIONS = """
@njit
def apply(a, b, out):
    for p in range(0, a.size, {n}):
        x, y = load(F, a, p), load(F, b, p)
        store(out[0], p, x + y)
        store(out[1], p, x - y)
        store(out[2], p, x * y)
        store(out[3], p, x / y)
        store(out[4], p, -x)
        store(out[5], p, abs(x))
        store(out[6], p, sqrt(x))
        store(out[7], p, floor(x))
        store(out[8], p, rint(x))
        store(out[9], p, minimum(x, y))
        store(out[10], p, maximum(x, y))
        store(out[11], p, select(x < y, x, y * 2.0))
        store(out[12], p, select((x <= y) & ~(x == y), 1.0, y))
        store(out[13], p, select((x > y) | (x != y), x, 0.25))
        store(out[14], p, select((x >= y) ^ (x == x), splat(F, 3.0), x))
        store(out[15], p, 1.0 - x)
        x += y
        x *= 3
        store(out[16], p, x)
"""


@pytest.mark.parametrize("dtype, n", in_widths("float64", "float32"))
def test_operations_have_the_bits_of_numpy(dtype, n):
    a, b = specials(dtype)
    out = np.zeros((17, a.size), dtype)
    kernels(OPERATIONS.format(n=n), n, dtype).apply(a, b, out)
    two, three = np.dtype(dtype).type(2), np.dtype(dtype).type(3)
    with np.errstate(all="ignore"):
        expected = [a + b, a - b, a * b, a / b, -a, abs(a), np.sqrt(a), np.floor(a), np.rint(a)]
        expected += [np.where(a < b, a, b), np.where(a > b, a, b), np.where(a < b, a, b * two)]
        expected += [np.where((a <= b) & ~(a == b), 1.0, b), np.where((a > b) | (a != b), a, 0.25)]
        expected += [np.where((a >= b) ^ (a == a), 3.0, a), 1 - a, (a + b) * three]
    for k, values in enumerate(expected):
        assert same_bits(out[k], values.astype(dtype)), k


FMA = """
@njit
def apply(a, b, c, out):
    for p in range(0, a.size, {n}):
        store(out, p, fma(load(F, a, p), load(F, b, p), load(F, c, p)))

@njit
def one(a, b, c):
    return fma(a, b, c)
"""


@pytest.mark.parametrize("n", WIDTHS)
def test_fma_rounds_once(n):
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 64))
    c = -a * b + rng.choice([0.0, 1e-17, 1.0], 64)  # where rounding the product would show
    out = np.zeros(64)
    module = kernels(FMA.format(n=n), n)
    module.apply(a, b, c, out)
    exact = np.array([float(Fraction(x) * Fraction(y) + Fraction(z)) for x, y, z in zip(a, b, c)])
    assert not same_bits(exact, a * b + c)
    assert same_bits(out, exact)
    assert module.one(a[0], b[0], c[0]) == exact[0]


INTEGERS = """
J = Vec({n}, np.{dtype})

@njit
def apply(a, b, out):
    for p in range(0, a.size, {n}):
        x, y = load(J, a, p), load(J, b, p)
        store(out[0], p, x + y)
        store(out[1], p, x - y)
        store(out[2], p, x * y)
        store(out[3], p, (x & y) | (x ^ ~y))
        store(out[4], p, (x << 3) + (y >> 2))
        store(out[5], p, select(x < y, -x, lane_numbers(J)))
        store(out[6], p, maximum(minimum(x, y), 5))
        store(out[7], p, select(x != y, splat(J, 1), 0) - select(x == x, splat(J, 1), 0))
"""


@pytest.mark.parametrize("dtype, n", in_widths("int64", "int32"))
def test_integers_wrap_as_in_numpy(dtype, n):
    info = np.iinfo(dtype)
    a, b = np.random.default_rng(1).integers(info.min, info.max, (2, 64), dtype, endpoint=True)
    a[:4] = info.min, info.max, 0, b[3]
    out = np.zeros((8, 64), dtype)
    kernels(INTEGERS.format(n=n, dtype=dtype), n, dtype).apply(a, b, out)
    expected = [a + b, a - b, a * b, (a & b) | (a ^ ~b), (a << 3) + (b >> 2)]
    expected += [np.where(a < b, -a, np.arange(64) % n), np.maximum(np.minimum(a, b), 5)]
    expected += [(a != b).astype(dtype) - 1]
    for k, values in enumerate(expected):
        np.testing.assert_array_equal(out[k], values, err_msg=str(k))


CONVERSIONS = """
S = Vec({n}, np.float32)
J = Vec({n}, np.int32)

@njit
def apply(a, narrow, wide, small, whole, fixed, scale):
    for p in range(0, a.size, {n}):
        x = load(D, a, p)
        store(narrow, p, convert(S, x))
        store(wide, p, convert(D, convert(S, x)))
        store(small, p, convert(J, convert(S, x)))
        store(whole, p, convert(I, floor(x)) - convert(I, convert(J, x)))
        store(fixed, p, to_fixed(x, scale))
        store(wide, p, load(D, wide, p) + convert(D, convert(I, x)))
"""


@pytest.mark.parametrize("n", WIDTHS)
@pytest.mark.parametrize("scale", [1.0, 2.0**-3, 2.0**44])
def test_conversions_and_fixed_point(n, scale):
    rng = np.random.default_rng(2)
    a = np.concatenate([rng.uniform(-100, 100, 48), np.arange(-8, 8) * 0.5 + 0.0])  # ties too
    narrow, small = np.zeros(64, np.float32), np.zeros(64, np.int32)
    wide, whole, fixed = np.zeros(64), np.zeros(64, np.int64), np.zeros(64, np.int64)
    kernels(CONVERSIONS.format(n=n), n).apply(a, narrow, wide, small, whole, fixed, scale)
    single = a.astype(np.float32)
    assert same_bits(narrow, single)
    assert same_bits(wide, single.astype(float) + np.trunc(a))
    np.testing.assert_array_equal(small, single.astype(np.int32))
    np.testing.assert_array_equal(whole, np.floor(a) - np.trunc(a))
    np.testing.assert_array_equal(fixed, np.rint(a * scale).astype(np.int64))


MASKS = """
@njit
def below(a, limit, out):
    for p in range(0, a.size, {n}):
        bits = bitmask(load(F, a, p) < limit)
        n_set = count_bits(bits)
        while bits:
            out[p + first_bit(bits)] += n_set
            bits &= bits - 1

@njit
def ends(bits):
    return first_bit(bits), last_bit(bits)
"""


@pytest.mark.parametrize("dtype, n", in_widths("float64", "float32"))
def test_bits_of_a_mask_are_its_lanes(dtype, n):
    a = np.random.default_rng(4).random(64).astype(dtype)
    out = np.zeros(64, np.int64)
    module = kernels(MASKS.format(n=n), n, dtype)
    module.below(a, 0.3, out)
    inside = a < np.dtype(dtype).type(0.3)
    np.testing.assert_array_equal(out, inside * np.repeat(inside.reshape(-1, n).sum(axis=1), n))
    assert module.ends(0) == (64, -1)
    assert [module.ends(5 << k) for k in range(61)] == [(k, k + 2) for k in range(61)]


MEMORY = """
H = Vec({n} // 2, np.float64)

@njit
def copy(a, b, c, d, swapped):
    for p in range(0, a.size, {n}):
        here = address_of(a, p)
        prefetch(here + 512)
        prefetch_to_write(address_of(b, p))
        x = load_at(F, here, 8)
        store_at(address_of(b, p), x, 8)
        stream_at(address_of(c, p), x + load_at(F, here, {n} * 8))
        low, high = halves(x)
        store(swapped, p, exchange(x, {n} // 2))
        store(d, p // 2, high)

@njit
def words(a, out):
    whole = lane_values(load(I, a, 0))
    for k in range({n}):
        out[k] = whole[k]

@njit
def values(a, out, neighbours):
    x = load(F, a, 0)
    whole = lane_values(x)
    for k in range({n}):
        out[k] = whole[k]
    store(neighbours, 0, exchange(x, 1))
"""


@pytest.mark.parametrize("n", WIDTHS)
def test_memory_by_address(n):
    a, c = aligned(64, float, np.arange(64.0)), aligned(64, float)
    b, d, swapped = np.zeros(64), np.zeros(32), np.zeros(64)
    module = kernels(MEMORY.format(n=n), n)
    module.copy(a, b, c, d, swapped)
    assert same_bits(b, a)
    assert same_bits(c, 2 * a)
    pairs = a.reshape(-1, 2, n // 2)
    assert same_bits(d, pairs[:, 1].ravel())
    assert same_bits(swapped, pairs[:, ::-1].ravel())
    out = np.zeros(n, np.int64)
    module.words(np.arange(n) ** 5 - 7, out)
    np.testing.assert_array_equal(out, np.arange(n) ** 5 - 7)
    of_floats, neighbours, x = np.zeros(n), np.zeros(n), np.linspace(-0.3, 1.0, n)
    module.values(x, of_floats, neighbours)
    assert same_bits(of_floats, x)
    assert same_bits(neighbours, x.reshape(-1, 2)[:, ::-1].ravel())


LINES = """
J = Vec({n}, np.{offsets})

@njit
def gather(table, cells, out):
    for p in range(0, cells.size, {n}):
        values = gather_lines(F, {m}, address_of(table, 0), load(J, cells, p) * ({m} * table.itemsize))
        for k in range({m}):
            store(out[k], p, values[k])

@njit
def add(table, cells, w):
    for p in range(0, cells.size, {n}):
        add_lines(address_of(table, 0), load(J, cells, p) * ({m} * table.itemsize), ({parts}))
"""


def line_kernels(n, m, dtype, offsets="int64"):
    parts = ", ".join(f"load(F, w[{k}], p)" for k in range(m))
    return kernels(LINES.format(n=n, m=m, offsets=offsets, parts=parts), n, dtype)


WRITTEN = """
@njit
def write(w, table):
    for p in range(0, w.shape[1], {n}):
        store_lines(address_of(table, {m} * p), ({parts}))
"""


@pytest.mark.parametrize(
    "n, m, dtype", [(n, m, dtype) for dtype, n in (("float64", 4), ("float64", 8), ("float32", 16)) for m in (2, n)]
)
def test_lines_are_written(n, m, dtype):
    parts = ", ".join(f"load(F, w[{k}], p)" for k in range(m))
    w = np.arange(m * 64).reshape(m, 64).astype(dtype)
    table = aligned(m * 64, dtype)
    kernels(WRITTEN.format(n=n, m=m, parts=parts), n, dtype).write(w, table)
    np.testing.assert_array_equal(table.reshape(64, m), w.T)


OF_LINES = [(2, "float64", "int64"), (4, "float64", "int64"), (8, "float64", "int64"), (8, "float32", "int32"),
            (16, "float32", "int32"), (4, "int64", "int64"), (8, "int64", "int64")]  # fmt: skip


@pytest.mark.parametrize(
    "n, dtype, offsets, m",
    [
        pytest.param(*kind, m, marks=[] if m == (2, 4, 8)[k % 3] or kind[0] == 8 == m else pytest.mark.validation)
        for k, kind in enumerate(OF_LINES)
        for m in (2, 4, 8)
    ],
)
def test_lines_are_gathered_and_added(n, m, dtype, offsets):
    module = line_kernels(n, m, dtype, offsets)
    rng = np.random.default_rng(6)
    cells = rng.integers(0, 11, 64).astype(offsets)  # lines coincide within a vector
    table = aligned(11 * m, dtype, rng.integers(-50, 50, 11 * m))
    w = rng.integers(-50, 50, (m, 64)).astype(dtype)
    out = np.zeros((m, 64), dtype)
    module.gather(table, cells, out)
    np.testing.assert_array_equal(out, table.reshape(11, m)[cells].T)
    added = aligned(11 * m, dtype)
    module.add(added, cells, w)
    assert (out * w).sum() == (table * added).sum()  # adjoint; exact: small whole numbers
    expected = np.zeros((11, m), dtype)
    np.add.at(expected, cells, w.T)
    np.testing.assert_array_equal(added, expected.ravel())


FORMULA = """
@njit
def push(x, v, cells, table, charge, scale):
    for p in range(0, x.size, {n}):
        at = load(D, x, p)
        cell = floor(at)
        f = at - cell
        offsets = to_fixed(cell, 1.0) * 32
        c = gather_lines(D, 4, address_of(table, 0), offsets)
        u = fma(fma(f, c[1], c[0]), 0.1, load(D, v, p)) / sqrt(fma(f, f, 1.0))
        store(v, p, u)
        store(x, p, at + u)
        g = 1.0 - f
        w = (to_fixed(g * g, scale), to_fixed(f * g, scale), to_fixed(g * f, scale), to_fixed(f * f, scale))
        add_lines(address_of(charge, 0), offsets, w)
"""


def test_bits_do_not_depend_on_the_width():
    results = []
    for n in WIDTHS:
        rng = np.random.default_rng(9)
        x, v = rng.uniform(0, 10, 64), rng.normal(size=64)
        table, charge = aligned(40, float, rng.normal(size=40)), aligned(40, np.int64)
        kernels(FORMULA.format(n=n), n).push(x, v, 0, table, charge, 2.0**44)
        results.append(x.tobytes() + v.tobytes() + charge.tobytes())
        assert abs(charge.sum() / 2.0**44 - 64) < 64 * 4 * 2.0**-45  # each particle has weight 1
    assert len(set(results)) == 1


def test_vectors_hold_as_many_numbers_on_every_processor():
    assert (lanes(np.float64), lanes(np.float32), lanes("int64")) == (8, 16, 8)


@pytest.mark.parametrize("n", [0, 3, -2])
def test_lanes_are_a_power_of_two(n):
    with pytest.raises(ValueError, match="power of two"):
        Vec(n, np.float64)


def assembly(kernel, *arguments):
    """Of the kernel itself, without its Python wrappers; compiled here, since cached code cannot be looked into."""
    fresh = numba.njit(error_model="numpy")(kernel.py_func)
    fresh(*arguments)
    text = next(iter(fresh.inspect_asm().values()))
    return text[: text.index("cpython")]


@pytest.mark.skipif(not FEATURES.get("avx2"), reason="counts instructions of AVX2")
@pytest.mark.parametrize("dtype, suffix", [("float64", "pd"), ("float32", "ps")])
def test_one_instruction_for_all_lanes(dtype, suffix):
    n = lanes(dtype)
    a = np.zeros(n, dtype)
    body = assembly(kernels(FMA.format(n=n), n, dtype).apply, a, a, a, a)
    register = "zmm" if FEATURES.get("avx512f") else "ymm"
    assert re.search(rf"vfmadd\d+{suffix}\s.*%{register}", body)
    assert not re.search(r"\sv(fmadd\d+|mul|add)s[sd]\s", body)  # no scalar arithmetic


@pytest.mark.skipif(not FEATURES.get("avx512f"), reason="counts instructions of AVX-512")
def test_lines_are_moved_whole():
    n = lanes(np.float64)
    module = line_kernels(n, 8, "float64")
    body = assembly(module.gather, aligned(8, float), np.zeros(n, np.int64), np.zeros((8, n)))
    assert "gather" not in re.sub(r"_Z\S*", "", body)  # names of functions aside
    assert (
        len(re.findall(r"vperm[ti]2pd|vunpck[lh]pd|vinsertf|vshuff", body)) <= 3 * 8
    )  # three stages of a transposition


@pytest.mark.parametrize("n", WIDTHS)
def test_total_adds_the_lanes_by_halves(n):
    module = kernels("@njit\ndef f(x):\n    return total(load(F, x, 0))\n", n)
    x = aligned(n, np.float64, np.random.default_rng(1).normal(size=n) * 10.0 ** np.arange(n))
    expected = x.copy()
    while len(expected) > 1:
        expected = expected[: len(expected) // 2] + expected[len(expected) // 2 :]
    assert module.f(x) == expected[0]


EXTREMES = """
@njit
def f(x):
    return smallest_lane(load(F, x, 0)), largest_lane(load(F, x, 0))
"""


@pytest.mark.parametrize("dtype, n", in_widths("float64", "float32", "int32", "int64"))
def test_the_least_and_the_largest_lane(dtype, n):
    module, rng = kernels(EXTREMES, n, dtype), np.random.default_rng(2)
    for k in range(n):  # in any lane
        x = aligned(n, dtype, rng.integers(-9, 9, n))
        x[k] = -11
        x[(k + 1) % n] = 13
        assert module.f(x) == (-11, 13)


@pytest.mark.parametrize("n", WIDTHS)
def test_bits_are_those_of_memory(n):
    text = "@njit\ndef f(x, out):\n    store(out, 0, bits(load(F, x, 0)))\n    return bits(x[0])\n"
    x = aligned(n, np.float64, specials("float64")[0][:n])
    x[0], out = np.nan, aligned(n, np.int64)
    assert kernels(text, n).f(x, out) == x.view(np.int64)[0]
    assert np.array_equal(out, x.view(np.int64))
