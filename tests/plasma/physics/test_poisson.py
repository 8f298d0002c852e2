"""The field solvers: what they solve, to which order, and that they agree."""

import numpy as np
import pytest

from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError
from hpcpic.core.space.domain import Domain, even_cuts
from hpcpic.core.tasks.graph import Pool
from hpcpic.plasma.physics.poisson import LU, MFT, Operator, strongest_response

GENERAL = Operator(1.3, 0.4, -0.7, 0.6, -0.9, -0.2)
SHAPES = [(16, 16), (12, 20), (7, 9), (1, 8), (5, 2), (6, 4, 10), (5, 7, 3), (1, 2, 4)]


def domain(points, lengths, ranks=1):
    return Domain(lengths, points, (True,) * len(points), even_cuts(points[0], ranks))


def charge(points):
    return np.random.default_rng(7).standard_normal(points)


@pytest.fixture(scope="module")
def alone():
    world, pool = World.alone(), Pool(1)
    yield world, pool
    pool.close()


def solved(kind, alone, place, rho, **options):
    solver = kind(*alone, place, **options)
    solver.rho[:] = rho
    solver.solve()
    assert np.array_equal(solver.rho, rho), "rho must survive: the field energy needs it"
    result = solver.phi.copy(), [component.copy() for component in solver.E]
    solver.free()
    return result


def differences(operator, phi, spacing):
    """(5.7) applied to phi, centred differences, periodic."""
    x = phi.ndim - 1
    terms = [(x, spacing[x], operator.a, operator.b)]
    if x > 0:
        terms.append((x - 1, spacing[x - 1], operator.d, operator.e))
    if x == 2:
        terms.append((0, spacing[0], 1.0, 0.0))
    total = (operator.c + operator.f) * phi
    for axis, step, second, first in terms:
        up, down = np.roll(phi, -1, axis), np.roll(phi, 1, axis)
        total = total + second * (up - 2 * phi + down) / step**2 + first * (up - down) / (2 * step)
    return total


@pytest.mark.parametrize("kind", [MFT, LU])
@pytest.mark.parametrize("operator", [Operator(), GENERAL])
@pytest.mark.parametrize("points", [*SHAPES, (32,), (9,), (2,)])
def test_solution_satisfies_the_difference_equation(alone, kind, operator, points):
    place = domain(points, (2.0, 0.75, 1.5)[: len(points)])
    rho, eps0 = charge(points), 3.0
    phi, _ = solved(kind, alone, place, rho, operator=operator, permittivity=eps0)
    g = -(rho - (rho.mean() if operator.singular else 0)) / eps0
    # round-off of the second differences, which divide by dx^2
    scale = np.abs(phi).max() * sum(4 / step**2 for step in place.spacing)
    assert np.abs(differences(operator, phi, place.spacing) - g).max() < 1e-13 * max(scale, 1)


@pytest.mark.parametrize("lengths", [(1.0, 1.0, 1.0), (0.3, 2.5, 0.7)])
@pytest.mark.parametrize("operator", [Operator(), GENERAL])
@pytest.mark.parametrize("points", [*SHAPES, (64, 48), (1,), (1, 1)])
def test_lu_and_mft_agree(alone, lengths, operator, points):
    place, rho = domain(points, lengths[: len(points)]), charge(points)
    phi, _ = solved(MFT, alone, place, rho, operator=operator)
    other, _ = solved(LU, alone, place, rho, operator=operator)
    assert np.abs(phi - other).max() < 1e-12 * max(np.abs(phi).max(), 1)


@pytest.mark.parametrize("spectral", [False, True])
def test_clouds_give_each_wave_its_gaussian_twice(alone, spectral):
    """Once for the charge, once for the field that it feels: by a sum over all modes."""
    points, lengths, radius = (12, 10), (1.5, 2.0), 0.2
    place, rho, options = domain(points, lengths), charge(points), {"operator": GENERAL, "spectral": spectral}
    phi, _ = solved(MFT, alone, place, rho, cloud_radius=radius, **options)
    sharp, _ = solved(MFT, alone, place, rho, **options)
    ky, kx = (2 * np.pi * np.fft.fftfreq(n, step) for n, step in zip(points, place.spacing))
    gauss = np.exp(-(radius**2) * (kx**2 + ky[:, None] ** 2))
    assert np.abs(phi - np.fft.ifft2(np.fft.fft2(sharp) * gauss).real).max() < 1e-14 * np.abs(sharp).max()


def test_general_constants_against_a_dense_solve(alone):
    place, rho = domain((6, 7), (1.5, 2.0)), charge((6, 7))
    units = np.eye(42).reshape(42, 6, 7)
    matrix = np.stack([differences(GENERAL, unit, place.spacing).ravel() for unit in units], axis=1)
    phi, _ = solved(MFT, alone, place, rho, operator=GENERAL, permittivity=2.0)
    assert np.allclose(phi.ravel(), np.linalg.solve(matrix, -rho.ravel() / 2), rtol=0, atol=1e-13)


def manufactured(n, lengths):
    """phi, rho = -Laplace phi, E = -grad phi of a smooth periodic potential on [n, 2 n] points."""
    ly, lx = lengths
    y, x = np.meshgrid(np.arange(n) * ly / n, np.arange(2 * n) * lx / (2 * n), indexing="ij")
    kx, ky = 2 * np.pi / lx, 2 * np.pi / ly
    f, g = np.exp(np.sin(kx * x)), np.exp(np.cos(ky * y))
    phi = f * g
    second_x = kx**2 * (np.cos(kx * x) ** 2 - np.sin(kx * x)) * phi
    second_y = ky**2 * (np.sin(ky * y) ** 2 - np.cos(ky * y)) * phi
    e = [-kx * np.cos(kx * x) * phi, ky * np.sin(ky * y) * phi]
    return phi - phi.mean(), -(second_x + second_y), e


def test_differences_are_of_second_order(alone):
    lengths, errors = (1.0, 3.0), []
    for n in (32, 64, 128):
        phi, rho, _ = manufactured(n, lengths)
        errors.append(np.abs(solved(MFT, alone, domain((n, 2 * n), lengths), rho)[0] - phi).max())
    orders = np.log2(errors[:-1]) - np.log2(errors[1:])
    assert np.all(np.abs(orders - 2) < 0.05), orders


def test_spectral_is_exact_to_round_off(alone):
    lengths = (1.0, 3.0)
    phi, rho, e = manufactured(48, lengths)
    got, field = solved(
        MFT, alone, domain((48, 96), lengths), rho, spectral=True, gradient="spectral", permittivity=1.0
    )
    # round-off of rho over the smallest k^2; of E over the smallest k
    assert np.abs(got - phi).max() < 1e-12
    for component, want in zip(field, e, strict=True):
        assert np.abs(component - want).max() < 1e-11


def test_spectral_gradient_in_one_dimension(alone):
    x = np.arange(40) * 2.0 / 40
    phi, (e,) = solved(
        MFT,
        alone,
        domain((40,), (2.0,)),
        np.pi**2 * np.sin(np.pi * x),
        spectral=True,
        gradient="spectral",
    )
    assert np.allclose(phi, np.sin(np.pi * x), rtol=0, atol=1e-14)
    assert np.allclose(e, -np.pi * np.cos(np.pi * x), rtol=0, atol=1e-13)


def test_scaling_by_powers_of_two_keeps_the_bits(alone):
    rho = charge((12, 20))
    phi, _ = solved(MFT, alone, domain((12, 20), (1.5, 2.0)), rho)
    scaled, _ = solved(MFT, alone, domain((12, 20), (6.0, 8.0)), rho * 2.0**-9, permittivity=2.0**5)
    assert np.array_equal(scaled, phi * 2.0 ** (4 - 9 - 5))


def test_single_precision_follows_double(alone):
    place, rho = domain((48, 40), (1.0, 1.0)), charge((48, 40))
    phi, _ = solved(MFT, alone, place, rho)
    single, _ = solved(MFT, alone, place, rho.astype(np.float32), dtype=np.float32)
    assert single.dtype == np.float32
    assert 0 < np.abs(single - phi).max() < 1e-6 * np.abs(phi).max()


@pytest.mark.parametrize("points", [(9,), (16,), (12, 7), (2, 8)])
@pytest.mark.parametrize(
    "a, c, d", [(1.0, 0.0, 1.0), (0.3, -2.0, 1.5), (2.0, -0.5, 2.0), (1.0, 30.0, 1.0), (1.0, 1e4, -1.0)]
)
def test_the_strongest_response_is_that_of_some_mode(points, a, c, d):
    lengths = (2.0, 0.7)[: len(points)]
    steps = [length / n for n, length in zip(points, lengths)]
    square = [(2 / h * np.sin(np.pi * np.arange(n) / n)) ** 2 for n, h in zip(points, steps)]
    kx, ky = np.meshgrid(square[0], square[1] if len(points) > 1 else 0.0)
    there = kx + ky > 0
    form = (a * kx + d * ky - c)[there]
    expected = np.inf if (form <= 0).any() else ((kx + ky)[there] / form).max()
    found = strongest_response(Operator(a=a, c=c, d=d), points, lengths)
    assert found == pytest.approx(expected, rel=1e-12)


def test_lu_refuses_large_grids(alone):
    with pytest.raises(ValueError, match="256 x 256"):
        LU(*alone, domain((257, 256), (1.0, 1.0)))


def test_resonance_and_walls_are_refused(alone):
    k = 2 * (1 - np.cos(2 * np.pi / 8))
    with pytest.raises(ConfigError, match="resonant"):
        MFT(*alone, domain((4, 8), (4.0, 8.0)), operator=Operator(c=float(k)))
    with pytest.raises(ValueError, match="periodic"):
        MFT(*alone, Domain((1.0, 1.0), (8, 8), (False, True), (0, 8)))


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("kind", [MFT, LU])
@pytest.mark.parametrize("points", [(20, 12), (1, 8), (33,), (2,)])
def test_ranks_give_the_bits_of_one(kind, points):
    from mpi4py import MPI

    world, pool = World.start(), Pool(1)
    rho = charge(points)
    lengths = (1.0, 2.0)[: len(points)]
    one = World(MPI.COMM_SELF, MPI.COMM_SELF), pool
    with world.first_on_node():  # the first compiles
        whole, _ = solved(kind, one, domain(points, lengths), rho)
    place = domain(points, lengths, world.size)
    own = slice(*place.row_range(world.rank))
    part, _ = solved(kind, (world, pool), place, rho[own])
    assert np.array_equal(part, whole[own])
    pool.close()
