"""Pressure on areas of walls: their forces add up to that on the wall, in space and time."""

import numpy as np
import pytest
from sph_scenes import engine, jitter, tank

from hpcpic.core.case.config import loads
from hpcpic.core.errors import ConfigError
from sph.case.config import Gauge
from sph.configure import configure

FLOOR = 'at = [0.5, 0.0]; axis = "y-"; '


def gauge(text, name="g"):
    return f'{{ name = "{name}"; what = "wall-pressure"; {text} }}'


def pool(*gauges, kind="extrapolated-free-slip", d=2, size=(1.0, 1.2), **more):
    walls = tank(d, kind, size) + f"\ngauge = ( {', '.join(gauges)} );"
    return engine(**{"d": d, "size": size, "fill": (*size[:-1], 0.5), "more": walls, "alpha": 0.2} | more)


@pytest.mark.parametrize("kind", ["extrapolated-free-slip", "repulsive", "mirror-no-slip"])
def test_areas_side_by_side_bear_what_one_over_all_of_them_does(kind):
    parts = [gauge(f'at = [{x}, 0.0]; axis = "y-"; size = [{w}, 0.0];', f"g{k}")
             for k, (x, w) in enumerate([(0.31, 0.02), (0.37, 0.1), (0.46, 0.08), (0.4, 0.2)])]  # fmt: skip
    sph = pool(*parts, kind=kind)
    jitter(sph)
    sph.evolution.evaluate_forces()
    *small, all_of_it = sph.sensors.now() * [0.02, 0.1, 0.08, 0.2]
    assert abs(all_of_it) > 100.0
    assert np.sum(small) == pytest.approx(all_of_it, rel=1e-8)  # rounded to 2^-40 rho0 c0^2


def test_readings_are_means_over_the_time_since_the_last_one():
    """As the impulse on all of the wall tells: a floor of its own, and an area beyond its ends. Looks begin none."""
    floor = """wall = ( { name = "floor"; measure_force = true; type = "extrapolated-free-slip";
                 shape = { plane = { point = [0.0, 0.0]; normal = [0.0, 1.0]; }; }; } );"""
    sph = engine(periodic=("x",), fill=(1.0, 0.5), more=f"{floor} gauge = ( {gauge(FLOOR + 'size = [1.0, 0.0];')} );")
    jitter(sph)
    assert sph.scalars()["g"] == pytest.approx(-sph.wall_forces()["floor"][0][1], rel=1e-8)  # now
    for steps in (1, 3):
        before, since = sph.forces.impulses[0].copy(), sph.time
        for _ in range(steps):
            sph.step()
            pushed = -(sph.forces.impulses[0] - before)[2]
            assert sph.scalars()["g"] == pytest.approx(pushed / (sph.time - since), rel=1e-8)
        read = sph.scalars()["g"]
        sph.sampled()
        assert sph.scalars()["g"] == read  # of one time the same


@pytest.mark.parametrize(
    "kind, error", [("extrapolated-free-slip", 0.01), ("mirror-no-slip", 0.01), ("repulsive", 0.09)]
)
def test_corners_take_nothing_from_a_sensor_in_them(kind, error):
    """Bodies behind two walls bear a quarter of the load at the foot of one, which was missing. Once it has settled."""
    side = [gauge(f'at = [1.0, {y}]; axis = "x+"; size = [0.0, 0.05];', f"g{k}") for k, y in enumerate((0.025, 0.075))]
    sph = pool(*side, gauge('at = [0.05, 0.0]; axis = "y-"; size = [0.1, 0.0];', "floor"), kind=kind)
    for _ in range(200):
        sph.step()
    found, weight = sph.scalars(), 1000 * 9.81
    for name, depth in (("g0", 0.475), ("g1", 0.425), ("floor", 0.5)):
        assert found[name] == pytest.approx(weight * depth, rel=error), name


@pytest.mark.parametrize("way", ["amplitude = [1e-6, 0.0];", "velocity = [0.0, 1e-6];"])
def test_corners_take_nothing_from_a_sensor_at_the_foot_of_a_piston(way):
    """Its distance from the floor stays. That of a gate that goes up does not: what the corner bears is not counted."""
    shape = "shape = { box = { low = [1.0, 0.0]; high = [1.2, 0.9]; }; };"
    piston = f'{{ name = "piston"; solid = true; {shape} motion = {{ {way} }}; }} );'
    foot = gauge('at = [1.0, 0.025]; axis = "x+"; size = [0.0, 0.05]; wall = "piston";')
    more = tank(2, "extrapolated-free-slip", (1.2, 1.0)).replace(" );", f", {piston}") + f"gauge = ( {foot} );"
    sph = engine(size=(1.2, 1.0), fill=(1.0, 0.5), spacing=0.05, more=more)
    for _ in range(200):
        sph.step()
    expected = 1.0 if "amplitude" in way else 0.77
    assert sph.scalars()["g"] == pytest.approx(1000 * 9.81 * 0.475 * expected, rel=0.01 if expected == 1.0 else 0.06)


@pytest.mark.validation
def test_corners_take_nothing_from_a_sensor_in_space():
    """A disc at one edge and one in a corner, a square on three walls: to 1.5 %."""
    side, foot = 'at = [0.8, %s, 0.04]; axis = "x+"; radius = 0.04;', 'at = [0.05, 0.05, 0.0]; axis = "z-";'
    foot += "size = [0.1, 0.1, 0.0];"
    sensors = gauge(side % 0.4, "edge"), gauge(side % 0.04, "corner"), gauge(foot, "foot")
    sph = pool(*sensors, d=3, size=(0.8, 0.8, 0.6), fill=(0.8, 0.8, 0.5), spacing=0.05)
    for _ in range(200):
        sph.step()
    found, weight = sph.scalars(), 1000 * 9.81
    for name, depth in (("edge", 0.46), ("corner", 0.46), ("foot", 0.5)):
        assert found[name] == pytest.approx(weight * depth, rel=0.015), name


def test_a_sensor_under_still_water_reads_its_weight():
    """To 5 %, which sums over neighbours lack at h / dp = 1.3, at rest on the lattice: a rectangle and a disc in the
    floor of a 3D tank and one in its side.
    """
    floor = 'at = [0.4, 0.4, 0.0]; axis = "z-"; '
    sph = pool(gauge(floor + "size = [0.2, 0.3, 0.0];", "a"), gauge(floor + "radius = 0.2;", "b"),
               gauge('at = [0.8, 0.4, 0.25]; axis = "x+"; size = [0.0, 0.3, 0.2];', "c"),
               d=3, size=(0.8, 0.8, 0.6), fill=(0.8, 0.8, 0.5), spacing=0.05)  # fmt: skip
    found, weight = sph.scalars(), 1000 * 9.81
    for name, depth, error in (("a", 0.5, 0.05), ("b", 0.5, 0.06), ("c", 0.25, 0.06)):
        assert found[name] == pytest.approx(weight * depth, rel=error)


def test_a_sensor_moves_with_its_wall():
    more = tank(2, more="motion = { velocity = [0.0, 1.0]; };") + f"gauge = ( {gauge(FLOOR + 'wall = {0};')} );"
    for wall, height in (('"tank"', 1.0), ('""', 0.0)):
        sph = engine(more=more.replace("{0}", wall))
        for _ in range(3):
            sph.step()
        sph.sensors.now()
        up = sph.scene.axes.index(1)
        assert sph.tasks.arena["area_middle"][0, up] == pytest.approx(height * sph.time, abs=1e-12)


def test_areas():
    def area(text, d=2):
        more = tank(d) + f"gauge = ( {gauge(text)} );"
        return engine(d=d, spacing=0.1, more=more).scene.config.gauge[0].area(0.1)

    assert area(FLOOR) == 0.1 and area(FLOOR + "size = [0.3, 0.0];") == 0.3 and area(FLOOR + "radius = 0.2;") == 0.4
    assert area(FLOOR + "radius = 0.04;") == pytest.approx(0.081)


@pytest.mark.parametrize("radius", [0.04, 0.06, 0.13, 0.3])
def test_a_disc_has_the_area_of_its_soft_edge(radius):
    """Mean over places on a lattice of what bodies have of it: 1 in the middle, 0 a spacing farther out, linearly."""
    places = np.random.default_rng(3).uniform(0.0, 0.1, (2, 4000))
    lattice = 0.1 * np.mgrid[-6:7, -6:7]
    r = np.hypot(*(lattice[..., None] - places[:, None, None]))
    mean = 0.1**2 * np.clip((radius - r) / 0.1 + 0.5, 0.0, 1.0).sum(axis=(0, 1)).mean()
    disc = Gauge(name="g", what="wall-pressure", at=(0.0, 0.0, 0.0), radius=radius)
    assert disc.area(0.1) == pytest.approx(mean, rel=0.01)


@pytest.mark.parametrize(
    "text, words",
    [("at = [0.5, 0.0];", "axis is missing"), (FLOOR + "radius = 0.1; size = [0.1, 0.0];", "a rectangle or a disc"),
     (FLOOR + 'wall = "roof";', "floor")],
)  # fmt: skip
def test_what_an_area_lacks_is_told(text, words):
    from sph_scenes import text as case

    more = tank(2).replace('"tank"', '"floor"') + f"gauge = ( {gauge(text)} );"
    with pytest.raises(ConfigError, match=words):
        configure(loads(case(more=more)))


@pytest.mark.parametrize("axis", ["x+", "y-"])
def test_a_sensor_in_an_inclined_wall_reads_the_pressure_along_its_normal(axis):
    """All of the force on a plane at 40 degrees, over the width of an area that holds all of it, whichever axis is
    named.
    """
    slope = np.radians(40.0)
    normal = [float(-np.sin(slope)), float(np.cos(slope))]  # fluid pushes along x+ and y-
    wall = f"""wall = ( {{ name = "slope"; measure_force = true; type = "extrapolated-free-slip";
        shape = {{ plane = {{ point = [0.5, 0.3]; normal = {normal}; }}; }}; }} );"""
    whole = gauge(f'at = [0.5, 0.3]; axis = "{axis}"; radius = 5.0;')
    sph = engine(size=1.0, fill=1.0, gravity=(0.0, 0.0), pressure="zero", more=f"{wall} gauge = ( {whole} );")
    jitter(sph)
    sph.evolution.evaluate_forces()
    force = -np.dot(sph.wall_forces()["slope"][0], normal)
    assert sph.sensors.now()[0] * 10.0 == pytest.approx(force, rel=1e-6) and abs(force) > 100.0


def test_a_sensor_in_a_round_wall_lies_in_its_tangent():
    disc = """wall = ( { name = "disc"; solid = true; type = "extrapolated-free-slip";
        shape = { sphere = { centre = [0.5, 0.5]; radius = 0.2; }; }; } );"""
    at = 0.5 - 0.2 * np.sqrt(0.5)
    sensor = gauge(f'at = [{at}, {at}]; axis = "x+"; radius = 0.04;')
    sph = engine(size=1.0, fill=1.0, more=f"{disc} gauge = ( {sensor} );")
    along = sph.tasks.arena["area_along"][0]
    assert np.abs(sph.tasks.arena["area_frame"][0, along]) == pytest.approx([np.sqrt(0.5)] * 2, abs=1e-3)
