"""Scenes that are their own mirror image shed no wakes, of which check tells."""

import pytest

from hpcpic.core.case.config import loads
from lbmdem.configure import configure
from lbmdem.forecast.driven import wakes

STREAM = """
simulation = { end_time = 1.0; };
domain = { size = [0.2, 0.08]; spacing = 1.0e-3; };
fluid = { kinematic_viscosity = 1.0e-5; relaxation_time = 0.51; };
boundary = ({ face = "x-"; type = "velocity"; velocity = [0.06, 0.0]; }, { face = "y+"; type = "wall"; });
"""
BOX = "obstacle=({ shape = { box = { low = [0.08, 0.035]; high = [0.09, 0.045]; }; }; })"
OTHER = BOX.replace("0.035", "0.0355").replace("0.045", "0.0455")
PLANES = ", ".join(
    f"{{ shape = {{ plane = {{ point = [0.0, {at}]; normal = [0.0, {way}]; }}; }}; }}"
    for at, way in ((0.01, 2), (0.07, -3))
)
PAIR = "grains=({ diameter = 0.01; moving = false; position = ([0.08, 0.02], [0.08, 0.06]); })"


def told(*sets):
    return [(one.value, one.verdict) for one in wakes(configure(loads(STREAM, sets=sets)))]


@pytest.mark.parametrize("solids", [BOX, PAIR, PAIR.replace("([0.08, 0.02], [0.08, 0.06])", "[0.08, 0.04]")])
def test_solids_that_are_even_across_a_stream_are_told_their_reynolds_number(solids):
    """With the widest one; below the onset of wakes all is well."""
    assert told(solids) == [(pytest.approx(60.0), "warn")]
    assert told(solids, "fluid.kinematic_viscosity=2e-5") == [(pytest.approx(30.0), "ok")]


def test_in_three_dimensions_a_bar_sheds_as_in_two_and_a_sphere_later():
    """A cube, which sheds later, is not told."""
    text = (
        STREAM.replace("0.2, 0.08]", "0.2, 0.02, 0.08]").replace("[0.06, 0.0]", "[0.06, 0.0, 0.0]").replace("y+", "z+")
    )
    bar = BOX.replace("[0.08, ", "[0.08, 0.0, ").replace("[0.09, ", "[0.09, 0.02, ")
    ball = "grains=({ diameter = 0.01; moving = false; position = [0.08, 0.01, 0.04]; })"

    def found(*sets):
        return {one.name[-1]: (one.value, one.limit) for one in wakes(configure(loads(text, sets=sets)))}

    assert found(bar) == {"z": (pytest.approx(60.0), "<= 47")}
    assert found(ball) == dict.fromkeys("yz", (pytest.approx(60.0), "<= 210"))
    assert not found(bar.replace("0.02, 0.045", "0.01, 0.045"))


def test_planes_are_turned_and_grains_that_move_shed_a_wake():
    assert told(PAIR, f"obstacle=({PLANES})") == told(PAIR)
    assert not told(PAIR.replace("moving = false", "moving = true"))


@pytest.mark.parametrize(
    "uneven",
    [
        OTHER,
        "fluid.body_force=[0.0, 0.1]",
        "shaking={acceleration=[0.0, 1.0]; frequency=1.0;}",
        PAIR.replace("0.06]", "0.05]"),
        PAIR.replace("moving", "angular_velocity = [1.0]; moving"),
        f"obstacle=({PLANES.replace('0.07', '0.069')})",
        "boundary[1].velocity=[0.01, 0.0]",
    ],
)
def test_what_is_uneven_sheds_by_itself(uneven):
    """Nothing is told; nor without solids, of a step on each wall, or where no face lets fluid in."""
    assert told(BOX, PAIR) and not told(BOX, PAIR, uneven)
    assert not told() and not told(BOX, "boundary=()", 'domain.periodic=["x"]')
    steps = BOX.replace("0.035", "0.0").replace("0.045", "0.01")
    assert not told(steps[:-1] + ", " + steps[10:].replace("0.0]", "0.07]").replace("0.01]", "0.08]"))
