import itertools

import numpy as np
import pytest
from lattice_scenes import fluid_in_a_box

from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from lbmdem.fluid.fluid import Fluid
from lbmdem.physics.reference import central, random_populations, stream, two_rates
from lbmdem.physics.velocity_sets import D2Q9, D3Q19

SHAPES = {"D2Q9": (5, 19), "D3Q19": (3, 4, 17)}
TAU = 0.7
NO_FORCE = (0.0,) * 3  # by the kernels that add a force, which other tests of single precision need as well
STEPS = [
    pytest.param(*one, marks=pytest.mark.validation if one == (False, "central", D3Q19) else [])  # 5 s to compile
    for one in itertools.product((False, True), ("BGK", "TRT", "central"), (D2Q9, D3Q19))
]


def make(lattice, shape, **options) -> Fluid:
    return fluid_in_a_box(World.alone(), Pool(1), lattice, shape, tau=TAU, **options)


@pytest.mark.parametrize(("forced", "collision", "lattice"), STEPS)
def test_steps_are_their_definition(forced, collision, lattice):
    """Three steps among random solid nodes, on a row that ends within a vector. Rounding of 60 operations per step."""
    shape = SHAPES[lattice.name]
    force = np.array([1e-3, -2e-3, 3e-3])[: lattice.dimensions] * forced
    fluid = make(lattice, shape, collision=collision, force=force if forced else None)
    solid = np.random.default_rng(2).random(shape) < 0.15
    fluid.solid.inner[solid] = 7
    fluid.solid_changed()
    h = random_populations(lattice, shape)
    h[:, solid] = 0
    fluid.set_populations(h)
    even, odd = fluid.collision.rates
    for _ in range(3):
        fluid.step()
        g = central(lattice, h, even, force) if collision == "central" else two_rates(lattice, h, even, odd, force)
        h = stream(lattice, g, solid)
        np.testing.assert_allclose(fluid.populations(), h, rtol=0, atol=60 * 2.0**-53)


@pytest.mark.parametrize("collision", ["TRT", "central"])
def test_a_turned_or_mirrored_fluid_takes_the_same_step(collision):
    """All 48 symmetries of the cube; sums are in another order, hence 1e-15 of values of order 0.1."""
    n, lattice = 8, D3Q19
    fluid = make(lattice, (n, n, n), collision=collision, force=NO_FORCE)
    h = random_populations(lattice, (n, n, n))
    fluid.set_populations(h)
    fluid.step()
    after = fluid.populations()
    index = {tuple(e): i for i, e in enumerate(lattice.e)}
    for turn in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            to = [index[tuple(int(signs[a] * e[turn[a]]) for a in range(3))] for e in lattice.e]

            def moved(values, turn=turn, signs=signs, to=to):
                physical = values.transpose(0, 3, 2, 1).transpose(0, *[1 + a for a in turn])
                physical = np.flip(physical, [1 + a for a in range(3) if signs[a] < 0])
                result = np.empty_like(physical)
                result[to] = physical
                return result.transpose(0, 3, 2, 1)

            fluid.iteration = 0
            fluid.set_populations(moved(h))
            fluid.step()
            np.testing.assert_allclose(fluid.populations(), moved(after), rtol=0, atol=1e-15)


@pytest.mark.parametrize("storage", ["double", "single"])
def test_a_shifted_fluid_takes_the_same_steps_bit_for_bit(storage):
    """No node is special: not the ends of rows, nor vectors with solid nodes in them."""
    shape, lattice = (4, 5, 33), D3Q19
    h = random_populations(lattice, shape)
    solid = np.random.default_rng(3).random(shape) < 0.1
    h[:, solid] = 0
    results = []
    for shift in [(0, 0, 0), (1, 2, 3), (3, 0, 16)]:
        fluid = make(lattice, shape, storage=storage, force=NO_FORCE)
        fluid.solid.inner[np.roll(solid, shift, (0, 1, 2))] = 0
        fluid.solid_changed()
        fluid.set_populations(np.roll(h, shift, (1, 2, 3)))
        fluid.advance(3)
        results.append(np.roll(fluid.populations(), [-s for s in shift], (1, 2, 3)))
    assert np.array_equal(results[0], results[1]) and np.array_equal(results[0], results[2])


@pytest.mark.parametrize("storage", ["double", "single"])
def test_mass_and_momentum_stay_as_sums(storage):
    """Each node's rounding is below 40 ulp of 0.1, at random: the sum of n nodes over 20 steps stays within."""
    shape, lattice = (6, 8, 16), D3Q19
    fluid = make(lattice, shape, storage=storage, force=NO_FORCE)
    fluid.set_populations(random_populations(lattice, shape))
    ulp = np.finfo(fluid.f.dtype).eps * 0.1

    def sums():
        h = fluid.populations().astype(float)
        return np.append(h.sum(), np.tensordot(h, lattice.e, axes=(0, 0)).sum(axis=(0, 1, 2)))

    before = sums()
    fluid.advance(20)
    assert np.abs(sums() - before).max() < 40 * ulp * np.sqrt(20 * np.prod(shape))


def test_fluid_at_rest_stays_exactly_at_rest():
    fluid = make(D3Q19, (4, 4, 20))
    fluid.solid.inner[1, 1:3, 5:9] = 0
    fluid.solid_changed()
    fluid.advance(5)
    assert not fluid.populations().any()
