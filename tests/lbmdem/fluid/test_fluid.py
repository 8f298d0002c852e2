import csv
import hashlib
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from lattice_scenes import fluid_in_a_box
from seldom import seldom

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import even_cuts
from hpcpic.core.tasks.graph import Pool
from lbmdem.fluid.fluid import Fluid
from lbmdem.physics.reference import random_populations
from lbmdem.physics.velocity_sets import CS2, D2Q9, D3Q19

SLIP = Path(__file__).parents[2] / "data" / "poiseuille_slip.csv"


def make(lattice, shape, *, periodic=None, world=None, threads=1, cuts=None, **options) -> Fluid:
    return fluid_in_a_box(world or World.alone(), Pool(threads), lattice, shape, periodic, cuts, **options)


def taylor_green(n: int, tau: float, steps: int, **options) -> tuple[float, float]:
    """Relative L2 error of the velocity after `steps`, u ~ 1/n; and the viscosity over its theory."""
    fluid = make(D2Q9, (n, n), tau=tau, **options)
    k, u0 = 2 * np.pi / n, 0.64 / n
    y, x = np.meshgrid(*[k * (np.arange(n) + 0.5)] * 2, indexing="ij")
    u = u0 * np.stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y)], axis=-1)
    rho = 1.0 + 0.25 * u0**2 / CS2 * (np.cos(2 * x) + np.cos(2 * y))
    fluid.set_equilibrium(rho, u)
    nu = CS2 * (tau - 0.5)
    fluid.advance(n)
    start = np.linalg.norm(fluid.moments()[1])
    fluid.advance(steps)
    found = fluid.moments()[1]
    decay = np.linalg.norm(found) / start
    exact = u * np.exp(-2 * nu * k * k * (n + steps))
    error = np.linalg.norm(found - exact) / np.linalg.norm(exact)
    return error, -np.log(decay) / (2 * nu * k * k * steps)


@pytest.mark.parametrize("collision", ["BGK", "TRT", "central"])
def test_taylor_green_vortices_decay_at_the_viscosity_and_converge_at_second_order(collision):
    (coarse, _), (fine, nu) = (taylor_green(n, 0.6, n * n // 16, collision=collision) for n in (16, 32))
    assert 1.8 < np.log2(coarse / fine) < 2.4  # diffusive scaling: u and dx halve, the step is a quarter
    assert nu == pytest.approx(1.0, abs=0.006)


def test_single_precision_has_the_error_of_the_grid():
    double, single = (taylor_green(32, 0.6, 64, storage=one, force=(0.0, 0.0))[0] for one in ("double", "single"))
    assert single == pytest.approx(double, rel=0.02)


def channel(height: int, tau: float, **options) -> np.ndarray:
    """Steady velocity across a channel with a force along it, over its parabola's centre."""
    nu = CS2 * (tau - 0.5)
    force = 8 * nu * 1e-3 / height**2
    fluid = make(D2Q9, (height, 8), periodic=(False, True), tau=tau, force=(force, 0.0), **options)
    y = (np.arange(height) + 0.5) / height
    u = np.zeros((height, 8, 2))
    u[..., 0] = (4e-3 * y * (1 - y))[:, None]
    fluid.set_equilibrium(1.0, u)
    fluid.advance(int(6 * height**2 / nu))
    return fluid.moments()[1][:, 0, 0] / 1e-3


def table() -> list[dict[str, float]]:
    lines = [line for line in SLIP.read_text().splitlines() if not line.startswith("#")]
    return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(lines)]


@pytest.mark.parametrize("tau", [0.6, 0.8, 1.0, 2.0])
def test_bgk_slips_at_half_way_walls_as_the_law_says(tau):
    """u_s/u_c = (16 (tau - 1/2)^2 - 3)/(3 H^2) at every node; the table has seven digits."""
    (row,) = (row for row in table() if row["tau"] == tau)
    y = (np.arange(8) + 0.5) / 8
    slip = channel(8, tau, collision="BGK") - 4 * y * (1 - y)
    np.testing.assert_allclose(slip, row["us_over_uc_H8"], rtol=1e-6)


@pytest.mark.parametrize("tau", [0.6, 2.0])
def test_trt_has_the_parabola_at_every_node(tau):
    y = (np.arange(8) + 0.5) / 8
    np.testing.assert_allclose(channel(8, tau), 4 * y * (1 - y), atol=1e-9)


def test_a_force_accelerates_a_uniform_fluid_exactly():
    force = np.array([1e-4, -2e-4, 3e-4])
    fluid = make(D3Q19, (4, 4, 8), tau=0.8, force=force)
    fluid.advance(10)
    u = fluid.moments()[1]
    np.testing.assert_allclose(u, np.broadcast_to(10.5 * force, u.shape), atol=1e-16)
    fluid.set_force(-force)
    fluid.advance(10)
    np.testing.assert_allclose(fluid.moments()[1], np.broadcast_to(-0.5 * force, u.shape), atol=1e-16)


@pytest.mark.parametrize(
    ("lattice", "collision"),
    [*product([D2Q9, D3Q19], ["BGK", "TRT"]), (D2Q9, "central"), seldom(D3Q19, "central")],
)
def test_a_fluid_starts_with_the_velocity_that_it_is_given_under_a_force_too(lattice, collision):
    """And has F t more from then on: it is no half step ahead of its force."""
    force = np.array([1e-4, -2e-4, 3e-4])[: lattice.dimensions]
    start = np.array([2e-3, 1e-3, -1e-3])[: lattice.dimensions]
    fluid = make(lattice, (4, 4, 8)[3 - lattice.dimensions :], tau=0.8, collision=collision, force=force)
    fluid.set_equilibrium(1.0, start)
    for steps in (0, 1, 9):
        fluid.advance(steps)
        u = fluid.moments()[1]
        np.testing.assert_allclose(u, np.broadcast_to(start + fluid.iteration * force, u.shape), atol=1e-15)


@pytest.mark.parametrize("collision", ["TRT", "central"])
def test_a_moving_frame_changes_the_viscosity_by_the_square_of_mach_only(collision):
    """Shear wave carried along its gradient: the equilibrium lacks u^3, hence -3 u^2 of nu (central moments: less)."""
    n, speed, nus = 32, 0.1, []
    for frame in (0.0, speed):
        fluid = make(D2Q9, (n, 4), tau=0.6, collision=collision)
        u = np.zeros((n, 4, 2))
        u[..., 0] = 1e-3 * np.sin(2 * np.pi / n * (np.arange(n) + 0.5))[:, None]
        u[..., 1] = frame
        fluid.set_equilibrium(1.0, u)
        sizes = []
        for _ in range(2):
            fluid.advance(200)
            sizes.append(np.abs(np.fft.rfft(fluid.moments()[1][:, 0, 0])[1]))
        nus.append(np.log(sizes[0] / sizes[1]))
    change = nus[1] / nus[0] - 1
    assert abs(change) < (3.3 if collision == "TRT" else 0.3) * speed**2


def shear_layers(collision: str, tau: float, u0: float, n: int = 64) -> bool:
    """Are doubly periodic shear layers (Minion & Brown 1997) alive after one convective time?"""
    fluid = make(D2Q9, (n, n), tau=tau, collision=collision)
    y, x = np.meshgrid(*[(np.arange(n) + 0.5) / n] * 2, indexing="ij")
    along = np.where(y <= 0.5, np.tanh(80 * (y - 0.25)), np.tanh(80 * (0.75 - y)))
    fluid.set_equilibrium(1.0, u0 * np.stack([along, 0.05 * np.sin(2 * np.pi * (x + 0.25))], axis=-1))
    with np.errstate(all="ignore"):
        fluid.advance(int(n / u0))
        _, u = fluid.moments()
    return bool(np.isfinite(u).all() and np.abs(u).max() < 5 * u0)


@pytest.mark.parametrize(
    ("collision", "viscosity", "alive"),
    [("BGK", 2e-2, True), ("BGK", 1e-5, False), ("TRT", 2e-2, True), ("TRT", 1e-5, False), ("central", 1e-6, True)],
)
def test_central_moments_alone_survive_a_vanishing_viscosity(collision, viscosity, alive):
    assert shear_layers(collision, 0.5 + 3 * viscosity, 0.1) is alive


def digest(fluid: Fluid) -> str:
    """Of the whole fluid's populations, in global order (rank 0)."""
    rows = np.moveaxis(fluid.populations(), 0, -1)
    whole = fluid.world.gather_rows(np.ascontiguousarray(rows))
    return "" if whole is None else hashlib.sha256(whole.tobytes()).hexdigest()


def scene(lattice, **options) -> Fluid:
    """Random populations and solid nodes; the force makes no difference alike."""
    shape = {2: (23, 37), 3: (13, 6, 21)}[lattice.dimensions]
    fluid = make(lattice, shape, tau=0.8, force=(1e-4,) * lattice.dimensions, **options)
    low, high = fluid.domain.row_range(fluid.world.rank)
    solid = np.random.default_rng(3).random(shape) < 0.2
    fluid.solid.inner[solid[low:high]] = 1
    fluid.solid_changed()
    fluid.set_populations(random_populations(lattice, shape)[:, low:high])
    return fluid


@pytest.mark.parametrize("lattice", [D2Q9, D3Q19], ids=["D2Q9", "D3Q19"])
@pytest.mark.parametrize("storage", ["double", "single"])
def test_bits_do_not_depend_on_threads_blocks_and_restarts(lattice, storage):
    plain = scene(lattice, storage=storage)
    plain.advance(7)
    reference = digest(plain)
    for threads, blocks in [(2, 0), (1, 5), (2, 40)]:
        fluid = scene(lattice, storage=storage, threads=threads, blocks=blocks)
        fluid.advance(7)
        assert digest(fluid) == reference
    for after in (3, 4):  # odd and even
        first, second = scene(lattice, storage=storage), scene(lattice, storage=storage)
        first.advance(after)
        second.iteration = after
        second.set_populations(first.populations())
        second.advance(7 - after)
        assert digest(second) == reference


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("lattice", [D2Q9, D3Q19], ids=["D2Q9", "D3Q19"])
def test_bits_do_not_depend_on_ranks(world, lattice):
    """Even, uneven and one-plane slabs, and a rank without any."""
    alone = scene(lattice)
    alone.advance(7)
    reference = digest(alone)
    rows = alone.domain.points[0]
    for cuts in [even_cuts(rows, world.size), (*range(world.size), rows), (0, *[rows] * world.size)]:
        fluid = scene(lattice, world=world, threads=2, cuts=cuts)
        fluid.advance(7)
        found = digest(fluid)  # on rank 0
        fluid.free()
        assert world.rank or found == reference


@pytest.mark.parametrize("lattice", [D2Q9, D3Q19], ids=["D2Q9", "D3Q19"])
def test_moments_are_those_of_the_populations(lattice):
    """Rounding of sums of at most 40 numbers of order 1."""
    fluid = scene(lattice, threads=2)
    fluid.advance(3)
    wet, h = fluid.solid.inner == -1, fluid.populations()
    rho, u = fluid.moments()
    np.testing.assert_allclose(rho, 1.0 + h.sum(axis=0), atol=1e-15)
    momentum = (np.tensordot(h, lattice.e, axes=(0, 0)) + 0.5e-4) * wet[..., None]
    np.testing.assert_allclose(rho[..., None] * u, momentum, atol=1e-15)
    fastest = np.sum(u * u, axis=-1).max(axis=-1).ravel()
    np.testing.assert_allclose(fluid.row_sums()[1], fastest, rtol=1e-14)


@pytest.mark.parametrize("storage", ["double", "single"])
@pytest.mark.parametrize("lattice", [D2Q9, D3Q19], ids=["D2Q9", "D3Q19"])
def test_row_sums_are_rounded_as_sums_node_by_node(lattice, storage):
    """Bit for bit, whatever the vectors: of directions in their order, then of nodes in theirs."""
    fluid = scene(lattice, storage=storage)
    fluid.advance(3)
    h = fluid.populations().astype(np.float64)
    mass, momentum = np.zeros(h.shape[1:]), np.zeros((lattice.dimensions, *h.shape[1:]))
    for e, one in zip(lattice.e, h):
        mass += one
        for c, along in enumerate(e):
            momentum[c] += along * one
    momentum += np.asarray(fluid.force).reshape(-1, *[1] * mass.ndim) * 0.5
    square = momentum[0] * momentum[0]
    for p in momentum[1:]:
        square += p * p
    flow = [p / (1.0 + mass) for p in momentum]
    columns = [np.ones_like(mass), mass, *momentum, square / (1.0 + mass), *flow]
    wet = fluid.solid.inner == -1
    expected = [np.add.accumulate(np.where(wet, column, 0.0), axis=-1)[..., -1].ravel() for column in columns]
    assert np.array_equal(fluid.row_sums()[0], np.stack(expected, axis=1))
