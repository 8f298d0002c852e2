"""Laws of cuts by cost: of a dense slab at the start, as it moves, after a restart; none of a plasma that is even."""

import numpy as np
import pytest
from plasma_cases import PLANE, advanced
from test_step import Memory, digest

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.run import balance
from hpcpic.core.space.domain import MAX_IMBALANCE, even_cuts, fullest
from hpcpic.core.space.rng import uniforms
from hpcpic.plasma.configure import configure
from hpcpic.plasma.diagnostics.snapshot import particles_by_row
from hpcpic.plasma.forecast import cuts
from hpcpic.plasma.forecast.plan import plan
from hpcpic.plasma.setup import loaders

ROWS = 40


class DenseSlab(loaders.Loader):
    """Four of five particles in the first quarter along the last axis."""

    name = "dense slab"

    def positions(self, batch):
        x = uniforms(batch.seed, 1, batch.ids, len(batch.lengths)) * batch.lengths
        x[:, -1] *= np.where(batch.index % 5 < 4, 0.25, 1.0)
        return x


@pytest.fixture(autouse=True)
def dense_slab(monkeypatch):
    monkeypatch.setitem(loaders.LOADERS, DenseSlab.name, DenseSlab())


DENSE = PLANE.replace('init_method = "random position"', 'init_method = "dense slab"')


def config(text, sets=()):
    return configure(loads(text, sets=sets))


def is_even(made):
    """No rank costs more than the mean and a row."""
    counts = made.world.sum_int(particles_by_row(made.scene, made.cloud))
    cost = cuts.row_costs(made.scene.config, counts)
    return fullest(cost, made.domain.cuts) <= cost.sum() / made.world.size + cost.max()


def alone():
    from mpi4py import MPI

    return World(MPI.COMM_SELF, MPI.COMM_SELF)


@pytest.mark.parametrize("ranks", [2, 3, 5])
def test_no_rank_has_more_than_the_mean_and_a_row_at_the_start(ranks):
    case = config(DENSE)
    counts = np.zeros(ROWS)
    for species in cuts.Scene(case).species:
        rows = species.positions(np.array(species.ids))[:, -1] / (60.0 / ROWS)
        counts += np.bincount(rows.astype(int), minlength=ROWS)
    cost, made = cuts.row_costs(case, counts), cuts.first_cuts(case, ranks)
    assert fullest(cost, made) <= cost.sum() / ranks + cost.max()
    assert fullest(cost, even_cuts(ROWS, ranks)) > MAX_IMBALANCE * fullest(cost, made)
    told = next(line for line in plan(case, ranks, 1) if line.startswith("  rows"))
    assert [int(word) for word in told.split()[1:]] == np.diff(made).tolist()


@pytest.mark.parametrize("wave", ["", "perturbation = { mode = [0, 1]; amplitude = 0.02; };"])
def test_an_even_plasma_is_cut_evenly_and_no_particle_is_looked_at(monkeypatch, wave):
    monkeypatch.setattr(cuts, "Scene", None)
    for ranks in (1, 2, 3, 7):
        assert cuts.first_cuts(config(PLANE.replace('"quiet";', f'"quiet"; {wave}')), ranks) == even_cuts(ROWS, ranks)


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("solver", ["MFT", "LU"])
def test_ranks_with_uneven_slabs_give_the_bits_of_one(solver):
    world, sets = World.start(), [f'simulation.solver="{solver}"']
    together = advanced(DENSE, world, sets, steps=4)
    assert together.domain.cuts == cuts.first_cuts(config(DENSE, sets), world.size) != even_cuts(ROWS, world.size)
    single = advanced(DENSE, alone(), sets, steps=4)
    for made in (together, single):  # uneven otherwise, and with slabs of a row
        if made is together:
            made.balance.move((*range(world.size), ROWS))
        for _ in range(3):
            made.step()
    found = digest(together), together.scalars()
    expected = digest(single), single.scalars()
    assert not world.any(found != expected)


@pytest.mark.mpi(min_size=2)
def test_cuts_follow_the_particles_when_that_is_worth_laying_out(monkeypatch):
    world = World.start()
    monkeypatch.setattr(balance, "PERIOD", 3)
    monkeypatch.setattr(cuts, "LAYING_OUT", (0.0, 0.0))
    made = advanced(PLANE, world, steps=2)
    assert made.domain.cuts == even_cuts(ROWS, world.size)
    dense = Memory(advanced(DENSE, alone(), steps=2))
    dense.time = 0.2
    made.restore(dense)  # as after a restart
    assert is_even(made)
    made.balance.move((*range(world.size), ROWS))
    assert not is_even(made)
    made.step()
    assert is_even(made)  # at step 3
    assert not world.any(digest(made) != digest(advanced(DENSE, alone(), steps=3)))
