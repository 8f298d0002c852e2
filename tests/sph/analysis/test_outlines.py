"""Lines of walls lie on their surfaces, where these are at that time."""

import numpy as np
import pytest

from hpcpic.core.case.config import loads
from sph.analysis import outlines
from sph.analysis.particle_plots import layout
from sph.configure import configure
from sph.setup import signed_distance
from sph.setup.scene import Scene

MOTION = "motion = { velocity = [VELOCITY]; };"
SHAPES = {
    "box": "box = { low = [0.1, 0.1]; high = [0.9, 0.8]; };",
    "sphere": "sphere = { centre = [0.5, 0.5]; radius = 0.4; };",
    "cylinder": "cylinder = { base = [0.2, 0.3]; top = [0.8, 0.6]; radius = 0.2; };",
    "polygon": "polygon = { corners = ([0.1, 0.1], [0.9, 0.2], [0.5, 0.4], [0.6, 0.9]); };",
    "plane": "plane = { point = [0.5, 0.2]; normal = [-0.6, 0.8]; };",
    "sphere in space": "sphere = { centre = [0.5, 0.5, 0.5]; radius = 0.4; };",
    "cylinder in space": "cylinder = { base = [0.5, 0.4, 0.1]; top = [0.5, 0.6, 0.8]; radius = 0.3; };",
    "box in space": "box = { low = [0.1, 0.1, 0.1]; high = [0.9, 0.8, 0.9]; };",
}


def walls_of(shape, d, motion=MOTION):
    low, high = [0.45] * d, [0.55] * d
    velocity = [0.0] * (d - 1) + [0.25]
    text = f"""
simulation = {{ dimensions = {d}; end_time = 1.0; }};
domain = {{ low = {[-1.0] * d}; high = {[2.0] * d}; }};
fluid = ( {{ shape = {{ box = {{ low = {low}; high = {high}; }}; }}; }} );
wall = ( {{ shape = {{ {shape} }}; {motion.replace("[VELOCITY]", str(velocity))} }} );
eos = {{ max_velocity = 1.0; }};
numerics = {{ spacing = 0.02; }};
"""
    return Scene(configure(loads(text))).walls


@pytest.mark.parametrize("name", SHAPES)
def test_lines_lie_on_the_surface_that_has_moved(name):
    d = 3 if "space" in name else 2
    walls, t = walls_of(SHAPES[name], d), 0.8
    low, high = np.full(d, -1.0), np.full(d, 2.0)
    draw = outlines.tank if d == 3 else outlines.in_plane
    lines = draw(walls, t, low, high)
    points = np.concatenate([line.reshape(-1, 3) if d == 3 else line.T for line in lines])
    here = points - [*[0.0] * (d - 1), 0.25 * t]
    distance = signed_distance.signed_distance(walls[0].section.shape, here)
    assert len(points) >= 2 and np.abs(distance).max() < 1e-9


def test_a_round_tank_is_drawn_within_what_is_shown_alone():
    walls = walls_of(SHAPES["cylinder in space"], 3, motion="")
    low, high = np.zeros(3), np.array([1.0, 1.0, 0.5])
    points = np.concatenate(outlines.tank(walls, 0.0, low, high))
    points = points[np.isfinite(points).all(axis=1)]
    assert len(points) > 20 and np.all((points >= low) & (points <= high))


def test_a_scene_without_a_tank_has_the_edges_of_what_is_shown():
    assert len(outlines.tank([], 0.0, np.zeros(3), np.ones(3))) == 12


@pytest.mark.parametrize("most", [2, 3])
def test_no_line_of_panels_could_be_spared(most):
    """A run that has stopped early has fewer pictures; four were laid out as three and one, seven as twice three and
    one."""
    for panels in range(1, 13):
        lines, columns = layout(panels, most)
        needed = -(-panels // most)
        wider = columns > most
        assert columns <= most + wider and lines <= needed and lines * columns - panels < lines
        assert not wider or (panels > 2 * most and lines * columns < needed * -(-panels // needed))
        assert wider or lines == needed
    assert layout(7, 3) == (2, 4)
