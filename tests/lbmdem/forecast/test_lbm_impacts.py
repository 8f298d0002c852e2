"""What check tells of grains that strike in a fluid: how deep, and what central moments make of the gaps before."""

import math

import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from hpcpic.core.physics.contact_law import deepest_overlap
from lbmdem.case.config import contact_law
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived

BALL = """
simulation = { end_time = 0.2; };
domain = { size = [0.016, 0.016, 0.016]; spacing = 5.0e-4; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-5; time_step = 8.0e-5; };
grains = ({ diameter = 5.0e-3; density = 7800.0; position = [0.008, 0.008, 0.01]; velocity = [0.0, 0.0, -0.35]; });
contact = { normal_stiffness = 80.0; damping = 0.02; };
"""
IMPACT = "overlap at impact"


def told(text, name, *sets):
    return next((one for one in derived(configure(loads(text, sets=sets))) if one.name == name), None)


def test_a_ball_thrown_in_a_fluid_meets_the_wall_with_its_speed_at_most():
    """As deep as without the film, which is said, and refuses nothing; a stiffness that is told is enough."""
    one, mass = told(BALL, IMPACT), 7800.0 * math.pi / 6.0 * 5.0e-3**3
    deepest = deepest_overlap(0.35, mass, contact_law(configure(loads(BALL)))) / 5.0e-3
    assert one.value == pytest.approx(deepest, rel=1e-12) and one.verdict == "warn"
    assert "speed at the start, 0.35 m/s, at most" in one.source
    stiffness = float(one.cure.partition(" = ")[2].split()[0])
    assert told(BALL, IMPACT, f"contact.normal_stiffness={1.1 * stiffness}") is None


def test_a_ball_that_falls_in_a_fluid_meets_the_floor_with_its_terminal_speed_at_most():
    """Or with that of its fall, if it is less, or of its start, if it is more."""
    falls = "grains[0].velocity=[]", "gravity=[0.0, 0.0, -9.81]"
    speed = told(BALL, "speed of grains_1, alone", *falls).value
    low = math.sqrt(2.0 * 9.81 * 0.0075)
    one = told(BALL, IMPACT, *falls)
    assert "terminal speed" in one.source
    assert one.value / told(BALL, IMPACT).value == pytest.approx(min(speed, low) / 0.35, rel=1e-9)
    thrown = told(BALL, IMPACT, falls[1], "grains[0].velocity=[0.0, 0.0, -2.0]")
    assert thrown.value / one.value == pytest.approx(2.0 / min(speed, low), rel=1e-9)


@pytest.mark.parametrize("stokes, strikes", [(9.0, False), (11.0, True)])
def test_a_film_brings_to_rest_what_strikes_at_a_low_stokes_number(stokes, strikes):
    """Below ten (Gondret et al. 2002), of a wall and of a second ball; without films there is none that would."""
    viscosity = f"fluid.kinematic_viscosity={7800.0 * 0.35 * 5.0e-3 / (9.0 * 1000.0 * stokes)}"
    assert bool(told(BALL, IMPACT, viscosity)) == strikes
    assert told(BALL, IMPACT, viscosity, "coupling.lubrication=false").verdict == "fail"
    pair = 'domain.periodic=["x", "y", "z"]', "grains[0].position=([0.008, 0.008, 0.004], [0.008, 0.008, 0.012])"
    assert told(BALL, IMPACT, viscosity, *pair) is None  # they move alike


@pytest.mark.parametrize("tau", [0.51, 0.6])
def test_the_flow_that_central_moments_let_through_a_gap_of_one_node_is_as_told(world, tau):
    """Over that of a parabola, of which TRT lets 1.5 through at any relaxation time."""
    nu = (tau - 0.5) / 3.0
    gap = f"""
        simulation = {{ end_time = 1e6; }}; domain = {{ size = [8.0, 1.0]; spacing = 1.0; periodic = ["x"]; }};
        fluid = {{ density = 1.0; kinematic_viscosity = {nu!r}; time_step = 1.0; body_force = [{1e-3 * nu!r}, 0.0]; }};
    """
    flows = {}
    for collision in ("TRT", "central"):
        with running(world, "lbmdem", gap, (f'fluid.collision="{collision}"',)) as app:
            while app.iteration < 1.2 / nu + 50.0:
                app.step()
            flows[collision] = app.scalars()["flow_rate_x"] / (1e-3 / 12.0)
    step = (tau - 0.5) / 3.0 * 2.5e-7 / 1e-5
    share = told(BALL, "flow through a gap of one node", 'fluid.collision="central"', f"fluid.time_step={step!r}").value
    assert flows["central"] == pytest.approx(share, rel=0.02) and flows["TRT"] == pytest.approx(1.5, rel=1e-3)


def test_central_moments_are_warned_of_where_grains_strike():
    """Not where they rest, stay, or the relaxation time is large; the ways out of a limit say so too."""
    name, central = "flow through a gap of one node", 'fluid.collision="central"'
    assert told(BALL, name) is None and told(BALL, name, central, "coupling.frozen=true") is None
    one = told(BALL, name, central)
    assert one.verdict == "warn" and one.value == pytest.approx(4.0 * 3.0 * 1e-5 * 8e-5 / 2.5e-7, rel=1e-9)
    for sets in (("grains[0].velocity=[]",), ("fluid.time_step=1.1e-3",)):
        assert told(BALL, name, central, *sets).verdict == "ok"
    past = told(BALL, "grid Reynolds number", "grains[0].velocity=[0.0, 0.0, -2.0]")
    assert past.verdict == "fail" and "brakes grains in gaps" in past.cure


RELEASED = """
simulation = { end_time = 0.1; };
domain = { size = [0.006, 0.01]; spacing = 1.0e-4; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-4; relaxation_time = 5.0; };
grains = ({ diameter = 1.0e-3; density = 1100.0; position = [0.003, 0.0065]; });
gravity = [0.0, -9.81];
"""
SWINGS = "swing of the speed of released grains"


def test_a_grain_that_begins_to_fall_swings_with_the_sound_of_its_box(world):
    """With long steps sound is slow: the swing that is told bounds that of a run, which the cure ends."""
    one, alone, speeds = told(RELEASED, SWINGS), told(RELEASED, "speed of grains_1, alone").value, []
    assert one.verdict == "warn" and one.key == ("fluid", "relaxation_time")
    mass = 1100.0 * math.pi / 4.0 * 1e-6
    period = 2.0 * 0.01 * math.sqrt(3.0) * configure(loads(RELEASED)).time_step / 1e-4
    with running(world, "lbmdem", RELEASED) as app:
        while app.time < 2.0 * period:
            for _ in range(10):
                app.step()
            speeds.append(math.sqrt(2.0 * app.scalars()["energy_kinetic_grains"] / mass))
    last = speeds[len(speeds) // 2 :]
    assert 0.35 < 0.5 * (max(last) - min(last)) / alone / one.value < 1.0
    cure = float(one.cure.partition(" = ")[2].split()[0])
    assert told(RELEASED, SWINGS, f"fluid.relaxation_time={cure}").verdict == "ok"


@pytest.mark.parametrize("sets", [('domain.periodic=["y"]',), ("coupling.frozen=true",), ("gravity=[9.81, 0.0]",)])
def test_no_swing_is_told_where_nothing_falls_between_walls(sets):
    """Along a periodic side sound goes on, and a shorter way has a lower swing."""
    one = told(RELEASED, SWINGS, *sets)
    if sets[0].startswith("gravity"):
        assert one.value == pytest.approx(0.6 * told(RELEASED, SWINGS).value, rel=0.03)
    else:
        assert one is None


@pytest.mark.parametrize("share", [0.2, 0.3, 0.5])
def test_a_disc_between_walls_falls_with_the_speed_of_faxen(share):
    """Faxen 1946, for a channel that is closed below; a plane narrows it as a wall does."""
    creeping, alone = "gravity=[0.0, -1e-6]", "speed of grains_1, alone"
    size = share * 0.006
    drag = math.log(1.0 / share) - 0.9157 + 1.7244 * share**2 - 1.7302 * share**4 + 2.4056 * share**6
    drag -= 4.5913 * share**8
    speed = 100.0 * 1e-6 * math.pi / 4.0 * size**2 / (4.0 * math.pi * 0.1) * drag
    sets = creeping, f"grains[0].diameter={size}"
    assert told(RELEASED, alone, *sets).value == pytest.approx(speed, rel=0.04)
    plane = "obstacle=({ shape = { plane = { point = [0.001, 0.0]; normal = [1.0, 0.0]; }; }; })"
    narrower = told(RELEASED, alone, *sets, "domain.size=[0.007, 0.01]", "grains[0].position=[0.004, 0.0065]", plane)
    assert narrower.value == told(RELEASED, alone, *sets).value
    stokes = 100.0 * 1e-6 * size**2 / (18.0 * 0.1)
    for free in ('domain.periodic=["x"]', 'domain.periodic=["y"]'):
        assert told(RELEASED, alone, *sets, free).value == pytest.approx(stokes, rel=1e-9)


def test_a_disc_that_fills_its_channel_hardly_falls():
    """As h^2.5 of the gap h over its radius, for what it drives up beside it; the swing is told of that speed."""
    alone, creeping = "speed of grains_1, alone", "gravity=[0.0, -1e-6]"
    fills = [(creeping, f"grains[0].diameter={0.006 / (1.0 + h)}") for h in (0.01, 0.02)]
    thin, thick = (told(RELEASED, alone, *sets).value for sets in fills)
    assert thick / thin == pytest.approx(2.0**2.5, rel=0.04)
    assert told(RELEASED, SWINGS, *fills[0]).value > 100.0 * told(RELEASED, SWINGS, creeping).value


@pytest.mark.parametrize(
    ("h", "e", "measured"), [(0.3, 0.7, 2.01), (0.6, 0.9, 1.96), (1.0, 0.5, 1.36), (2.0, 0.5, 1.14)]
)
def test_a_disc_off_the_middle_of_its_channel_falls_faster(h, e, measured):
    """By the wider of its gaps, which it drives the fluid up through, on either side; runs of the creeping flow."""
    alone, size = "speed of grains_1, alone", 0.006 / (1.0 + h)
    sets = "gravity=[0.0, -1e-6]", f"grains[0].diameter={size}"
    aside = 0.5 * e * (0.006 - size)
    middle, left, right = (
        told(RELEASED, alone, *sets, f"grains[0].position=[{0.003 + x}, 0.0065]").value for x in (0.0, -aside, aside)
    )
    assert left == pytest.approx(right) and left / middle == pytest.approx(measured, rel=0.15)


@pytest.mark.parametrize(("share", "measured"), [(0.3, 0.470), (0.5, 0.222), (0.7, 0.0786), (0.85, 0.0254)])
def test_a_sphere_in_a_duct_falls_as_walls_let_it(share, measured):
    """Its speed over Stokes's, of runs of the creeping flow; between two walls alone it is faster, and slowed too."""
    sets = "domain.size=[0.006, 0.006, 0.01]", "grains[0].position=[0.003, 0.003, 0.0065]", "gravity=[0.0, 0.0, -1e-6]"
    alone, size = "speed of grains_1, alone", f"grains[0].diameter={0.006 * share}"
    stokes = 1e-7 * (0.006 * share) ** 2 / (18.0 * 1e-4)
    duct, slot = (told(RELEASED, alone, *sets, size, f"domain.periodic=[{axis}]").value for axis in ("", '"x"'))
    assert duct / stokes == pytest.approx(measured, rel=0.07) and duct < 0.8 * slot < 0.8 * stokes
    assert told(RELEASED, "grain in the box", *sets, "grains[0].diameter=0.009").verdict == "fail"


@pytest.mark.parametrize(("axes", "rests"), [("", True), ('"x"', True), ('"y"', False)])
def test_a_grain_rests_where_something_holds_it(axes, rests):
    """Along an axis that repeats it falls for ever; it was told an overlap at rest, with fluid and without."""
    dry = "\n".join(line for line in RELEASED.splitlines() if not line.startswith("fluid"))
    for text in (RELEASED, dry):
        assert (told(text, "overlap at rest", f"domain.periodic=[{axes}]") is not None) is rests
