"""Rigid bodies: what moves them is what they do to the fluid."""

import math

import numpy as np
import pytest
from seldom import seldom
from sph_scenes import config, engine, jitter, layers, tank, text

import sph
from hpcpic.core.errors import ConfigError, Diverged
from sph.forecast.derived import derived
from sph.kernels.marks import MINE, OWN, WALL_SHIFT
from sph.setup.rigid.mass import angle_of, rigid_of, rotation, times, turning
from sph.setup.scene import Scene

BOX = "box = { low = [0.3, 0.4]; high = [0.7, 0.6]; };"


def body(shape=BOX, density=500.0, more="", name="raft", kind=""):
    return f"""{{ name = "{name}"; solid = true; {kind} shape = {{ {shape} }};
        body = {{ density = {density}; {more} }}; }}"""


def bodies(*every):
    return f"wall = ( {', '.join(every)} );"


def in_both(*cases):
    """Cases in double precision, and seldom in single."""
    return [
        way(*case, precision) for case in cases for way, precision in ((pytest.param, "double"), (seldom, "single"))
    ]


def total_momentum(sph):
    """Of fluid and bodies, [3], in physical axes."""
    storage, axes = sph.storage, list(sph.scene.axes)
    found = np.zeros(3)
    mine = storage.flags[: storage.end] & MINE == MINE
    found[axes] = (storage.v[:, : storage.end] * storage.m[: storage.end])[:, mine].sum(axis=1)
    return found + sum(wall.rigid.mass * state[7:10] for wall, state in zip(sph.bodies.of, sph.bodies.state))


@pytest.mark.parametrize("integrator", ["symplectic", "rk3-tvd"])
def test_fluid_and_bodies_keep_their_momentum(integrator):
    """Also where a body goes through a periodic side."""
    edge = "box = { low = [0.595, 0.4]; high = [0.995, 0.6]; };"
    moving = body(edge, more="velocity = [0.6, 0.2]; angular_velocity = [3.0];")
    sph = engine(spacing=0.05, fill=1.0, periodic=("x", "y"), gravity=(0.0, 0.0), pressure="zero",
                 more=bodies(moving), integrator=integrator)  # fmt: skip
    before = total_momentum(sph)
    for _ in range(80):
        sph.step()
    wall, state = sph.bodies.of[0], sph.bodies.state[0]
    assert np.abs(wall.rigid.mass * (state[7:9] - [0.6, 0.2])).max() > 0.5  # it has given some of it to the fluid
    assert np.abs(total_momentum(sph) - before).max() < 1e-12 * np.abs(before).max()
    x = sph.storage.physical("x")[sph.storage.own_values("wall") == 1]
    assert x[:, 0].min() < 0.05 and x[:, 0].max() > 0.95  # particles on both sides
    x[:, 0] += x[:, 0] < 0.5
    off = sph.walls.at_rest(wall, x)[:, None] - sph.bodies.outer[0]
    assert np.abs(off).max(axis=2).min(axis=1).max() < 1e-13  # which kept their places in the body


SOLIDS = {  # volume, centre, second moments along x, y, z over the mass, in m: exact
    "box = { low = [0.1, 0.2]; high = [0.5, 0.4]; }": (0.08, (0.3, 0.3, 0.0), (0.4**2 / 12, 0.2**2 / 12, 0.0)),
    "sphere = { centre = [0.5, 0.4]; radius = 0.12; }": (
        np.pi * 0.12**2, (0.5, 0.4, 0.0), (0.12**2 / 4, 0.12**2 / 4, 0.0)),
    "cylinder = { base = [0.1, 0.4]; top = [0.7, 0.4]; radius = 0.1; }": (
        0.12, (0.4, 0.4, 0.0), (0.6**2 / 12, 0.2**2 / 12, 0.0)),
    "box = { low = [0.1, 0.2, 0.3]; high = [0.5, 0.4, 0.6]; }": (
        0.024, (0.3, 0.3, 0.45), (0.4**2 / 12, 0.2**2 / 12, 0.3**2 / 12)),
    "sphere = { centre = [0.5, 0.4, 0.3]; radius = 0.2; }": (
        4 / 3 * np.pi * 0.2**3, (0.5, 0.4, 0.3), (0.2**2 / 5,) * 3),
    "cylinder = { base = [0.5, 0.4, 0.1]; top = [0.5, 0.4, 0.7]; radius = 0.1; }": (
        np.pi * 0.1**2 * 0.6, (0.5, 0.4, 0.4), (0.1**2 / 4, 0.1**2 / 4, 0.6**2 / 12)),
}  # fmt: skip


@pytest.mark.parametrize("text", SOLIDS)
def test_mass_and_inertia_of_shapes(text):
    volume, centre, moments = SOLIDS[text]
    wall = config(d=text.count(",") // text.count("[") + 1, more=bodies(body(f"{text};"))).wall[0]
    found = rigid_of(wall.shape, 500.0)
    assert found.mass == pytest.approx(500.0 * volume) and found.centre == pytest.approx(centre)
    expected = 500.0 * volume * (sum(moments) * np.eye(3) - np.diag(moments))
    np.testing.assert_allclose(found.inertia, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 0.4, 2.5])
def test_the_inertia_of_a_cylinder_turns_with_it(angle):
    ends = [(np.array([0.5, 0.5, 0.5]) + side * 0.3 * np.array([np.cos(angle), 0.0, np.sin(angle)])).tolist()
            for side in (-1, 1)]  # fmt: skip
    solid = f"cylinder = {{ base = {ends[0]}; top = {ends[1]}; radius = 0.1; }};"
    inertia = rigid_of(config(d=3, more=bodies(body(solid))).wall[0].shape, 1.0).inertia
    upright = SOLIDS[[*SOLIDS][-1]][2]
    turn = rotation(turning(np.array([0.0, np.pi / 2 - angle, 0.0])))
    expected = turn @ (sum(upright) * np.eye(3) - np.diag(upright)) @ turn.T
    np.testing.assert_allclose(inertia, np.pi * 0.1**2 * 0.6 * expected, atol=1e-12)


def test_rotations_follow_each_other():
    a, b = turning(np.array([0.3, -1.1, 0.4])), turning(np.array([-0.2, 0.5, 2.0]))
    assert np.allclose(rotation(times(a, b)), rotation(a) @ rotation(b), atol=1e-15)
    assert np.allclose(angle_of(a), [0.3, -1.1, 0.4]) and not angle_of(turning(np.zeros(3))).any()
    assert np.allclose(rotation(turning(np.array([0.0, 0.0, np.pi / 2]))) @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])


def test_a_body_falls_with_g_and_not_along_what_is_held():
    high = "box = { low = [0.3, 0.6]; high = [0.7, 0.8]; };"
    sph = engine(spacing=0.05, fill=(1.0, 0.3), more=bodies(body(high, more='velocity = [0.4, 0.0]; held = ["x"];')))
    for _ in range(10):
        sph.step()
    seen = sph.scalars()
    assert seen["velocity_raft_y"] == pytest.approx(-9.81 * sph.time, rel=1e-12) and seen["velocity_raft_x"] == 0.4
    assert seen["position_raft_x"] == pytest.approx(0.5 + 0.4 * sph.time) and seen["angle_raft_z"] == 0.0


def test_a_rotor_whose_motions_are_held_turns_at_its_speed_and_drives_the_fluid():
    rotor = body(more='angular_velocity = [3.0]; held = ["x", "y", "rz"];')
    sph = engine(spacing=0.05, fill=1.0, more=bodies(rotor))
    for _ in range(10):
        sph.step()
    seen = sph.scalars()
    assert (seen["velocity_raft_x"], seen["velocity_raft_y"], seen["spin_raft_z"]) == (0.0, 0.0, 3.0)
    assert seen["angle_raft_z"] == pytest.approx(3.0 * sph.time) and seen["position_raft_x"] == pytest.approx(0.5)
    assert abs(seen["torque_raft_z"]) > 0.0


def test_the_speed_of_sound_knows_how_fast_a_rotor_goes():
    """Its tips, 0.2236 m off, and those of one on a hinge, 0.4123 m off; or what a ball that spins has besides."""
    turning = text(fill=1.0, gravity=(0.0, 0.0), more="").replace("eos = { sound_speed = 20.0;", "eos = {")
    for more, shape, speed in (
        ('held = ["x", "y", "rz"];', BOX, 8.0 * math.hypot(0.2, 0.1)),
        ("hinge = { point = [0.3, 0.5]; };", BOX, 8.0 * math.hypot(0.4, 0.1)),
        ("velocity = [3.0, 0.0];", "sphere = { centre = [0.5, 0.5]; radius = 0.2; };", 4.6),
    ):
        case = config(turning + bodies(body(shape, more=f"angular_velocity = [8.0]; {more}")))
        found = {number.name: number for number in derived(case)}
        assert case.sound_speed == pytest.approx(10 * speed) and case.eos.max_velocity == pytest.approx(speed)
        assert found["sound speed over the speed of raft"].value == pytest.approx(10.0)
    slow = turning.replace("eos = {", "eos = { sound_speed = 20.0;")
    found = {number.name: number for number in derived(config(slow + bodies(body(more="angular_velocity = [40.0];"))))}
    assert found["sound speed over the speed of raft"].verdict == "warn"


def test_a_rotor_that_is_faster_than_sound_is_not_taken_for_fluid(caplog):
    """Fluid that is faster than both is told."""
    rotor = body(more='angular_velocity = [100.0]; held = ["x", "y", "rz"];')
    sph = engine(spacing=0.05, fill=1.0, more=bodies(rotor), sound=15.0)  # its outermost particles go at 19 m/s
    sph.step()
    assert "fluid at" not in caplog.text
    slot = sph.storage.fluid_slots[7]
    number = sph.storage.number(slot)
    sph.storage.v[0, slot] = 30.0
    sph.sort()
    with pytest.raises(Diverged, match=f"particle {number} at .* is faster than sound"):
        sph.step()


def test_a_body_sinks_to_the_floor_and_rests_there():
    """On the floor, or on water that it did not drive out: less than a spacing of it."""
    low = body("box = { low = [0.3, 0.1]; high = [0.7, 0.3]; };", density=1500.0)
    sph = engine(spacing=0.05, fill=(1.0, 0.5), more=bodies(tank()[9:-3], low))
    while sph.time < 1.5:
        sph.step()
    state = sph.bodies.state[0]
    assert -0.01 * 0.05 < state[1] - 0.1 < 0.05 and np.abs(state[7:9]).max() < 0.1


@pytest.mark.parametrize(
    ("wall", "told"),
    [
        (body(density=0.0), "greater than 0"),
        (body().replace("solid = true;", ""), r"solid = true, which fills .* wall\.motion .* a fluid\.acceleration"),
        (body(BOX.replace("; }", '; open = ["y+"]; }')), r"body: it is filled, .* no cup .* a fluid\.acceleration"),
        (body(kind='type = "repulsive";'), "extrapolated-free-slip"),
        (body(kind="motion = { velocity = [1.0, 0.0]; };"), "the wall has a motion"),
        (body(more="angular_velocity = [1.0, 2.0];"), "needs 1 in 2D"),
        (body(more="velocity = [1.0, 2.0, 3.0];"), "needs 2 numbers in 2D"),
        (body(more='held = ["rx"];'), "must be one of x, y, rz"),
        (body("plane = { point = [0.0, 0.0]; normal = [0.0, 1.0]; };"), "half-space"),
    ],
)
def test_what_can_be_no_body_is_refused(wall, told):
    with pytest.raises(ConfigError, match=told):
        config(more=bodies(wall))


def test_no_sensor_sits_in_a_body():
    gauge = """gauge = ( { name = "g"; what = "wall-pressure"; wall = "raft"; at = [0.5, 0.4]; axis = "y+"; } );"""
    with pytest.raises(ConfigError, match="raft is a body, which may turn"):
        config(more=bodies(body()) + gauge)


@pytest.mark.parametrize(("d", "smoothing", "precision"), in_both((2, 1.3), (2, 2.0), (3, 1.5)))
def test_a_film_of_water_bears_what_solids_press_on_each_other(d, smoothing, precision):
    """One layer of it between a body and the floor, a wall and another body, deep under water: the body has the lift of
    Archimedes and is drawn nowhere. Corners lack up to 3.4 % of it; of the pressures, a few times the lift, films alone
    bear as little as 0.8.
    """
    low, high = [0.3] * (d - 2) + [0.05], [0.6] * (d - 2) + [0.3]
    walls = tank(d, "extrapolated-free-slip")[9:-3]
    one = body(f"box = {{ low = {[0.05, *low]}; high = {[0.3, *high]}; }};")
    two = body(f"box = {{ low = {[0.35, *low]}; high = {[0.6, *high]}; }};", name="other")
    sph = engine(d=d, spacing=0.05, fill=(1.0,) * d, smoothing=smoothing, flux="delta", sound=60.0, precision=precision,
                 more=bodies(walls, one, two))  # fmt: skip
    forces = sph.wall_forces()
    lift = 9810.0 * 0.25**2 * 0.3 ** (d - 2)
    for name in ("raft", "other"):
        force = forces[name][0]
        assert force[d - 1] == pytest.approx(lift, rel=0.05)
        assert np.abs(force[: d - 1]).max() < 1e-3 * lift


@pytest.mark.parametrize(("low", "verdict"), [(0.05, "ok"), (0.0, "warn"), (0.03, "warn"), (-0.01, "fail")])
def test_bodies_start_apart(low, verdict):
    """In water by a layer of it, or they are told that the water presses them together."""
    shape = f"box = {{ low = [0.3, {low}]; high = [0.7, 0.25]; }};"
    other = body("box = { low = [0.3, 0.5]; high = [0.7, 0.7]; };", name="other")
    found = derived(config(text(more=bodies(tank()[9:-3], body(shape), other))))
    verdicts = {line.name: line.verdict for line in found if line.name.startswith("gap")}
    assert verdicts["gap between raft and tank"] == verdict
    assert verdicts["gap between other and raft"] == "ok"


@pytest.mark.parametrize(("density", "verdict"), [(30.0, "ok"), (10.0, "fail")])
def test_how_light_a_body_may_be(density, verdict):
    """The lightest that is legal is let go deep in the water: nothing is faster there than the surface is high."""
    deep = body("box = { low = [0.6, 0.4]; high = [0.8, 0.6]; };", density=density, more='held = ["x", "rz"];')
    walls = bodies(tank(size=(1.4, 1.6))[9:-3], deep)
    whole = text(size=(1.4, 1.6), fill=(1.4, 0.8), flux="delta", cfl=0.6, more=walls)
    assert {line.verdict for line in derived(config(whole)) if line.name.startswith("mass of raft")} == {verdict}
    if verdict == "ok":
        sph = engine(case=whole)
        for _ in range(100):
            sph.step()
        assert 0.0 < sph.bodies.state[0][8] < 4.0 < np.sqrt(2 * 9.81 * 0.9)


def turning_disc(density=1000.0, kind="extrapolated-no-slip", form="morris", fill=1.0, make=text, **settings):
    """The torque of the fluid on a disc that turns at 3 rad/s, that of its pair forces, which take hold at its surface
    if they are not along their line, and 2 mu w V.
    """
    disc = body("sphere = { centre = [0.5, 0.5]; radius = 0.25; };", more="angular_velocity = [3.0];",
                kind=f'type = "{kind}";')  # fmt: skip
    case = make(spacing=0.05, fill=fill, gravity=(0.0, 0.0), pressure="zero", more=bodies(disc), form=form,
                **{"viscosity": 4.0, "alpha": 0.0} | settings)  # fmt: skip
    sph = engine(case=case)
    force, torque = sph.wall_forces()["raft"]
    flags, key = sph.storage.flags[: sph.storage.end], sph.storage.key[: sph.storage.end]
    own = np.flatnonzero((flags & OWN > 0) & (key >> WALL_SHIFT == 1))
    axes = list(sph.scene.axes)
    pairs, x = np.zeros((2, len(own))), sph.storage.physical("x", own).T - 0.5
    pairs[axes] = sph.sums.forces_on(own)
    np.testing.assert_allclose(force, pairs.sum(axis=1), atol=1e-9)
    x *= 0.25 / np.sqrt(np.sum(x * x, axis=0)) if form == "morris" else 1.0
    return torque[2], float(np.sum(x[0] * pairs[1] - x[1] * pairs[0])), 2 * 4.0 * 3.0 * np.pi * 0.25**2


@pytest.mark.parametrize("precision", ["double", pytest.param("single", marks=pytest.mark.validation)])
def test_a_body_that_turns_in_fluid_has_the_torque_of_the_whole_traction(precision):
    """Pair forces along v_ij give mu dv/dn: all around a body -2 mu w V is missing, beside half of it half as much."""
    torque, pairs, whole = turning_disc(precision=precision)
    assert torque - pairs == pytest.approx(-whole, rel=1e-6)
    torque, pairs, whole = turning_disc(precision=precision, fill=(1.0, 0.5))
    assert torque - pairs == pytest.approx(-whole / 2, rel=0.1)


@pytest.mark.parametrize("settings", [{"form": "cleary"}, {"viscosity": 0.0, "form": "artificial", "alpha": 0.1}])
def test_pairs_that_push_along_their_line_miss_no_torque(settings):
    torque, pairs, whole = turning_disc(**settings)
    assert torque == pytest.approx(pairs, abs=1e-9 * whole)


@pytest.mark.parametrize(
    ("d", "form", "most"), [(2, "morris", 0.03), seldom(2, "full-stress", 0.1), seldom(3, "morris", 0.2)]
)
def test_fluid_that_turns_with_a_body_feels_none_of_its_friction(d, form, most):
    """The torque over 2 mu w V: 0 by theory. Measured -0.004 and 0.04 with 10 spacings of radius, in space -0.14
    with 5; -0.06, 0.04 and -0.24 where friction takes hold at the particles of the body, below its surface; 0.7, 0.8
    and 0.4 where the velocity of the wall is theirs too.
    """
    w = np.array([0.0, 0.0, 2.0] if d == 2 else [1.0, -2.0, 1.5])
    turns = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])[:d, :d]
    ball, around = ({"sphere": {"centre": [0.0] * d, "radius": radius}} for radius in (0.05, 0.12 if d == 2 else 0.09))
    case = sph.Case(
        simulation={"dimensions": d, "end_time": 1.0}, eos={"sound_speed": 3.0},
        domain={"low": [-0.2] * d, "high": [0.2] * d},
        numerics={"spacing": 0.005 if d == 2 else 0.01, "viscosity_form": form},
        fluid=[{"dynamic_viscosity": 1.0, "shape": around, "initial_pressure": "zero",
                "flow": {"type": "linear", "gradient": turns.ravel().tolist(), "centre": [0.0] * d}}],
        wall=[{"name": "ball", "solid": True, "type": "extrapolated-no-slip", "shape": ball,
               "body": {"density": 1000.0, "angular_velocity": w.tolist() if d == 3 else [2.0]}}],
    )  # fmt: skip
    with case.simulation(threads=1) as sim:
        sim.step()
        torque = np.array([float(sim.scalars().get(f"torque_ball_{a}", 0.0)) for a in "xyz"])
    volume = math.pi * 0.05**2 if d == 2 else 4 / 3 * math.pi * 0.05**3
    assert np.linalg.norm(torque) < most * 2 * volume * np.linalg.norm(w)


def test_the_torque_on_a_body_between_two_liquids_is_of_the_viscosity_of_both():
    def make(**more):
        return layers(viscosities=(4.0, 2.0), densities=(1000.0, 900.0), **more)

    torque, pairs, whole = turning_disc(make=make)
    assert torque - pairs == pytest.approx(-0.75 * whole, rel=0.05)


@pytest.mark.parametrize(("kind", "turned"), [("extrapolated-free-slip", False), ("extrapolated-no-slip", True)])
def test_fluid_that_slips_along_a_disc_does_not_turn_it(kind, turned):
    """Its particles are not quite round; pressure goes through its centre all the same."""
    disc = body("sphere = { centre = [0.52, 0.41]; radius = 0.17; };", kind=f'type = "{kind}";')
    sph = engine(fill=(1.0, 0.7), more=bodies(disc), viscosity=1.0 if turned else 0.0,
                 alpha=0.0 if turned else 0.1, form="morris" if turned else "artificial")  # fmt: skip
    jitter(sph)
    for _ in range(5):
        sph.step()
    assert (abs(sph.bodies.state[0, 12]) > 0.0) == turned


def pier(low, high, kind="extrapolated-free-slip", *others):
    """A solid that stays and whose force is measured, in a tank of the same kind."""
    return bodies(
        tank(len(low), kind)[9:-3],
        f"""{{ name = "pier"; type = "{kind}"; solid = true; measure_force = true;
        shape = {{ box = {{ low = {low}; high = {high}; }}; }}; }}""",
        *others,
    )


@pytest.mark.parametrize(("low", "told"), [(0.0, 0), (0.05, 1), (0.08, 1), (0.1, 0)])
def test_a_measured_solid_is_two_layers_from_others_or_touches_them(low, told):
    """Or its walls have the pressure of the fluid before them, and press on each other across it."""
    for kind, lines in (("pressure-continuity", told), ("extrapolated-no-slip", 0)):
        found = derived(config(smoothing=1.5, more=pier([0.3, low], [0.7, 0.4], kind)))
        assert [line.verdict for line in found if line.name.startswith("layers of fluid")] == ["warn"] * lines


@pytest.mark.parametrize(
    ("d", "smoothing", "gap", "precision"), in_both((2, 1.3, 1), (2, 2.0, 1), (2, 2.0, 2), (3, 1.5, 1))
)
def test_solids_that_stay_press_on_each_other_across_a_film(d, smoothing, gap, precision):
    """A measured one has the lift of Archimedes over one or two layers of water; it had -0.8 to 0.85 of it."""
    low = [0.3] * (d - 1) + [0.05 * gap]
    sph = engine(d=d, spacing=0.05, fill=(1.0,) * d, smoothing=smoothing, flux="delta", sound=60.0, precision=precision,
                 more=pier(low, [0.7] * (d - 1) + [low[-1] + 0.3]))  # fmt: skip
    force = sph.wall_forces()["pier"][0]
    lift = 9810.0 * 0.4 ** (d - 1) * 0.3
    assert force[-1] == pytest.approx(lift, rel=0.05)
    assert np.abs(force[:-1]).max() < 1e-3 * lift


def test_solids_that_stay_and_touch_press_as_one():
    """A pier over a layer of water and what lies on it have the lift of Archimedes: it saw the one, not the water. A
    body that is held on the floor is pressed down by the water above it; half of that was lifted by no film.
    """
    kind, held = 'type = "extrapolated-free-slip";', 'held = ["x", "y", "rz"];'
    on_pier = body("box = { low = [0.3, 0.2]; high = [0.7, 0.35]; };", more=held, kind=kind)
    on_floor = body("box = { low = [0.3, 0.0]; high = [0.7, 0.3]; };", more=held, kind=kind)
    walls = tank(2, "extrapolated-free-slip")[9:-3]
    for more, force in (
        (pier([0.3, 0.05], [0.7, 0.2], "extrapolated-free-slip", on_pier), 9810.0 * 0.4 * 0.3),
        (bodies(walls, on_floor), -9810.0 * 0.4 * 0.7),
    ):
        sph = engine(d=2, spacing=0.05, fill=(1.0, 1.0), smoothing=1.3, flux="delta", sound=60.0, more=more)
        found = sum(one[0] for name, one in sph.wall_forces().items() if name != "tank")
        assert found[1] == pytest.approx(force, rel=0.05)  # as of one solid over a layer
        assert abs(found[0]) < 1e-3 * abs(force)


def test_a_solid_that_touches_another_does_not_press_on_it():
    """No fluid gets between them. Nor does one farther than its particles see."""
    for low, presses in ((0.0, False), (0.05, True), (0.1, False)):
        assert [wall.presses for wall in Scene(config(more=pier([0.3, low], [0.7, 0.4]))).walls] == [False, presses]
