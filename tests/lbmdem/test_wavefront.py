import itertools

import numpy as np
import pytest
from lbm_reference import random_populations

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain, even_cuts
from hpcpic.core.tasks import Pool
from lbmdem import wavefront
from lbmdem.fluid import Fluid
from lbmdem.lattices import D2Q9, D3Q19

SHAPES = {"D2Q9": (40, 37), "D3Q19": (36, 26, 12)}


def make(lattice, periodic, *, world=None, threads=1, storage="double") -> Fluid:
    """Random populations and solid nodes."""
    world, shape = world or World.alone(), SHAPES[lattice.name]
    domain = Domain(tuple(map(float, shape)), shape, periodic, even_cuts(shape[0], world.size))
    fluid = Fluid(world, Pool(threads), domain, lattice, tau=0.8, storage=storage)
    low, high = domain.row_range(world.rank)
    fluid.solid.inner[(np.random.default_rng(4).random(shape) < 0.1)[low:high]] = 1
    fluid.solid_changed()
    fluid.set_populations(random_populations(lattice, shape)[:, low:high])
    return fluid


def stepped(lattice, periodic, n: int, **options) -> np.ndarray:
    fluid = make(lattice, periodic, **options)
    for _ in range(n):
        fluid.step()
    return fluid.populations()


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    ("lattice", "periodic"),
    [(D2Q9, (True, True)), (D2Q9, (False, True)), (D3Q19, (True, True, True)), (D3Q19, (False, False, True))],
)
def test_a_wave_has_the_bits_of_plain_steps(monkeypatch, lattice, periodic, threads):
    """Depths odd and even, with and without tiles of rows, from either parity, steps left over."""
    plain = stepped(lattice, periodic, 13)
    for depth, cache in itertools.product((2, 3, 4), (1.0, 1e9)):
        monkeypatch.setitem(wavefront.DEPTH, "double", depth)
        monkeypatch.setattr(wavefront, "CACHE", cache)
        fluid = make(lattice, periodic, threads=threads)
        fluid.step()
        assert fluid.depth == depth
        fluid.advance(12)
        assert fluid.iteration == 13
        assert np.array_equal(fluid.populations(), plain)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize(("planes", "parts", "depth"), [(24, 1, 4), (24, 2, 5), (25, 3, 4)])
def test_blocks_and_gaps_do_every_plane_once_per_step_and_never_too_early(planes, parts, depth, periodic):
    pieces = wavefront.blocks(planes, parts, periodic, periodic)
    pieces += [wavefront.gap(piece.high) for piece in pieces if periodic or piece.high < planes]
    rows = wavefront.row_tiles(30, periodic, 8, depth)
    done = np.zeros((planes, 30), int)
    for piece in pieces:
        for parity, z, _, low, high in wavefront.tiles(piece, rows, (planes, 30), depth, 0):
            for y in range(low, high):
                step = done[z, y]
                assert step % 2 == parity
                for a, b in itertools.product((-1, 0, 1), repeat=2):
                    inside = periodic or (0 <= z + a < planes and 0 <= y + b < 30)
                    assert not inside or done[(z + a) % planes, (y + b) % 30] >= step
                done[z, y] += 1
    assert (done == depth).all()


def test_a_slab_too_thin_for_a_wave_is_stepped(monkeypatch):
    domain = Domain((5.0, 9.0), (5, 9), (True, True), (0, 5))
    assert wavefront.possible_depth(domain, 1, 4) == 2
    assert wavefront.possible_depth(domain, 2, 4) == 1
    fluid = make(D2Q9, (True, True))
    fluid.hooks.append(lambda fluid, parity: None)
    assert fluid.depth == 1


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(("lattice", "periodic"), [(D2Q9, (False, True)), (D3Q19, (True, True, True))])
def test_a_wave_through_several_ranks_has_the_bits_of_plain_steps(world, lattice, periodic, threads):
    plain = stepped(lattice, periodic, 9)
    fluid = make(lattice, periodic, world=world, threads=threads)
    assert fluid.depth > 1
    fluid.step()
    fluid.advance(8)
    low, high = fluid.domain.row_range(world.rank)
    found = fluid.populations()
    fluid.free()
    assert np.array_equal(found, plain[:, low:high])
