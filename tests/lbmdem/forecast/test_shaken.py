"""What `check` says of a frame that is shaken along an axis without walls is what a run does."""

import math

import numpy as np
import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from hpcpic.core.physics.contact_law import deepest_overlap
from lbmdem.case.config import contact_law
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived
from lbmdem.forecast.free_fall import impact_speed

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


LAYER, STEP = "layer of fluid that solids drag along", "shaking in a step"


@pytest.mark.parametrize(
    "name, value, sets",
    [
        (LAYER, 0.80, ("shaking.frequency=198.9", "shaking.acceleration=[60.0, 0.0]")),
        (LAYER, 0.50, ("shaking.frequency=509.3", "shaking.acceleration=[60.0, 0.0]")),
        (STEP, 0.141, ("fluid.relaxation_time=2.0", "shaking.frequency=12.0", "shaking.acceleration=[0.1, 0.0]")),
    ],
)
def test_a_layer_too_thin_and_a_step_too_long_are_told_and_cured(name, value, sets):
    found = told(name, *sets)
    assert found.value == pytest.approx(value, rel=5e-3)
    assert found.verdict == ("ok" if value == 0.80 else "warn")
    if found.verdict == "warn":
        setting, cured = (found.cure.split()[0], found.cure.split()[2])
        key = setting if setting.startswith("domain") else f"fluid.{setting}"
        assert told(name, *sets, f"{key}={cured}").verdict == "ok"


def test_a_fluid_that_nothing_drags_along_has_no_layer():
    assert told(LAYER, 'domain.periodic=["x", "y"]') is None
    assert told(LAYER, "shaking.acceleration=[0.0, 60.0]") is None  # its walls push it
    assert told(LAYER, "shaking.acceleration=[0.0, 60.0]", "grains=({diameter=4e-4; position=[5e-4, 5e-4];})")


@pytest.mark.parametrize(
    "tau, frequency, least, most",
    [(0.6, 50.0, 0.0, 0.01), (0.6, 580.0, 0.06, 0.2), (2.0, 30.0, 0.06, 0.2)],
)
def test_velocities_are_off_where_it_is_told(world, tau, frequency, least, most):
    """Between walls that shake, beside the exact flow, once the start has faded; of the largest velocity."""
    sets = (f"fluid.relaxation_time={tau}", f"shaking.frequency={frequency}", "shaking.acceleration=[0.1, 0.0]")
    fine = all(told(name, *sets).verdict == "ok" for name in (LAYER, STEP))
    omega, nu, h, off, largest = 2.0 * math.pi * frequency, 1.0e-6, 5.0e-4, 0.0, 0.0
    k = np.sqrt(1j * omega / nu)
    y = (np.arange(20) + 0.5) * 5.0e-5 - h
    shape = 0.1 / omega * (1.0 - np.cosh(k * y) / np.cosh(k * h))
    with running(world, "lbmdem", SHAKEN, sets=(*sets, "domain.size=[1.0e-4, 1.0e-3]")) as app:
        end = 4.0 * h * h / nu
        while app.time < end + 1.0 / frequency:
            app.step()
            if app.time > end:
                found = app.fields()["velocity"].values
                exact = np.real(shape * np.exp(1j * omega * app.time))
                off, largest = max(off, np.abs(found[:, 0, 0] - exact).max()), max(largest, np.abs(exact).max())
    assert least <= off / largest <= most
    assert fine == (most <= 0.05)


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


@pytest.mark.parametrize("height, amplitude, thrown", [(0.0, 9.0, 0.0), (0.0, 30.0, 2.0), (2e-3, 9.0, 2.0)])
def test_a_grain_meets_a_shaken_floor_with_what_the_frame_gives_it_at_most(world, height, amplitude, thrown):
    """Twice a/omega beside its fall, where it falls or is thrown; on a floor that its weight holds it to, nothing."""
    text = f"""
    simulation = {{ end_time = 0.04; }};
    domain = {{ size = [0.01, 0.01]; }};
    grains = ({{ diameter = 1.0e-3; density = 2500.0; position = [0.005, {5e-4 + height}]; }});
    contact = {{ normal_stiffness = 4.0e4; friction = 0.0; }};
    gravity = [0.0, -9.81];
    shaking = {{ acceleration = [0.0, {amplitude}]; frequency = 100.0; }};
    """
    config = configure(loads(text))
    speed = math.sqrt(2.0 * 9.81 * height) + thrown * amplitude / (200.0 * math.pi)
    assert impact_speed(config, 0) == pytest.approx(speed, rel=1e-9)
    if amplitude < 9.81:
        return
    with running(world, "lbmdem", text) as app:
        deepest = 0.0
        while app.time < 0.03:
            app.advance(4)
            deepest = max(deepest, app.scalars()["overlap"])
    mass = 2500.0 * math.pi / 4.0 * 1e-6
    told = deepest_overlap(speed, mass, contact_law(config)) / 1e-3
    assert 0.3 * told < deepest < told + mass * (9.81 + amplitude) / 4.0e4 / 1e-3  # and what presses it on meanwhile
