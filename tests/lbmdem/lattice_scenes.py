"""Fluids for tests of the lattice."""

from hpcpic.core.space.domain import Domain, even_cuts
from lbmdem.fluid.fluid import Fluid


def fluid_in_a_box(world, pool, lattice, shape, periodic=None, cuts=None, **options) -> Fluid:
    """A fluid at rest of so many nodes (storage order), periodic along all axes unless something else is said."""
    periodic = periodic or (True,) * len(shape)
    domain = Domain(tuple(map(float, shape)), shape, periodic, cuts or even_cuts(shape[0], world.size))
    return Fluid(world, pool, domain, lattice, **{"tau": 0.7, **options})
