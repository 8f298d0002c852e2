"""Links against the plain method of physics/reference.py."""

import numpy as np
import pytest
from lattice_scenes import fluid_in_a_box

from lbmdem.coupling.immersed import Immersed
from lbmdem.fluid.solid_nodes import kernel_axes, kernel_rotation
from lbmdem.physics.reference import Links
from lbmdem.physics.velocity_sets import D2Q9, D3Q19
from lbmdem.physics.wall_rules import RULES

BOXES = {"D3Q19": (9, 10, 11), "D2Q9": (12, 13)}
ROUNDING = 3e-16  # populations are below 0.02, some tens of operations in four steps
FORCE_ROUNDING = 2e-13  # a thousand links, each rounded to 2^-50


def two_grains(lattice):
    """One of them across the corners of the box."""
    three = lattice.dimensions == 3
    centres = np.array([[4.2, 5.1, 3.3], [9.8, 1.2, 7.9]])[:, : lattice.dimensions]
    velocity = np.array([[0.01, 0.02, -0.03], [-0.02, 0.01, 0.01]])[:, : lattice.dimensions]
    omega = np.array([[0.003, -0.004, 0.002], [0.001, 0.002, 0.005]])[:, : 3 if three else 1]
    return np.arange(2), centres, np.array([2.6, 2.2]), velocity, omega


def slow_steps(fluid, grains, rule, steps):
    """The plain method from the same populations; its forces on the grains [2, 6] in the axes of kernels."""
    shape = fluid.ids[1:-1, 1:-1, 1:-1].shape if fluid.domain.ndim == 3 else fluid.ids[1:-1, :, 1:-1].shape
    slow = Links(fluid.lattice, shape, *fluid.collision.rates)
    slow.solid[:] = fluid.solid.inner.reshape(shape)
    _, centres, radii, velocity, omega = grains
    places, speeds, turns = kernel_axes(centres), kernel_axes(velocity), kernel_rotation(omega)
    box = np.array(shape[::-1])

    def crossing(x, i, s):
        body, e = int(slow.at(slow.solid, s)), slow.e[i]
        d = x + e - places[body]
        d -= np.rint(d / box) * box * (box > 1) + e
        a, b, c = e @ e, e @ d, d @ d - radii[body] ** 2
        q = (-b - np.sqrt(b * b - a * c)) / a
        arm = d + q * e
        return body, q, arm, speeds[body] + np.cross(turns[body], arm)

    first = slow.h.copy()
    for _ in range(steps):
        forces = slow.step(rule, crossing)
    return first, slow, np.array([forces[0], forces[1]])


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("lattice", [D2Q9, D3Q19], ids=lambda lattice: lattice.name)
def test_links_are_those_of_the_papers(world, pool, lattice, rule, moving):
    grains, steps = two_grains(lattice), 1 if lattice is D3Q19 else 3
    fluid = fluid_in_a_box(world, pool, lattice, BOXES[lattice.name])
    immersed = Immersed(fluid, world, pool, rule=rule, fixed=None if moving else grains)
    if moving:
        immersed.move(*grains)
    first, slow, wanted = slow_steps(fluid, grains, rule, steps)
    fluid.set_populations(first.reshape(lattice.q, *fluid.domain.points))
    for _ in range(steps):
        fluid.step()
    free = slow.solid == -1
    got = fluid.populations().reshape(slow.h.shape)
    assert np.abs(got - slow.h)[:, free].max() < ROUNDING
    force, torque = immersed.all_forces(2, steps=1)
    assert np.abs(kernel_axes(force) - wanted[:, :3]).max() < FORCE_ROUNDING
    turned = wanted[:, 3:] if lattice is D3Q19 else -wanted[:, 4:5]
    assert np.abs(torque - turned).max() < FORCE_ROUNDING
    assert np.abs(wanted).min(axis=0)[[0, 2]].min() > 1e-4  # there is something to compare
