"""Leaks: fluid behind walls of any shape is found wherever it is, though few particles are asked for their depth."""

import numpy as np
import pytest
from sph_scenes import config

from hpcpic.core.comm.world import World
from sph.diagnostics.leaks import MOST_CELLS, LeakFinder
from sph.kernels.marks import FLUID, OWN
from sph.particles.arrays import arrays_of
from sph.particles.storage import Storage
from sph.particles.tasks import arena_of
from sph.particles.walls import Walls
from sph.setup.pair_numbers import pair_spec_of
from sph.setup.rigid.mass import rotation
from sph.setup.scene import Scene
from sph.setup.tanks import depth_in_wall, lost_in

SWINGS = "motion = { amplitude = [0.1, 0.07, 0.0]; period = 1.0; };"
WALLS = {
    "bowl": "shape = { sphere = { centre = [0.5, 0.5, 0.5]; radius = 0.5; }; };",
    "ball": "solid = true; shape = { sphere = { centre = [0.4, 0.5, 0.6]; radius = 0.2; }; };",
    "pipe": "shape = { cylinder = { base = [0.2, 0.3, 0.2]; top = [0.9, 0.6, 0.8]; radius = 0.35; }; };",
    "slope": "shape = { plane = { point = [0.5, 0.5, 0.3]; normal = [-0.3, 0.2, 1.0]; }; };",
    "well": 'solid = true; shape = { box = { low = [0.3, 0.2, 0.1]; high = [0.8, 0.7, 1.0]; open = ["z-", "z+"]; }; };',
    "basin": 'shape = { box = { low = [0.1, 0.0, 0.2]; high = [0.9, 1.0, 0.8]; open = ["z+"]; }; };',
}


def finder(wall, d=3):
    """Of leaks through one wall, with fluid nowhere yet."""
    scene = Scene(config(d=d, spacing=0.05, size=1.0, fill=0.6, more=f"wall = ( {{ {wall} }} );"))
    arena = arena_of(scene, arrays_of(pair_spec_of(scene.config, True), False), 1, mirrors=np.zeros((1, 1)))
    storage = Storage(scene, World.alone(), arena)
    n = 20000
    zeros = np.zeros((d, n))
    storage.append(zeros, zeros, zeros[0], zeros[0], np.arange(n), FLUID | OWN)
    return LeakFinder(storage, Walls(scene))


def thrown(leaks, seed, reach=0.4):
    """Put the fluid anywhere in the domain and beside it. Returns who is lost by the exact distances of all, [n]."""
    scene, storage, walls = leaks.scene, leaks.storage, leaks.walls
    x = np.random.default_rng(seed).uniform(-reach, 1.0 + reach, (storage.n, scene.dimensions))
    storage.x[:, storage.own_slots] = (x - scene.low)[:, list(scene.axes)].T
    return [storage.own_slots[lost_in(wall, walls.at_rest(wall, storage.physical("x")))] for wall in scene.walls]


def held(leaks, lost):
    """Whether what is told is who is lost, by number, place and wall."""
    told = leaks.through_wall()
    if not len(lost):
        return told is None
    place = ", ".join(f"{value:.4g}" for value in leaks.storage.physical("x", lost[:1])[0])
    one = f"particle {leaks.storage.number(lost[0])} at ({place}) m"
    return told == f"{len(lost)} particles went through wall_1, as {one}"


@pytest.mark.parametrize("motion", ["", SWINGS])
@pytest.mark.parametrize("most", [MOST_CELLS, 200])
@pytest.mark.parametrize("name", WALLS)
def test_who_is_behind_a_wall_is_told_wherever_and_whenever(monkeypatch, name, motion, most):
    monkeypatch.setattr("sph.diagnostics.leaks.MOST_CELLS", most)
    leaks = finder(WALLS[name] + motion)
    for k in range(5):  # what was found out about places before holds wherever the wall has gone
        leaks.walls.move(0.23 * k)
        lost = thrown(leaks, k)[0]
        assert len(lost) > 20 and held(leaks, lost)


def test_behind_triangles_too(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    bowl = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    bowl.apply_translation([0.5, 0.5, 0.5])
    bowl.export(tmp_path / "bowl.stl")
    leaks = finder(f'shape = {{ stl = {{ file = "{tmp_path / "bowl.stl"}"; }}; }}; {SWINGS}')
    for k in range(4):
        leaks.walls.move(0.23 * k)
        lost = thrown(leaks, k)[0]
        assert len(lost) > 1000 and held(leaks, lost)


@pytest.mark.parametrize("d", [2, 3])
def test_behind_a_body_that_has_moved_and_turned(d):
    body = f"solid = true; shape = {{ cylinder = {{ base = {[0.3] * d}; top = {[0.7] * d}; radius = 0.25; }}; }};"
    leaks = finder(f"{body} body = {{ density = 500.0; }};", d)
    for k in range(4):
        about = np.array([0.0, 0.0, np.sin(0.7 * k)] if d == 2 else [0.2 * k, -0.1, 0.2 * k])
        turn = rotation(np.array([np.sqrt(1.0 - about @ about), *about]))[:d, :d]
        leaks.walls.displacement[0], leaks.walls.turns[0] = 0.05 * k, (np.full(d, 0.5), turn)
        lost = thrown(leaks, k)[0]
        assert len(lost) > 100 and held(leaks, lost)


@pytest.mark.parametrize("name", ["bowl", "ball", "pipe"])
def test_few_are_asked_of_what_fills_a_tank_or_surrounds_a_solid(name):
    """Of a lattice up to half a spacing before the wall."""
    leaks = finder(WALLS[name])
    wall, dp, storage = leaks.scene.walls[0], leaks.scene.spacing, leaks.storage
    x = np.stack(np.meshgrid(*[np.arange(0.0, 1.0, dp)] * 3), axis=-1).reshape(-1, 3)
    x = x[depth_in_wall(wall, x) < -dp / 2]
    storage.x[:, storage.own_slots[: len(x)]] = (x - leaks.scene.low)[:, list(leaks.scene.axes)].T
    storage.remove(storage.own_slots[len(x) :])
    assert len(x) > 1000 and len(leaks.suspects(wall)) < 0.02 * len(x)
