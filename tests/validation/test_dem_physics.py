"""Grains against theory, at length: collisions, budgets, jammed packings, a heap."""

import csv
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from hpcpic.core.physics.contact_law import ContactLaw, stable_step
from hpcpic.core.space.domain import Domain, even_cuts
from lbmdem.grains.contact_network import contacts, energies, momentum
from lbmdem.grains.dem import Dem
from lbmdem.grains.packing import Sample, beta_diameters, grow, solid_volume
from lbmdem.physics.plane_walls import PlaneWall

sys.path.insert(0, str(Path(__file__).parent.parent / "lbmdem"))
from dem_scenes import RADIUS, STIFFNESS, box, by_id, cloud, grains

pytestmark = pytest.mark.validation
TABLE = Path(__file__).parent.parent / "data" / "dem_restitution.csv"


def rebounds(world, pool, law, part):
    """Restitution of head-on collisions that begin at 20 places within a step of a part of an undamped contact."""
    speed, found = 0.01, []
    columns = grains([[0.5, 0.5], [0.6, 0.5]])
    duration = math.pi * math.sqrt(0.5 * columns["mass"][0] / STIFFNESS)
    dt = part * duration
    for phase in range(20):
        gap = 2.0 * speed * dt * (3 + phase / 20)
        columns["x"][:, 0] = 0.5, 0.5 + 2 * RADIUS + gap
        columns["v"][:, 0] = speed, -speed
        scene = Dem(world, pool, box(world, (1.0, 1.0)), columns, law)
        scene.advance(dt, int(4 + 2.5 / part))
        found.append(-by_id(scene, scene.grains.v)[0, 0] / speed)
    return np.array(found)


def test_restitution_wherever_in_a_step_the_contact_begins(world, pool):
    """All rows of data/dem_restitution.csv: within 0.003 at 2 % of a contact per step, far less at a quarter of it."""
    with TABLE.open() as file:
        rows = [list(map(float, row)) for row in csv.reader(file) if row[0][0].isdigit()]
    for alpha, full, _, clipped, _ in rows:
        for pulls, exact in ((True, full), (False, clipped)):
            coarse, fine = (
                np.abs(rebounds(world, pool, ContactLaw(STIFFNESS, alpha, pulls=pulls), part) - exact).max()
                for part in (0.02, 0.005)
            )
            assert coarse < 0.003, (alpha, pulls, coarse)
            assert fine < max(coarse / 8, 2e-5), (alpha, pulls, coarse, fine)


@pytest.mark.parametrize("shear", [0.0, 0.5 * STIFFNESS])
def test_the_energy_budget_of_a_shaken_bed_closes_with_the_step(world, pool, shear):
    """500 grains shaken for 0.5 s: what is missing, of the energy turned over, shrinks with the step."""
    gaps = []
    for part in (0.2, 0.1, 0.05):
        columns = cloud(500, 3, (0.8, 0.8, 0.8), speed=0.2)
        law = ContactLaw(STIFFNESS, 0.2, 0.4, 2.0, shear)
        floor = PlaneWall((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), amplitude=(0.0, 0.0, 0.01), frequency=10.0)
        scene = Dem(
            world, pool, box(world, (0.8, 0.8, 2.0), (True, True, False)), columns, law, (floor,), (0, 0, -9.81)
        )
        dt = part * stable_step(law, columns["radius"], columns["mass"], columns["inertia"])
        before = energies(scene)
        scene.advance(dt, round(0.5 / dt))
        after = energies(scene)
        change = {name: after[name] - before[name] for name in before}
        missing = change["kinetic"] + change["elastic"] + change["potential"] + change["heat"] - change["work"]
        gaps.append(abs(missing) / (change["heat"] + abs(change["work"])))
    assert gaps[0] < 0.02
    assert gaps[2] < 0.005


def test_momentum_of_many_collisions(world, pool):
    """Drift of the linear momentum of a periodic gas after 20 000 steps, to rounding."""
    columns = cloud(216, 3, (0.7, 0.7, 0.7), speed=1.0)
    scene = Dem(world, pool, box(world, (0.7, 0.7, 0.7)), columns, ContactLaw(1e5, 0.0, 0.3, 5.0))
    before, _ = momentum(scene)
    scene.advance(5e-5, 20000)
    after, _ = momentum(scene)
    assert np.abs(after - before).max() < 1e-12 * np.abs(columns["mass"][:, None] * columns["v"]).sum()


def test_a_jammed_packing_is_isostatic(world, pool):
    """Frictionless spheres where packing ends: six contacts each, without those that touch fewer than four."""
    radius = 0.5 * beta_diameters(500, 1e-3, 2e-3, 1.0, 1.0, 5)
    side = (solid_volume(radius, 3) / (1.0 - 0.35)) ** (1 / 3)
    domain = Domain((side,) * 3, (12,) * 3, (True,) * 3, even_cuts(12, world.size))
    x = grow(world, pool, domain, Sample(radius, 0.0, side, 5))
    delta = x[:, None] - x[None]
    delta -= side * np.rint(delta / side)
    touch = np.sqrt(np.square(delta).sum(-1)) < radius[:, None] + radius[None] - 1e-9
    np.fill_diagonal(touch, False)
    bearing = np.ones(len(x), bool)
    for _ in range(10):
        bearing &= touch[:, bearing].sum(axis=1) >= 4
    assert bearing.sum() > 0.9 * len(x)
    assert touch[bearing][:, bearing].sum(axis=1).mean() == pytest.approx(6.0, abs=0.5)


def test_a_heap_stands_on_a_rough_floor(world, pool):
    """Discs poured on fixed ones: at rest with springs, and steeper than without friction."""
    slopes = []
    for friction in (0.6, 0.0):
        floor = np.stack([np.arange(0.0, 8.0, 2 * RADIUS) + RADIUS, np.zeros(80)], 1)
        ids = np.arange(300)
        heap = np.stack([3.3 + 0.11 * (ids % 13) + 0.03 * (ids // 13 % 2), 0.11 * (1 + ids // 13)], 1)
        columns = grains(np.concatenate([floor, heap]), fixed=[True] * 80 + [False] * 300)
        law = ContactLaw(1e6, 0.4, friction, 100.0, 3e5 * (friction > 0))
        domain = box(world, (8.0, 4.0), (True, False))
        scene = Dem(world, pool, domain, columns, law, (PlaneWall((0.0, -RADIUS), (0.0, 1.0)),), (0.0, -9.81))
        dt = 0.4 * stable_step(law, columns["radius"], columns["mass"], columns["inertia"])
        scene.advance(dt, round(3.0 / dt))
        x = by_id(scene, scene.grains.x)[80:]
        slopes.append(x[:, 1].mean() / x[:, 0].std())
        assert len(contacts(scene).first) > 300
        if friction:
            speed = np.sqrt(np.square(by_id(scene, scene.grains.v)[80:]).sum(axis=1))
            assert np.quantile(speed, 0.9) < 1e-2 * math.sqrt(9.81 * RADIUS)  # a few roll on
    assert slopes[0] > 1.15 * slopes[1]
