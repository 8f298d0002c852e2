"""The state for checkpoints: all particles, in order of their numbers, whoever holds them."""

import numpy as np
import pytest
from plasma_cases import advanced

from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.run.checkpoint import digest
from hpcpic.plasma.particles import cloud

CASE = """
simulation = { dimensions = 2; cycles = 5; time_step = 0.2; space_length = [32.0, 48.0]; random_seed = 7; };
grid = { points = [32, 48]; };
species = (
  { name = "e"; particles = 3000; charge = -1.0; mass = 1.0; drift_velocity = [1.0, 0.0];
    thermal_velocity = 1.0; plasma_frequency = 1.0;
    init_method = "random position"; },
  { name = "i"; particles = 700; charge = 1.0; mass = 100.0; drift_velocity = [0.0, 0.0];
    plasma_frequency = 0.1;
    init_method = "random position"; }
);
"""


@pytest.fixture(params=["double", "single"])
def plasma(request, world):
    plasma = advanced(CASE, world, [f'numerics.precision="{request.param}"'])
    yield plasma
    plasma.close()


def check_state_is_what_particles_says(plasma):
    """Row k of the state is the particle of number k of `particles`, which goes its own way to metres."""
    scene, world = plasma.scene, plasma.world
    state, particles = plasma.state(), plasma.particles()
    for species in scene.species:
        found = particles[species.name]
        assert found.time_offsets == {"velocity": -0.5 * scene.time_step}
        n, here = np.zeros(species.n, np.int64), np.zeros((species.n, 3))
        n[found.ids - species.first] = 1
        here[found.ids - species.first] = found.position
        assert (world.sum_int(n) == 1).all()
        position, tile = state[f"{species.name}/position"], state[f"{species.name}/tile"].local
        corner = np.stack([tile % 2, tile // 2], axis=1) * 16
        own = slice(position.offset, position.offset + len(position.local))
        mine = n[own] == 1
        np.testing.assert_array_equal((position.local + corner)[mine], here[own][mine, :2])


def test_state_is_what_particles_says(plasma):
    check_state_is_what_particles_says(plasma)


def test_state_does_not_depend_on_chunks(plasma, monkeypatch):
    whole = digest(plasma.world, plasma.state())
    monkeypatch.setattr(cloud, "CHUNK", 128)
    assert digest(plasma.world, plasma.state()) == whole


@pytest.mark.mpi(min_size=2)
def test_state_of_many_ranks_is_that_of_one(plasma):
    from mpi4py import MPI

    check_state_is_what_particles_says(plasma)
    alone = World(MPI.COMM_SELF, MPI.COMM_SELF)
    one = advanced(CASE, alone, [f'numerics.precision="{plasma.scene.config.numerics.precision}"'])
    assert digest(plasma.world, plasma.state()) == digest(alone, one.state())
    one.close()


class Changed:
    """A reader of the state of a plasma, with one value changed."""

    def __init__(self, plasma, name, value):
        self.step, self.arrays = plasma.iteration, {name: shard.local.copy() for name, shard in plasma.state().items()}
        self.arrays[name].reshape(-1)[1001] = value

    def read(self, name, start, stop):
        return self.arrays[name][start:stop]


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e-30, 16.0])
def test_a_position_that_is_not_in_its_tile_is_told(plasma, value):
    """Kernels would go out of their arrays with it."""
    with pytest.raises(Diverged, match="a position of e"):
        plasma.restore(Changed(plasma, "e/position", value))


@pytest.mark.parametrize("tile", [-1, 6])
def test_a_tile_that_is_not_on_the_grid_is_told(plasma, tile):
    with pytest.raises(Diverged, match="a position of e"):
        plasma.restore(Changed(plasma, "e/tile", tile))


def test_a_state_that_is_left_alone_is_taken(plasma):
    before = digest(plasma.world, plasma.state())
    kept = plasma.state()["e/velocity"].local.reshape(-1)[1001]
    plasma.restore(Changed(plasma, "e/velocity", kept))
    assert digest(plasma.world, plasma.state()) == before
