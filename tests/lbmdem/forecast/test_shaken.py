"""What `check` says of a frame that is shaken along an axis without walls is what a run does."""

import math

import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived

SHAKEN = """
simulation = { end_time = 0.2; };
domain = { size = [1.0e-3, 1.0e-3]; spacing = 5.0e-5; periodic = ["x"]; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-6; relaxation_time = 0.8; };
shaking = { acceleration = [60.0, 0.0]; frequency = 10.0; };
"""
MACH, SPEED = "Mach number of the driven fluid", "speed that the shaking makes"


def told(name, *sets):
    return next((one for one in derived(configure(loads(SHAKEN, sets=sets))) if one.name == name), None)


@pytest.mark.parametrize(
    ("sets", "speed"),
    [
        ((), 2.0 * 60.0 / (20.0 * math.pi)),  # a sine from rest drifts up to twice a/omega
        (("simulation.end_time=0.025",), 60.0 / (20.0 * math.pi)),  # a quarter of a period
        (("shaking.frequency=1.0", "fluid.kinematic_viscosity=1.0e-5"), 60.0 * 1.0e-6 / 8.0e-5),  # the parabola
        (('domain.periodic=["x", "y"]',), 2.0 * 60.0 / (20.0 * math.pi)),
        (('domain.periodic=["x", "y"]', "shaking.acceleration=[60.0, 80.0]"), 200.0 / (20.0 * math.pi)),
        (("fluid.body_force=[1.0e-3, 0.0]",), 120.0 / (20.0 * math.pi) + 1.25e-4),
        (("domain.periodic=[]",), None),  # walls push the fluid along
        (("shaking.acceleration=[0.0, 60.0]",), None),
    ],
)
def test_the_speed_that_shaking_makes_is_told(sets, speed):
    found = told(SPEED, *sets)
    assert (found and found.value) == (speed and pytest.approx(speed, rel=1e-12))


def test_shaking_that_makes_the_fluid_too_fast_is_refused():
    fast = told(MACH)
    assert (fast.verdict, fast.forceable, fast.key) == ("fail", True, ("shaking", "acceleration"))
    tau = fast.cure.split("relaxation_time = ")[1]
    assert told(MACH, f"fluid.relaxation_time={tau}").verdict == "ok"
    assert told(MACH, "shaking.acceleration=[0.5, 0.0]").verdict == "ok"
    assert told(MACH, "shaking.acceleration=[0.5, 0.0]", "fluid.body_force=[50.0, 0.0]").key == ("fluid", "body_force")
    grain = "grains=({diameter=4.0e-4; density=2000.0; position=[5.0e-4, 5.0e-4];})"
    assert told(MACH, grain).value == fast.value  # it is shaken too


def test_a_shaken_fluid_gets_as_fast_as_is_told(world):
    """Above the layer that the walls hold back, a node thick."""
    sets = ("shaking.acceleration=[0.5, 0.0]", "shaking.frequency=100.0", "simulation.end_time=0.006")
    fastest = 0.0
    with running(world, "lbmdem", SHAKEN, sets=sets) as app:
        while app.time < 0.006:
            app.step()
            fastest = max(fastest, app.scalars()["max_mach"])
        unit = app.scene.units.velocity / math.sqrt(3.0)
    speed = told(SPEED, *sets).value
    assert 0.9 * speed < fastest * unit < 1.02 * speed
