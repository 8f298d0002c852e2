"""Still water in tanks that cut its lattice has the mass of its space, lies evenly, and stays at rest."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sph_scenes import by_id

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from sph.configure import configure
from sph.forecast.derived import derived
from sph.physics.smoothing import SMOOTHING
from sph.setup.rigid.packing import part_before
from sph.setup.scene import Scene
from sph.step import Sph

DP = 0.02
DISC = "sphere = { centre = [0.003, 0.001]; radius = 0.3; };"
BALL = "sphere = { centre = [0.001, 0.002, 0.0]; radius = 0.2; };"


def tilted(degrees, length=0.6, width=0.5, middle=(0.0, 0.0)):
    """A rectangle whose long sides are inclined."""
    along = length / 2 * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    base, top = (np.array(middle) - along).tolist(), (np.array(middle) + along).tolist()
    return f"cylinder = {{ base = {base}; top = {top}; radius = {width / 2}; }};"


def config(*shapes, low=(-0.6, -0.6), high=(0.6, 0.0), more="", wall="", fluid="", water=None, gravity=None):
    """Water in a box or in a shape of its own, less what walls of these shapes leave of it."""
    d = len(low)
    water = water or f"box = {{ low = {list(low)}; high = {list(high)}; }};"
    texts = [f'{{ name = "tank{k}"; shape = {{ {shape} }}; measure_force = true; {wall} }}'
             for k, shape in enumerate(shapes)]  # fmt: skip
    return configure(loads(f"""simulation = {{ dimensions = {d}; end_time = 1.0; }};
        gravity = {gravity or [0.0] * (d - 1) + [-9.81]}; numerics = {{ spacing = {DP}; }}; {more}
        fluid = ( {{ name = "water"; {fluid} shape = {{ {water} }}; }} );
        wall = ( {', '.join(texts)} );"""))  # fmt: skip


def plane(degrees, point):
    normal = [float(-np.sin(np.radians(degrees))), float(np.cos(np.radians(degrees)))]
    return f"plane = {{ point = {list(point)}; normal = {normal}; }};"


def placed(scene):
    return scene.fluid(np.arange(scene.n_fluid))


def unevenness(scene, x):
    """h |sum V grad W| [n] of the fluid, which is 0 where particles lie evenly, more than a support below the top."""
    low, high = x.min(axis=0) - scene.support, x.max(axis=0) + scene.support
    every = np.concatenate([x, *(wall.near(low, high)[1] for wall in scene.walls)])
    d, h = scene.dimensions, scene.h
    i, j = cKDTree(every).query_pairs(scene.support, output_type="ndarray").T
    apart, slopes = every[i] - every[j], np.zeros_like(every)
    slope = SMOOTHING[scene.kernel].gradient(np.sqrt(np.sum(apart**2, axis=1)) / h, d)[:, None] * apart
    np.add.at(slopes, i, slope)
    np.add.at(slopes, j, -slope)
    deep = x[:, -1] < x[:, -1].max() - scene.support
    return (np.linalg.norm(slopes[: len(x)], axis=1) * DP**d / h ** (d + 1))[deep]


@pytest.mark.parametrize("d", [2, 3])
def test_a_plane_parts_a_cube(d):
    """Both sides make the whole, and half of it where it goes through the middle; else as points of it tell."""
    random = np.random.default_rng(d)
    normal = random.normal(size=(20, d))
    normal[0] = np.eye(d)[0]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    off, points = random.uniform(-0.6, 0.6, 20), random.uniform(-0.5, 0.5, (40_000, d))
    part = part_before(off, normal)
    assert part + part_before(-off, -normal) == pytest.approx(1.0, abs=1e-6)
    assert part_before(0 * off, normal) == pytest.approx(0.5, abs=1e-6)
    assert part == pytest.approx(np.mean(points @ normal.T + off > 0.0, axis=0), abs=0.015)


@pytest.mark.parametrize("degrees", [8.0, 30.0, 42.0, 45.0])
def test_the_mass_is_that_of_an_inclined_tank_full_of_water(degrees):
    """Up to what cells in its corners count for: four of them, by a fifth of a particle each."""
    scene = Scene(config(tilted(degrees, middle=(0.003, 0.007)), high=(0.6, 0.6)))
    assert placed(scene)["m"].sum() == pytest.approx(1000.0 * 0.6 * 0.5, rel=4 * 0.2 * DP**2 / 0.3)


def test_the_mass_is_that_between_planes():
    scene = Scene(config(plane(-45.0, (0.0, -0.45)), plane(45.0, (0.0, -0.45)), low=(-0.6, -0.6), high=(0.6, 0.0)))
    assert placed(scene)["m"].sum() == pytest.approx(1000.0 * 0.45**2, rel=1e-3)


def test_the_mass_is_that_of_round_tanks():
    """A cell that is cut counts as before the plane that touches the surface: a share of (dp / R)^2 / 16 is missing."""
    disc = Scene(config(DISC, high=(0.6, 0.6)))
    assert placed(disc)["m"].sum() == pytest.approx(1000.0 * np.pi * 0.3**2, rel=1e-3)
    ball = Scene(config(BALL, low=(-0.3,) * 3, high=(0.3, 0.3, 0.0)))
    assert placed(ball)["m"].sum() == pytest.approx(1000.0 * 2 / 3 * np.pi * 0.2**3, rel=1.5e-3)


@pytest.mark.parametrize(("shape", "low", "high"), [
    (tilted(45.0), (-0.6, -0.6), (0.6, 0.0)), (tilted(30.0), (-0.6, -0.6), (0.6, 0.0)),
    (DISC, (-0.6, -0.6), (0.6, 0.0)), (BALL, (-0.3,) * 3, (0.3, 0.3, 0.0)),
])  # fmt: skip
def test_particles_lie_evenly_and_in_the_tank(shape, low, high):
    """Ten times as evenly as the lattice that is cut: what is left are some hundredths of p / (rho h)."""
    scene = Scene(config(shape, low=low, high=high))
    fluid, x = scene.fluids[0], placed(scene)["x"]
    lattice = scene.from_lattice(fluid, np.arange(scene.n_fluid))
    even, before = unevenness(scene, x), unevenness(scene, lattice)
    assert np.sqrt(np.mean(even**2)) < 0.1 * np.sqrt(np.mean(before**2))
    assert x[:, -1].max() <= high[-1] - 0.49 * DP
    assert cKDTree(x).query(x, k=2)[0][:, 1].min() > 0.6 * DP


def test_a_place_does_not_depend_on_who_asks():
    first, second = (Scene(config(tilted(45.0))) for _ in range(2))
    ids = np.arange(first.n_fluid)[::-7]
    assert (first.fluid(ids)["x"] == placed(second)["x"][ids]).all()


@pytest.mark.parametrize("shape", [
    tilted(0.0, width=0.4), plane(0.0, (0.0, -0.4)),
    "box = { low = [-0.3, -0.4]; high = [0.3, 0.4]; open = [\"y+\"]; };",
])  # fmt: skip
def test_walls_along_the_lattice_leave_it_as_it_is(shape):
    scene = Scene(config(shape))
    fluid = scene.fluids[0]
    assert not fluid.oblique and fluid.mass == pytest.approx(1000.0 * DP**2)
    assert (placed(scene)["x"] == scene.from_lattice(fluid, np.arange(scene.n_fluid))).all()


def test_a_solid_box_along_the_lattice_leaves_it_as_it_is():
    scene = Scene(config("box = { low = [-0.1, -0.4]; high = [0.1, -0.2]; };", wall="solid = true;"))
    assert scene.fluids[0].clipped["tank0"] == 100 and not scene.fluids[0].oblique


def test_fluid_without_weight_is_not_packed():
    assert not Scene(config(tilted(30.0), fluid='initial_pressure = "zero";')).fluids[0].oblique


@pytest.mark.parametrize("kind", ["body = { density = 500.0; };", ""], ids=["body", "fixed"])
@pytest.mark.parametrize("centre", [(0.003, -0.3), (0.01, -0.31), (0.0, 0.01, -0.295), (0.0125, 0.0, -0.29)])
def test_a_round_solid_has_its_lift_wherever_it_lies_on_the_lattice(centre, kind):
    """At the start 0.97 to 0.98 of it, with 5 spacings in radius (later 0.98 and more); while its particles lay on a
    lattice 0.93 to 0.95. Not packed it had 0.4 to 0.8, and up to 0.2 to a side.
    """
    d = len(centre)
    ball = f"sphere = {{ centre = {list(centre)}; radius = 0.1; }};"
    low, high = [-0.2] * (d - 1) + [-0.5], [0.2] * (d - 1) + [-0.1]
    case = config(ball, low=low, high=high, wall=f"solid = true; {kind}", fluid="surface = 0.0;")
    force = Sph(case, World.alone(), Pool(1), Timers()).wall_forces()["tank0"][0]
    lift = 9810.0 * np.pi * (0.1**2 if d == 2 else 4 / 3 * 0.1**3)
    assert force[-1] == pytest.approx(lift, rel=0.035)
    assert np.abs(force[:-1]).max() < 0.03 * lift


@pytest.mark.parametrize("kind", ["body = { density = 500.0; };", ""], ids=["body", "fixed"])
@pytest.mark.parametrize("off", [(0.4, 0.0), (0.2, 0.3), (0.0, 0.4), (0.4, 0.0, 0.3)])
def test_a_box_has_its_lift_and_no_push_to_a_side_wherever_it_lies_on_the_lattice(off, kind):
    """Within 5 % of the lift, that of a particle's depth on a box of 10 spacings (measured 0.95 to 0.99, 0.02 to a
    side; along the lattice 0.99). Not packed it had 0.3 to 0.5 of it, and up to 0.63 to a side.
    """
    d = len(off)
    low = np.array([-0.1] * (d - 1) + [-0.3]) + DP * np.array(off)
    box = f"box = {{ low = {low.tolist()}; high = {(low + 0.2).tolist()}; }};"
    low, high = [-0.26] * (d - 1) + [-0.5], [0.26] * (d - 1) + [0.0]
    case = config(box, low=low, high=high, wall=f"solid = true; {kind}")
    force = Sph(case, World.alone(), Pool(1), Timers()).wall_forces()["tank0"][0] / (9810.0 * 0.2**d)
    assert force[-1] == pytest.approx(1.0, abs=0.05)
    assert np.abs(force[:-1]).max() < 0.03


def test_fluid_that_does_not_touch_an_oblique_wall_stays_as_it_is():
    """Not even where walls leave nothing of it."""
    apart = Scene(config(tilted(30.0, middle=(0.0, -0.8)), wall="solid = true;", high=(0.6, -0.3), low=(-0.6, -0.4)))
    gone = Scene(config(plane(20.0, (0.0, 0.5))))
    assert not apart.fluids[0].oblique and apart.n_fluid == len(placed(apart)["x"]) > 0
    assert not gone.fluids[0].oblique and gone.n_fluid == len(placed(gone)["x"]) == 0


def test_check_tells_the_mass_beside_walls_that_cut_the_lattice():
    case = config(tilted(45.0))
    row = next(row for row in derived(case) if row.name == "mass of water beside walls that cut its lattice")
    assert row.value == pytest.approx(Scene(case).fluids[0].filled - 1) and row.value != 0.0


@pytest.mark.parametrize("degrees", [30.0, 45.0])
def test_water_in_an_inclined_tank_stays_at_rest(degrees):
    """From the start its wall bears the weight, up to sound of 3 % (measured 1.6 and 2.3, of a box 1); then pressures
    are those of the depth up to 2 % of that at the bottom, nothing is faster than 0.3 % of c0, and the level stays.
    Without packing the force is off by 57 %, the level sinks by 0.13 spacings.
    """
    sph = Sph(config(tilted(degrees)), World.alone(), Pool(1), Timers())
    scene, weight = sph.scene, 9.81 * placed(sph.scene)["m"].sum()
    height, n = list(scene.axes).index(1), scene.n_fluid
    before, pulls, speeds, pressures = by_id(sph, "x")[0][height, :n], [], [], []
    while sph.time < 0.4:
        sph.step()
        row = sph.scalars()
        pulls.append(-row["force_tank0_y"] / weight)
        if sph.time > 0.2:
            speeds.append(row["max_velocity"])
            pressures.append(scene.eos.pressure(by_id(sph, "drho")[0][:n]))
    after = by_id(sph, "x")[0][height, :n]
    depth = -(after + scene.low[1])
    error = (np.mean(pressures, axis=0) - 9810.0 * depth) / (9810.0 * depth.max())
    band = np.floor(5 * depth / depth.max() * (1 - 1e-9))
    assert max(abs(error[band == k].mean()) for k in range(5)) < 0.02
    assert np.abs(np.array(pulls) - 1).max() < 0.03 and np.mean(pulls) == pytest.approx(1.0, abs=0.002)
    assert max(speeds) < 0.003 * scene.c0
    assert abs(np.mean(after - before)) < 0.05 * DP


def test_a_tank_that_is_turned_with_gravity_and_surface_is_at_rest_as_well():
    """The wall bears the weight along gravity up to 3 % (measured 2.2; without packing 92), nothing across it."""
    along, up = np.array([np.cos(np.radians(30)), np.sin(np.radians(30))]), np.array([-0.5, np.cos(np.radians(30))])
    water = tilted(30.0, length=0.5, width=0.4, middle=(-0.2 * up).tolist())
    sph = Sph(config(tilted(30.0, length=0.5, width=0.8), water=water, fluid="surface = 0.0;",
                     gravity=(-9.81 * up).tolist()), World.alone(), Pool(1), Timers())  # fmt: skip
    weight, pulls = 9.81 * placed(sph.scene)["m"].sum(), []
    while sph.time < 0.2:
        sph.step()
        row = sph.scalars()
        pulls.append([row["force_tank0_x"], row["force_tank0_y"]])
    pulls = -np.array(pulls) / weight
    assert np.abs(pulls @ up - 1).max() < 0.03 and np.abs(pulls @ along).max() < 0.01


DISORDERED = """simulation = { dimensions = 2; end_time = 1.0; }; gravity = [0.0, -9.81];
numerics = { spacing = 0.02; };
fluid = ( { name = "water"; disorder = 0.1; shape = { box = { low = [0.0, 0.0]; high = [WIDTH, 0.6]; }; }; } );
wall = ( { name = "tank"; measure_force = true;
  shape = { box = { low = [0.0, 0.0]; high = [WIDTH, 0.8]; open = ["y+"]; }; }; } );"""


def test_water_that_starts_disordered_rests_from_the_start_and_is_disordered_yet():
    """The tank bears the weight up to 2 % (measured 1.1; a lattice 0.9; not evened out 17), and it is off its lattice
    by half of 0.1 / sqrt(3) spacings.
    """
    sph = Sph(configure(loads(DISORDERED.replace("WIDTH", "0.3"))), World.alone(), Pool(1), Timers())
    scene, pulls = sph.scene, []
    water = placed(scene)
    off = (water["x"] - scene.fluids[0].points(np.arange(scene.n_fluid))) / 0.02
    assert 0.02 < np.sqrt(np.mean(off**2)) < 0.04
    while sph.time < 0.2:
        sph.step()
        pulls.append(-sph.scalars()["force_tank_y"] / (9.81 * water["m"].sum()))
    assert np.abs(np.array(pulls) - 1).max() < 0.02


@pytest.mark.parametrize(("tank", "rests"), [("[0.3, 0.8]", True), ("[0.6, 0.8]", False)], ids=["held", "dam"])
def test_water_that_runs_out_stays_disordered(tank, rests):
    scene = Scene(configure(loads(DISORDERED.replace("[WIDTH, 0.8]", tank).replace("WIDTH", "0.3"))))
    ids = np.arange(scene.n_fluid)
    off = placed(scene)["x"] - scene.disordered(scene.fluids[0], scene.fluids[0].points(ids), ids)
    assert (off == 0.0).all() != rests


def test_a_part_of_water_that_is_evened_out_has_the_bits_of_the_whole():
    """As that of a rank, which packs no more than its part and 11 supports beside it."""
    scene = Scene(configure(loads(DISORDERED.replace("WIDTH", "4.0"))))
    for part in (np.arange(100, 200), np.arange(scene.n_fluid - 700, scene.n_fluid)):
        assert np.array_equal(scene.fluid(part)["x"], placed(scene)["x"][part])
