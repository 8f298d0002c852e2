"""Ranks with nothing to do, and with images from the other end, take part in every step."""

import numpy as np
import pytest
from sph_scenes import engine, jitter, tank, text

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import MAX_IMBALANCE, balanced_cuts, fullest
from sph.kernels.marks import FLUID
from sph.particles.neighbours import BODY_COST, VECTOR

SCENES = {
    "most ranks are empty": {"size": (20.0, 1.0), "fill": (0.3, 0.3), "more": tank(2, size=(20.0, 1.0))},
    "periodic along the slabs": {"size": (2.0, 1.0), "fill": (2.0, 0.5), "periodic": ("x",), "velocity": (3.0, 0.0)},
    "mirrors": {"size": (1.0, 1.0), "fill": (1.0, 0.5), "more": tank(2, "mirror-no-slip")},
}


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("name", SCENES)
def test_ranks_compute_what_one_does(name):
    together, alone = (engine(world=world, spacing=0.1, **SCENES[name]) for world in (World.start(), World.alone()))
    for sph in (together, alone):
        jitter(sph, speed=0.1)
        for _ in range(10):
            sph.step()
    assert together.scalars() == alone.scalars()


def test_the_cost_of_a_layer_counts_its_neighbours_and_dry_walls_have_none():
    sph = engine(spacing=0.1, **SCENES["most ranks are empty"])
    costs, counts = sph.cells.costs(), sph.cells.counts(sph.storage)
    x, fluid = sph.storage.own_values("x"), sph.storage.own_values("flags") & FLUID != 0
    dry = sph.grid.layer(x[0])[fluid].max() + 2  # the layer beside fluid reaches it
    assert np.array_equal(costs[dry:], BODY_COST * counts[dry:]) and counts[dry:].any()
    distance = np.linalg.norm(x[:, :, None] - x[:, None], axis=0)
    pairs = np.triu((distance < sph.scene.support) & (fluid[:, None] | fluid), 1)
    vectors = costs.sum() - BODY_COST * counts.sum()
    assert pairs.sum() / VECTOR <= vectors <= pairs.sum()


# with more wall than fluid
FILM = '{ name = "film"; shape = { box = { low = [0.6, 0.0, 0.0]; high = [3.0, 0.6, 0.1]; }; }; }'


@pytest.mark.mpi(min_size=2)
def test_slabs_cost_alike_at_the_start_and_costs_do_not_depend_on_them():
    size = (3.0, 0.6, 0.6)
    case = text(d=3, spacing=0.05, size=size, fill=(0.6, 0.6, 0.6), more=tank(3, size=size))
    case = case.replace("fluid = (", f"fluid = ( {FILM},")
    together, alone = (engine(world=world, case=case) for world in (World.start(), World.alone()))
    costs = together.world.sum_int(together.cells.costs())
    assert np.array_equal(costs, alone.cells.costs())
    ranks = together.world.size
    least = fullest(costs, balanced_cuts(costs, ranks))
    assert fullest(costs, together.slabs.domain.cuts) <= MAX_IMBALANCE * least
    by_number = balanced_cuts(alone.cells.counts(alone.storage), ranks)
    assert fullest(costs, by_number) > 1.05 * least
