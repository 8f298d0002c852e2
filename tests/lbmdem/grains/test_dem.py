"""Motion of grains: friction and rolling, conservation, order, bits."""

import cmath
import csv
import functools
import math
from pathlib import Path

import numpy as np
import pytest
from dem_scenes import DENSITY, FLOOR, HISTORY, LAW, RADIUS, STIFFNESS, Saved, by_id, cloud, dem, grains

from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError, Diverged
from hpcpic.core.physics.contact_law import ContactLaw
from lbmdem.grains.contact_network import (
    contact_count,
    contacts,
    energies,
    greatest_overlap,
    momentum,
    stress,
    wall_force,
)
from lbmdem.physics.plane_walls import PlaneWall

DATA = Path(__file__).parents[2] / "data"
G = 9.81


def table(name, shape):
    with (DATA / name).open() as file:
        return next([float(v) for v in row[1:]] for row in csv.reader(file) if row and row[0] == shape)


def on_slope(world, pool, d, law, slope=0.0, speed=0.0, overlap=0.0):
    """A grain that touches the floor with its weight's overlap, gravity turned by the slope."""
    columns = grains([[0.5] * d])
    columns["v"][0, 0] = speed
    weight = columns["mass"][0] * G * math.cos(slope)
    columns["x"][0, -1] = RADIUS - weight / law.stiffness
    gravity = np.zeros(d)
    gravity[0], gravity[-1] = G * math.sin(slope), -G * math.cos(slope)
    wall = PlaneWall((0.0,) * d, (0.0,) * (d - 1) + (1.0,))
    ends = {"periodic": (True,) * (d - 1) + (False,), "walls": (wall,)}
    return dem(world, columns, law, (1.0,) * d, **ends, gravity=gravity, pool=pool)


def spin_of(scene):
    """Angular velocity that rolls along x: about y in 3D, about -z in 2D."""
    return scene.grains.omega[0, 1] if scene.grains.dimensions == 3 else -scene.grains.omega[0, 0]


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("shear", [0.0, 1e7])
def test_sliding_becomes_rolling(world, pool, d, shear):
    """Final velocity, time and distance of data/dem_slide_roll.csv, to the relative size of the overlap."""
    final, time, distance, decay = table("dem_slide_roll.csv", "sphere" if d == 3 else "disc")
    law, speed = ContactLaw(1e7, 0.2, 0.3, 5e3, shear), 0.5
    scene = on_slope(world, pool, d, law, speed=speed)
    stop, dt = time * speed / (law.friction * G), 2e-5
    scene.advance(dt, int(0.8 * stop / dt))
    assert scene.grains.v[0, 0] == pytest.approx(speed - law.friction * G * scene.time, rel=1e-3)  # still slides
    assert spin_of(scene) * RADIUS < 0.8 * scene.grains.v[0, 0]
    scene.advance(dt, int(1.0 * stop / dt))
    assert scene.grains.v[0, 0] == pytest.approx(final * speed, rel=1e-3)
    assert spin_of(scene) * RADIUS == pytest.approx(final * speed, rel=1e-3)
    travelled = 0.5 + distance * speed**2 / (law.friction * G) + final * speed * (scene.time - stop)
    assert scene.grains.x[0, 0] == pytest.approx(travelled % 1.0, abs=1e-3)
    assert decay == pytest.approx(1 + 2.5 * (d == 3) + 2 * (d == 2))


@pytest.mark.parametrize("d", [2, 3])
def test_a_grain_on_a_slope_rolls_or_slides(world, pool, d):
    """data/dem_incline.csv: rolls, with its part of g sin(slope), where friction is above the critical one."""
    critical, rolling = table("dem_incline.csv", "sphere" if d == 3 else "disc")
    slope = 0.5
    for part in (1.3, 0.6):
        law = ContactLaw(1e7, 0.2, part * critical * math.tan(slope), 5e3, 1e7)
        scene = on_slope(world, pool, d, law, slope=slope)
        scene.advance(2e-5, 5000)
        slides = G * (math.sin(slope) - law.friction * math.cos(slope))
        expected = rolling * G * math.sin(slope) if part > 1 else slides
        assert scene.grains.v[0, 0] / scene.time == pytest.approx(expected, rel=3e-3)
        slips = (2.5 if d == 3 else 2.0) * law.friction * G * math.cos(slope)
        turns = (slips if part < 1 else expected) / RADIUS
        assert spin_of(scene) / scene.time == pytest.approx(turns, rel=5e-3)


def test_history_holds_a_block_where_the_regularised_law_creeps(world, pool):
    """A grain that cannot turn, on a slope below the angle of friction: at rest with springs, else m g sin / beta."""
    for shear, beta in ((STIFFNESS, 20.0), (0.0, 20.0)):
        law = ContactLaw(STIFFNESS, 0.3, 0.5, beta, shear)
        scene = on_slope(world, pool, 3, law, slope=0.3)
        scene.grains.columns["row"][:, 11] = 0.0
        scene.advance(2e-4, 5000)
        creep = scene.grains.mass[0] * G * math.sin(0.3) / beta
        assert scene.grains.v[0, 0] == pytest.approx(0.0 if shear else creep, rel=1e-3, abs=1e-5 * creep)


def test_a_grain_that_stays_slides_under_what_lies_on_it(world, pool):
    """Its velocity is that of its surface, as in a fluid, which sees it where it is at the start: it does not go."""
    weight = DENSITY * 4 / 3 * math.pi * RADIUS**3 * G
    x = [[0.5, 0.5, 0.5], [0.5, 0.5, 0.5 + 2 * RADIUS - weight / STIFFNESS]]
    columns = grains(x, v=[[3.0, 0.0, 0.0], [0.0] * 3], fixed=[True, False])
    scene = dem(world, columns, LAW, (1.0,) * 3, gravity=(0.0, 0.0, -G), pool=pool)
    scene.advance(1e-4, 50)
    assert by_id(scene, scene.grains.x)[0].tolist() == x[0]
    assert by_id(scene, scene.grains.v)[1, 0] == pytest.approx(LAW.friction * G * scene.time, rel=0.01)


@pytest.mark.parametrize("law", [LAW, HISTORY])
@pytest.mark.parametrize("d", [2, 3])
def test_free_grains_keep_momentum(world, pool, d, law):
    """Linear and angular, to the rounding of forces; nobody crosses a side of the box here."""
    columns = cloud(27, d, (0.27,) * d, spread=0.1, speed=0.1)
    columns["x"] += 1.0
    columns["v"] -= 3.0 * (columns["x"] - 1.135)  # towards the middle
    scene = dem(world, columns, law, (3.0,) * d, pool=pool)
    before = momentum(scene)
    scene.advance(2e-4, 100)
    assert contact_count(scene) > 5
    scene.advance(2e-4, 300)
    after = momentum(scene)
    scale = np.abs(columns["mass"][:, None] * columns["v"]).sum()
    for a, b in zip(before, after):
        assert np.abs(a - b).max() < 1e-13 * scale


def budget(world, pool, law, dt, time=0.2, d=3):
    columns = cloud(64, d, (0.5,) * d, speed=0.3)
    wall = PlaneWall((0.0,) * d, (0.0,) * (d - 1) + (1.0,), amplitude=(0.0,) * (d - 1) + (0.02,), frequency=5.0)
    scene = dem(world, columns, law, (0.5,) * d, periodic=(True,) * (d - 1) + (False,), walls=(wall,),
                gravity=(0.0,) * (d - 1) + (-3.0,), pool=pool)  # fmt: skip
    history = [energies(scene)]
    for _ in range(10):
        scene.advance(dt, round(time / dt / 10))
        history.append(energies(scene))
    return history


@pytest.mark.parametrize("law", [ContactLaw(STIFFNESS), LAW, HISTORY])
def test_the_energy_budget_closes(world, pool, law):
    """Of a shaken, falling, rubbing cloud: below 0.5 % of what was turned over is missing."""
    gaps = []
    for dt in (4e-4, 1e-4):
        history = budget(world, pool, law, dt)
        total = [e["kinetic"] + e["elastic"] + e["potential"] + e["heat"] - e["work"] for e in history]
        turnover = (
            history[0]["kinetic"] + abs(history[-1]["work"]) + abs(history[-1]["potential"] - history[0]["potential"])
        )
        gaps.append(np.abs(np.array(total) - total[0]).max() / turnover)
        assert np.all(np.diff([e["heat"] for e in history]) >= 0.0)
    assert gaps[0] < 2e-2
    assert gaps[1] < 5e-3


@pytest.mark.parametrize("law", [LAW, HISTORY])
def test_energy_never_grows(world, pool, law):
    """Kinetic and elastic energy of free grains, sampled often; without damping it is bounded."""
    for chosen, bound in ((law, 1e-4), (ContactLaw(STIFFNESS), 2e-3)):
        columns = cloud(64, 3, (0.5,) * 3, speed=0.5)
        scene = dem(world, columns, chosen, (0.5,) * 3, pool=pool)
        sums = []
        for _ in range(60):
            scene.advance(1e-4, 20)
            found = energies(scene)
            sums.append(found["kinetic"] + found["elastic"])
        assert np.max(np.diff(sums)) < bound * sums[0]
        assert abs(sums[-1] / sums[0] - 1) < 5e-3 if chosen.damping == 0.0 else sums[-1] < 0.85 * sums[0]


def test_verlet_is_second_order(world, pool):
    """Two grains in lasting contact, damped, with history friction, spinning: error of positions and orientation."""

    def final(dt):
        columns = grains([[0.5, 0.5, 0.5], [0.5 + 1.98 * RADIUS, 0.5, 0.5]], v=[[0, 0.01, 0], [0, -0.01, 0.002]])
        columns["omega"][:] = [[0.3, 0.0, 0.5], [0.1, -0.2, 0.4]]
        law = ContactLaw(STIFFNESS, 0.1, 1e6, 0.5, 0.3 * STIFFNESS)
        scene = dem(world, columns, law, (1.0,) * 3, pool=pool)
        scene.advance(dt, round(4e-3 / dt))
        return np.concatenate([by_id(scene, scene.grains.x), by_id(scene, scene.grains.orientation)], axis=1)

    coarse, middle, fine, exact = (final(4e-4 / n) for n in (1, 2, 4, 32))
    errors = [np.abs(value - exact).max() for value in (coarse, middle, fine)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 1.8), (errors, orders)


W, DRAG, BEAT, PUSH = 30.0, 2.0, 70.0, 25.0  # 1/s, 1/s, 1/s, m/s2


def driven_spring(x, v, t):
    """A damped spring to a place, pushed by a force that swings."""
    return -W * W * (x[0] - 0.5) - 2.0 * DRAG * v[0] + PUSH * math.cos(BEAT * t), 0.0, 0.0


def sun(x, v, t):
    a, b = x[0] - 0.5, x[1] - 0.5
    r = math.sqrt(a * a + b * b)
    return -a / r**3, -b / r**3, 0.0


def test_an_acceleration_of_ones_own_is_of_second_order(world, pool):
    """In place, velocity and time, against the exact motion; the same however many substeps there are to a call."""
    time = 0.2
    steady = PUSH / complex(W * W - BEAT * BEAT, 2.0 * DRAG * BEAT)  # of exp(i BEAT t)
    root = complex(-DRAG, math.sqrt(W * W - DRAG * DRAG))
    start = 0.01 - steady.real, 0.2 - (1j * BEAT * steady).real
    free = complex(start[0], (start[0] * root.real - start[1]) / root.imag)  # of exp(root t)
    exact = 0.5 + (free * cmath.exp(root * time) + steady * cmath.exp(1j * BEAT * time)).real

    columns = grains([[0.51, 0.5], [0.2, 0.2]], v=[[0.2, 0.0], [0.0, 0.0]])
    scene = dem(world, columns, LAW, (1.0, 1.0), pool=pool, own=[(driven_spring, np.array([True, False]))])
    beginning = Saved(scene)  # a scene compiles what it is given

    def error(steps, calls):
        scene.restore(beginning)
        for _ in range(steps // calls):
            scene.advance(time / steps, calls)
        assert np.array_equal(by_id(scene, scene.grains.x)[1], [0.2, 0.2])  # the other one is left alone
        return abs(by_id(scene, scene.grains.x)[0, 0] - exact)

    for calls in (1, 10):
        errors = np.array([error(steps, calls) for steps in (100, 200, 400)])
        orders = np.log2(errors[:-1] / errors[1:])
        assert np.all(orders > 1.9) and errors[0] < 1e-4, (errors, orders)


def test_a_central_acceleration_keeps_angular_momentum_and_energy(world, pool):
    """A planet, which comes as near to the sun as a third of its greatest distance."""
    columns = grains([[0.9, 0.5]], v=[[0.0, 1.2]], radius=0.005)
    scene = dem(world, columns, LAW, (1.0, 1.0), pool=pool, own=[(sun, np.array([True]))])

    def kept():
        x, v = scene.grains.x[0] - 0.5, scene.grains.v[0]
        return np.array([0.5 * v @ v - 1.0 / math.hypot(*x), x[0] * v[1] - x[1] * v[0]])

    before = kept()
    for _ in range(20):
        scene.advance(1e-4, 500)
        off = np.abs(kept() / before - 1.0)
        assert off[0] < 1e-6 and off[1] < 1e-12


def test_overlap_stays_below_one_per_cent(world, pool):
    """The stiffness for v = 0.3 m/s: sqrt(m / 2 k) v < 1 % of a diameter."""
    columns = cloud(64, 3, (0.5,) * 3, speed=0.15)
    scene = dem(world, columns, ContactLaw(1e5, 0.2, 0.4, 5.0), (0.5,) * 3, pool=pool)
    most = 0.0
    for _ in range(100):
        scene.advance(5e-5, 20)
        most = max(most, greatest_overlap(scene))
    assert 1e-4 < most < 0.01


def busy_scene(world, law=HISTORY, threads=1, d=3, scale=(1.0, 1.0, 1.0), driven=False):
    """Grains that collide, cross all sides and the floor, one faster than a slab per step; units of 1/scale."""
    length, time, mass = scale
    columns = cloud(100, d, (0.7,) * d, speed=1.0)
    columns["v"][5, -1] = 1.5e3 if d == 2 else 0.0
    columns["fixed"][7] = True
    columns["v"][7] = 0.0
    columns["x"] *= length
    columns["v"] *= length / time
    columns["omega"] /= time
    columns["radius"] *= length
    columns["mass"] *= mass
    columns["inertia"] *= mass * length**2
    force = mass * length / time**2
    law = ContactLaw(law.stiffness * force / length, law.damping, law.friction, law.viscosity * force * time / length,
              law.shear * force / length)  # fmt: skip
    along = np.eye(d)[0]
    wall = PlaneWall(0.1 * length * along, along, amplitude=tuple(0.02 * length * along), frequency=8.0 / time)
    own = [(own_of_some, np.arange(100) % 3 == 0), (own_of_others, np.arange(100) % 3 == 1)] if driven else []
    return dem(world, columns, law, (0.7 * length,) * d, periodic=(False,) + (True,) * (d - 1), walls=(wall,),
               gravity=(-5.0 * length / time**2,) + (0.0,) * (d - 1), threads=threads, own=own)  # fmt: skip


def own_of_some(x, v, t):
    return 30.0 * x[1] - v[0], -30.0 * x[0], 5.0 * t


def own_of_others(x, v, t):
    return 0.0, 9.0 * math.sin(40.0 * t), -20.0 * x[2]


def test_places_of_a_wall_are_found_at_once_for_many_substeps(monkeypatch):
    """One after the other they took more than the grains, by a hundred times where these are few."""
    scene, asked, rows = busy_scene(World.alone(), HISTORY, d=2), [], PlaneWall.rows
    monkeypatch.setattr(PlaneWall, "rows", lambda wall, times: asked.append(len(times)) or rows(wall, times))
    scene.advance(2e-4, 90)
    assert sum(asked) == 90 and len(asked) < 9
    times = np.array([0.1, 0.2, 0.3])
    for wall in scene.walls:
        assert np.array_equal(rows(wall, times), np.vstack([rows(wall, times[k : k + 1]) for k in range(3)]))


def digest_after(scene, between=lambda: None):
    """Of steps without and with given forces."""
    scene.advance(2e-4, 90)
    between()
    push = np.sin(scene.grains.ids[: scene.grains.n, None] + np.arange(scene.grains.dimensions))
    scene.advance(2e-4, 60, 0.5 * push, 0.01 * push[:, : scene.grains.omega.shape[1]])
    scene.advance(2e-4, 100)
    return Saved(scene).digest


@functools.cache
def serial_digest(law, d, driven=False):
    """Of one rank and one thread, in this process."""
    return digest_after(busy_scene(World.alone(), law, d=d, driven=driven))


@pytest.mark.parametrize("driven", [False, True])
@pytest.mark.parametrize("d", [2, 3])
def test_bits_do_not_depend_on_threads_or_lists(world, d, driven, monkeypatch):
    monkeypatch.setattr("lbmdem.grains.dem.GRAINS_OF_ONE_THREAD", 0)
    scene = busy_scene(world, threads=2, d=d, driven=driven)
    scene.skin *= 2.5
    assert digest_after(scene, scene.rebuild) == serial_digest(HISTORY, d, driven)
    assert not driven or serial_digest(HISTORY, d, True) != serial_digest(HISTORY, d)


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("driven", [False, True])
@pytest.mark.parametrize(("law", "d", "together"), [(LAW, 2, 0), (HISTORY, 3, 0), (HISTORY, 2, 512), (LAW, 3, 512)])
def test_bits_do_not_depend_on_ranks(world, law, d, together, driven, monkeypatch):
    """Whether each rank moves its own grains and knows copies of others, or all ranks move all of them."""
    monkeypatch.setattr("lbmdem.grains.grains.MAX_REPLICATED", together)
    scene = busy_scene(world, law, d=d, driven=driven)
    assert digest_after(scene) == serial_digest(law, d, driven)
    assert scene.version > 3 and 0 < scene.grains.n < 100


@pytest.mark.parametrize(("law", "driven"), [(LAW, False), (HISTORY, False), (HISTORY, True)])
def test_a_restart_continues_with_the_same_bits(world, law, driven):
    scene = busy_scene(world, law, driven=driven)
    scene.advance(2e-4, 100)
    saved = Saved(scene)
    found = contacts(scene)
    again = busy_scene(world, law, driven=driven)
    again.restore(saved)
    np.testing.assert_array_equal(np.sort(contacts(again).first), np.sort(found.first))
    assert Saved(again).digest == Saved(scene).digest
    scene.advance(2e-4, 100)
    again.advance(2e-4, 100)
    assert Saved(again).digest == Saved(scene).digest


@pytest.mark.parametrize("scale", [(2.0**10, 1.0, 1.0), (1.0, 2.0**-7, 1.0), (2.0**-20, 2.0**9, 2.0**13)])
def test_units_of_powers_of_two_give_the_same_bits(world, scale):
    length, time, _ = scale
    plain, scaled = busy_scene(world), busy_scene(world, scale=scale)
    plain.advance(2e-4, 150)
    scaled.advance(2e-4 * time, 150)
    np.testing.assert_array_equal(by_id(plain, plain.grains.x) * length, by_id(scaled, scaled.grains.x))
    np.testing.assert_array_equal(by_id(plain, plain.grains.omega) / time, by_id(scaled, scaled.grains.omega))


def test_a_place_on_the_seam_is_like_any_other(world, pool):
    """Moved by half a box, a power of two, a cloud does the same, to rounding."""
    results = []
    for shift in (0.0, 0.5):
        columns = cloud(64, 3, (0.5,) * 3)
        columns["x"] = (columns["x"] + 0.25 + shift) % 1.0
        scene = dem(world, columns, LAW, (1.0,) * 3, pool=pool)
        scene.advance(2e-4, 200)
        results.append((by_id(scene, scene.grains.x) + 1.0 - shift) % 1.0)
    apart = np.abs(results[0] - results[1])
    assert np.minimum(apart, 1.0 - apart).max() < 1e-9


def test_stress_of_a_column_is_its_weight(world, pool):
    """Settled grains above a floor: the mean vertical stress in a slice is the weight above it per area."""
    n, side = 6, 4 * RADIUS
    columns = grains(np.stack([np.full(n, 0.1), np.full(n, 0.1), RADIUS * (2 * np.arange(n) + 1)], 1))
    law = ContactLaw(1e5, 0.8)
    scene = dem(world, columns, law, (side, side, 1.5), periodic=(True, True, False), walls=(FLOOR,),
                gravity=(0, 0, -G), pool=pool)  # fmt: skip
    scene.advance(1e-4, 20000)
    weight = columns["mass"][0] * G / side**2
    cut = 2 * RADIUS * np.arange(n + 1)
    found = stress(scene, cut * scene.grains.x[:, 2].max() / (cut[-1] - RADIUS))
    np.testing.assert_allclose(found[:-1, 2, 2], weight * (n - 0.5 - np.arange(n - 1)), rtol=2e-2)
    assert np.abs(found[:, 0, 0]).max() < 1e-9 * weight
    assert wall_force(scene, 0)[2] == pytest.approx(-n * columns["mass"][0] * G, rel=1e-6)
    inside = contacts(scene)
    pairs = set(zip(inside.first.tolist(), inside.second.tolist()))
    assert pairs == {(0, -1)} | {(k, k + 1) for k in range(n - 1)}
    assert len(inside.first) == contact_count(scene) == n


def test_added_mass_divides_forces_and_makes_no_weight(world, pool):
    columns = grains([[0.5] * 3])
    scene = dem(world, columns, LAW, (1.0,) * 3, gravity=(0, 0, -G), pool=pool)
    m, inertia = columns["mass"], columns["inertia"]
    scene.grains.set_added(3 * m, inertia)
    scene.advance(1e-3, 1, np.array([[8.0, 0, 0]]), np.array([[0, 2.0, 0]]))
    np.testing.assert_allclose(scene.grains.v[0], [8e-3 / (4 * m[0]), 0, -G * 1e-3 / 4], rtol=1e-14)
    assert scene.grains.omega[0, 1] == pytest.approx(2e-3 / (2 * inertia[0]), rel=1e-14)


def test_a_turning_grain_keeps_its_axis(world, pool):
    """One revolution about a skew axis comes back to the start, to the second order of the step."""
    axis = np.array([2.0, -1.0, 2.0]) / 3
    columns = grains([[0.5] * 3], omega=[axis * 2 * np.pi])
    scene = dem(world, columns, LAW, (1.0,) * 3, pool=pool)
    scene.advance(1.0 / 400, 100)
    np.testing.assert_allclose(scene.grains.orientation[0], [np.sqrt(0.5), *(np.sqrt(0.5) * axis)], atol=2e-5)
    scene.advance(1.0 / 400, 300)
    np.testing.assert_allclose(np.abs(scene.grains.orientation[0]), [1, 0, 0, 0], atol=2e-4)


def test_what_cannot_be_is_refused(world, pool):
    columns = grains([[0.5] * 3, [0.7] * 3])
    with pytest.raises(ConfigError, match="two diameters"):
        dem(world, columns, LAW, (0.15, 1.0, 1.0), pool=pool)
    columns["x"][1] = columns["x"][0]
    with pytest.raises(ConfigError, match="same centre: 0 and 1"):
        dem(world, columns, LAW, (1.0,) * 3, pool=pool)
    columns["x"][1] += 0.2
    columns["v"][0, 0] = np.nan
    scene = dem(world, columns, LAW, (1.0,) * 3, pool=pool)
    with pytest.raises(Diverged, match="not a number"):
        scene.advance(1e-4, 2)
