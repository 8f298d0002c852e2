"""The contact law in collisions, and how large a step may be."""

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest
from dem_scenes import RADIUS, STIFFNESS, box, by_id, dem, grains

from hpcpic.core.physics import contact_law
from hpcpic.core.physics.contact_law import ContactLaw, deepest_overlap, regularised_friction, stable_step, step_limit
from lbmdem.grains.contact_network import contact_count, energies
from lbmdem.grains.dem import Dem
from lbmdem.physics.lubrication import Film
from lbmdem.physics.plane_walls import PlaneWall

TABLE = Path(__file__).parents[2] / "data" / "dem_restitution.csv"
FRICTION = ContactLaw(STIFFNESS, 0.2, 0.3, 1.0)
SPRINGS = ContactLaw(STIFFNESS, 0.3, 0.5, 1.0, 0.5 * STIFFNESS)


def rebound(world, pool, law, fraction, d=3, shift=0.37):
    """Restitution of two equal grains that meet head on, with steps of a fraction of an undamped contact."""
    speed, gap = 0.01, RADIUS * 1e-3
    start = np.zeros((2, d)) + 0.5
    start[:, 0] += (-RADIUS - gap, RADIUS + gap)
    columns = grains(start)
    columns["v"][:, 0] = speed, -speed
    duration = math.pi * math.sqrt(0.5 * columns["mass"][0] / STIFFNESS)
    scene = dem(world, columns, law, (1.0,) * d, pool=pool)
    dt = fraction * duration
    scene.advance(dt, int((gap / speed + 2.5 * duration) / dt + shift))
    v = by_id(scene, scene.grains.v)
    np.testing.assert_array_equal(v[0], -v[1])
    return -v[0, 0] / speed


def test_the_ratio_of_the_stiffnesses_stands_once():
    root = Path(contact_law.__file__).parents[3]
    sources = [file for package in ("hpcpic", "sph", "lbmdem") for file in (root / package).rglob("*.py")]
    found = [file for file in sources if re.search(r"\b2(\.0)? / 7(\.0)?\b", file.read_text())]
    assert found == [Path(contact_law.__file__)] and contact_law.SHEAR_RATIO == 2.0 / 7.0


def rows():
    with TABLE.open() as file:
        return [[float(value) for value in row] for row in csv.reader(file) if row and row[0][0].isdigit()]


def test_restitution_is_that_of_the_damped_oscillator(world, pool):
    """With the crossing inside the step accounted for, 2 % of a contact per step gives e within 0.003."""
    for alpha, full, _, clipped, _ in rows():
        for law, expected in (
            (ContactLaw(STIFFNESS, alpha), full),
            (ContactLaw(STIFFNESS, alpha, pulls=False), clipped),
        ):
            assert rebound(world, pool, law, 0.02) == pytest.approx(expected, abs=3e-3), (alpha, law.pulls)


def test_restitution_is_second_order_in_the_step(world, pool):
    """A step four times smaller makes the error about sixteen times smaller: here at least ten."""
    exact = math.exp(-math.pi * 0.3 / math.sqrt(1 - 0.09))
    for d in (2, 3):
        coarse, fine = (abs(rebound(world, pool, ContactLaw(STIFFNESS, 0.3), part, d) - exact) for part in (0.04, 0.01))
        assert coarse < 0.01
        assert fine < coarse / 10


def oscillation(world, pool, contacts, alpha, dt_of_root):
    """Growth of a small motion along x between fixed grains, half of the contacts on either side."""
    overlap = 0.01 * RADIUS
    left, right = contacts - contacts // 2, contacts // 2
    at = 2 * RADIUS - overlap
    x = [[0.5, 0.5]] + [[0.5 - at, 0.5]] * left + [[0.5 + at, 0.5]] * right
    columns = grains(x, fixed=[False] + [True] * contacts)
    scene = dem(world, columns, ContactLaw(STIFFNESS, alpha), (1.0, 1.0), pool=pool)
    balance = np.zeros_like(scene.grains.x)
    balance[scene.grains.ids == 0, 0] = -STIFFNESS * overlap * (left - right)
    small = 1e-6 * overlap
    scene.grains.x[scene.grains.ids == 0, 0] += small
    scene.advance(dt_of_root * math.sqrt(columns["mass"][0] / STIFFNESS), 400, balance)
    return abs(by_id(scene, scene.grains.x)[0, 0] - 0.5) / small


@pytest.mark.parametrize("alpha", [0.0, 0.1, 0.5])
def test_the_deepest_overlap_is_that_of_the_damped_oscillator(world, pool, alpha):
    """Two grains meet head on: half the mass at twice the speed. Samples a hundredth of a contact apart miss 1e-4."""
    law, speed = ContactLaw(STIFFNESS, alpha), 0.01
    start = np.full((2, 3), 0.5)
    start[:, 0] += (-RADIUS, RADIUS)
    columns = grains(start)
    columns["v"][:, 0] = speed, -speed
    scene = dem(world, columns, law, (1.0,) * 3, pool=pool)
    dt, deepest = 0.01 * math.pi * math.sqrt(0.5 * columns["mass"][0] / STIFFNESS), 0.0
    for _ in range(100):
        scene.advance(dt, 1)
        x = by_id(scene, scene.grains.x)
        deepest = max(deepest, 2.0 * RADIUS - (x[1, 0] - x[0, 0]))
    assert deepest == pytest.approx(deepest_overlap(2.0 * speed, 0.5 * columns["mass"][0], law), rel=1e-3)


@pytest.mark.parametrize("alpha", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("contacts", [1, 2, 4, 6])
def test_the_limit_of_stability_is_that_of_theory(world, pool, contacts, alpha):
    """Four per cent below the limit a disturbance stays bounded, four above it grows without bound."""
    limit = step_limit(alpha, contacts)
    assert oscillation(world, pool, contacts, alpha, 0.96 * limit) < 30
    assert oscillation(world, pool, contacts, alpha, 1.04 * limit) > 1e4


def test_undamped_limits_are_the_classical_ones():
    """2 sqrt(m / (z k)): 0.637, 0.450, 0.318, 0.260 of a contact of pi sqrt(m / k)."""
    for contacts, expected in ((1, 0.637), (2, 0.450), (4, 0.318), (6, 0.260)):
        assert step_limit(0.0, contacts) / math.pi == pytest.approx(expected, abs=5e-4)


@pytest.mark.parametrize("speed", [1e-6, 0.3, 40.0])
def test_friction_is_viscous_below_the_limit_of_coulomb_and_never_beyond(speed):
    """Along the slip, min(beta v, mu N) of Mansouri et al. 2011; what it does is heat."""
    slip, limit, viscosity = speed * np.array([2.0, -1.0, 2.0]) / 3.0, 0.7, 5.0
    force, heat = regularised_friction(tuple(slip), limit, viscosity)
    expected = min(viscosity, limit / speed) * slip
    np.testing.assert_allclose(force, expected, rtol=1e-14)  # a few roundings
    assert heat == pytest.approx(np.dot(expected, slip), rel=1e-14)


def crystal_growth(world, pool, law, d, part):
    """Greatest velocity, of its first value, in a periodic close packing after 200 steps of a part of stable_step."""
    if d == 2:
        cell, basis, count = np.array([1.0, 3**0.5]), [[0, 0], [0.5, 0.5]], (6, 4)
    else:
        cell, basis, count = np.full(3, 2**0.5), [[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]], (4, 4, 4)
    corners = np.stack(np.meshgrid(*[np.arange(n) for n in count], indexing="ij"), -1).reshape(-1, d)
    spacing, first = 2 * RADIUS * 0.99, 1e-4
    x = np.concatenate([(corners + b) * cell for b in basis]) * spacing
    columns = grains(x + 0.01 * RADIUS)
    columns["v"][:] = first * np.sin(np.arange(x.size) * 12.9898).reshape(x.shape)
    scene = dem(world, columns, law, tuple(np.array(count) * cell * spacing), pool=pool)
    scene.advance(part * stable_step(law, columns["radius"], columns["mass"], columns["inertia"]), 200)
    return np.abs(scene.grains.v).max() / first


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    "law", [ContactLaw(STIFFNESS), ContactLaw(STIFFNESS, 0.9), ContactLaw(STIFFNESS, 0.3, 0.5, 1.0, 0.5 * STIFFNESS)]
)
def test_the_stable_step_is_a_sharp_bound(world, pool, law, d):
    """Every grain of a crystal has the most contacts there can be, and all move, in antiphase too."""
    assert crystal_growth(world, pool, law, d, 0.8) < 2
    assert crystal_growth(world, pool, law, d, 1.6) > 100


def test_the_step_of_the_paper_is_beyond_the_limit_of_many_damped_contacts():
    columns = grains([[0.0, 0.0, 0.0]])
    law = ContactLaw(STIFFNESS, damping=0.9)
    paper = 0.1 * math.pi * math.sqrt(columns["mass"][0] / STIFFNESS)  # [2] of Mansouri et al. 2011
    assert paper > stable_step(law, columns["radius"], columns["mass"], columns["inertia"])


@pytest.mark.parametrize("d", [2, 3])
def test_a_film_slows_grains_down_as_lubrication_says(world, pool, d):
    """m dv/dt = -resistance(gap) v between a grain and a fixed one, and above a wall; nothing beyond the cut-off."""
    film = Film(0.5 if d == 2 else 2.0, 0.2 * RADIUS, d)
    for to_wall in (False, True):
        start, speed, dt = 0.15 * RADIUS, 0.01, 1e-4
        x = [[0.5] * d, [0.5 + 2 * RADIUS + start] + [0.5] * (d - 1)]
        columns = grains(x, v=[[0.0] * d, [-speed] + [0.0] * (d - 1)], fixed=[True, False])
        walls = ()
        if to_wall:
            columns = {name: values[1:] for name, values in columns.items()}
            walls = (PlaneWall([0.5 + RADIUS] + [0.0] * (d - 1), np.eye(d)[0]),)
        scene = Dem(
            world, pool, box(world, (1.0,) * d), columns, ContactLaw(STIFFNESS, 0.2, 0.3, 1.0), walls, film=film
        )
        scene.advance(dt, 2000)
        gap, v, mass = start, speed, columns["mass"][-1]
        for _ in range(20000):
            v -= 0.1 * dt * v * film.resistance(gap, RADIUS if to_wall else RADIUS / 2) / mass
            gap -= 0.1 * dt * v
        mine = np.flatnonzero(scene.grains.ids == len(columns["mass"]) - 1)[0]
        assert -scene.grains.v[mine, 0] == pytest.approx(v, rel=1e-3)
        assert scene.grains.x[mine, 0] == pytest.approx(0.5 + 2 * RADIUS + gap, abs=1e-4 * start)
        assert v < 0.9 * speed
        assert contact_count(scene) == 0


def sliding(world, pool, radius, gap, v, omega, *, planar=False, to_wall=False):
    """Two spheres (discs), one above the other with a gap, or one above a wall, in a film of cut-off 0.08."""
    d = 2 if planar else 3
    x = np.full((2, d), 0.5)
    x[1, -1] += sum(radius) + gap
    columns = grains(x, v=v, omega=omega, radius=np.array(radius))
    walls = ()
    if to_wall:
        columns = {name: values[1:] for name, values in columns.items()}
        walls = (PlaneWall([0.0] * (d - 1) + [x[1, -1] - radius[1] - gap], np.eye(d)[-1]),)
    film = Film(0.7, 0.08, d)
    return Dem(
        world, pool, box(world, (1.0,) * d), columns, ContactLaw(STIFFNESS, 0.2, 0.3, 1.0), walls, film=film
    ), film


@pytest.mark.parametrize("gap", [1e-4, 5e-3, 0.03, 0.067, 0.069, 0.09])
def test_a_sheared_film_drags_along_and_turns(world, pool, gap):
    """Forces and torques of surfaces that slide past each other with s and of fluid that both carry along with p, from
    any directions, at a plane too; equal and opposite forces, and nothing beyond the cut-off."""
    (low, r), v, omega = (0.11, 0.07), [[0.0] * 3, [0.3, -0.2, 0.0]], [[0.1, 0.5, 0.9], [0.4, -0.3, -0.8]]
    along, turning = np.array(v[1]), np.cross(omega[1], [0, 0, -r])
    for to_wall in (False, True):
        scene, film = sliding(world, pool, (low, r), gap, v, omega, to_wall=to_wall)
        upper = scene.grains.columns["force"][list(scene.grains.ids).index(len(scene.grains.ids) - 1)]
        below = np.zeros(3) if to_wall else np.cross(omega[0], [0, 0, low])
        d, reduced = (-1.0, r) if to_wall else ((r - low) / (r + low), r * low / (r + low))
        resistance, s, p = film.shear_resistance(gap, reduced), along + turning - below, turning + below + d * along
        force, lever = -resistance * (s + 0.6 * d * p), -resistance * (s + 0.6 * p)
        np.testing.assert_allclose(upper[:3], force, rtol=1e-7, atol=1e-15)
        np.testing.assert_allclose(upper[4:7], np.cross([0, 0, -r], lever), rtol=1e-7, atol=1e-15)
        assert np.any(upper) == (gap < 0.068)
        if not to_wall:
            np.testing.assert_array_equal(scene.grains.columns["force"][:, :3].sum(axis=0), 0.0)


@pytest.mark.parametrize("planar", [False, True])
def test_a_film_takes_energy_only(world, pool, planar):
    """What grains lose becomes heat."""
    if planar:
        v, omega = [[0.0, 0.02], [0.3, -0.02]], [[0.5], [-0.7]]
    else:
        v, omega = [[0.0, 0.1, 0.02], [0.3, -0.2, -0.02]], [[0.1, 0.5, 0.9], [0.4, -0.3, -0.8]]
    scene, _ = sliding(world, pool, (0.11, 0.07), 0.01, v, omega, planar=planar)
    start = energies(scene)
    before = start["kinetic"]
    for _ in range(40):
        scene.advance(1e-5, 10)
        after = energies(scene)
        assert after["kinetic"] < before
        before = after["kinetic"]
    lost = start["kinetic"] - after["kinetic"]
    assert after["heat"] == pytest.approx(lost, rel=1e-3)
