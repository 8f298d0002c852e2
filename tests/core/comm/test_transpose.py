"""The slab transform against numpy, its adjointness, and that its bits depend on nothing but the input."""

import numpy as np
import pytest
from mpi4py import MPI

from hpcpic.core.comm import shared_memory
from hpcpic.core.comm.line import LineFFT
from hpcpic.core.comm.transpose import SlabFFT, padded, spectrum_range
from hpcpic.core.comm.transpose_kernels import transpose
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import balanced_cuts, even_cuts
from hpcpic.core.tasks.graph import Pool

SHAPES = [(1, 8), (3, 4), (5, 12), (7, 50), (32, 32), (33, 20), (64, 31), (7, 8, 9), (9, 7, 8), (3, 2, 1), (4, 242)]
LINES = [(1,), (2,), (7,), (64,), (242,)]  # 242 = 2 11^2: FFTW would work in its input, were that not forbidden
TOLERANCE = {np.float64: 1e-14, np.float32: 5e-6}  # a few units in the last place, times log2 of the points


def alone():
    return World(MPI.COMM_SELF, MPI.COMM_SELF)


def grid(points, dtype=np.float64):
    return np.random.default_rng(3).standard_normal(points).astype(dtype)


def spectrum_of(values):
    """numpy's transform of the whole grid, slab axis last: [M], [M, N0], [N1, M, N0]."""
    return np.moveaxis(np.fft.rfftn(values.astype(np.float64)), 0, -1)


def factors(points, complex_values=False):
    """A multiplier for the whole spectrum: of a real, periodic convolution, so that the result is real."""
    kernel = np.random.default_rng(4).standard_normal(points)
    factor = spectrum_of(kernel) / np.prod(points)
    return factor if complex_values else np.abs(factor)


class Case:
    """One transform of `points` on the ranks of `world`, with numpy's answers cut to this rank."""

    def __init__(self, world, pool, points, dtype=np.float64, multiplier=None, cuts=None, messages=False):
        cuts = cuts or even_cuts(points[0], world.size)
        self.rows = slice(cuts[world.rank], cuts[world.rank + 1])
        self.values = grid(points, dtype)
        if len(points) == 1:
            self.part, kind, options = slice(None), LineFFT, {}
        else:
            self.part = slice(*spectrum_range(points, world.size, world.rank))
            kind, options = SlabFFT, {"messages": messages}
        if multiplier is not None:
            multiplier = multiplier[..., self.part, :] if len(points) == 2 else multiplier[..., self.part]
            if len(points) == 3:
                raise AssertionError("cut a multiplier in 3D by hand")
        self.fft = kind(world, pool, points, cuts, dtype, multiplier, **options)
        self.fft.real[:] = self.values[self.rows]


def check_forward_and_back(world, pool, points, dtype, **options):
    case = Case(world, pool, points, dtype, **options)
    tolerance = TOLERANCE[dtype] * max(1, np.log2(np.prod(points)))
    want = spectrum_of(case.values)
    for _ in range(2):
        case.fft.forward()
        spectrum = case.fft.spectrum.copy()
        assert spectrum.shape == want[case.part].shape
        assert np.abs(spectrum - want[case.part]).max(initial=0) <= tolerance * np.abs(want).max()
    case.fft.backward()
    back = case.fft.results[0] / np.prod(points)
    assert np.abs(back - case.values[case.rows]).max(initial=0) <= tolerance * np.abs(case.values).max()
    assert np.array_equal(case.fft.real, case.values[case.rows]), "the input survives"
    case.fft.free()
    return spectrum


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("points", [*LINES, *SHAPES])
def test_spectrum_and_round_trip(pool, points, dtype):
    check_forward_and_back(alone(), pool, points, dtype)


@pytest.mark.parametrize("complex_values", [False, True])
@pytest.mark.parametrize("points", [(64,), (7,), (5, 12), (33, 20), (64, 31)])
def test_solve_is_the_convolution(pool, points, complex_values):
    factor = factors(points, complex_values)
    case = Case(alone(), pool, points, multiplier=factor)
    case.fft.solve()
    product = np.moveaxis(spectrum_of(case.values) * factor, -1, 0)
    want = np.fft.irfftn(product, s=points, axes=range(len(points))) * np.prod(points)
    assert np.abs(case.fft.results[0] - want).max() < 1e-13 * np.abs(want).max()
    case.fft.free()


def test_solve_with_several_multipliers_in_three_dimensions(pool):
    points = (6, 8, 9)
    factor = np.stack([factors(points), 2 * factors(points)])
    fft = SlabFFT(alone(), pool, points, (0, 6), multiplier=factor)
    fft.real[:] = grid(points)
    fft.solve()
    product = np.moveaxis(spectrum_of(fft.real) * factor[0], -1, 0)
    assert np.allclose(fft.results[0], np.fft.irfftn(product, s=points, axes=range(3)) * 432, rtol=0, atol=1e-12)
    assert np.array_equal(fft.results[1], 2 * fft.results[0])
    fft.free()


def test_solve_of_a_line_with_several_multipliers(pool):
    factor = factors((64,), complex_values=True)
    fft = LineFFT(alone(), pool, (64,), (0, 64), multiplier=np.stack([factor, 2 * factor]))
    fft.real[:] = grid((64,))
    fft.solve()
    want = np.fft.irfft(spectrum_of(fft.real) * factor) * 64
    assert np.abs(fft.results[0] - want).max() < 1e-13 * np.abs(want).max()
    assert np.array_equal(fft.results[1], 2 * fft.results[0])


@pytest.mark.parametrize("points", [(64,), (33, 20), (7, 8, 9)])
def test_parseval_and_adjointness(pool, points):
    """<F a, F b> = N <a, b>: the back transform is the adjoint of the forward one."""
    case = Case(alone(), pool, points)
    n = np.prod(points)
    spectra = []
    for factor in (1.0, -0.5):
        case.fft.real[:] = factor * case.values + (factor < 0)
        case.fft.forward()
        spectra.append(case.fft.spectrum.copy())
    axis = {1: 0, 2: 0, 3: 1}[len(points)]
    last = points[-1] if len(points) > 1 else n
    k = np.arange(last // 2 + 1)
    weight = np.where((k == 0) | (2 * k == last), 1.0, 2.0)  # the half that is not stored
    weight = np.expand_dims(weight, tuple(j for j in range(len(points)) if j != axis))
    product = (weight * spectra[0] * spectra[1].conj()).sum().real
    want = n * (case.values * (1 - 0.5 * case.values)).sum()
    assert abs(product - want) < 1e-12 * n * (case.values**2).sum()
    case.fft.free()


@pytest.mark.parametrize("points", [(33, 20), (64, 31), (128, 96)])
def test_threads_keep_the_bits(pool, points):
    results = []
    for threads in (1, 2, 3):
        team = Pool(threads)
        case = Case(alone(), team, points, multiplier=factors(points))
        case.fft.solve()
        results.append(case.fft.results[0].copy())
        case.fft.free()
        team.close()
    assert np.array_equal(results[0], results[1])
    assert np.array_equal(results[0], results[2])


@pytest.mark.parametrize("n", [1, 3, 4, 7, 33, 70])
@pytest.mark.parametrize("m", [1, 5, 32, 41])
def test_transpose_of_any_size(n, m):
    source = np.random.default_rng(0).random((n + 2, m + 3))
    target = np.zeros((m + 1, n + 4))
    want = target.copy()
    want[1 : 1 + m, 3 : 3 + n] = source[2 : 2 + n, 1 : 1 + m].T
    transpose(source, *map(np.uint64, (2, 1)), target, *map(np.uint64, (1, 3, n, m)))
    assert np.array_equal(target, want)


def test_padded_rows_start_lines_and_avoid_pages():
    for dtype in (np.float32, np.float64, np.complex128):
        for n in range(1, 3000, 7):
            size = padded(n, dtype) * np.dtype(dtype).itemsize
            assert size >= n * np.dtype(dtype).itemsize
            assert size % 64 == 0
            assert size % 4096 != 0


@pytest.fixture(params=[1, 2], ids=["1 thread", "2 threads"])
def world_and_pool(request):
    pool = Pool(request.param)
    yield World.start(), pool
    pool.close()


def cuts_of(points, ranks):
    """Even slabs, uneven slabs, and all rows on the last rank."""
    heavy = balanced_cuts(np.arange(points[0]) ** 2 + 1.0, ranks)
    return [even_cuts(points[0], ranks), heavy, (*(0 for _ in range(ranks)), points[0])]


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("messages", [False, True], ids=["window", "messages"])
@pytest.mark.parametrize("points", SHAPES)
def test_ranks_spectrum_has_the_bits_of_one(pool, points, messages):
    world = World.start()
    for dtype in (np.float64, np.float32):
        with world.first_on_node():  # the first compiles
            whole = check_forward_and_back(alone(), pool, points, dtype)
        for cuts in cuts_of(points, world.size):
            spectrum = check_forward_and_back(world, pool, points, dtype, cuts=cuts, messages=messages)
            assert np.array_equal(spectrum, whole[slice(*spectrum_range(points, world.size, world.rank))])


@pytest.mark.mpi(min_size=2)
def test_columns_travel_as_messages_where_a_node_has_no_room_to_share_them(pool, monkeypatch, caplog):
    """All ranks agree, though one alone has found so: writing to memory that is not there would end them."""
    world, points = World.start(), (32, 32)
    cuts = even_cuts(32, world.size)
    shared = check_forward_and_back(world, pool, points, np.float64, cuts=cuts)
    assert not caplog.records
    columns = (points[1] // 2 + 1) * padded(points[0], np.complex128) * 16
    for left, windows in ((1 << 30, True), (columns, False), (0 if world.rank == 0 else 1 << 30, False)):
        monkeypatch.setattr(shared_memory, "free", lambda left=left: float(left))
        assert (Case(world, pool, points, cuts=cuts).fft._window is not None) == windows
    assert np.array_equal(check_forward_and_back(world, pool, points, np.float64, cuts=cuts), shared)
    assert "/dev/shm" in caplog.text


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("points", LINES)
def test_ranks_lines_have_the_bits_of_one(points):
    world, pool = World.start(), Pool(1)
    with world.first_on_node():  # the first compiles
        whole = check_forward_and_back(alone(), pool, points, np.float64)
    for cuts in cuts_of(points, world.size):
        assert np.array_equal(check_forward_and_back(world, pool, points, np.float64, cuts=cuts), whole)
    pool.close()


@pytest.mark.mpi(min_size=2)
def test_what_is_sent_is_received_into_only_after_that(pool):
    """MPI leaves open what becomes of a message whose memory another one may fill."""
    fft = Case(World.start(), pool, (300, 260), multiplier=factors((300, 260)), messages=True).fft
    graph = fft._graphs["solve"]
    number = {name: k for k, name in enumerate(graph.names)}
    for j in range(fft._n_chunks):
        sent, received = (number[f"{what} {j} of a transform"] for what in ("send forward", "receive backward"))
        assert received in graph._successors[sent]
    fft.free()


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("messages", [False, True], ids=["window", "messages"])
@pytest.mark.parametrize("points", [(5, 12), (33, 20), (300, 260)])
def test_ranks_solve_again_and_again(world_and_pool, points, messages):
    """One solve after the other without a barrier: nothing is overwritten before it was read.

    The largest grid sends its columns in chunks.
    """
    world, pool = world_and_pool
    factor = np.stack([factors(points, True), factors(points, True) ** 2])
    with world.first_on_node():  # the first compiles
        one = Case(alone(), pool, points, multiplier=factor)
    many = Case(world, pool, points, multiplier=factor, messages=messages)
    if messages and points == (300, 260) and world.size == 2:
        assert many.fft._n_chunks > 1
    for step in range(20):
        values = np.roll(one.values, step, 0)
        one.fft.real[:] = values
        many.fft.real[:] = values[many.rows]
        one.fft.solve()
        many.fft.solve()
        for got, want in zip(many.fft.results, one.fft.results, strict=True):
            assert np.array_equal(got, want[many.rows]), step
        if step % 7 == 3:
            many.fft.forward()
    one.fft.free()
    many.fft.free()
