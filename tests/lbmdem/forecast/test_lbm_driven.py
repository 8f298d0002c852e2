"""What `check` says of a fluid that pressure faces drive, and of one that is driven through a packing."""

import math

import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived

SLOT = """
simulation = { end_time = 30.0; };
domain = { size = [0.02, 0.01]; spacing = 5.0e-4; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-6; relaxation_time = 0.6; };
boundary = ({ face = "x-"; type = "pressure"; pressure = 0.002; }, { face = "x+"; type = "pressure"; pressure = 0.0; });
"""
SPEED, MACH = "speed that the pressure difference makes", "Mach number of the driven fluid"
GRID = "grid Reynolds number of the driven fluid, at most"
GRADIENT = 0.002 / 1000.0 / 0.0195  # m/s2; the faces are the last nodes
PARABOLA = GRADIENT * 0.01**2 / 8.0e-6


def told(name, *sets, case=SLOT):
    return next((one for one in derived(configure(loads(case, sets=sets))) if one.name == name), None)


@pytest.mark.parametrize(
    ("sets", "speed"),
    [
        ((), PARABOLA),
        (("simulation.end_time=1.0",), GRADIENT),
        (("boundary[0].pressure=-0.002",), PARABOLA),
        (("boundary[0].pressure=0.0", "boundary[0].pressure_rate=2e-4"), 3.0 * PARABOLA),
        ((f"fluid.body_force=[{GRADIENT}, 0.0]",), 2.0 * PARABOLA),
        (("boundary[1].pressure=0.002",), None),  # none against none
    ],
)
def test_the_speed_that_pressure_faces_make_is_told(sets, speed):
    found = told(SPEED, *sets) or told("speed that the body force makes", *sets)
    assert (found and found.value) == (speed and pytest.approx(speed, rel=1e-9))


def test_a_force_that_faces_hold_makes_no_speed():
    held = told(SPEED, f"fluid.body_force=[{-GRADIENT!r}, 0.0]")
    assert held is None or held.value < 1e-12 * PARABOLA


def test_a_difference_that_makes_the_fluid_too_fast_is_refused_and_cured():
    """A slot of 50 by 100 nodes with 0.12 Pa ended at a Mach number of 0.55, and check had not said a word."""
    fast = told(MACH, "boundary[0].pressure=0.03")
    assert (fast.verdict, fast.forceable, fast.key) == ("fail", True, ("boundary", 1))
    tau = fast.cure.split("relaxation_time = ")[1]
    assert told(MACH, "boundary[0].pressure=0.03", f"fluid.relaxation_time={tau}").verdict == "ok"


NARROW = """
simulation = { end_time = 40.0; };
domain = { size = [0.002, 0.005]; spacing = 1.0e-3; periodic = ["x"]; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-6; body_force = [1.0e-6, 0.0]; };
"""


@pytest.mark.parametrize(
    "fluid",
    ['collision="BGK"; relaxation_time=2.0;', 'collision="central"; relaxation_time=0.6;', "magic=0.5;"],
)
def test_the_slip_of_the_walls_of_a_channel_is_that_of_the_run(world, fluid):
    """BGK was told by a channel of 16 nodes, and of the others nothing: 4 % with central moments and 5 nodes, 15 % with
    a product of 3 and 10. A wider channel, and walls that slide alone, have less and none."""
    sets = (f"fluid={{ {fluid} }}",)
    name, largest = "slip of the walls", 1.0e-6 * 0.005**2 / 8.0e-6
    one = told(name, *sets, case=NARROW)
    with running(world, "lbmdem", NARROW, sets) as app:
        while app.iteration < app.n_steps:
            app.step()
        middle = float(app.fluid.moments()[1][2, 0, 0]) * app.scene.units.velocity
    assert one.verdict == "warn" and one.value == pytest.approx(middle / largest - 1.0, rel=0.02)
    assert told(name, *sets, "domain.size=[0.002, 0.05]", case=NARROW).verdict == "ok"
    assert told(name, case=NARROW) is None  # TRT and 3/16
    assert told(name, *sets, "fluid.body_force=[0.0, 0.0]", 'domain.periodic=["x", "y"]', case=NARROW) is None


def test_gravity_that_drives_nothing_is_told(world):
    """A fluid knows its pressure beyond its own weight: between open ends it stays at rest, where a stream falls."""
    name, falls = "gravity on the fluid", ("gravity=[-9.81, 0.0]", "boundary=()", 'domain.periodic=["x"]')
    one = told(name, *falls)
    assert one.verdict == "warn" and "body_force = [-9.81, 0.0]" in one.cure
    with running(world, "lbmdem", SLOT, falls) as app:
        app.step()
        assert app.scalars()["momentum_x"] == 0.0
    moving = "grains=({ diameter = 1.0e-3; position = [0.01, 0.005]; })"
    packed = "grains=({ moving = false; diameters = { min = 1e-3; max = 1e-3; count = 2; }; packing = { }; })"
    for sets in (("gravity=[0.0, -9.81]",), ("fluid.body_force=[1.0, 0.0]",), (moving,), (packed,)):
        assert told(name, *falls, *sets) is None


def test_grains_that_move_may_bear_the_pressure():
    grain = 'grains=({name="g"; diameter=2.5e-3; density=2000.0; position=[5.0e-3, 5.0e-3];})'
    assert told(SPEED, grain) is None
    assert told("largest speed that the pressure difference can make", grain.replace("density=2000.0", "moving=false"))


def test_a_slot_gets_as_fast_as_is_told(world):
    """Within what compressibility does at this pressure, and half a node beside the middle."""
    with running(world, "lbmdem", SLOT, sets=("simulation.end_time=60.0", "domain.spacing=1.0e-3")) as app:
        while app.time < 60.0:
            app.step()
        fastest = app.scalars()["max_mach"] * app.scene.units.velocity / math.sqrt(3.0)
    assert fastest == pytest.approx(told(SPEED, "simulation.end_time=60.0", "domain.spacing=1.0e-3").value, rel=0.03)


PACKED = """
simulation = { dimensions = 3; end_time = 0.1; };
domain = { size = [2.2e-3, 2.2e-3, 2.2e-3]; spacing = 1.0e-4; periodic = ["x", "y", "z"]; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-6; relaxation_time = 0.51; body_force = [0.0, 0.0, 8.0]; };
grains = ({ moving = false; diameters = { min = 1e-3; max = 1e-3; count = 12; }; packing = { porosity = 0.42; }; });
"""


@pytest.mark.parametrize("collision, verdict", [("TRT", "ok"), ("BGK", "warn")])
def test_a_flow_through_a_packing_has_a_grid_reynolds_number(collision, verdict):
    """Of TRT up to 24 held, 49 diverged, and check had not said a word; BGK bears half."""
    held = told(GRID, f'fluid.collision="{collision}"', case=PACKED)
    speed = told("largest speed that the body force can make", case=PACKED).value
    assert held.value == pytest.approx(speed * 1.0e-4 / 1.0e-6) and held.verdict == verdict
    fast = told(GRID, "fluid.body_force=[0.0, 0.0, 40.0]", case=PACKED)
    assert fast.verdict == "warn" and "gaps of a few nodes" in fast.cure
    assert told(GRID, 'fluid.collision="central"', case=PACKED) is None  # it has no such limit, and lets less through


CARRIED = """
simulation = { end_time = 0.6; };
domain = { size = [0.01, 0.006]; spacing = 2.0e-4; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-6; relaxation_time = 0.65; };
boundary = ({ face = "x-"; type = "velocity"; velocity = [0.01, 0.0]; },
            { face = "x+"; type = "pressure"; pressure = 0.0; });
grains = ({ name = "discs"; diameter = 1e-3; density = 1000.0; position = ([0.004, 0.003], [0.006, 0.0045]); });
contact = { normal_stiffness = 10.0; };
"""
OUT = "way of discs towards x+"


@pytest.mark.parametrize(
    ("sets", "share"),
    [
        ((), 0.006 / 0.0035),
        (("simulation.end_time=0.2",), 0.002 / 0.0035),
        (('boundary[0].profile="parabolic"',), 0.009 / 0.0035),
        (("gravity=[-9.81, 0.0]",), 0.006 / 0.0035),  # of grains as heavy as the fluid
        (("boundary[0].velocity=[-0.01, 0.0]",), None),
        (("grains[0].moving=false",), None),
        (("coupling.frozen=true",), None),
    ],
)
def test_grains_that_a_stream_carries_to_an_open_face_are_told(sets, share):
    found = told(OUT, *sets, case=CARRIED)
    assert (found and found.value) == (share and pytest.approx(share))
    if share:
        assert found.verdict == ("warn" if share > 1.0 else "ok")


def test_grains_that_rise_to_an_open_top_are_told():
    """Lighter ones rise, heavier ones sink to a wall."""
    top = 'boundary=({face="y+"; type="pressure"; pressure=0.0;})', "gravity=[0.0, -9.81]", "simulation.end_time=5.0"
    name = "way of discs towards y+"
    speed = told("speed of discs, alone", *top, "grains[0].density=990.0", case=CARRIED).value
    assert told(name, *top, "grains[0].density=990.0", case=CARRIED).value == pytest.approx(speed * 5.0 / 0.001)
    assert told(name, *top, "grains[0].density=1010.0", case=CARRIED) is None


def test_a_grain_stops_at_an_open_face_as_it_is_told(world):
    with running(world, "lbmdem", CARRIED) as app:
        while app.time < 0.6:
            app.step()
        x = app.dem.grains.x[:, 0]
    assert x.max() == pytest.approx(0.0095, abs=1e-4)  # its own radius before it


def test_a_packing_of_two_grains_across_a_periodic_side_is_refused_before_it_grows():
    sets = "domain.size=[1.9e-3, 1.9e-3, 4.0e-3]", "grains[0].diameters.count=9"
    found = told("grain in the box", *sets, case=PACKED)
    assert found.verdict == "fail" and found.value == pytest.approx(2.0 / 1.9)
