"""Initial states as laws: every particle once, all of the mass, walls whole however they are asked for."""

import numpy as np
import pytest
from sph_scenes import config

from hpcpic.core.case.config import loads
from sph.configure import configure
from sph.setup import flows, signed_distance
from sph.setup.scene import Scene

TANK = """
simulation = { dimensions = 3; end_time = 1.0; };
domain = { low = [0.0, 0.0, 0.0]; high = [1.0, 0.5, 0.6]; };
gravity = [0.0, 0.0, -9.81];
fluid = ( { name = "pool"; shape = { box = { low = [0.0, 0.0, 0.0]; high = [0.4, 0.5, 0.3]; }; }; },
          { name = "bed"; shape = { box = { low = [0.0, 0.0, 0.0]; high = [1.0, 0.5, 0.1]; }; }; } );
numerics = { spacing = 0.05; };
wall = ( { name = "tank"; type = "KIND";
           shape = { box = { low = [0.0, 0.0, 0.0]; high = [1.0, 0.5, 0.6]; open = ["z+"]; }; }; },
         { name = "post"; type = "KIND"; solid = true; MOTION
           shape = { box = { low = [0.6, 0.2, 0.0]; high = [0.8, 0.4, 0.6]; }; }; } );
"""
KINDS = ("pressure-continuity", "repulsive", "point-symmetric-free-slip", "mirror-no-slip", "extrapolated-free-slip")
GATE = "motion = { velocity = [0.0, 0.0, 2.0]; amplitude = [0.1, 0.0, 0.0]; period = 0.5; start = 0.1; stop = 0.8; };"


def scene_of(text=TANK, kind="pressure-continuity", motion=""):
    return Scene(configure(loads(text.replace("KIND", kind).replace("MOTION", motion))))


def flat_case(shape, more="", d=2):
    return scene_of(
        f"simulation = {{ dimensions = {d}; end_time = 1.0; }};"
        f"fluid = ( {{ shape = {{ {shape} }}; {more} }} ); numerics = {{ spacing = 0.02; }};"
        "eos = { max_velocity = 1.0; };" + ("gravity = [0.0, -9.81];" if d == 2 else "gravity = [0.0, 0.0, -9.81];")
    )


def test_fluids_do_not_overlap_and_keep_out_of_solids():
    scene = scene_of()
    state = scene.fluid(np.arange(scene.n_fluid))
    cells = np.floor(state["x"] / 0.05).astype(int)
    assert len(np.unique(cells, axis=0)) == scene.n_fluid  # one particle to a cell of the lattice
    assert signed_distance.signed_distance(scene.walls[1].section.shape, state["x"]).min() > 0.0
    assert scene.fluids[1].clipped == {"post": 4 * 4 * 2, "pool": 8 * 10 * 2}
    assert scene.fluids[0].clipped == {}


def test_the_mass_of_boxes_is_exact_however_the_spacing_divides_them():
    shape = "box = { low = [0.0, 0.0]; high = [0.513, 0.337]; };"
    scene = flat_case(shape)
    state = scene.fluid(np.arange(scene.n_fluid))
    assert state["m"].sum() == pytest.approx(1000 * 0.513 * 0.337, rel=1e-13)
    assert np.allclose(state["x"].mean(axis=0), (0.513 / 2, 0.337 / 2), rtol=1e-13)


@pytest.mark.parametrize(
    "shape, volume, d",
    [("sphere = { centre = [0.1, 0.2]; radius = 0.5; };", np.pi * 0.25, 2),
     ("cylinder = { base = [0.0, 0.0]; top = [0.3, 0.4]; radius = 0.2; };", 0.2, 2),
     ("sphere = { centre = [0.1, 0.2, 0.3]; radius = 0.3; };", 4 / 3 * np.pi * 0.027, 3),
     ("cylinder = { base = [0.0, 0.0, 0.0]; top = [0.0, 0.0, 0.5]; radius = 0.2; };", np.pi * 0.02, 3)],
)  # fmt: skip
def test_round_shapes_are_filled(shape, volume, d):
    scene = flat_case(shape, d=d)
    state = scene.fluid(np.arange(scene.n_fluid))
    assert state["m"].sum() == pytest.approx(1000 * volume, rel=0.02)  # particles at the edge: dp / R to the 3/2
    assert signed_distance.signed_distance(scene.fluids[0].section.shape, state["x"]).max() <= 0.0
    assert len(np.unique(state["x"], axis=0)) == scene.n_fluid


def test_disorder_moves_every_particle_a_little_and_only_by_its_number():
    box = "box = { low = [0.0, 0.0]; high = [0.3, 0.2]; };"
    lattice, off = (flat_case(box, more) for more in ("", "disorder = 0.1;"))
    ids = np.random.default_rng(1).permutation(lattice.n_fluid)
    away = (off.fluid(ids)["x"] - lattice.fluid(ids)["x"]) / off.spacing
    assert np.abs(away).max() <= 0.1 and np.all(np.abs(away).max(axis=1) > 0.0)
    assert np.array_equal(off.fluid(ids)["x"], off.fluid(np.arange(off.n_fluid))["x"][ids])


def test_a_particle_does_not_depend_on_who_asks_for_it():
    scene = scene_of()
    whole = scene.fluid(np.arange(scene.n_fluid))
    some = np.random.default_rng(1).permutation(scene.n_fluid)[:97]
    for name, values in scene.fluid(some).items():
        assert np.array_equal(values, whole[name][some])


@pytest.mark.parametrize("kind", KINDS[:3])
@pytest.mark.parametrize("index", [0, 1])
def test_walls_are_the_same_in_one_piece_and_in_many(kind, index):
    wall = scene_of(kind=kind).walls[index]
    low, high = wall.bounds
    ids, x, normal = wall.near(low, high)
    assert len(np.unique(ids)) == len(ids) and np.all(ids >> 50 == index + 1)
    cuts = np.linspace(low, high, 4)
    axes = np.arange(3)
    parts = [wall.near(cuts[at, axes], cuts[np.add(at, 1), axes]) for at in np.ndindex(3, 3, 3)]
    found = np.concatenate([part[0] for part in parts])
    order = np.argsort(found)
    assert np.array_equal(found[order], np.sort(ids))
    again, turned = wall.at(ids)
    assert np.array_equal(again, x) and np.array_equal(turned, normal)
    assert np.allclose(np.linalg.norm(normal, axis=1)[np.any(normal != 0, axis=1)], 1.0)


def test_layers_of_a_tank_fill_faces_edges_and_corners_once():
    scene = scene_of()
    wall = scene.walls[0]
    _, x, normal = wall.near(*wall.bounds)
    assert wall.layers == 3
    assert len(np.unique(np.round(x / 0.025).astype(int), axis=0)) == len(x)
    below = (20 + 6) * (10 + 6) * 3  # under the floor and its edges
    sides = ((20 + 6) * (10 + 6) - 20 * 10) * 12
    assert len(x) == below + sides
    outside = np.maximum(np.array([0.0, 0.0, 0.0]) - x, x - np.array([1.0, 0.5, 9.0]))
    assert outside.max(axis=1).min() == pytest.approx(0.025)
    moved = x + 0.2 * normal  # inwards from everywhere
    assert np.all((moved > -0.13) & (moved < np.array([1.13, 0.63, 9.0])))


def test_a_repulsive_layer_lies_back_so_that_the_fluid_rests_half_a_spacing_before_the_face():
    scene = scene_of(kind="repulsive")
    back = 0.9 * scene.h - 0.025
    _, x, normal = scene.walls[0].near(*scene.walls[0].bounds)
    floor = normal[:, 2] == 1.0
    assert np.allclose(x[floor, 2], -back) and np.all(normal[floor, :2] == 0.0)
    _, x, normal = scene.walls[1].near(*scene.walls[1].bounds)
    front = normal[:, 0] == -1.0
    assert np.allclose(x[front, 0], 0.6 + back)
    assert x[:, 2].min() == pytest.approx(back) and x[:, 2].max() == pytest.approx(0.6 - back)  # its ends are closed


def test_mirrors_are_the_closed_faces_with_normals_into_the_fluid():
    tank, post = scene_of(kind="mirror-no-slip").walls
    middle = np.array([0.5, 0.25, 0.3])
    assert len(tank.faces) == 5 and len(post.faces) == 6 and tank.lattice is None
    assert all((middle - face.point) @ face.normal > 0 for face in tank.faces)
    assert all((np.array([0.7, 0.3, 0.3]) - face.point) @ face.normal < 0 for face in post.faces)


def test_a_wall_across_a_periodic_side_is_left_out():
    scene = scene_of(TANK.replace("0.6]; };\ng", '0.6]; periodic = ["x"]; };\ng'), "mirror-no-slip")
    assert [tuple(face.normal) for face in scene.walls[0].faces] == [(0, 1, 0), (0, -1, 0), (0, 0, 1)]
    scene = scene_of(TANK.replace("0.6]; };\ng", '0.6]; periodic = ["x"]; };\ng'))
    _, x, _ = scene.walls[0].near(*scene.walls[0].bounds)
    assert x[:, 0].min() > 0.0 and x[:, 0].max() < 1.0


def test_the_velocity_of_a_moving_wall_is_the_rate_of_its_displacement():
    wall = scene_of(motion=GATE).walls[1]
    for t in np.linspace(0.005, 1.0, 37):
        before, after = wall.motion(t - 1e-6)[0], wall.motion(t + 1e-6)[0]
        assert np.allclose((after - before) / 2e-6, wall.motion(t)[1], atol=1e-6 + 3e-5)
    path = GATE.split("velocity")[0] + (
        "path = ( { time = 0.2; displacement = [0.1, 0.0, 0.0]; },"
        "         { time = 0.5; displacement = [0.1, 0.3, 0.0]; } ); };"
    )
    wall = scene_of(motion=path).walls[1]
    assert np.allclose(wall.motion(0.1), ([0.05, 0, 0], [0.5, 0, 0], [0, 0, 0]))
    assert np.allclose(wall.motion(0.35), ([0.1, 0.15, 0], [0, 1.0, 0], [0, 0, 0]))
    assert np.allclose(wall.motion(2.0), ([0.1, 0.3, 0], [0, 0, 0], [0, 0, 0]))


@pytest.mark.parametrize("gamma", [1.0, 7.0])
def test_hydrostatic_density_balances_gravity(gamma):
    """dp/dz = rho g through the equation of state."""
    text = TANK + f"eos = {{ gamma = {gamma}; sound_speed = 30.0; }};"
    scene = scene_of(text)
    depth = np.linspace(0.0, 1.0, 2001)
    drho = scene.eos.excess_at_rest(depth, 9.81)
    p = scene.eos.pressure(drho)
    slope = (p[2:] - p[:-2]) / (depth[2:] - depth[:-2])
    assert np.allclose(slope, (scene.rho0 + drho[1:-1]) * 9.81, rtol=1e-6)  # central differences
    assert np.allclose(scene.eos.excess(p), drho, rtol=1e-11)


def test_water_in_two_boxes_on_each_other_rests_as_in_one():
    box = "{{ shape = {{ box = {{ low = [0.0, {}]; high = [1.0, {}]; }}; }}; }}"
    rest = (
        "simulation = {{ dimensions = 2; end_time = 1.0; }}; gravity = [0.0, -9.81]; numerics = {{ spacing = 0.05; }};"
        "eos = {{ sound_speed = 30.0; }}; fluid = ( {} );"
    )
    x = np.array([[0.5, 0.025], [0.5, 0.275]])
    one = scene_of(rest.format(box.format(0.0, 0.5)))
    two = scene_of(rest.format(f"{box.format(0.0, 0.3)}, {box.format(0.3, 0.5)}"))
    told = flows.hydrostatic(two, two.config.fluid[0], x)
    assert told == pytest.approx(flows.hydrostatic(one, one.config.fluid[0], x), rel=1e-12)


def test_particles_of_walls_start_with_the_pressure_of_the_fluid_beside_them():
    scene = scene_of()
    x = np.array([[0.2, 0.25, -0.025], [0.9, 0.25, -0.025], [0.9, 0.25, 0.55]])
    p = scene.eos.pressure(scene.rest_density(x))
    assert p == pytest.approx([1000 * 9.81 * 0.325, 1000 * 9.81 * 0.125, 0.0], rel=5e-3)


@pytest.mark.parametrize(
    "shape, flow",
    [("sphere = { centre = [0.3, 0.1]; radius = 0.5; };",
      'type = "linear"; gradient = [-2.0, 1.0, 0.5, 2.0]; centre = [0.3, 0.1];'),
     ("box = { low = [-0.5, -0.4]; high = [0.5, 0.4]; };", 'type = "linear"; gradient = [0.0, 1.0, -1.0, 0.0];'),
     ("box = { low = [0.0, 0.0]; high = [1.0, 1.0]; };", 'type = "taylor-green"; amplitude = 0.7; wavelength = 1.0;'),
     ("box = { low = [0.0, 0.0]; high = [1.0, 1.0]; };",
      'type = "standing-wave"; amplitude = 0.05; wavelength = 0.5;')],
)  # fmt: skip
def test_initial_flows_have_no_divergence_and_their_pressure_keeps_it_so(shape, flow):
    """lap p = -rho dv_i/dx_j dv_j/dx_i at points inside; but a standing wave starts with the pressure of rest."""
    scene = flat_case(shape, f'initial_pressure = "flow"; flow = {{ {flow} }};')
    section = scene.fluids[0].section
    x = np.array([[0.31, 0.13], [0.2, 0.3], [0.41, 0.05]])
    e = 1e-4 * np.eye(2)

    def v(at):
        return flows.velocity(scene, section, at)

    gradient = np.stack([(v(x + e[k]) - v(x - e[k])) / 2e-4 for k in range(2)], axis=-1)
    size = np.abs(gradient).max()
    assert np.abs(np.trace(gradient, axis1=1, axis2=2)).max() < 1e-6 * size
    if "standing" in flow:
        return
    e *= 30

    def p(at):
        return scene.eos.pressure(flows.density_of_flow(scene, section, at))

    laplacian = sum(p(x + e[k]) + p(x - e[k]) - 2 * p(x) for k in range(2)) / 3e-3**2
    source = -scene.rho0 * np.einsum("nij,nji->n", gradient, gradient)
    assert np.allclose(laplacian, source, atol=0.02 * np.abs(source).max())  # 30 terms of the sine series


def test_the_centre_of_a_rotating_square_has_the_known_pressure():
    turning = 'initial_pressure = "flow"; flow = { type = "linear"; gradient = [0.0, 1.0, -1.0, 0.0]; };'
    scene = flat_case("box = { low = [-0.5, -0.5]; high = [0.5, 0.5]; };", turning)
    p = scene.eos.pressure(flows.density_of_flow(scene, scene.fluids[0].section, np.zeros((1, 2))))
    assert p[0] == pytest.approx(-147.34, rel=1e-3)


def test_the_slab_axis_is_the_longest():
    assert scene_of().axes == (0, 1, 2)
    tall = scene_of(TANK.replace("high = [1.0, 0.5, 0.6]; };\ng", "high = [1.0, 0.5, 3.0]; };\ng"))
    assert tall.axes == (2, 0, 1)


def plane_scene(normal, point="[0.2, 0.3, -0.05]", periodic=""):
    """The fluids of TANK before a plane with particles."""
    plane = f"wall = ( {{ shape = {{ plane = {{ point = {point}; normal = {list(normal)}; }}; }}; }} );"
    whole = TANK[: TANK.index("wall =")] + plane
    return scene_of(whole.replace("0.6]; };\ng", f'0.6]; periodic = ["{periodic}"]; }};\ng') if periodic else whole)


@pytest.mark.parametrize(
    ("normal", "periodic"),
    [((0, 0, 1.0), "x"), ((0, -2.0, 0.5), "x"), ((0.3, 0, 1.0), "y"), ((0.3, 0, 1.0), ""), ((0.2, -0.7, 0.4), "")],
)
def test_layers_of_a_plane_lie_behind_it(normal, periodic):
    scene = plane_scene(normal, periodic=periodic)
    wall = scene.walls[0]
    _, x, _ = wall.near(*wall.bounds)
    depth = np.round(-signed_distance.signed_distance(wall.shape, x), 9)
    assert np.array_equal(np.unique(depth), [0.025, 0.075, 0.125])
    for k in np.flatnonzero(scene.periodic):  # all round, each once
        length = scene.high[k] - scene.low[k]
        assert len(np.unique(np.round(x[depth == 0.025][:, k], 9))) == round(length / 0.05)
        assert np.all((x[:, k] > 0) & (x[:, k] < length))


def test_a_plane_stands_before_fluid_that_leaves_the_domain_along_it():
    scene = plane_scene((1.0, 0.0, 0.0), "[0.0, 0.0, 0.0]")
    above = scene.high + np.array([0.0, 0.0, 1.0])
    _, x, _ = scene.walls[0].near(above - 0.3, above + 0.3)
    assert not len(x)
    _, x, _ = scene.walls[0].near(above - [1.3, 0.3, 0.3], above + 0.3)
    assert len(x) and x[:, 2].max() > above[2]


def test_fluid_is_before_a_plane_and_its_particles_behind():
    scene = plane_scene((0.0, 0.0, 1.0), "[0.0, 0.0, 0.1]")
    assert scene.fluid(np.arange(scene.n_fluid))["x"][:, 2].min() == pytest.approx(0.125)
    assert scene.walls[0].near(*scene.walls[0].bounds)[1][:, 2].max() == pytest.approx(0.075)


@pytest.mark.parametrize("kind", ["extrapolated-free-slip", "pressure-continuity"])
@pytest.mark.parametrize("thick", [1.0, 1.4, 2.0, 2.3, 2.4, 2.5, 3.4, 4.4, 4.6, 5.0, 5.7])
def test_layers_of_a_thin_solid_are_not_drawn_apart(kind, thick):
    """Two that were 1.2 spacings apart let still water through; whole spacings have as many layers."""
    shape = f"box = {{ low = [1.0, 0.0]; high = [{1.0 + 0.1 * thick}, 1.0]; }};"
    gate = f'wall = ( {{ solid = true; type = "{kind}"; shape = {{ {shape} }}; }} );'
    wall = Scene(config(size=(3.0, 1.0), spacing=0.1, more=gate)).walls[0]
    places = np.unique(np.round(wall.near(*wall.bounds)[1][:, 0], 9))
    half = 0.05 * thick / len(places)
    assert places[[0, -1]] == pytest.approx([1.0 + half, 1.0 + 0.1 * thick - half])
    assert np.diff(places).max(initial=0.0) < 0.1101 and thick < 1.101 * len(places)
    if round(thick) == thick:
        assert len(places) == thick
