"""Which particles of walls are near an edge."""

import numpy as np
import pytest
from sph_scenes import config, layers, text

from hpcpic.core.case.config import loads
from sph.configure import configure
from sph.setup.rigid.edges import at_edges, places
from sph.setup.scene import Scene


def edges(walls, d=2, **settings):
    """The scene, and of its last wall the particles x[n, d] and which are at edges."""
    whole = text(d=d, size=1.0, fill=0.2, spacing=0.02, smoothing=1.5, more=f"wall = ( {walls} );", **settings)
    scene = Scene(configure(loads(whole)))
    _, x, _ = scene.walls[-1].near(np.full(d, -2.0), np.full(d, 2.0))
    return scene, x, at_edges(scene, scene.walls[-1], x)


def box(low, high, more=""):
    return f"{{ shape = {{ box = {{ low = {low}; high = {high}; {more} }}; }};"


def test_places_lie_evenly():
    for d in (2, 3):
        around = places(d)
        assert np.abs(np.sum(around**2, axis=1) - 1).max() < 1e-12
        assert np.abs(around.mean(axis=0)).max() < 0.02
        assert np.abs(around.T @ around / len(around) - np.eye(d) / d).max() < 0.02


@pytest.mark.parametrize("d", [2, 3])
def test_a_block_has_edges_where_two_faces_meet(d):
    """As far as 0.6 supports from both; none a support from one. Where it stands on the floor it has none."""
    low, high = [0.3] * (d - 1) + [0.0], [0.7] * (d - 1) + [0.6]
    tank = box([0.0] * d, [1.0] * d, f'open = ["{"xyz"[d - 1]}+"];') + " }, "
    scene, x, found = edges(tank + box(low, high) + " solid = true; }", d=d)
    off = np.sort(np.minimum(x - low, np.array(high) - x), axis=1) / scene.support
    upper = x[:, -1] > scene.support  # the floor is far
    assert found[upper & (off[:, 1] < 0.6)].all() and not found[off[:, 1] > 1.0].any()
    up = (high[-1] - x[:, -1]) / scene.support
    sides = np.sort(np.minimum(x - low, np.array(high) - x)[:, :-1], axis=1) / scene.support
    lower = (x[:, -1] < 0.2 * scene.support) & (sides[:, 1:] > 1.0).all(axis=1) & (up > 1.0)
    assert lower.any() and not found[lower].any()


def test_a_tank_has_edges_at_its_rim_alone():
    scene, x, found = edges(box([0.0, 0.0], [1.0, 0.6], 'open = ["y+"];') + " }")
    from_rim = (0.6 - x[:, 1]) / scene.support
    assert found[from_rim < 0.6].all() and not found[from_rim > 1.0].any()
    _, _, found = edges(box([0.0, 0.0], [1.0, 0.6]) + " }")
    assert not found.any()


def test_a_ball_that_is_large_has_none():
    """Its radius is seven times the support."""
    _, _, found = edges("{ shape = { sphere = { centre = [0.5, 0.5]; radius = 0.45; }; }; solid = true; }")
    assert found.mean() < 0.03


def test_rigid_bodies_and_several_fluids_are_without():
    tank = 'wall = ( { shape = { box = { low = [0.0, 0.0]; high = [1.0, 1.0]; open = ["y+"]; }; }; } );'
    one = Scene(config(more=tank)).walls[0]
    two = Scene(configure(loads(layers(more=tank))))
    assert one.rule.has_edges(False, one.scene.liquids) and not one.rule.has_edges(True, one.scene.liquids)
    assert not one.rule.has_edges(False, two.liquids)
