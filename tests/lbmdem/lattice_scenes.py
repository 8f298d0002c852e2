"""Fluids and cases for tests of the lattice."""

from hpcpic.core.space.domain import Domain, even_cuts
from lbmdem.fluid.fluid import Fluid

# a sphere of ten Cate et al. (2002) that sinks in a closed box
SPHERE = """
simulation = { end_time = 1.0; };
domain = { size = [0.1, 0.1, 0.16]; spacing = 2.0e-3; };
fluid = { density = 960.0; viscosity = 6.04e-5; relaxation_time = 0.9; };
grains = ({ diameter = 0.015; density = 1120.0; position = [0.05, 0.05, 0.12]; });
gravity = [0.0, 0.0, -9.81];
"""


def fluid_in_a_box(world, pool, lattice, shape, periodic=None, cuts=None, **options) -> Fluid:
    """A fluid at rest of so many nodes (storage order), periodic along all axes unless something else is said."""
    periodic = periodic or (True,) * len(shape)
    domain = Domain(tuple(map(float, shape)), shape, periodic, cuts or even_cuts(shape[0], world.size))
    return Fluid(world, pool, domain, lattice, **{"tau": 0.7, **options})
