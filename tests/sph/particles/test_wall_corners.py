"""Walls that meet share the load of their corner: each bears the pressure of the fluid on its face, up to the edge."""

import numpy as np
import pytest

import sph
from sph.kernels.marks import WALL_BITS
from sph.particles.wall_corners import WallCorners, duals
from sph.particles.walls import Walls
from sph.setup.scene import Scene
from sph.setup.signed_distance import signed_distance

DEPTH, G, RHO = 0.3, 9.81, 1000.0


def gate(low, high, spacing=0.02, **more):
    """Water to the left of a gate that stands in a tank, [d] lower and upper corner, 2D or 3D."""
    d = len(low)
    up = "xyz"[d - 1] + "+"
    tank = {"low": [0.0] * d, "high": [*[0.6, 0.1][: d - 1], 0.5], "open": [up]}
    water = {"low": [0.0] * d, "high": [*[low[0], 0.1][: d - 1], DEPTH]}
    return sph.Case(
        simulation={"dimensions": d, "end_time": 1.0},
        gravity=[0.0] * (d - 1) + [-G],
        numerics={"spacing": spacing} | more,
        fluid=[{"name": "water", "shape": {"box": water}}],
        wall=[
            {"name": "tank", "shape": {"box": tank}, "measure_force": True},
            {"name": "gate", "solid": True, "shape": {"box": {"low": low, "high": high}}, "measure_force": True},
        ],
        output={"period": {"series": 0.1, "particles": 1.0}},
    )


def shares(case, displacement=0.0):
    """Number of the owner, place [d], wall and direction [d] of each share."""
    scene = Scene(case.config)
    walls = Walls(scene)
    walls.displacement[1, -1] = displacement
    found = WallCorners(walls).shares()
    owners = (found.ids >> WALL_BITS) - 1
    places = np.array([scene.walls[o].at(np.array([i]))[0][0] for o, i in zip(owners, found.ids)])
    return owners, places, found.of, found.way


# within 0.9 % with the shares, -3 to -10 % without
@pytest.mark.parametrize(
    ("low", "high", "smoothing"),
    [
        ((0.3, 0.0), (0.4, 0.4), 1.5),
        ((0.31, 0.0), (0.41, 0.4), 1.5),  # particles of the floor lie below its face
        ((0.3, 0.0), (0.4, 0.4), 2.0),
        ((0.3, -0.1, 0.0), (0.36, 0.2, 0.4), 1.5),
    ],
)
def test_a_gate_bears_the_pressure_up_to_its_edges(low, high, smoothing):
    d, time = len(low), 0.1 if len(low) == 2 else 0.05
    width = 0.1 if d == 3 else 1.0
    with gate(list(low), list(high), smoothing=smoothing).simulation(threads=1) as sim:
        sim.advance(until=time)
        found, water = sim.scalars(), sim.particles("water")
        load = RHO * G * DEPTH**2 / 2 * width
        assert found["impulse_gate_x"] / sim.time == pytest.approx(load, rel=0.015)
        momentum = float((water["mass"] * water["velocity"][:, 0]).sum())  # what one wall takes the other has not
        assert found["impulse_gate_x"] + found["impulse_tank_x"] == pytest.approx(-momentum, abs=1e-12 * load * time)


def test_shares_along_oblique_normals_give_each_wall_its_pressure():
    rng = np.random.default_rng(1)
    owner, first, second = rng.normal(size=(3, 50, 3))
    owner, first, second = (v / np.linalg.norm(v, axis=1)[:, None] for v in (owner, first, second))
    good = np.abs(np.linalg.det(np.stack([owner, first, second], axis=1))) > 0.35  # no two nearly parallel
    owner, first, second = owner[good], first[good], second[good]
    numbers = np.repeat(np.arange(len(owner)), 2)
    normals = np.stack([first, second], axis=1).reshape(-1, 3)
    pressures = rng.uniform(0.5, 2.0, size=(3, len(owner), 1))
    force = np.repeat(pressures[0] * owner + pressures[1] * first + pressures[2] * second, 2, axis=0)
    along = np.sum(duals(numbers, np.repeat(owner, 2, axis=0), normals) * force, axis=1)
    np.testing.assert_allclose(along.reshape(-1, 2).T, pressures[1:, :, 0], rtol=1e-9)


def load_under_pressure(corners, dp=0.01):
    """[2] m: the load of the floor of a tank on which a solid stands, under a pressure of 1: all pairs by numpy, with
    a kernel so wide that sums are nearly integrals.
    """
    solid = {"name": "solid", "solid": True, "measure_force": True, "shape": {"polygon": {"corners": corners}}}
    tank = {"low": [0.0, 0.0], "high": [0.8, 0.4], "open": ["y+"]}
    scene = Scene(sph.Case(
        simulation={"dimensions": 2, "end_time": 1.0}, gravity=[0.0, -G], numerics={"spacing": dp, "smoothing": 3.0},
        fluid=[{"shape": {"box": {"low": [0.0, 0.0], "high": [0.8, 0.4]}}}],
        wall=[{"name": "tank", "shape": {"box": tank}, "measure_force": True}, solid],
    ).config)  # fmt: skip
    place = np.stack(np.meshgrid((np.arange(80) + 0.5) * dp, (np.arange(40) + 0.5) * dp), axis=-1).reshape(-1, 2)
    part = np.clip(0.5 + signed_distance(scene.walls[1].shape, place) / dp, 0.0, 1.0)  # of a cell that a face cuts
    place, part = place[part > 0.0], part[part > 0.0]
    ids, x, _ = map(np.concatenate, zip(*(wall.near(*wall.bounds) for wall in scene.walls)))
    near = np.flatnonzero(np.abs(x[:, 1] - 0.15) < 0.25)  # the top is open
    ids, x, force = ids[near], x[near], np.zeros((2, len(near)))
    for k, at in enumerate(x):
        far = np.maximum(1.0 - np.sqrt(np.sum((at - place) ** 2, axis=1)) / scene.support, 0.0)
        force[:, k] = 2.0 * dp**4 * 35.0 / (4.0 * np.pi * scene.h**4) * (part * far**3) @ (at - place)  # Wendland C2
    found, shared = np.zeros((2, 2)), WallCorners(Walls(scene)).shares()
    np.add.at(found, (ids >> WALL_BITS) - 1, force.T)
    at = np.argsort(ids)[np.searchsorted(np.sort(ids), shared.ids)]
    taken = shared.force(np.arange(len(at)), force[:, at]).T
    np.add.at(found, shared.of, taken)
    np.add.at(found, (ids[at] >> WALL_BITS) - 1, -taken)
    return found[0]


@pytest.mark.parametrize(
    ("corners", "covered"),
    [
        ([[0.2, 0.0], [0.6, 0.0], [0.6, 0.3]], 0.4),  # a ramp whose toe is sharp
        ([[0.1, 0.0], [0.6, 0.0], [0.6, 0.125]], 0.5),  # a beach of 1 to 4
        ([[0.2, 0.0], [0.4, 0.0], [0.6, 0.3], [0.2, 0.3]], 0.2),  # one that hangs over
    ],
)
def test_a_floor_bears_the_pressure_up_to_a_slope(corners, covered):
    """What is not covered bears it; with shares along the normals alone half a spacing to 5 more. A fifth of one is
    left of the lattice that slopes cut.
    """
    along, down = load_under_pressure(corners)
    assert down == pytest.approx(covered - 0.8, abs=0.003)
    assert abs(along) < 0.0015


@pytest.mark.parametrize("end", [0.34, 0.4])  # one is thinner than the support: both its faces reach beside it
def test_only_particles_behind_both_faces_are_shared(end):
    owners, places, takers, normals = shares(gate([0.3, 0.0], [end, 0.4]))
    assert set(owners.tolist()) == {0} and set(takers.tolist()) == {1}  # of the floor, by the gate
    assert len(places) == round((end - 0.3) / 0.02) * 3
    assert np.all((places[:, 0] > 0.3) & (places[:, 0] < end) & (places[:, 1] < 0.0))
    assert np.all(np.abs(normals[:, 0]) == 1.0) and np.all(normals[:, 1] == 0.0)


def test_a_gate_that_has_moved_shares_as_one_that_stands_there():
    moved, there = shares(gate([0.3, -0.1], [0.4, 0.3]), 0.1), shares(gate([0.3, 0.0], [0.4, 0.4]))
    for one, other in zip(moved, there):
        assert one == pytest.approx(other)
    assert len(shares(gate([0.3, 0.0], [0.4, 0.4]), 0.2)[0]) == 0  # above the floor nothing is behind both
