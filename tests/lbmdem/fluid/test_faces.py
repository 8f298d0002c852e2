import numpy as np
import pytest
from lattice_scenes import fluid_in_a_box

from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from lbmdem.fluid.faces import Face
from lbmdem.fluid.fluid import Fluid
from lbmdem.physics.reference import random_populations
from lbmdem.physics.velocity_sets import CS2, D2Q9, D3Q19

AXES = {"x": 0, "y": 1, "z": 2}


def make(lattice, shape, faces, *, world=None, **options) -> Fluid:
    names = "xyz"[: lattice.dimensions][::-1]
    periodic = tuple(not any(face[0] == name for face in faces) for name in names)
    return fluid_in_a_box(world or World.alone(), Pool(1), lattice, shape, periodic, faces=faces, **options)


@pytest.mark.parametrize(("moving", "across"), [("x", "y"), ("y", "x"), ("x", "z"), ("z", "x"), ("y", "z")])
def test_couette_flow_is_linear_at_every_node(moving, across):
    """Half-way walls, one of them sliding; exact for TRT 3/16 up to the round-off of a steady state."""
    lattice = D3Q19 if "z" in moving + across else D2Q9
    d, n = lattice.dimensions, 8
    shape = [3] * d
    shape[d - 1 - AXES[across]] = n
    speed = np.zeros(d)
    speed[AXES[moving]] = 0.02
    faces = {across + "-": Face("wall"), across + "+": Face("wall", velocity=speed)}
    fluid = make(lattice, tuple(shape), faces, tau=1.5)
    fluid.advance(1500)
    u = np.moveaxis(fluid.moments()[1], d - 1 - AXES[across], 0)
    exact = ((np.arange(n) + 0.5) / n).reshape(-1, *[1] * (d - 1)) + 0 * u[..., 0]
    np.testing.assert_allclose(u[..., AXES[moving]] / 0.02, exact, atol=1e-9)
    fluid.set_face(across + "+", velocity=-speed)
    fluid.advance(1500)
    u = np.moveaxis(fluid.moments()[1], d - 1 - AXES[across], 0)
    np.testing.assert_allclose(-u[..., AXES[moving]] / 0.02, exact, atol=1e-9)


@pytest.mark.parametrize("lattice", [D2Q9, D3Q19], ids=["D2Q9", "D3Q19"])
def test_a_driven_cavity_keeps_its_mass(lattice):
    """A sliding wall adds w rho (e.u) in opposite pairs: nothing, up to rounding of the sum."""
    n = 9
    names = [axis + side for axis in "xyz"[: lattice.dimensions] for side in "-+"]
    lid = (0.1, 0.0, 0.0)[: lattice.dimensions]
    top = names[-1]
    faces = {name: Face("wall", velocity=lid if name == top else (0.0,) * lattice.dimensions) for name in names}
    fluid = make(lattice, (n,) * lattice.dimensions, faces, tau=0.8)
    fluid.advance(100)
    assert abs(fluid.populations().sum()) < 1e-13
    assert fluid.moments()[1][..., 0].max() > 0.02


@pytest.mark.parametrize(("along", "across"), [("x", "y"), ("y", "x"), ("z", "x"), ("x", "z"), ("y", "z")])
def test_a_pressure_difference_drives_the_parabola(along, across):
    """Zou-He faces with half-way walls: Poiseuille's profile but for a layer of nodes at the faces, where the reflected
    part lacks the gradient (2e-3 of the flow). An even length: an odd one keeps a checkerboard of the velocity alive.
    """
    lattice = D3Q19 if "z" in along + across else D2Q9
    d, height, length, tau, drop = lattice.dimensions, 6, 16, 1.2, 1e-6
    shape = [3] * d
    shape[d - 1 - AXES[across]], shape[d - 1 - AXES[along]] = height, length
    faces = {
        along + "-": Face("pressure", density=1.0 + drop / 2),
        along + "+": Face("pressure", density=1.0 - drop / 2),
        across + "-": Face("wall"),
        across + "+": Face("wall"),
    }
    fluid = make(lattice, tuple(shape), faces, tau=tau)
    fluid.advance(1200)
    rho, u = fluid.moments()
    order = [d - 1 - AXES[along], d - 1 - AXES[across]]
    rho, u = np.moveaxis(rho, order, [0, 1]), np.moveaxis(u, order, [0, 1])
    gradient = CS2 * drop / (length - 1)  # the faces are at the first and the last nodes
    y = np.arange(height) + 0.5
    parabola = gradient / (2 * CS2 * (tau - 0.5)) * y * (height - y)
    found = u[..., AXES[along]]
    parabola = parabola.reshape(1, -1, *[1] * (d - 2)) + 0 * found
    np.testing.assert_allclose(found[4:-4], parabola[4:-4], rtol=2e-3)
    np.testing.assert_allclose(found, parabola, rtol=8e-3)
    linear = 1.0 + drop * (0.5 - np.arange(length) / (length - 1))
    np.testing.assert_allclose(rho, linear.reshape(-1, *[1] * (d - 1)) + 0 * rho, atol=2e-3 * drop)


@pytest.mark.parametrize("side", ["-", "+"])
@pytest.mark.parametrize("lattice", [D2Q9, D3Q19], ids=["D2Q9", "D3Q19"])
def test_faces_have_what_they_are_given(lattice, side):
    """Random populations after one step: the density or the velocity (with half the force) at the face is exact."""
    d = lattice.dimensions
    wanted = np.array([0.03, -0.02, 0.01])[:d]
    force = np.array([1e-3, 2e-3, -1e-3])[:d]
    shape = (6, 5, 9)[-d:]
    for axis in "xyz"[:d]:
        for kind in ("pressure", "velocity"):
            faces = {axis + s: Face(kind, density=1.01, velocity=wanted) for s in "-+"}
            fluid = make(lattice, shape, faces, tau=0.9, force=force)
            fluid.set_populations(random_populations(lattice, shape))
            fluid.step()
            rho, u = fluid.moments()
            at = np.index_exp[0 if side == "-" else -1]
            layer = np.moveaxis(u, d - 1 - AXES[axis], 0)[at]
            if kind == "velocity":
                np.testing.assert_allclose(layer, wanted + 0 * layer, atol=1e-15)
            else:
                np.testing.assert_allclose(np.moveaxis(rho, d - 1 - AXES[axis], 0)[at], 1.01, rtol=1e-15)
                tangent = [k for k in range(d) if k != AXES[axis]]
                np.testing.assert_allclose(layer[..., tangent], wanted[tangent] + 0 * layer[..., tangent], atol=1e-15)


@pytest.mark.parametrize(("along", "across"), [("x", "y"), ("y", "x"), ("z", "x"), ("x", "z"), ("y", "z")])
@pytest.mark.parametrize("most", [1, 40])
def test_a_stream_between_walls_that_go_with_it_stays_uniform(along, across, most):
    """Also in the corners of its inlet and outlet, which are fed by both a wall and an open face; step by step, and
    with several steps in a pass."""
    lattice = D3Q19 if "z" in along + across else D2Q9
    d = lattice.dimensions
    speed = np.zeros(d)
    speed[AXES[along]] = 0.03
    faces = {across + side: Face("wall", velocity=speed) for side in "-+"}
    faces |= {along + "-": Face("velocity", velocity=speed), along + "+": Face("pressure")}
    fluid = make(lattice, (30, 7, 8)[:d], faces, tau=0.56)
    assert fluid.depth > 1
    fluid.set_equilibrium(1.0, np.broadcast_to(speed, (*fluid.domain.points, d)))
    for _ in range(40 // most):
        fluid.advance(most)
    rho, u = fluid.moments()
    np.testing.assert_allclose(u, speed + 0 * u, atol=1e-13)
    np.testing.assert_allclose(rho, 1.0, atol=1e-13)


def test_a_face_takes_a_profile():
    height = 8
    profile = np.zeros((height, 2))
    profile[:, 0] = 1e-3 * np.arange(height)
    faces = {"x-": Face("velocity"), "x+": Face("pressure"), "y-": Face("wall"), "y+": Face("wall")}
    fluid = make(D2Q9, (height, 12), faces, tau=0.9)
    fluid.set_face("x-", velocity=profile)
    fluid.advance(3)
    np.testing.assert_allclose(fluid.moments()[1][:, 0], profile, atol=1e-15)


def test_wrong_faces_are_refused():
    with pytest.raises(ValueError, match="no such face: z-"):
        make(D2Q9, (4, 4), {"z-": Face("wall")}, tau=1.0)
    with pytest.raises(ValueError, match="is slippery"):
        make(D2Q9, (4, 4), {"x-": Face("slippery"), "x+": Face("wall")}, tau=1.0)
    with pytest.raises(ValueError, match=r"y\+ is periodic, but its axis is not"):
        make(D2Q9, (4, 4), {"y-": Face("wall"), "y+": Face("periodic")}, tau=1.0)


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize(("along", "across"), [("z", "y"), ("y", "z")])
def test_faces_do_not_depend_on_ranks(world, along, across):
    shape = (9, 9, 12)
    faces = {
        along + "-": Face("pressure", density=1.02),
        along + "+": Face("velocity", velocity=(0.0, 0.01, 0.01)),
        across + "-": Face("wall", velocity=(0.02, 0.0, 0.0)),
        across + "+": Face("wall", velocity=(0.02, 0.0, 0.01)),
    }
    results = []
    for ranks in (World.alone(), world):
        fluid = make(D3Q19, shape, faces, world=ranks, tau=0.9)
        low, high = fluid.domain.row_range(ranks.rank)
        fluid.set_populations(random_populations(D3Q19, shape)[:, low:high])
        fluid.advance(5)
        results.append((low, high, fluid.populations()))
        fluid.free()
    whole, (low, high, mine) = results[0][2], results[1]
    assert np.array_equal(whole[:, low:high], mine)
