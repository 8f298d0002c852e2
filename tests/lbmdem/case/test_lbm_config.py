"""What a case says: bad input is told with its place, good input survives being written, derived numbers hold."""

import math
import re

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hpcpic.core.case.config import leaves, load, loads
from hpcpic.core.case.derived import enforce
from hpcpic.core.case.dump import dump
from hpcpic.core.errors import ConfigError
from hpcpic.core.physics.contact_law import ContactLaw, stable_step
from lbmdem.app import shipped_cases
from lbmdem.case.config import Contact, Diameters, LbmDemConfig, contact_step, lightest
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived
from lbmdem.forecast.estimate import estimate
from lbmdem.forecast.plan import plan
from lbmdem.physics.velocity_sets import CS2
from lbmdem.setup.overlap_survey import law_diameters, law_volume, solid_volume

CHANNEL = """
simulation = { end_time = 1.0; };
domain = { size = [2.5e-4, 1.0e-3]; spacing = 3.125e-5; periodic = ["x"]; };
fluid = { kinematic_viscosity = 1.0e-6; relaxation_time = 1.0; body_force = [1.0e-3, 0.0]; };
"""


def config_of(text: str) -> LbmDemConfig:
    return configure(loads(text))


def messages(text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        tree = loads(text)
        enforce(derived(configure(tree)), tree)
    return str(caught.value)


DISC = "grains = ({ diameter = 2e-4; position = [1e-4, 5e-4]; });"


def plane(normal: str = "[0.0, 1.0]", velocity: str = "[1e-4, 0.0]") -> str:
    shape = f"shape = {{ plane = {{ point = [0.0, 1e-4]; normal = {normal}; }}; }}"
    return f"obstacle = ({{ velocity = {velocity}; {shape}; }});"


def packed(*packings: str) -> str:
    law = "diameters = { min = 8e-5; max = 1e-4; count = 4; }"
    return f"grains = ({', '.join(f'{{ {law}; packing = {{ {packing} }}; }}' for packing in packings)});"


def test_a_domain_of_sph_is_answered_by_its_size():
    assert "domain.high: unknown key; the box begins at the origin" in messages(CHANNEL.replace("size =", "high ="))


@pytest.mark.parametrize(
    "extra, said",
    [
        ("obstacle = ({ shape = { cylinder = { radius = 1.0; }; }; });", "what is round is a grain with moving"),
        (plane().replace("velocity", "angular_velocity"), "a ring of such grains of radius r with -w R/r"),
        ("contact = { rolling_friction = 0.1; };", "heaps are those of round grains"),
        ("contact = { restitution = 0.7; };", "damping = 0.05, 0.1, 0.2, 0.3 gives 0.85, 0.73, 0.53, 0.37"),
        ("contact = { youngs_modulus = 1e7; };", "normal_stiffness in N/m"),
        ("grains = ({ radius = 1e-3; position = [0.002, 0.002]; });", "diameter is twice that"),
    ],
)
def test_what_other_programs_have_is_answered_by_what_stands_for_it(extra, said):
    assert said in messages(CHANNEL + extra)


def test_the_restitution_that_is_told_of_a_damping_is_that_of_the_law():
    numbers = np.array([float(x) for x in re.findall(r"0\.\d+", Contact.instead["restitution"])])
    alphas, found = numbers[:4], numbers[4:]
    assert np.exp(-np.pi * alphas / np.sqrt(1.0 - alphas**2)) == pytest.approx(found, abs=5e-3)


@pytest.mark.parametrize("stiffness", [0.01, 1.0, 1e3, 1e5])
def test_a_substep_of_the_contacts_is_a_fifth_of_the_largest_stable_one(stiffness):
    """A step of the fluid has as few substeps as that allows; grains without fluid take a fifth exactly."""
    config = config_of(f"{CHANNEL} {DISC} contact = {{ normal_stiffness = {stiffness}; }};")
    wanted = config.time_step / contact_step(config) / 0.2
    assert config.substeps - 1 < wanted <= config.substeps * (1 + 1e-9)
    alone = config_of(
        f"simulation = {{ end_time = 1.0; }}; domain = {{ size = [1e-3, 1e-3]; }}; {DISC} "
        f"contact = {{ normal_stiffness = {stiffness}; }};"
    )
    assert alone.time_step == pytest.approx(0.2 * contact_step(alone), rel=1e-12)


@pytest.mark.parametrize("tangential", ["regularised", "history"])
def test_without_friction_nothing_along_a_contact_limits_the_step(tangential):
    """The force there is at most mu N: none. The default viscosity would ask for fifteen times as many steps."""
    dry = f"simulation = {{ end_time = 1.0; }}; domain = {{ size = [1e-3, 1e-3]; }}; {DISC} "
    none, some = (
        config_of(f'{dry} contact = {{ tangential = "{tangential}"; friction = {mu}; {more} }};')
        for mu, more in ((0.0, "tangential_viscosity = 1e9;"), (1e-9, ""))
    )
    normal = ContactLaw(none.contact.normal_stiffness, none.contact.damping)
    radius, mass = np.array([1e-4]), np.array([lightest(none)])
    assert contact_step(none) == stable_step(normal, radius, mass, 0.5 * mass * radius**2)
    assert contact_step(some) < 0.8 * contact_step(none)


@pytest.mark.parametrize("name", sorted(shipped_cases()))
def test_a_shipped_case_is_legal_and_survives_being_written(name):
    config = configure(load(shipped_cases()[name]))
    enforce(derived(config), loads(dump(config)))
    assert config_of(dump(config)) == config


@pytest.mark.parametrize(
    "change, said",
    [
        (("spacing = 3.125e-5", "spacing = 3.0e-5"), "domain.size: is 8.33333 spacings along x"),
        (('periodic = ["x"]', 'periodic = ["z"]'), "domain.periodic: there is no z in 2D"),
        (("relaxation_time = 1.0", "relaxation_time = 0.5"), "fluid.relaxation_time"),
        (("relaxation_time = 1.0", "relaxation_time = 1.0; time_step = 1e-3"), "give either this or fluid.relaxation"),
        (("viscosity = 1.0e-6", "viscosity = -1.0e-6"), "fluid.kinematic_viscosity"),
        (("relaxation_time = 1.0", "relaxation_time = 1.0e4"), "relaxation time tau = 1e+04"),
        (("relaxation_time = 1.0", "relaxation_time = 1.0; gravity = 9.81"), "body_force drives a fluid"),
        (("kinematic_viscosity", "kinematic_viscosty"), "did you mean 'kinematic_viscosity'"),
        (("[1.0e-3, 0.0]", "[1.0e-3, 0.0, 0.0]"), "fluid.body_force: needs 2 numbers in 2D (got 3)"),
        (("end_time = 1.0", "end_time = 1.0; lattice = \"D3Q19\""), "D3Q19 is not of 2 dimensions"),
    ],
)  # fmt: skip
def test_bad_input_is_told(change, said):
    assert said in messages(CHANNEL.replace(*change))


def test_a_time_step_that_is_set_takes_the_place_of_the_relaxation_time_of_the_file():
    tree = loads(CHANNEL, sets=["fluid.time_step=1e-4"])
    assert configure(tree) == config_of(CHANNEL.replace("relaxation_time = 1.0", "time_step = 1e-4"))


def test_a_size_of_nothing_is_one_fault():
    """And not that the list is too short without it."""
    assert len(messages(CHANNEL.replace("2.5e-4", "0.0")).splitlines()) == 1


def test_a_periodic_face_is_a_periodic_axis():
    lid = '{ face = "y+"; type = "wall"; velocity = [1.0, 0.0]; }'
    faces = f'boundary = ({{ face = "x-"; type = "periodic"; }}, {lid});'
    config = config_of(CHANNEL.replace('periodic = ["x"];', "") + faces)
    assert config == config_of(f"{CHANNEL} boundary = ({lid});") == config_of(dump(config))
    assert "the box is periodic along x" in messages(CHANNEL + faces.replace('"periodic"', '"wall"'))
    said = messages(CHANNEL + faces.replace('"periodic"', '"periodic"; velocity = [1.0, 0.0]'))
    assert "boundary[0].velocity: a periodic face has none" in said


@pytest.mark.parametrize(
    "extra, said",
    [
        ('boundary = ({ face = "x-"; type = "wall"; });', "the box is periodic along x"),
        ('boundary = ({ face = "y-"; type = "pressure"; });', "needs either pressure or density"),
        ('boundary = ({ face = "y-"; type = "wall"; pressure = 1.0; });', "no pressure of its own"),
        ('boundary = ({ face = "y-"; type = "wall"; }, { face = "y-"; type = "wall"; });', "given twice"),
        ("grains = ({ diameter = 3e-4; });", "needs either position or packing"),
        ("grains = ({ diameter = 3e-4; packing = { porosity = 0.5; }; });", "needs diameters = { min = ..; max"),
        ("grains = ({ position = [1e-4, 5e-4]; });", "needs either diameter or diameters"),
        ('grains = ({ diameter = 3e-4; position = [1e-4, 5e-4]; shape = "sphere"; });', "disc is the shape there"),
        ("grains = ({ diameter = 3e-5; position = [1e-4, 5e-4]; });", "resolves the grains of grains_1"),
        ("grains = ({ diameter = 3e-4; position = [1e-4, 5e-4, 0.0]; });", "needs 2 numbers in 2D (got 3)"),
        (DISC.replace(" });", ' moving = false; acceleration = "own"; });'), "acceleration: moves nothing"),
        ("obstacle = ({ shape = { }; });", "needs one of plane"),
        (plane(normal="[0.0, 0.0]"), "normal: is no direction"),
        (plane(normal="[0.1, 1.0]"), "has a part along x, along which the box is periodic"),
        (plane(velocity="[1e-4, 1e-5]"), "obstacle[0].velocity: has a part along the normal"),
        ("obstacle = ({ shape = { box = { low = [0.0, 5e-4]; high = [1e-4, 5e-4]; }; }; });", "has no inside"),
        (DISC + "obstacle = ({ shape = { box = { low = [0.0, 0.0]; high = [1e-4, 1e-4]; }; }; });",
         "is nothing that moving grains could touch"),
        (DISC.replace("({", '({ name = "obstacle_1";') + plane(), "'obstacle_1' is taken by an earlier one"),
        (DISC.replace("({", '({ name = "a/b";'), "grains[0].name: must do without"),
        ('boundary = ({ face = "y+"; type = "wall"; velocity = [0.0, 1e-5]; });', "a wall slides along itself"),
        (DISC.replace("({", "({ angular_velocity = [0.0, 0.0, 1.0];"), "needs 1 number(s) in 2D (got 3)"),
        (packed("").replace("8e-5", "2e-4"), "grains[0].diameters.min: is above max (0.0001 m; got 0.0002)"),
        (packed("low = -1e-4"), "grains[0].packing.low: must lie in the box"),
        (packed("low = 2e-4; high = 1e-4"), "grains[0].packing.high: must be above low (0.0002 m)"),
        (packed("", "low = 0.0; high = 1e-3"), "grains[1].packing: fills the space of an earlier one"),
    ],
)  # fmt: skip
def test_bad_scenes_are_told(extra, said):
    assert said in messages(CHANNEL + extra)


def test_packings_may_stand_on_each_other():
    above = packed("porosity = 0.7; high = 4e-4", "low = 4.1e-4").replace("8e-5", "1e-4")
    assert len(config_of(CHANNEL + above).grains) == 2


def test_keys_of_the_other_kind_of_case_are_told():
    """With and without fluid: what has no meaning there is a fault, not passed over."""
    wet = CHANNEL.replace("{ end", "{ time_step = 1e-4; end")
    assert "simulation.time_step: is of a case without fluid" in messages(wet)
    dry = CHANNEL.split("fluid")[0]
    assert "grains: none moves, and there is no fluid" in messages(dry + DISC.replace("({", "({ moving = false;"))


@pytest.mark.parametrize("kinds", [("pressure", "pressure"), ("velocity", "pressure"), ("velocity", "velocity")])
def test_open_faces_that_meet_are_refused(kinds):
    """A uniform flow through both would not stay one at their edge; through opposite faces it does."""
    values = {"pressure": "pressure = 0.0", "velocity": "velocity = [1e-4, 1e-4]"}

    def faces(*names):
        made = (f'{{ face = "{name}"; type = "{kind}"; {values[kind]}; }}' for name, kind in zip(names, kinds))
        return CHANNEL.replace('periodic = ["x"];', "") + f"boundary = ({', '.join(made)});"

    assert "boundary[1].face: meets x-: the fluid can pass" in messages(faces("x-", "y+"))
    assert config_of(faces("x-", "x+")).boundary


def test_the_surface_of_a_turning_grain_has_a_speed():
    text = CHANNEL + DISC.replace("({", "({ moving = false; velocity = [3e-3, 4e-3]; angular_velocity = [-20.0];")
    assert next(n for n in derived(config_of(text)) if n.symbol == "u dt/dx").value == pytest.approx(
        (5e-3 + 20.0 * 1e-4) * config_of(text).time_step / 3.125e-5, rel=1e-12
    )


def test_the_time_step_gives_the_viscosity_back():
    """[5]: nu = c_s^2 (tau - 1/2) dx^2 / dt, whichever of tau and dt the case gives."""
    by_tau = config_of(CHANNEL)
    assert by_tau.tau == 1.0
    assert math.isclose(CS2 * (by_tau.tau - 0.5) * by_tau.spacing**2 / by_tau.time_step, 1e-6, rel_tol=1e-15)
    text = CHANNEL.replace("relaxation_time = 1.0", f"time_step = {by_tau.time_step!r}")
    assert math.isclose(config_of(text).tau, 1.0, rel_tol=1e-15)


def test_a_fast_lid_is_warned_of_and_refused():
    """Mach 0.2 is a warning with its cure, Mach 1 is refused even by force."""

    def lid(speed: float) -> str:
        return CHANNEL + f'boundary = ({{ face = "y+"; type = "wall"; velocity = [{speed}, 0.0]; }});'

    unit = config_of(CHANNEL).spacing / config_of(CHANNEL).time_step
    warned = [n for n in derived(config_of(lid(0.2 * unit * CS2**0.5))) if n.symbol == "Ma"]
    assert warned[0].verdict == "warn" and "relaxation_time" in warned[0].cure
    tree = loads(lid(1.1 * unit * CS2**0.5))
    with pytest.raises(ConfigError, match="Mach number"):
        enforce(derived(configure(tree)), tree, force=True)


def test_the_speed_of_a_falling_grain_is_foreseen():
    """As slow as Stokes says in thick fluid, as fast as the drag coefficient says in thin; a cure is one."""
    text = shipped_cases()["liquefaction"].read_text()

    def mach(text):
        config = config_of(text)
        found = next(n for n in derived(config) if n.name == "Mach number of a lone grain")
        return found, found.value * config.spacing / config.time_step * CS2**0.5

    thin, v = mach(text)
    assert v == pytest.approx(math.sqrt(math.pi / 2 * 3e-3 * 1.65 * 9.81), rel=1e-12) and thin.verdict == "ok"
    _, v = mach(text.replace("viscosity = 1.0e-6", "viscosity = 1.0e-4"))
    assert v == pytest.approx(1.65 * 9.81 * 9e-6 / 18e-4, rel=1e-12)
    fast, _ = mach(text.replace("relaxation_time = 0.51", "relaxation_time = 0.56"))
    assert fast.verdict == "fail" and fast.value == pytest.approx(6 * thin.value)
    tau = fast.cure.split("relaxation_time = ")[1].split()[0]
    assert mach(text.replace("relaxation_time = 0.51", f"relaxation_time = {tau}"))[0].verdict == "ok"
    assert mach(text.replace("density = 2650.0", "density = 999.0"))[0].value > 0.0


def test_check_tells_lattice_units_beside_the_physical_ones():
    config = config_of(CHANNEL)
    found = {number.symbol: number for number in derived(config)}
    dx, dt = 3.125e-5, (1.0 - 0.5) / 3.0 * 3.125e-5**2 / 1e-6
    told = [found[symbol].value for symbol in ("dx", "dx/dt", "nu dt/dx2", "a dt2/dx")]
    assert told == pytest.approx([dx, dx / dt, 0.5 / 3.0, 1e-3 * dt * dt / dx], rel=1e-14)
    assert found["nu dt/dx2"].name == "viscosity of 1e-06 m2/s" and "u dt/dx" not in found


def test_a_scene_keeps_what_nothing_takes_from_it():
    assert config_of(CHANNEL).conserved == ("mass",)
    around = CHANNEL.replace('["x"]', '["x", "y"]')
    assert config_of(around).conserved == ("mass", "momentum_y")
    lid = 'boundary = ({ face = "y+"; type = "pressure"; pressure = 0.0; });'
    assert config_of(CHANNEL + lid).conserved == ()


def test_a_slab_has_no_more_nodes_than_its_numbers_tell_apart():
    large = config_of(CHANNEL.replace("[2.5e-4, 1.0e-3]", "[1.5625, 1.5625]"))
    told = {ranks: next(one for one in derived(large, ranks) if one.name == "nodes") for ranks in (1, 2)}
    assert [one.verdict for one in told.values()] == ["fail", "ok"]
    assert "2 ranks hold them" in str(told[1])


def test_open_faces_have_two_nodes_between_them():
    faces = ", ".join(f'{{ face = "x{side}"; type = "pressure"; pressure = 0.0; }}' for side in "-+")
    for nodes, said in ((1, "has one node in common with x-"), (2, "")):
        size = f"[{nodes * 3.125e-5}, 1.0e-3]"
        case = CHANNEL.replace('periodic = ["x"];', "").replace("[2.5e-4, 1.0e-3]", size)
        text = f"{case} boundary = ({faces});"
        assert said in messages(text) if said else config_of(text)


@pytest.mark.parametrize(
    ("low", "high", "there"),
    [
        ("[1.0e-4, 0.0]", "[2.0e-4, 1.0e-4]", True),
        ("[-1.0e-4, 0.0]", "[-5.0e-5, 1.0e-4]", True),  # comes again on the other side
        ("[1.0e-4, 1.1e-3]", "[2.0e-4, 1.2e-3]", False),
        ("[1.0e-4, 1.0e-4]", "[1.05e-4, 2.0e-4]", False),
    ],
)
def test_an_obstacle_that_covers_no_node_is_told(low, high, there):
    shapes = [f"box = {{ low = {low}; high = {high}; }}"]
    shapes += [f"plane = {{ point = [0.0, {1e-4 if there else -1e-4}]; normal = [0.0, 1.0]; }}"]
    for shape in shapes:
        told = derived(config_of(f"{CHANNEL} obstacle = ({{ shape = {{ {shape}; }}; }});"))
        assert ("nodes in obstacle_1" in [one.name for one in told]) is not there


EVERYTHING = """
simulation = { end_time = 1.0; };
domain = { size = [0.064, 0.032, 0.096]; spacing = 1.0e-3; periodic = ["x"]; };
fluid = { density = 1000.0; viscosity = 1.0e-6; relaxation_time = 0.6; magic = 0.1875; body_force = [0.1, 0.0, 0.0]; };
boundary = ({ face = "z+"; type = "pressure"; pressure = 1.0; pressure_rate = 1.0; },
            { face = "z-"; type = "velocity"; velocity = [0.0, 0.0, 1.0e-3]; });
obstacle = ({ shape = { plane = { point = [0.0, 0.0, 0.002]; normal = [0.0, 0.0, 1.0]; }; }; });
grains = (
  { diameters = { min = 3.0e-3; max = 5.0e-3; a = 2.0; b = 3.0; count = 100; }; density = 2650.0;
    packing = { low = 0.01; porosity = 0.5; }; },
  { diameter = 4.0e-3; position = [0.03, 0.02, 0.09]; velocity = [0.0, 0.1, 0.0];
    angular_velocity = [1.0, 0.0, 0.0]; });
contact = { normal_stiffness = 1.0e4; damping = 0.2; tangential = "history"; tangential_viscosity = 0.1;
            tangential_stiffness = 2.0e3; friction = 0.5; };
coupling = { substeps = 0; };
gravity = [0.0, 0.0, -9.81];
shaking = { acceleration = [1.0, 0.0, 0.0]; frequency = 2.0; };
output = { period = { series = 0.1; fields = 0.1; grains = 0.1; checkpoint = 0.1; }; stress_slices = 3; };
"""
PLACES = list(leaves(loads(EVERYTHING).data))
FLOATS = [key for key, value in PLACES if isinstance(value, float)]
COUNTS = [key for key, value in PLACES if isinstance(value, int)]
EXTREMES = (5e-324, 1e-30, 1e-20, 1e-12, 0.0, -1.0, 1e12, 1e20, 1e30, 1.7e308)


@settings(max_examples=60, deadline=None)
@given(
    st.dictionaries(st.sampled_from(FLOATS), st.sampled_from(EXTREMES), max_size=4),
    st.dictionaries(st.sampled_from(COUNTS), st.sampled_from((0, 1, 2**31 - 1, 10**11, 2**63 - 1)), max_size=1),
)
@example({"fluid.viscosity": 1e-30}, {})
@example({"domain.spacing": 1e-20}, {})
@example({"grains[0].diameters.max": 1e12}, {"grains[0].diameters.count": 1})
@example({"grains[0].diameters.a": 1e12}, {})
@example({}, {"grains[0].diameters.count": 10**11})
def test_no_numbers_break_check_estimate_or_plan(floats, counts):
    """Whatever a case says, in whatever units: it is refused with a reason, or all is computed, in little memory."""
    changed = [f"{key}={value!r}" for key, value in floats.items()]
    changed += [f"{key}={value}L" for key, value in counts.items()]
    try:
        config = configure(loads(EVERYTHING, sets=changed))
    except ConfigError as error:
        assert error.messages
        return
    assert all(isinstance(number.value, (int, float)) and str(number) for number in derived(config, 2))
    assert estimate(config, 2, 2, {}).seconds > 0.0 and plan(config, 2, 2)


@pytest.mark.parametrize("value", [1e-30, 1e30])
def test_numbers_whose_products_leave_floating_point_are_refused_at_their_key(value):
    told = messages(CHANNEL.replace("1.0e-6", repr(value)))
    assert "fluid.kinematic_viscosity: is beyond what is computed with" in told


def test_a_viscosity_that_rounding_takes_away_is_refused():
    text = CHANNEL.replace("relaxation_time = 1.0", "time_step = 1.0e-18")
    assert "fluid.time_step: relaxation time tau = 0.5" in messages(text)


@pytest.mark.parametrize("count", [1000, 1 << 18])
def test_the_volume_of_very_many_grains_is_that_of_a_sample_of_them(count):
    law = Diameters(min=1e-3, max=3e-3, a=2.0, b=3.0, count=count)
    each = law_diameters(count, law.min, law.max, law.a, law.b, 3)
    assert law_volume(law, 3) == pytest.approx(solid_volume(0.5 * each, 3), rel=1e-12 if count == 1000 else 1e-5)
