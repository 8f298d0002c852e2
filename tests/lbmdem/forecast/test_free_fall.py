"""What check tells of gravity and body forces: falls that nothing holds, and grains too fast for their lattice."""

import math
import re

import numpy as np
import pytest
from app_runner import running
from lattice_scenes import SPHERE

from hpcpic.core.case import accelerations
from hpcpic.core.case.config import loads
from hpcpic.core.physics.contact_law import deepest_overlap
from lbmdem.case.config import contact_law
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived
from lbmdem.forecast.free_fall import drag_coefficient, terminal_speed

DROP = """
simulation = { end_time = 2.0; };
domain = { size = [0.016, 0.016]; spacing = 5.0e-4; periodic = ["x", "y"]; };
fluid = { density = 1000.0; viscosity = 1.0e-5; relaxation_time = 0.6; };
grains = ({ diameter = 5.0e-3; density = 1200.0; position = [0.008, 0.008]; });
gravity = [0.0, -1.0];
"""
DRY = """
simulation = { end_time = 1.0; };
domain = { size = [0.016, 0.016]; periodic = ["y"]; };
grains = ({ diameter = 5.0e-3; density = 1200.0; position = [0.008, 0.008]; });
contact = { friction = 0.5; };
gravity = [0.0, -1.0];
"""


def config_of(text, *sets):
    return configure(loads(text, sets=sets))


def number(text, name, *sets):
    return next((one for one in derived(config_of(text, *sets)) if one.name == name), None)


def fall(text, *sets):
    return number(text, "speed at the end along y", *sets)


def test_the_speed_of_a_box_that_nothing_holds_is_that_of_its_momentum():
    """Weight less buoyancy over the mass of grain and fluid; a force that balances it is not told."""
    told, disc = fall(DROP), math.pi / 4.0 * 5.0e-3**2
    assert told.verdict == "warn" and told.key == ("gravity",)
    mass = 1000.0 * (0.016**2 - disc) + 1200.0 * disc
    assert told.value == pytest.approx(200.0 * disc * 1.0 * 2.0 / mass, rel=1e-12)
    balance = float(told.cure.split("fluid.body_force of ")[1].split()[0])
    assert balance == pytest.approx(0.2 * disc / 0.016**2, rel=1e-5)  # it pulls at the grain too
    assert fall(DROP, f"fluid.body_force=[0.0, {balance!r}]").verdict == "ok"
    assert fall(DROP, "simulation.end_time=0.02").verdict == "ok"  # it does not get far


def test_a_box_that_drifts_beside_a_grain_that_settles_is_told():
    """Within a box's length, too: the speed of the grain that one reads has that of the box in it."""
    sets = "simulation.end_time=0.1", "fluid.viscosity=2.0e-4"
    for told, viscosity in ((fall(DROP, *sets), 2.0e-4), (fall(DROP, sets[0]), 1.0e-5)):
        share = told.value / terminal_speed(config_of(DROP, f"fluid.viscosity={viscosity}"), 0)
        assert 0.5 * told.value * 0.1 < 0.016 and f"{share:.2g} of the speed of a lone grain" in told.source
        assert told.verdict == ("warn" if share > 0.25 else "ok") == ("warn" if viscosity > 1e-5 else "ok")
    told = fall(DROP, *sets)
    balance = told.cure.split("fluid.body_force of ")[1].split()[0]
    assert fall(DROP, *sets, f"fluid.body_force=[0.0, {balance}]").verdict == "ok"


def test_the_balance_that_is_told_keeps_the_momentum_of_a_run(world):
    """The box as a whole stays at rest, to a hundredth of what it would have without the balancing force."""
    balance = float(fall(DROP).cure.split("fluid.body_force of ")[1].split()[0])
    sets = f"fluid.body_force=[0.0, {balance!r}]", 'coupling.refill="conserving"'
    with running(world, "lbmdem", DROP, sets) as app:
        for _ in range(100):
            app.step()
        momentum = app.scalars()["momentum_y"] + app.table.mass[0] * app.dem.grains.v[0, 1]
        unbalanced = 200.0 * math.pi / 4.0 * 5.0e-3**2 * 1.0 * app.time
        assert abs(momentum) < 0.01 * unbalanced


@pytest.mark.parametrize(
    "held",
    ['domain.periodic=["y"]', "gravity=[0.0, 0.0]", "grains[0].moving=false",
     'domain.periodic=["x"]'],
)  # fmt: skip
def test_what_has_walls_or_fixed_grains_to_pull_against_is_not_told(held):
    assert fall(DROP, held) is None


def test_a_fluid_alone_that_nothing_holds_is_told():
    driven = DROP.replace("gravity = [0.0, -1.0];", "").split("grains")[0]
    told = fall(driven, "fluid.body_force=[0.0, 0.5]")
    assert told.verdict == "warn" and told.value == pytest.approx(0.5 * 2.0) and told.key == ("fluid", "body_force")


def test_without_fluid_walls_hold_by_friction():
    assert fall(DRY) is None
    told = fall(DRY, "contact.friction=0.0")
    assert told.verdict == "warn" and told.value == pytest.approx(1.0) and "body_force" not in told.cure


def test_the_terminal_speed_balances_weight_and_drag():
    """From Stokes's fall to the constant drag coefficient, far from walls."""
    for viscosity in 10.0 ** np.arange(-9.0, 2.0):
        config = config_of(SPHERE, f"fluid.viscosity={viscosity}", 'domain.periodic=["x", "y"]')
        v, pull = terminal_speed(config, 0), 9.81 * (1120.0 / 960.0 - 1.0)
        drag = drag_coefficient(v * 0.015 / viscosity)
        assert drag * v * v == pytest.approx(4.0 / 3.0 * 0.015 * pull, rel=1e-6)
    assert v == pytest.approx(pull * 0.015**2 / 18.0 / viscosity, rel=1e-3)


def test_a_sphere_too_fast_for_four_nodes_is_told():
    """Re = 1e6, whatever the time step: refused with TRT, and told of where central moments stay stable."""
    sets = ("domain.spacing=0.004", "fluid.viscosity=3.8e-9", "fluid.relaxation_time=0.5000001")
    sets += ("domain.size=[0.1, 0.1, 0.16]",)
    name, layer = "grid Reynolds number of a lone grain", "boundary layer of a lone grain"
    assert number(SPHERE, name).verdict == number(SPHERE, layer).verdict == "ok"
    told = number(SPHERE, name, *sets)
    assert told.verdict == "fail" and told.forceable and 2e5 < told.value < 4e5
    central = (*sets, 'fluid.collision="central"')
    assert number(SPHERE, name, *central).verdict == "ok" and number(SPHERE, layer, *central).verdict == "warn"


@pytest.mark.parametrize(("stiffness", "verdict"), [(100.0, "ok"), (1e6, "ok"), (1e15, "fail")])
def test_substeps_that_take_longer_than_all_else_are_told_with_what_they_take(stiffness, verdict):
    told = number(SPHERE, "substeps of the contacts", f"contact.normal_stiffness={stiffness}")
    assert told.verdict == verdict and told.forceable
    assert bool(told.source) == (told.value > 1000) and bool(told.cure) == (verdict == "fail")
    if told.source:
        softer = told.source.split("normal_stiffness = ")[1].split()[0]
        fewer = number(SPHERE, "substeps of the contacts", f"contact.normal_stiffness={softer}")
        assert fewer.value == pytest.approx(1000, rel=0.03) and " s of a step" in told.source


def test_a_softer_stiffness_tells_the_overlaps_that_it_makes():
    told = number(SPHERE, "substeps of the contacts", "contact.normal_stiffness=1e6")
    softer, rest = (float(told.source.split(f"{w} ")[1].split()[0].rstrip(";")) for w in ("stiffness =", "rest to"))
    found = number(SPHERE, "overlap at rest", f"contact.normal_stiffness={softer}")
    assert found.value == pytest.approx(rest, rel=0.05)
    assert "% of it" in told.source


SILO = """
simulation = { end_time = 1.0; };
domain = { size = [0.012, 0.1]; };
grains = ({ diameters = { min = 0.9e-3; max = 1.1e-3; count = COUNT; }; packing = { }; });
contact = { friction = 0.5; };
gravity = [0.0, -9.81];
"""


@pytest.mark.parametrize(("count", "low"), [(900, 0.0), (900, 0.001), (1000, 0.0)])
def test_the_porosity_that_is_told_for_a_packing_beyond_its_box_fits_and_less_is_not_needed(count, low):
    text = SILO.replace("COUNT", str(count)).replace("packing = { }", f"packing = {{ porosity = 0.5; low = {low}; }}")
    told = number(text, "top of grains_1")
    fits = float(re.search(r"porosity = (\S+) has room for its (\d+) grains", told.cure)[1])
    at = [number(text, "top of grains_1", f"grains[0].packing.porosity={fits + more}").verdict for more in (0.0, 0.001)]
    assert told.verdict == "fail" and at == ["ok", "fail"]


def test_a_packing_between_walls_that_would_carry_it_is_no_silo_at_rest():
    """Janssen: of a low heap the floor bears all, of a tall one what a screening length weighs."""
    name = "weight of grains_1 on its floor"
    low, tall, endless = (number(SILO.replace("COUNT", str(n)), name) for n in (20, 2000, 4000))
    assert (low.verdict, tall.verdict) == ("ok", "warn") and low.value > 0.95
    assert endless.value / tall.value == pytest.approx(0.5, rel=0.01)
    for sets in (("contact.friction=0.0",), ('domain.periodic=["x"]',)):
        assert number(SILO.replace("COUNT", "400"), name, *sets) is None


def test_a_silo_is_as_wide_as_planes_leave_it_and_as_high_as_its_grains_settle():
    name = "weight of grains_1 on its floor"
    text = SILO.replace("COUNT", "400").replace("0.1]", "1.0]")
    bare = number(text, name).value
    assert number(text, name, "grains[0].packing.porosity=0.8").value == pytest.approx(bare)
    plane = "{ shape = { plane = { point = [%g, 0.0]; normal = [%g, 0.0]; }; }; }"
    planes = f"obstacle=({plane % (0.002, 1.0)}, {plane % (0.014, -1.0)})"
    assert number(text, name, "domain.size=[0.016, 1.0]", planes).value == pytest.approx(bare)


@pytest.mark.parametrize("text", [DRY.replace('["y"]', '["x"]'), SPHERE + "coupling = { lubrication = false; };"])
def test_contacts_are_as_stiff_as_the_fall_of_a_grain_needs(text):
    """An impact over a tenth of a diameter ends a run: the check knows it and what is stiff enough."""
    soft = "contact.normal_stiffness=0.05"
    told = number(text, "overlap at impact", soft)
    assert told.verdict == "fail" and told.forceable
    stiffness = float(told.cure.partition(" = ")[2].split()[0])
    assert number(text, "overlap at impact", f"contact.normal_stiffness={1.1 * stiffness}") is None
    assert number(text, "overlap at impact", f"contact.normal_stiffness={0.8 * stiffness}").verdict == "warn"


def test_nothing_falls_far_along_a_periodic_side():
    assert number(DRY, "overlap at impact", "contact.normal_stiffness=0.05") is None


def test_a_grain_without_weight_meets_what_its_speed_at_the_start_takes_it_to(monkeypatch):
    """A wall or a grain that stays; nothing where there is neither. On one that has an acceleration of the user's own
    it is told and refuses nothing: who knows its way?
    """
    monkeypatch.setitem(accelerations.ACCELERATIONS, "sun", lambda x, v, t: (-x[0], -x[1], 0.0))
    soft = "contact.normal_stiffness=0.05", "gravity=[0.0, 0.0]", "grains[0].velocity=[0.5, 0.1]"
    name, alone = "overlap at impact", ('domain.periodic=["x", "y"]',)
    told = number(DRY, name, *soft)
    assert told.verdict == "fail" and "its speed at the start" in told.source and "free fall" not in told.source
    assert number(DRY, name, *soft, *alone) is None
    two = "grains[0].position=([0.004, 0.008], [0.012, 0.008])"
    assert number(DRY, name, *soft, *alone, two) is None
    stays = "diameter = 1.0e-3; position = [0.012, 0.008]; moving = false;"
    assert number(DRY.replace("});", f"}}, {{ {stays} }});", 1), name, *soft, *alone).verdict == "fail"
    own = number(DRY, name, *soft, 'grains[0].acceleration="sun"')
    assert own.verdict == "warn" and own.value == told.value


def test_a_grain_falls_to_the_plane_below_it_and_not_beyond_the_end():
    """The impact is that of the speed with which it gets there; a run that ends before has none."""
    text, name = DRY.replace('["y"]', '["x"]'), "overlap at impact"
    soft = "contact.normal_stiffness=0.05"
    plane = "obstacle=({ shape = { plane = { point = [0.0, LOW]; normal = [0.0, 1.0]; }; }; })"
    mass, radius = 1200.0 * math.pi / 4.0 * 5.0e-3**2, 2.5e-3
    for low, height in ((3.0e-3, 2.5e-3), (-1.0, 5.5e-3), (9.0e-3, 5.5e-3)):  # the floor; the grain is beyond it
        told = number(text, name, soft, plane.replace("LOW", str(low)))
        deepest = deepest_overlap(math.sqrt(2.0 * height), mass, contact_law(config_of(text, soft)))
        assert told.value == pytest.approx(deepest / (2.0 * radius), rel=1e-12)
    arrives = math.sqrt(2.0 * 5.5e-3)
    assert number(text, name, soft, f"simulation.end_time={0.99 * arrives}") is None
    assert number(text, name, soft, f"simulation.end_time={1.01 * arrives}").verdict == "fail"


def given(folder, velocities, more=""):
    """Grains side by side in a box without gravity or walls along x, with these velocities from a file of arrays."""
    n = len(velocities)
    places = [[0.004 + 0.008 * i / n, 0.008] for i in range(n)]
    np.savez(folder / "grains.npz", position=places, diameter=np.full(n, 5e-4), velocity=velocities)
    start = f'start = {{ file = "{folder / "grains.npz"}"; }};'
    text = DRY.replace("[0.0, -1.0]", "[0.0, 0.0]").replace('["y"]', '["x"]')
    return re.sub(r"diameter.*position = [^;]*;", f"density = 1200.0; {start} {more}", text)


def test_a_grain_whose_velocity_an_array_gives_meets_the_floor_with_it(tmp_path):
    """Each with its own: the fast one below, the slow one above."""
    soft, name = "contact.normal_stiffness=0.5", "overlap at impact"
    text = given(tmp_path, [[0.0, -0.1]], "velocity = [0.0, 5.0];")  # which the array overrides
    law, mass = contact_law(config_of(text, soft)), 1200.0 * math.pi / 4.0 * 5.0e-4**2
    told = number(text, name, soft)
    assert told and told.value == pytest.approx(deepest_overlap(0.1, mass, law) / 5.0e-4, rel=1e-12)
    np.savez(tmp_path / "grains.npz", position=[[0.004, 0.001], [0.008, 0.004]], diameter=[5e-4] * 2,
             velocity=[[0.0, -0.1], [0.0, -0.05]])  # fmt: skip
    speed = math.hypot(0.1, math.sqrt(2.0 * (0.001 - 2.5e-4)))
    fall = number(text, name, soft, "gravity=[0.0, -1.0]")
    assert fall.value == pytest.approx(deepest_overlap(speed, mass, law) / 5.0e-4, rel=1e-12)


PAIR = """
simulation = { end_time = 0.05; };
domain = { size = [0.03, 0.01]; periodic = ["x"]; };
grains = ({ diameter = 2.0e-3; position = [0.01, 0.005]; velocity = [0.2, 0.0]; },
          { diameter = OTHER; position = [0.013, 0.005]; velocity = [SPEED, 0.0]; });
contact = { friction = 0.0; damping = 0.1; normal_stiffness = 5.0e4; };
"""


@pytest.mark.parametrize(("other", "speed"), [(2.0e-3, -0.2), (2.0e-3, 0.0), (1.0e-3, -0.6)])
def test_two_grains_meet_as_deep_as_is_told(world, other, speed):
    """With the reduced mass and both velocities: equal ones sqrt(2) times as deep as a wall."""
    text = PAIR.replace("OTHER", str(other)).replace("SPEED", str(speed))
    stiff, name, deepest = "contact.normal_stiffness=2.0e5", "overlap at impact", 0.0
    told = [one.value for one in derived(config_of(text, stiff)) if one.name == name][-1]
    with running(world, "lbmdem", text, (stiff,)) as app:
        while app.time < 0.03:
            app.step()
            deepest = max(deepest, app.scalars()["overlap"])
    assert told == pytest.approx(deepest, rel=0.01)


def test_grains_that_fall_alike_meet_floors_only(tmp_path):
    """And those of arrays each other, by the largest difference of their velocities."""
    soft, name, mass = "contact.normal_stiffness=0.5", "overlap at impact", 1200.0 * math.pi / 4.0 * 5.0e-4**2
    law = contact_law(config_of(given(tmp_path, [[0.0, 0.0]]), soft))
    angles = np.linspace(0.0, 2.0 * math.pi, 40, endpoint=False)
    for velocities, speed, reduced in (
        (np.full((40, 2), 0.1), math.hypot(0.1, 0.1), mass),
        (0.1 * np.stack([np.cos(angles), np.sin(angles)], axis=1), 0.2, 0.5 * mass),
        ([[0.1, 0.0], [0.0, 0.0], [0.08, 0.01]], 0.1, mass),
    ):
        told = number(given(tmp_path, velocities), name, soft)
        assert told.value == pytest.approx(deepest_overlap(speed, reduced, law) / 5.0e-4, rel=0.03)


def test_velocities_that_arrays_give_are_the_largest_of_a_scene(tmp_path):
    """Of the centres, and of a surface that turns."""
    start = f'start = {{ file = "{tmp_path / "grains.npz"}"; }};'
    text, name = DROP.replace("diameter = 5.0e-3;", f"diameter = 5.0e-3; {start}"), "Mach number"
    mach = number(text.replace(start, "velocity = [0.0, 0.003];"), name).value
    for key, values in (("velocity", [[0.0, 0.003]]), ("angular_velocity", [[0.003 / 2.5e-3]])):
        np.savez(tmp_path / "grains.npz", **{key: values})
        assert number(text, name).value == pytest.approx(mach, rel=1e-12)


ROW = """
simulation = { end_time = 0.3; };
domain = { size = [0.03, 0.06]; };
grains = ({ density = 2650.0; diameter = 1.0e-3; position = (PLACES); });
contact = { normal_stiffness = 4000.0; };
gravity = [0.0, -9.81];
"""


@pytest.mark.parametrize(("rows", "layers"), [(1, 1.0), (10, 10.0)])
def test_grains_side_by_side_do_not_lie_on_each_other(rows, layers):
    """The overlap at rest is that of the weight of those that stand on each other, here in 20 columns of discs."""
    places = ", ".join(f"[{1e-3 + 1.4e-3 * i}, {5e-4 + 1.1e-3 * k}]" for i in range(20) for k in range(rows))
    text = ROW.replace("PLACES", places)
    weight = 2650.0 * math.pi / 4.0 * 1e-6 * 9.81
    assert number(text, "overlap at rest").value == pytest.approx(layers * weight / 4000.0 / 1e-3, rel=1e-9)
    for stiffness, forceable in ((100.0 * layers, True), (layers, False)):
        soft = number(text, "overlap at rest", f"contact.normal_stiffness={stiffness}")
        assert (soft.verdict, soft.forceable) == ("fail", forceable)


def test_a_pile_whose_friction_is_a_viscosity_creeps_as_its_load_time_and_viscosity_say():
    """200 discs fill 6.5 layers of the floor, less than the 8.9 of their heap; a row of 3 is no pile."""
    places = [[1e-3 + 1.4e-3 * i, 5e-4 + 1.1e-3 * k] for i in range(20) for k in range(10)]
    text, name = ROW.replace("PLACES", ", ".join(map(str, places))), "creep of grains_1 in a pile"
    beta, high = 0.05, math.sqrt(200 * math.pi / 4.0 * 0.4 / 0.8)
    told = number(text, name, f"contact.tangential_viscosity={beta}")
    weight = 2650.0 * math.pi / 4.0 * 1e-6 * 9.81
    assert told.value == pytest.approx(0.5 * high * weight / beta * 0.3 / 1e-3, rel=1e-9) and told.verdict == "warn"
    assert number(text, name, f"contact.tangential_viscosity={told.value * beta}").verdict == "ok"
    for sets in (("simulation.end_time=0.6",), ("gravity=[0.0, -19.62]",), ("contact.friction=1.0",)):
        twice = number(text, name, *sets, f"contact.tangential_viscosity={2.0 * beta}")
        assert twice.value == pytest.approx(told.value, rel=1e-9)
    for sets in (('contact.tangential="history"',), ("contact.friction=0.0",), ("gravity=[0.0, 0.0]",)):
        assert number(text, name, *sets) is None
    assert number(ROW.replace("PLACES", ", ".join(map(str, places[:30:10]))), name) is None


HOPPER = """
simulation = { end_time = 0.5; };
domain = { size = [0.01, 0.08]; };
grains = ({ diameters = { min = 0.9e-3; max = 1.1e-3; count = 100; }; packing = { porosity = 0.25; low = 0.0406; }; },
          { moving = false; diameter = 1.0e-3; position = (PLACES); });
contact = { normal_stiffness = 2.0e4; };
gravity = [0.0, -9.81];
"""


def test_the_deepest_contacts_of_a_bed_are_told_beside_the_mean():
    """Of several layers alone: one has no chains of forces."""
    name = "deepest overlap at rest"
    bed = SILO.replace("COUNT", "200")
    mean, deep = number(bed, "overlap at rest"), number(bed, name)
    assert "in the mean" in mean.source and deep.value == pytest.approx(4.0 * mean.value) and deep.verdict == "ok"
    assert number(SILO.replace("COUNT", "5"), name) is None and number(SPHERE, name) is None


@pytest.mark.parametrize("missing", [(), (4,), (4, 5, 6)])
def test_a_packing_falls_through_the_hole_of_a_hopper(missing):
    """And not past fixed grains without a gap. Where one is missing the smallest grains have room."""
    places = ", ".join(f"[{1e-3 * (k + 0.5)}, 0.04]" for k in range(10) if k not in missing)
    text = HOPPER.replace("PLACES", places)
    told = number(text, "overlap at impact")
    assert (number(text, "weight of grains_1 on its floor") is None) == bool(missing)  # no silo with an open floor
    if not missing:
        assert told.value < 0.06  # a fall of 0.24e-3 onto two of them, and 0.66e-3 of its top as it settles
        return
    law = contact_law(config_of(text))._replace(damping=0.0)
    top = next(one for one in derived(config_of(text)) if one.name == "top of grains_1").value
    speed = math.sqrt(2.0 * 9.81 * (0.0406 + (top - 0.0406) * (1.0 - 0.75 / 0.8)))
    assert told.verdict == "fail"
    mass = 2650.0 * math.pi / 4.0 * 1.1e-3**2
    assert told.value == pytest.approx(deepest_overlap(speed, mass, law) / 1.1e-3, rel=1e-6)


CHANNEL = """
simulation = { end_time = 100.0; };
domain = { size = [4.0e-3, 2.0e-3]; spacing = 1.0e-4; periodic = ["x"]; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-6; relaxation_time = 0.8; body_force = [0.1, 0.0]; };
"""


@pytest.mark.parametrize(
    ("sets", "speed"),
    [
        ((), 0.1 * 2.0e-3**2 / 8.0e-6),  # the parabola
        (("simulation.end_time=0.2",), 0.1 * 0.2),  # which is not reached
        (('domain.periodic=["x", "y"]', "simulation.end_time=2.0"), 0.1 * 2.0),
        (('domain.periodic=["y"]',), None),  # walls across the force
        (("obstacle=({shape={box={low=[1.0e-3,0.0];high=[2.0e-3,1.0e-3];};};})",), None),
    ],
)
def test_the_speed_that_a_body_force_makes_is_told(sets, speed):
    told = number(CHANNEL, "speed that the body force makes", *sets)
    assert (told and told.value) == (speed and pytest.approx(speed, rel=1e-12))


def test_of_a_force_past_solids_that_stay_the_limit_without_them_is_told():
    """Past a bar or a pin that a channel leaves room beside; who asks for far too much is warned, not refused."""
    bar = "obstacle=({shape={box={low=[1.0e-3,0.0];high=[2.0e-3,1.0e-3];};};})"
    name, mach = "largest speed that the body force can make", "Mach number of the driven fluid, at most"
    for text, sets in ((CHANNEL, (bar,)), (GAUGED, ())):
        assert number(text, name, *sets).value == pytest.approx(0.1 * 2.0e-3**2 / 8.0e-6, rel=1e-12)
        assert number(text, mach, *sets).verdict == "warn"
        assert number(text, mach, *sets, "fluid.body_force=[0.02, 0.0]").verdict == "ok"
        assert number(text, mach, *sets, "fluid.body_force=[100.0, 0.0]").verdict == "warn"
    assert number(CHANNEL, name) is number(CHANNEL, name, bar, 'domain.periodic=["y"]') is None


def sheet(share, a, nu=1.0e-6):
    """Discs of 1 mm in a square array, in which they take this share of the area; driven by a."""
    side = math.sqrt(math.pi / 4.0 / share) * 1.0e-3
    return (
        CHANNEL.split("domain")[0]
        + f"""
domain = {{ size = [{side!r}, {side!r}]; spacing = {side / 24!r}; periodic = ["x", "y"]; }};
fluid = {{ kinematic_viscosity = {nu!r}; relaxation_time = 1.0; body_force = [0.0, {a!r}]; }};
grains = ({{ diameter = 1.0e-3; moving = false; position = [{0.5 * side!r}, {0.5 * side!r}]; }});
"""
    )


@pytest.mark.parametrize(
    ("share", "a", "measured"),  # largest speeds of runs with 12 nodes across a disc, m/s; Re 11, 2, 37, 38
    [(0.01, 1.0e-3, 0.01079), (0.5, 0.1, 0.00203), (0.05, 0.03, 0.0374), (0.2, 0.2, 0.0376)],
)
def test_the_speed_past_grains_is_at_most_what_is_told_and_not_far_below(share, a, measured):
    name = "largest speed that the body force can make"
    told, harder, thicker = (number(sheet(*at), name).value for at in ((share, a), (share, 2 * a), (share, a, 2.0e-6)))
    assert measured < told < 8.0 * measured and thicker <= told < harder


ROD = """
simulation = {{ end_time = 0.02; }};
domain = {{ size = [{side!r}, {side!r}]; spacing = {spacing!r}; periodic = ["x", "y"]; }};
fluid = {{ kinematic_viscosity = 1.0e-6; body_force = [0.0, 0.01]; }};
grains = ({{ diameter = 1.0e-4; moving = false; position = [{middle!r}, {middle!r}]; }});
"""


@pytest.mark.parametrize(
    ("share", "nodes", "measured"),  # time in which runs come to 1 - 1/e of their permeability, s
    [(0.05, 48, 0.01281), (0.3, 19, 5.80e-4)],
)
def test_a_run_that_ends_before_its_flow_is_steady_is_told(share, nodes, measured):
    """By the time in which the drag of the grains stops a fluid, whatever drives it."""
    side, name = 1.0e-4 * math.sqrt(math.pi / 4.0 / share), "end over the time to a steady flow"
    text = ROD.format(side=side, spacing=side / nodes, middle=0.5 * side)
    told = number(text, name)
    assert 0.8 * measured < 0.02 / told.value < 3.0 * measured
    long_enough = told.cure.partition("end_time = ")[2] or "0.02"
    assert told.verdict == ("warn" if share < 0.1 else "ok")
    assert number(text, name, f"simulation.end_time={1.01 * float(long_enough)}").verdict == "ok"
    assert number(text, name, "fluid.body_force=[0.0, 0.005]").value == pytest.approx(told.value, rel=1e-3)
    along = number(text, name, "fluid.body_force=[0.01, 0.0]")
    assert along.value == told.value and ("along x" in along.cure) == (along.verdict == "warn")
    assert number(text, name, "fluid.body_force=[0.01, 0.0]", 'domain.periodic=["y"]') is None


def test_a_body_force_that_makes_the_fluid_too_fast_is_refused():
    """Its Mach number is that of the parabola, and the relaxation time that is told mends it."""
    name = "Mach number of the driven fluid"
    slow, fast = (number(CHANNEL, name, f"fluid.body_force=[{a}, 0.0]") for a in (0.04, 5.0))
    assert (slow.verdict, fast.verdict, fast.forceable) == ("warn", "fail", True)
    assert slow.value == pytest.approx(0.02 * 1e-3 / 1e-4 * math.sqrt(3.0), rel=1e-12)
    tau = fast.cure.split("relaxation_time = ")[1]
    assert number(CHANNEL, name, "fluid.body_force=[5.0, 0.0]", f"fluid.relaxation_time={tau}").verdict == "ok"


GAUGED = (
    CHANNEL
    + """
gauge = ({ what = "pressure"; at = [2.0e-3, 1.0e-3]; });
grains = ({ name = "pin"; diameter = 6.0e-4; moving = false; position = [2.0e-3, 1.2e-3]; });
"""
)


def test_a_gauge_in_a_grain_is_told():
    name = "gauge_1 in pin"
    assert number(GAUGED, name).verdict == "warn" and number(GAUGED, name).key == ("gauge", 0, "at")
    for apart in ("gauge[0].at=[1.0e-3, 1.0e-3]", "gauge[0].size=[0.0, 2.0e-3]"):
        assert number(GAUGED, name, apart) is None
    box = 'obstacle=({name="bar";shape={box={low=[1.5e-3,0.0];high=[2.5e-3,1.1e-3];};};})'
    assert number(GAUGED, "gauge_1 in bar", box).verdict == "warn"


def test_a_velocity_of_a_grain_that_stays_is_told():
    name, sets = "velocity of pin, which stays", "grains[0].velocity=[0.01, 0.0]"
    assert number(GAUGED, name, sets).verdict == "warn" and number(GAUGED, name) is None
    assert number(GAUGED, name, sets, "grains[0].moving=true") is None


BELT = 'obstacle=({{ name = "belt"; shape = {{ box = {{ low = [{}]; high = [{}]; }}; }}; velocity = [0.01, 0.0]; }})'


@pytest.mark.parametrize(
    ("low", "high", "sets", "told"),
    [
        ("-1.0e-3, 0.0", "3.0e-3, 5.0e-4", (), None),  # once around
        ("0.0, 0.0", "4.0e-3, 5.0e-4", ("domain.periodic=[]",), None),  # from wall to wall
        ("0.0, 0.0", "3.0e-3, 5.0e-4", (), "warn"),
        ("0.0, 0.0", "3.0e-3, 5.0e-4", ("domain.periodic=[]",), "warn"),
        ("1.0e-3, 0.0", "4.0e-3, 5.0e-4", ("domain.periodic=[]",), "warn"),
    ],
)
def test_a_box_whose_surface_moves_through_a_face_that_the_fluid_meets_is_told(low, high, sets, told):
    """It takes in fluid behind and gives it out in front; one such face alone changed the mean density by 10 %."""
    found = number(CHANNEL, "velocity through belt", BELT.format(low, high), *sets)
    assert (found and found.verdict) == told
