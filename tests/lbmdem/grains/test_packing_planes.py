"""Packings go before the planes among the obstacles."""

import math

import numpy as np
import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from hpcpic.core.errors import ConfigError
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived

BETWEEN = """
simulation = {{ end_time = 1.0; }};
domain = {{ size = [5.0e-3, 5.0e-3, 6.0e-3]; periodic = ["x"]; }};
obstacle = ({planes});
grains = ({{ name = "balls"; diameters = {{ min = 1.0e-3; max = 1.0e-3; count = 28; }}; packing = {{ {packing} }}; }});
contact = {{ normal_stiffness = 100.0; }};
gravity = [0.0, 0.0, -9.81];
"""
FLOOR, LID = ([0.0, 0.0, 3.0e-4], [0.0, 0.0, 1.0]), ([0.0, 0.0, 5.7e-3], [0.0, 0.0, -2.0])
HOPPER = tuple(([0.0, 2.5e-3, 0.0], [0.0, way, 1.0]) for way in (1.0, -1.0))
SIDE, SLOPE = ([0.0, 2.0e-3, 0.0], [0.0, 1.0, 0.0]), ([0.0, 0.0, 1.0e-3], [0.0, -0.3, 1.0])


def case(planes, packing):
    shapes = [f"{{ shape = {{ plane = {{ point = {point}; normal = {normal}; }}; }}; }}" for point, normal in planes]
    return BETWEEN.format(planes=", ".join(shapes), packing=packing)


@pytest.mark.parametrize(
    ("planes", "packing"),
    [
        ((FLOOR, LID), "porosity = 0.89;"),
        ((FLOOR, LID), ""),
        ((SIDE,), "porosity = 0.7;"),
        ((SLOPE, LID), ""),
        ((SLOPE,), "porosity = 0.86;"),
        (HOPPER, "porosity = 0.6;"),
    ],
)
def test_grains_are_packed_before_planes(world, monkeypatch, planes, packing):
    monkeypatch.setattr("lbmdem.grains.packing.cached", lambda world, facts, made, *rest: made())
    text = case(planes, packing)
    assert not [one.name for one in derived(configure(loads(text))) if one.verdict == "fail"]
    with running(world, "lbmdem", text) as app:
        x, radius = app.table.x, app.table.radius
    for point, normal in planes:
        gap = (x - point) @ normal / math.hypot(*normal) - radius
        assert gap.min() > -0.02 * 2.0 * radius.min()
    assert np.all(x[:, 2] - radius > -2.0e-5)


def test_the_height_of_a_packing_is_that_which_planes_leave_it():
    """Above the floor, in what a side leaves of the width; and no higher than the lid."""

    def told(name, *planes):
        numbers = derived(configure(loads(case(planes, "porosity = 0.85;"))))
        return next(one for one in numbers if one.name == name)

    height = 28 * math.pi / 6.0 * 1.0e-9 / 0.15 / 25.0e-6
    assert told("top of balls").value == pytest.approx(height, rel=1e-4)
    assert told("top of balls", FLOOR).value == pytest.approx(height + 3.0e-4, rel=1e-4)
    assert told("top of balls", SIDE).value == pytest.approx(height / 0.6, rel=1e-4)
    assert told("void fraction of balls", SIDE).value == pytest.approx(0.85, rel=1e-4)
    low = ([0.0, 0.0, 4.0e-3], [0.0, 0.0, -1.0])
    assert told("top of balls", FLOOR, LID).verdict == "ok"
    assert told("top of balls", FLOOR, low).verdict == "fail" and "plane" in told("top of balls", low, FLOOR).limit


def test_planes_that_leave_no_space_are_refused():
    with pytest.raises(ConfigError, match="no space between the planes"):
        configure(loads(case((FLOOR, ([0.0, 0.0, 2.0e-4], [0.0, 0.0, -1.0])), "")))


def test_a_hopper_is_filled_from_its_edge_on():
    """As high as the space between its planes says, here a wedge; so many layers weigh on its lowest grains."""

    def told(name, *planes):
        numbers = derived(configure(loads(case(planes, "porosity = 0.6;"))))
        return next(one.value for one in numbers if one.name == name)

    solid = 28 * math.pi / 6.0 * 1.0e-9
    height = math.sqrt(solid / 0.4 / 5.0e-3)
    assert told("top of balls", *HOPPER) == pytest.approx(height, rel=0.01)
    assert told("void fraction of balls", *HOPPER) == pytest.approx(0.6, abs=0.01)
    layers = 0.4 * height / 0.6 / 1.0e-3  # of balls that lie loosely; on the whole floor they are less than one
    assert told("overlap at rest", *HOPPER) == pytest.approx(layers * told("overlap at rest", FLOOR), rel=0.01)
