"""What tests of the lattice and of grains share."""

import pytest

from hpcpic.core.comm.world import World


@pytest.fixture
def alone():
    """This rank by itself, whatever the launch."""
    return World.alone()
