"""What tests of the lattice and of grains share."""

import pytest

from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool


@pytest.fixture
def alone():
    """This rank by itself, whatever the launch."""
    return World.alone()


@pytest.fixture(scope="module")
def pool():
    """One thread."""
    made = Pool(1)
    yield made
    made.close()
