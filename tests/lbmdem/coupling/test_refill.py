"""What uncovered nodes are filled with."""

import numpy as np
import pytest
from app_runner import running
from lattice_scenes import fluid_in_a_box

import lbmdem
from hpcpic.core.tasks.graph import Pool
from lbmdem.coupling.immersed import Immersed
from lbmdem.fluid.solid_nodes import Change
from lbmdem.kernels.layout import FLUID
from lbmdem.physics.velocity_sets import D2Q9, D3Q19, equilibrium

SHAPES = {"D3Q19": (12, 13, 14), "D2Q9": (17, 19)}
LATTICES = pytest.mark.parametrize("lattice", [D2Q9, D3Q19], ids=lambda lattice: lattice.name)


class Uncovered:
    """A grain at a seam has moved by most of a node: `nodes` (mask) it left, `h` what they hold, `u` its velocity."""

    def __init__(self, world, pool, lattice, refill, populations):
        shape, d = SHAPES[lattice.name], lattice.dimensions
        fluid = fluid_in_a_box(world, pool, lattice, shape)
        immersed = Immersed(fluid, world, pool, refill=refill)
        x, radius = np.full((1, d), 0.4), np.array([3.3])
        self.u = np.array([0.8, 0.3, -0.4])[:d] / 40
        still = np.zeros((1, 3 if d == 3 else 1))
        immersed.start(np.array([7]), x, radius, self.u[None], still)
        fluid.set_populations(populations(fluid))
        before = fluid.solid.inner == 7
        excess = fluid.populations().sum(axis=0)
        immersed.move(np.array([7]), (x + 40 * self.u) % shape[::-1], radius, self.u[None], still)
        self.nodes = before & (fluid.solid.inner == -1)
        assert self.nodes.sum() > 2
        self.excess = excess[~before & (fluid.solid.inner == -1)].mean()
        self.h = fluid.populations()[:, self.nodes]


def uniform(density, velocity):
    def populations(fluid):
        shape = fluid.domain.points
        u = np.broadcast_to(np.array(velocity)[: len(shape)], (*shape, len(shape)))
        return equilibrium(fluid.lattice, np.full(shape, density), u)

    return populations


def rest(lattice, density, u):
    return equilibrium(lattice, np.array([density]), u[None])


@LATTICES
def test_the_paper_takes_the_mean_density_and_the_velocity_of_the_grain(world, pool, lattice):
    """Of all fluid nodes: here those of one half of the box have 1.03 and the others the density of rest."""

    def halves(fluid):
        return np.where(np.arange(fluid.domain.points[-1]) < 7, uniform(1.03, (0.01, 0.0, 0.0))(fluid), 0.0)

    left = Uncovered(world, pool, lattice, "average", halves)
    assert left.h == pytest.approx(np.broadcast_to(rest(lattice, 1.0 + left.excess, left.u), left.h.shape), abs=1e-15)
    assert 0.005 < left.excess < 0.025


@LATTICES
@pytest.mark.parametrize("refill", ["local", "non-equilibrium", "mass-conserving", "conserving"])
def test_the_density_is_that_of_the_neighbours(world, pool, lattice, refill):
    left = Uncovered(world, pool, lattice, refill, uniform(1.03, (0.01, 0.0, 0.0)))
    assert left.h == pytest.approx(np.broadcast_to(rest(lattice, 1.03, left.u), left.h.shape), abs=1e-15)


@LATTICES
def test_non_equilibrium_comes_from_the_neighbours(world, pool, lattice):
    """A departure that is the same everywhere, without mass and momentum, is in the uncovered nodes too."""
    e = lattice.e.astype(float)
    departure = 1e-3 * lattice.w * (e[:, 0] * e[:, 1])

    def populations(fluid):
        return uniform(1.0, (0.0, 0.0, 0.0))(fluid) + departure.reshape(-1, *[1] * fluid.domain.ndim)

    for refill, share in (("non-equilibrium", 1.0), ("local", 0.0)):
        left = Uncovered(world, pool, lattice, refill, populations)
        wanted = rest(lattice, 1.0, left.u) + share * departure[:, None]
        assert left.h == pytest.approx(np.broadcast_to(wanted, left.h.shape), abs=1e-16)


@LATTICES
def test_what_a_grain_gets_of_covered_nodes_has_the_bits_of_one_node_after_the_other(world, pool, lattice):
    """However many of them a rank has."""
    shape, d = SHAPES[lattice.name], lattice.dimensions
    fluid = fluid_in_a_box(world, pool, lattice, shape)
    immersed = Immersed(fluid, world, pool, refill="conserving")
    place = np.full((1, d), 5.0), np.array([3.3]), np.zeros((1, d)), np.zeros((1, 3 if d == 3 else 1))
    immersed.start(np.array([7]), *place)
    covered = np.flatnonzero(fluid.ids == 7)
    h = np.random.default_rng(1).random((len(covered), lattice.q))
    nothing = covered[:0], np.zeros(0, np.int32)

    def gained(rows):
        change = Change(*nothing, covered[rows], np.full(len(covered[rows]), 7, np.int32))
        return immersed._account(change, h[rows], h[:0]).sums

    one_by_one = sum(gained(slice(k, k + 1)) for k in range(len(covered)))
    assert np.array_equal(gained(slice(None)), one_by_one) and one_by_one.any()


@LATTICES
def test_nodes_of_a_grain_that_is_no_longer_there_are_filled_at_rest(world, pool, lattice):
    shape, d = SHAPES[lattice.name], lattice.dimensions
    fluid = fluid_in_a_box(world, pool, lattice, shape)
    immersed = Immersed(fluid, world, pool)
    still = np.zeros((1, 3 if d == 3 else 1))
    grain = np.array([7]), np.full((1, d), 5.0), np.array([3.3]), np.full((1, d), 0.1), still
    immersed.start(*grain)
    left = fluid.solid.inner == 7
    immersed.move(*(part[:0] for part in grain))
    assert left.any() and not fluid.populations()[:, left].any()


@LATTICES
@pytest.mark.parametrize("refill", ["local", "non-equilibrium", "mass-conserving", "conserving"])
def test_threads_move_grains_to_the_same_bits(world, lattice, refill):
    shape, d = SHAPES[lattice.name], lattice.dimensions
    rng = np.random.default_rng(3)
    x, v, h = rng.uniform(0, 12, (70, d)), rng.normal(0, 0.3, (70, d)), 1e-2 * rng.random((lattice.q, *shape))
    found = []
    for threads in (1, 3):
        pool = Pool(threads)
        fluid = fluid_in_a_box(world, pool, lattice, shape)
        immersed = Immersed(fluid, world, pool, refill=refill)
        for k in range(4):  # they overlap
            place = (x + k * v) % shape[::-1], np.full(70, 1.2), v, np.zeros((70, 3 if d == 3 else 1))
            immersed.move(np.arange(70), *place)
            fluid.set_populations(h) if k == 0 else None
        found.append((fluid.ids.copy(), fluid.populations().copy()))
        pool.close()
    assert np.array_equal(found[0][0], found[1][0]) and np.array_equal(found[0][1], found[1][1])


@pytest.mark.parametrize("refill", ["local", "mass-conserving"])
def test_a_stream_carries_a_grain_without_a_trace(world, refill):
    """A disc of the density of the fluid, which goes with it: nothing changes, while nodes change hands at each step.
    With "conserving" the disc loses two hundredths of its speed.
    """
    stream, nodes = np.array([0.06, 0.03]), (60, 100)
    case = lbmdem.Case(
        simulation={"end_time": 0.1},
        domain={"size": [0.01, 0.006], "spacing": 1e-4, "periodic": ["x", "y"]},
        fluid={"kinematic_viscosity": 1e-6, "relaxation_time": 0.55,
               "start": {"velocity": np.tile(stream, (*nodes, 1)), "pressure": np.zeros(nodes)}},
        grains=[{"name": "disc", "diameter": 1e-3, "density": 1000.0, "position": [0.005, 0.003],
                 "velocity": stream.tolist()}],
        contact={"normal_stiffness": 1.0},
        coupling={"refill": refill},
    )  # fmt: skip
    with running(world, "lbmdem", case.config) as app:
        mass = app.fluid.populations().sum()
        for _ in range(400):
            app.step()
        np.testing.assert_allclose(app.dem.grains.v[0], app.table.v[0], rtol=1e-3)
        assert abs(app.dem.grains.omega[0, 0]) * 5e-4 < 1e-3 * stream[0]
        off = np.abs(app.fluid.moments()[1] * app.scene.units.velocity - stream)[app.fluid.solid.inner == FLUID]
        assert off.max() < 2e-3 * stream[0]
        owed = app.immersed.owed()
        assert (abs(app.fluid.populations().sum() - owed - mass) < 1e-9) == (refill == "mass-conserving")


FOUR_DISCS = """
simulation = { dimensions = 2; end_time = 0.0236; };
domain = { size = [0.02, 0.02]; spacing = 0.0002; periodic = ["x", "y"]; };
fluid = { density = 1000.0; kinematic_viscosity = 1e-5; relaxation_time = 0.8; };
grains = ( { name = "d"; diameter = 0.002; density = 1100.0; velocity = [0.02, 0.01];
             position = ([0.005, 0.005], [0.015, 0.006], [0.005, 0.015], [0.014, 0.016]); } );
gravity = [0.0, -9.81];
"""


@pytest.mark.parametrize("steps", [13, 19, 20, 21])
def test_mass_that_is_owed_is_put_back_after_a_restart_as_without(tmp_path, steps):
    """It is put back every 20 steps, and a checkpoint between two of these holds what is owed."""
    (tmp_path / "discs.conf").write_text(FOUR_DISCS)
    case = lbmdem.Case(tmp_path / "discs.conf")
    dt = case.config.time_step
    whole = case.run(tmp_path / "whole", threads=1, quiet=True)
    part = case.changed({"simulation.end_time": steps * dt}).run(tmp_path / "part", threads=1, quiet=True)
    again = part.restart(until=case.config.end_time, quiet=True)
    assert whole.summary["steps"] > 40 and again.digest == whole.digest
    density = whole.series["mean_density"].values
    assert abs(density[-1] / density[0] - 1) < 1e-5  # of what 20 steps take; by the local refill -6e-5
