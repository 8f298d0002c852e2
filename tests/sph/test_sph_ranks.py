"""Ranks with nothing to do, and with images from the other end, take part in every step."""

import pytest
from sph_scenes import engine, jitter, tank

from hpcpic.core.comm.world import World

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
