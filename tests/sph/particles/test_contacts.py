"""Rigid bodies that strike each other and walls, hang on lines and turn on hinges: laws of mechanics, without fluid."""

import math
import subprocess
import sys

import numpy as np
import pytest
from app_runner import environment
from seldom import seldom
from sph_scenes import by_id, config, engine, text

from hpcpic.core.errors import ConfigError, Diverged
from sph.setup.rigid.mass import rotation

DP = 0.02
FLOOR = '{ name = "floor"; shape = { plane = { point = [0.0, 0.0]; normal = [0.0, 1.0]; }; }; }'
UNDER = {2: FLOOR, 3: FLOOR.replace("0.0];", "0.0, 0.0];").replace("1.0]", "1.0, 0.0]")}
BOX = "box = { low = [0.0, 0.1]; high = [0.4, 0.3]; };"
DISC = "sphere = { centre = [0.0, 0.21]; radius = 0.2; };"


def body(shape=BOX, more="", name="box", density=500.0):
    return f"""{{ name = "{name}"; solid = true; shape = {{ {shape} }}; body = {{ density = {density}; {more} }}; }}"""


def scene(*walls, d=2, gravity=(0.0, -9.81), fastest=2.0, spacing=DP, more="", sizes=(-2.0, 3.0), periodic=""):
    """Bodies and walls without fluid."""
    low, high = ([float(size)] * d for size in sizes)
    return f"""simulation = {{ dimensions = {d}; end_time = 5.0; {more} }}; gravity = {[float(g) for g in gravity]};
        domain = {{ low = {low}; high = {high}; periodic = [{periodic}]; }}; eos = {{ max_velocity = {fastest}; }};
        numerics = {{ spacing = {spacing}; }}; wall = ( {", ".join(walls)} );"""


def run(sph, until, look=lambda sph: None):
    """What `look` sees after each step, to a time in s."""
    found = []
    while sph.time < until - 1e-9:
        sph.step()
        found.append(look(sph))
    return found


def momenta(sph):
    """Momentum [3], angular momentum [3] about the origin, and kinetic energy of all bodies."""
    p, spins, energy = np.zeros(3), np.zeros(3), 0.0
    for wall, state in zip(sph.bodies.of, sph.bodies.state):
        x, v, w, turn = state[:3], state[7:10], state[10:13], rotation(state[3:7])
        inertia = turn @ wall.rigid.inertia @ turn.T
        p, spins = p + wall.rigid.mass * v, spins + wall.rigid.mass * np.cross(x, v) + inertia @ w
        energy += 0.5 * wall.rigid.mass * v @ v + 0.5 * w @ inertia @ w
    return p, spins, energy


SHAPES = {
    "boxes": (2, "box = { low = [-0.38, 0.0]; high = [0.02, 0.2]; };",
              "box = { low = [0.1, 0.1]; high = [0.4, 0.5]; };"),
    "box on disc": (2, "box = { low = [-0.38, 0.0]; high = [0.02, 0.2]; };",
                    "sphere = { centre = [0.3, 0.15]; radius = 0.2; };"),
    "strip on box": (2, "cylinder = { base = [-0.48, -0.1]; top = [-0.08, 0.2]; radius = 0.1; };",
                     "box = { low = [0.1, 0.1]; high = [0.4, 0.5]; };"),
    "boxes in 3D": (3, "box = { low = [-0.38, 0.0, 0.0]; high = [0.02, 0.2, 0.3]; };",
                    "box = { low = [0.1, 0.1, -0.2]; high = [0.4, 0.5, 0.2]; };"),
    "cylinder on ball": (3, "cylinder = { base = [-0.28, -0.1, 0.0]; top = [-0.08, 0.2, 0.1]; radius = 0.1; };",
                         "sphere = { centre = [0.3, 0.05, 0.1]; radius = 0.2; };"),
}  # fmt: skip
ROUGH = "box on disc", "strip on box", "boxes in 3D"  # with friction in the default run, the others without


@pytest.mark.parametrize(
    ("shapes", "friction"),
    [
        pytest.param(shapes, friction, marks=[pytest.mark.validation] * ((shapes in ROUGH) != (friction > 0.0)))
        for shapes in SHAPES
        for friction in (0.0, 0.5)
    ],
)
def test_two_bodies_that_collide_keep_their_momenta(shapes, friction):
    """Momentum and angular momentum to rounding; energy where nothing is lost, to 2 %: normals stay in a step."""
    d, first, second = SHAPES[shapes]
    law = f"contact = {{ restitution = 1.0; friction = {friction}; }};"
    push = f"velocity = {[1.0, 0.1, 0.0][:d]};"
    sph = engine(case=scene(body(first, push + law, "a"), body(second, law, "b", 800.0), d=d, gravity=(0.0,) * d,
                            spacing=0.04 if d == 3 else DP, more="time_step = 3e-4;"))  # fmt: skip
    before, still = momenta(sph), sph.bodies.state[1].copy()
    run(sph, 0.25)
    p, spins, energy = momenta(sph)
    assert np.abs(sph.bodies.state[1] - still)[7:10].max() > 0.1  # it was struck
    assert np.abs(p - before[0]).max() < 1e-12 * np.abs(before[0]).max()
    limit = 1e-12 if d == 2 else 1e-4  # in 3D bodies that tumble freely keep it to the order of the step
    assert np.abs(spins - before[1]).max() < limit * np.abs(before[0]).max()
    if not friction:
        assert energy == pytest.approx(before[2], rel=0.02)
    else:
        assert energy < 1.02 * before[2]


@pytest.mark.parametrize(
    ("what", "given"),
    [
        pytest.param(what, given, marks=[pytest.mark.validation] * (what != "disc" and given != 0.4))
        for what in ("box", "disc", "two discs", "ball", "side")
        for given in (1.0, 0.7, 0.4, 0.15)
    ],
)
def test_restitution_is_the_given_one(what, given):
    """A face of many points, a point, two bodies, three dimensions, and a face of a tank."""
    law = f"contact = {{ restitution = {given}; }};"
    if what == "two discs":
        other = "sphere = { centre = [0.05, 0.64]; radius = 0.2; };"
        walls = body(DISC, law, "a"), body(other, law + "velocity = [0.0, -1.0];", "b", 900.0)
        sph = engine(case=scene(*walls, gravity=(0.0, 0.0)))
        n = np.array([0.05, 0.43]) / math.hypot(0.05, 0.43)  # discs slide past: along the normal at first
        seen = run(sph, 0.1, lambda sph: (sph.bodies.state[1] - sph.bodies.state[0])[7:9] @ n)
        assert -seen[-1] / seen[0] == pytest.approx(given, abs=0.02)
        return
    shape = {"ball": "sphere = { centre = [0.0, 0.21, 0.0]; radius = 0.2; };", "disc": DISC}.get(what, BOX)
    floor, d, axis = FLOOR, 2, 1
    if what == "ball":
        floor, d = UNDER[3], 3
    if what == "side":
        floor, axis = '{ name = "t"; shape = { box = { low = [-1.0, 0.1]; high = [0.5, 1.0]; open = ["y+"]; }; }; }', 0
    velocity = [0.0] * d
    velocity[axis] = 1.0 if axis == 0 else -1.0
    wall = body(shape, law + f"velocity = {velocity};")
    sph = engine(case=scene(floor, wall, d=d, gravity=(0.0,) * d, spacing=0.04 if d == 3 else DP))
    run(sph, 0.3)
    assert -sph.bodies.state[0][7 + axis] / velocity[axis] == pytest.approx(given, abs=0.01)


def test_the_overlap_is_the_chosen_one():
    """A point of a body that meets a wall at eos.max_velocity goes so many spacings past where it touches."""
    for share in (0.05, 0.2):
        law = f"velocity = [0.0, -2.0]; contact = {{ restitution = 1.0; overlap = {share}; }};"
        sph = engine(case=scene(FLOOR, body(DISC, law), gravity=(0.0, 0.0), more="time_step = 1e-5;"))
        depth = max(run(sph, 0.0004 + 0.022 * share, lambda sph: 0.21 - sph.bodies.state[0][1]))  # where it began
        assert depth == pytest.approx(share * DP, rel=0.01)


@pytest.mark.parametrize("d", [2, pytest.param(3, marks=pytest.mark.validation)])  # in 3D: one that sinks, below
def test_a_dropped_body_comes_to_rest_on_the_floor(d):
    """Within 0.01 spacings of a spacing over the floor, a corner down at first in 2D."""
    shape = f"box = {{ low = {[0.0, 0.1, 0.0][:d]}; high = {[0.2, 0.3, 0.2][:d]}; }};"
    turning = "angular_velocity = [3.0];" if d == 2 else ""
    sph = engine(case=scene(UNDER[d], body(shape, turning), d=d, gravity=(0.0, -9.81, 0.0)[:d], spacing=DP * (d - 1)))
    run(sph, 1.4)
    state = sph.bodies.state[0]
    assert state[1] == pytest.approx(0.1 + sph.scene.spacing, abs=0.01 * DP) and np.abs(state[7:13]).max() < 1e-6
    weight = 9.81 * sph.bodies.of[0].rigid.mass
    gained = sph.scalars()["contact_box_y"]
    assert gained == pytest.approx(weight * sph.time, rel=1e-9)  # all its weight, as it rests


def test_fluid_starts_outside_the_cores_of_a_body():
    """A disc between the places of the lattice throws no particle off: none has a fiftieth of the speed of sound."""
    tank = '{ name = "tank"; shape = { box = { low = [0.0, 0.0]; high = [1.2, 0.8]; open = ["y+"]; }; }; }'
    disc = body("sphere = { centre = [0.55, 0.35]; radius = 0.1; };", density=300.0)
    sph = engine(case=text(d=2, size=(1.2, 0.6), spacing=DP, fill=(1.2, 0.6), gravity=(0.0, -9.81), flux="delta",
                           more=f"wall = ( {tank}, {disc} );"))  # fmt: skip
    fastest = []
    for _ in range(20):
        sph.step()
        fastest.append(np.abs(sph.storage.v[:, sph.storage.fluid_slots]).max())
    assert max(fastest) < 0.02 * sph.scene.c0


def test_bodies_touch_a_spacing_apart_once_they_were():
    """One that stands on the floor stays there until it is lifted by a spacing; lifted so far and let go it stands a
    spacing over it. No fluid comes under it before: one that is lifted less, or rocks, stands again as it stood.
    """
    standing = engine(case=scene(FLOOR, body("box = { low = [0.0, 0.0]; high = [0.2, 0.2]; };")))
    run(standing, 0.1)
    assert standing.bodies.state[0][1] == pytest.approx(0.1, abs=0.01 * DP)
    for up, apart in ((0.3 * DP, 0.0), (2 * DP, DP)):
        standing.bodies.state[0][1] += up
        run(standing, standing.time + 0.02, lambda sph: sph.bodies.state[0][1])
        run(standing, standing.time + 0.4)
        assert standing.bodies.state[0][1] == pytest.approx(0.1 + apart, abs=0.01 * DP)


SUNK = {
    "box": (2, 8000, "box = { low = [0.413, 0.12]; high = [0.613, 0.22]; };", 0.4),
    "box, walls that push": (2, 8000, "box = { low = [0.413, 0.12]; high = [0.613, 0.22]; };", 0.4),
    "disc": (2, 8000, "sphere = { centre = [0.513, 0.17]; radius = 0.05; };", 0.4),
    "box in 3D": (3, 8000, "box = { low = [0.1, 0.1, 0.08]; high = [0.2, 0.2, 0.16]; };", 0.25),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.validation] * (name not in ("box", "box in 3D"))) for name in SUNK]
)
def test_a_heavy_body_that_sinks_comes_to_rest_on_the_floor(name):
    """Over a film of a spacing, with all fluid outside body and floor."""
    d, density, shape, until = SUNK[name]
    size, depth, dp = ((1.0, 0.3, 0.0125), (0.3, 0.2, 0.02))[d - 2]
    high, top = [size] * (d - 1), "xyz"[d - 1]
    tank = f'box = {{ low = {[0.0] * d}; high = {[*high, 2 * depth]}; open = ["{top}+"]; }};'
    kind = 'type = "repulsive";' if "push" in name else ""
    case = f"""simulation = {{ dimensions = {d}; end_time = 1.0; }}; gravity = {[*[0.0] * (d - 1), -9.81]};
        fluid = ( {{ shape = {{ box = {{ low = {[0.0] * d}; high = {[*high, depth]}; }}; }}; }} );
        numerics = {{ spacing = {dp}; smoothing = 1.6; artificial_viscosity = 0.05; }};
        wall = ( {{ name = "tank"; {kind} shape = {{ {tank} }}; }}, {body(shape, density=density)} );"""
    sph = engine(case=case)
    half = sph.bodies.state[0][d - 1] - (0.12 if d == 2 else 0.08)
    run(sph, until)
    assert sph.bodies.state[0][d - 1] == pytest.approx(half + dp, abs=0.1 * dp)
    assert sph.guard() is None


@pytest.mark.parametrize(("friction", "slides"), [(0.55, False), (0.4, True), seldom(0.0, True)])
def test_friction_holds_on_a_slope_up_to_its_angle(friction, slides):
    """Of 0.5: below it slides by g (sin - mu cos)."""
    slope, g = math.atan(0.5), 9.81
    pull = (g * math.sin(slope), -g * math.cos(slope))
    resting = body("box = { low = [0.0, 0.0]; high = [0.4, 0.2]; };", f"contact = {{ friction = {friction}; }};")
    sph = engine(case=scene(FLOOR, resting, gravity=pull))
    seen = np.array(run(sph, 0.4, lambda sph: (sph.time, sph.bodies.state[0][7])))
    if slides:
        late = seen[:, 0] > 0.2
        rate = np.polyfit(*seen[late].T, 1)[0]
        assert rate == pytest.approx(pull[0] + friction * pull[1], rel=2e-3)
    else:
        place = sph.bodies.state[0][0]
        run(sph, 0.6)
        assert sph.bodies.state[0][0] - place == pytest.approx(0.0, abs=1e-6 * DP)


def line_of(stiffness, more):
    return f"""mooring = ( {{ at = [0.2, 0.2]; anchor = [0.2, 1.2]; stiffness = {stiffness}; length = 0.9;
                             {more} }} );"""


@pytest.mark.parametrize("integrator", ["symplectic", seldom("rk3-tvd")])
def test_a_moored_mass_swings_as_its_spring_says(integrator):
    """Frequency and damping of k, m and c."""
    mass, stiffness, damping = 40.0, 9000.0, 60.0
    spring = line_of(stiffness, f"damping = {damping}; pushes = true;")
    sph = engine(case=scene(body(more=spring), gravity=(0.0, 0.0), more=f'integrator = "{integrator}";'))
    seen = np.array(run(sph, 0.6, lambda sph: (sph.time, sph.bodies.state[0][1])))
    rate, free = damping / (2 * mass), math.sqrt(stiffness / mass)
    swing = math.sqrt(free**2 - rate**2)
    t = seen[:, 0]
    known = 0.3 - 0.1 * np.exp(-rate * t) * (np.cos(swing * t) + rate / swing * np.sin(swing * t))
    assert np.abs(seen[:, 1] - known).max() < 1e-4  # of 0.1: 2nd order in the short steps


def test_a_taut_line_only_pulls():
    """So that it gives a half of a swing."""
    sph = engine(case=scene(body(more=line_of(9000.0, "damping = 0.0;")), gravity=(0.0, 0.0)))
    run(sph, 0.3)
    state = sph.bodies.state[0]
    assert state[8] == pytest.approx(0.1 * math.sqrt(9000.0 / 40.0), rel=1e-3)  # it flies on, the line is slack
    assert sph.scalars()["mooring_box_1"] == 0.0


@pytest.mark.parametrize("d", [2, 3])
def test_a_box_on_a_hinge_is_a_physical_pendulum(d):
    """Period of small swings 2 pi sqrt(I / (m g r)); its hinge carries weight and centrifugal force; nothing drifts."""
    low, high = ([0.0, -0.4], [0.1, 0.0]) if d == 2 else ([0.0, -0.4, 0.0], [0.1, 0.0, 0.2])
    hinge = "hinge = { point = [0.05, 0.0]; };"
    if d == 3:
        hinge = "hinge = { point = [0.05, 0.0, 0.1]; axis = [0.0, 0.0, 2.0]; };"
    spin = "angular_velocity = [0.2];" if d == 2 else "angular_velocity = [0.0, 0.0, 0.2];"
    swinging = body(f"box = {{ low = {low}; high = {high}; }};", hinge + spin)
    g, arm, gyration = 9.81, 0.2, (0.1**2 + 0.4**2) / 12 + 0.2**2
    sph = engine(case=scene(swinging, d=d, gravity=(0.0, -g, 0.0)[:d], spacing=0.025 * (d - 1)))
    mass = sph.bodies.of[0].rigid.mass
    free = math.sqrt(g * arm / gyration)
    largest = 0.2 / free
    period = 2 * math.pi / free * (1 + largest**2 / 16)  # next order of the amplitude
    seen = np.array(run(sph, 1.9 * period, lambda sph: (sph.time, *sph.bodies.state[0])))
    t, spins = seen[:, 0], seen[:, 13]
    rising = np.flatnonzero((spins[:-1] < 0) & (spins[1:] >= 0))
    ends = t[rising] - spins[rising] * np.diff(t)[rising] / np.diff(spins)[rising]
    assert np.diff(ends)[0] == pytest.approx(period, rel=1e-3)
    top = np.array([0.0, arm])
    turns = [rotation(q)[:2, :2] for q in seen[:, 4:8]]
    hung = np.array([x + turn @ top for x, turn in zip(seen[:, 1:3], turns)])
    assert np.abs(hung - [0.05, 0.0]).max() < 1e-15
    sph = engine(case=scene(swinging, d=d, gravity=(0.0, -g, 0.0)[:d], spacing=0.025 * (d - 1)))
    sph.step()
    force = sph.scalars()
    assert force["hinge_box_y"] == pytest.approx(mass * (g + 0.04 * arm), rel=1e-3)
    assert abs(force["hinge_box_x"]) < 1e-2 * mass * g


def test_a_scene_turned_by_a_right_angle_does_the_same():
    """Falling, rolling, striking, on a line: x to y and y to -x."""
    line = "mooring = ( { at = [0.4, 0.3]; anchor = [0.8, 0.8]; stiffness = 800.0; damping = 2.0; } );"
    turned_line = "mooring = ( { at = [0.3, -0.4]; anchor = [0.8, -0.8]; stiffness = 800.0; damping = 2.0; } );"
    upright = engine(case=scene(FLOOR, body(BOX, line + "angular_velocity = [1.0];")))
    wall = FLOOR.replace("normal = [0.0, 1.0]", "normal = [1.0, 0.0]")
    shape = "box = { low = [0.1, -0.4]; high = [0.3, 0.0]; };"
    lying = engine(case=scene(wall, body(shape, turned_line + "angular_velocity = [1.0];"), gravity=(-9.81, 0.0),
                              sizes=(-3.0, 2.0)))  # fmt: skip
    for one in (upright, lying):
        run(one, 0.45)
    a, b = upright.bodies.state[0], lying.bodies.state[0]
    assert np.abs(upright.bodies.ledger).max() > 0.0
    assert np.allclose([-b[1], b[0], -b[8], b[7], b[12]], [*a[0:2], *a[7:9], a[12]], rtol=0, atol=1e-8)


def test_bodies_meet_through_a_periodic_side():
    law = "contact = { restitution = 1.0; friction = 0.0; };"
    left = "box = { low = [-1.8, 0.0]; high = [-1.5, 0.2]; };", law + "velocity = [-1.0, 0.0];", "a"
    right = "box = { low = [2.6, 0.0]; high = [2.9, 0.2]; };", law, "b"
    sph = engine(case=scene(body(*left), body(*right), gravity=(0.0, 0.0), periodic='"x"'))
    run(sph, 0.5)
    v = sph.bodies.state[:, 7]
    assert v[1] == pytest.approx(-1.0, abs=0.01) and v[0] == pytest.approx(0.0, abs=0.01)


def test_what_contacts_cannot_do_ends_the_run():
    fast = "velocity = [0.0, -19.0]; contact = { overlap = 0.4; };"
    sph = engine(case=scene(FLOOR, body(DISC, fast), fastest=2.0))
    with pytest.raises(Diverged, match=r"box .* (deep in floor|a spacing or more in a step)"):
        run(sph, 0.3)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ("contact = { restitution = 0.05; };", "restitution.*0.1"),
        ("contact = { friction = -1.0; };", "friction"),
        ("contact = { overlap = 2.0; };", "overlap"),
        ("mooring = ( { at = [0.0, 0.1]; anchor = [1.0]; stiffness = 1.0; } );", "needs 2 numbers"),
        ("mooring = ( { at = [0.0, 0.1]; anchor = [1.0, 1.0]; } );", "stiffness"),
        ("mooring = ( { at = [0.0, 0.1]; anchor = [0.0, 0.1]; stiffness = 1.0; } );", "length.*the anchor is where"),
        ("hinge = { point = [0.0, 0.1, 0.2]; };", "needs 2 numbers"),
        ("hinge = { point = [0.0, 0.1]; axis = [0.0, 1.0]; };", "in 2D a hinge turns"),
        ('hinge = { point = [0.0, 0.1]; }; held = ["x"];', "held.*hinge"),
        ("hinge = { point = [0.0, 0.1]; }; velocity = [1.0, 0.0];", "angular_velocity"),
    ],
)
def test_ties_that_cannot_be_are_refused(more, told):
    with pytest.raises(ConfigError, match=told):
        config(scene(FLOOR, body(more=more)))


def test_a_hinge_in_three_dimensions_needs_an_axis():
    box = "box = { low = [0.0, 0.1, 0.0]; high = [0.2, 0.3, 0.2]; };"
    for axis, told in (("", "axis.*is missing"), ("axis = [0.0, 0.0, 0.0];", "must not be zero"),
                       ("axis = [0.0, 0.0, 1.0]; }; angular_velocity = [1.0, 0.0, 0.0", "along the axis")):  # fmt: skip
        more = f"hinge = {{ point = [0.0, 0.1, 0.0]; {axis}"
        with pytest.raises(ConfigError, match=told):
            config(scene(body(box, more + ("];" if "angular" in axis else "};")), d=3, gravity=(0.0, 0.0, 0.0)))


def test_faults_of_ties_are_told_with_line_and_key_and_nothing_is_made(tmp_path):
    ties = """contact = { friction = -1.0; };
        mooring = ( { at = [0.0, 0.1]; anchor = [1.0, 1.0]; stiffness = -1.0; } );
        hinge = { point = [0.0, 0.1]; angle = 2.0; };"""
    (tmp_path / "bad.conf").write_text(scene(FLOOR, body(more=ties)))
    words = [sys.executable, "-m", "sph", "run", "bad.conf", "-o", "run"]
    done = subprocess.run(words, cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=100)
    assert done.returncode == 2 and [path.name for path in tmp_path.iterdir()] == ["bad.conf"], done.stderr
    for line, key in ((3, "contact.friction"), (4, "mooring[0].stiffness"), (5, "hinge.angle")):
        assert any(f"bad.conf:{line}:" in told and key in told for told in done.stderr.splitlines()), done.stderr


def scaled(s):
    """Two bodies that meet over water, one on a line, and a flap; lengths and times s times as large."""

    def box(*low_high):
        low, high = ([s * value for value in side] for side in low_high)
        return f"box = {{ low = {low}; high = {high}; }};"

    line = f"""mooring = ( {{ at = [{s * 0.3}, {s * 0.5}]; anchor = [{s * 0.1}, {s * 0.6}]; stiffness = 900.0;
                             damping = {s * 2.0}; }} );"""
    walls = (
        f'{{ name = "tank"; shape = {{ {box([0.0, 0.0], [1.0, 0.6])[:-3]} open = ["y+"]; }}; }}; }}',
        body(box([0.3, 0.42], [0.5, 0.54]), f"velocity = [2.0, 0.0]; angular_velocity = [{2.0 / s}]; {line}", "a"),
        body(f"sphere = {{ centre = [{s * 0.66}, {s * 0.5}]; radius = {s * 0.1}; }};", "velocity = [-2.0, 0.0];", "b"),
        body(box([0.84, 0.2], [0.92, 0.56]), f"hinge = {{ point = [{s * 0.88}, {s * 0.56}]; }};", "flap"),
    )
    return text(size=(s * 1.0, s * 0.6), fill=(s * 1.0, s * 0.4), spacing=s * 0.04, gravity=(0.0, -9.81 / s),
                flux="delta", more=f"wall = ( {', '.join(walls)} );")  # fmt: skip


def test_units_that_differ_by_a_power_of_two_give_the_same_bits():
    """Lengths and times 8 times as large: the same velocities, 8 times the forces and 64 times the impulses."""
    small, large = engine(case=scaled(1.0)), engine(case=scaled(8.0))
    for sph in (small, large):
        for _ in range(10):
            sph.step()
    assert large.time == 8 * small.time and small.bodies.ties.contacts.springs.any()  # in the middle of a contact
    units = np.repeat([8.0, 1.0, 1.0, 1 / 8, 1 / 8, 1 / 64], [3, 4, 3, 3, 3, 3])
    assert np.array_equal(large.bodies.state, units * small.bodies.state)
    assert np.array_equal(large.bodies.ledger, np.repeat([64.0, 8.0], 3) * small.bodies.ledger)
    for name, factor in (("x", 8.0), ("v", 1.0), ("drho", 1.0)):
        assert np.array_equal(by_id(large, name)[0], factor * by_id(small, name)[0]), name
