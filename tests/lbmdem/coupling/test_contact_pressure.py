"""The pressure between grains that touch: what links and contacts give together."""

import numpy as np
import pytest

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain, even_cuts
from lbmdem.coupling.contact_pressure import ContactPressure
from lbmdem.coupling.immersed import Immersed
from lbmdem.fluid.fluid import Fluid
from lbmdem.physics.velocity_sets import CS2, D2Q9, D3Q19

SHAPE = {"D3Q19": (31, 15, 16), "D2Q9": (31, 16)}
LATTICES = pytest.mark.parametrize("lattice", [D2Q9, D3Q19], ids=lambda lattice: lattice.name)
RADII = np.array([4.3, 4.8, 3.9])


def column(lattice):
    """Centres of three grains that touch, one on the other, across a seam."""
    x = np.array([[1.2, 6.3, 6.1], [4.0, 9.0, 14.3], [1.5, 7.5, 22.1]])
    for k in range(2):
        way = x[k + 1] - x[k]
        x[k + 1] = x[k] + way / np.linalg.norm(way) * (RADII[k] + RADII[k + 1])
    if lattice.dimensions == 2:
        x = x[:, [0, 2]]
        x[:, 1] = x[0, 1] + np.cumsum([0, 9.0, 8.6])
        x[1:, 0] = x[0, 0]
    return x


def scene(world, pool, lattice):
    shape, d = SHAPE[lattice.name], lattice.dimensions
    domain = Domain(tuple(map(float, shape)), shape, (False, *(True,) * (d - 1)), even_cuts(shape[0], world.size))
    fluid = Fluid(world, pool, domain, lattice, tau=0.8)
    still = np.zeros((3, d)), np.zeros((3, 1 if d == 2 else 3))
    solids = Immersed(fluid, world, pool, fixed=(np.arange(3), column(lattice), RADII, *still))
    return fluid, solids, ContactPressure(fluid, world, RADII)


@LATTICES
def test_still_water_of_any_pressure_moves_no_grain(lattice, pool):
    """Links alone would push grains together by the pressure on their far sides."""
    world = World.alone()
    fluid, solids, patches = scene(world, pool, lattice)
    fluid.set_equilibrium(1.04)
    for _ in range(3):
        fluid.step()
    links, _ = solids.all_forces(3)
    assert np.abs(links).max() > 0.01
    assert (
        np.abs(links + patches.forces()).max() < 1e-11
    )  # pressures are rounded to 36 / 2^44, times up to 86 / 36 nodes of area


@LATTICES
def test_equal_and_opposite(lattice, pool):
    fluid, _, patches = scene(World.alone(), pool, lattice)
    h = 1e-2 * np.random.default_rng(3).normal(size=(lattice.q, *fluid.domain.points))
    fluid.set_populations(h)
    force = patches.forces()
    assert np.abs(force).max() > 1e-4
    np.testing.assert_array_equal(force.sum(axis=0), 0.0)


@LATTICES
def test_a_falling_pressure_pushes_each_grain_by_its_volume(lattice, pool):
    """Before anything flows the force on a body is its volume times the fall of pressure."""
    fluid, solids, patches = scene(World.alone(), pool, lattice)
    z = np.arange(31.0).reshape(-1, *[1] * (lattice.dimensions - 1))
    slope = 1e-5
    fluid.set_equilibrium(1.0 + slope * (15.0 - z))
    fluid.step()
    links, _ = solids.all_forces(3, steps=1)
    inner = (slice(1, -1), slice(1, -1) if lattice.dimensions == 3 else slice(None), slice(1, -1))
    ids = fluid.ids[inner]
    volume = np.bincount(ids[ids >= 0], minlength=3)
    share = (links + patches.forces())[:, -1] / (volume * CS2 * slope)
    without = links[:, -1] / (volume * CS2 * slope)
    outside = (1.0 + 0.5 / RADII) ** lattice.dimensions  # links take the pressure up to half a spacing outside
    assert np.all((share > 1.0) & (share < outside))
    assert np.ptp(without) > 3.0 * np.ptp(share)


@pytest.mark.mpi(min_size=2)
@LATTICES
def test_bits_do_not_depend_on_ranks(world, lattice, pool):
    forces = []
    for some in (World.alone(), world):
        fluid, solids, patches = scene(some, pool, lattice)
        h = 1e-2 * np.random.default_rng(3).normal(size=(lattice.q, *fluid.domain.points))
        low, high = fluid.domain.row_range(some.rank)
        fluid.set_populations(h[:, low:high])
        forces.append(patches.forces())
        solids.free()
        fluid.free()
    np.testing.assert_array_equal(*forces)
