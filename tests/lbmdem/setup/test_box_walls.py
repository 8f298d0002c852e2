"""The planes that grains meet: sides of the box, screens under samples, obstacles."""

import numpy as np
import pytest
from dem_scenes import box, grains

from hpcpic.core.case.config import loads
from hpcpic.core.physics.contact_law import ContactLaw
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived
from lbmdem.forecast.free_fall import impact_speed
from lbmdem.grains.contact_network import wall_force
from lbmdem.grains.dem import Dem
from lbmdem.physics.lubrication import Film
from lbmdem.physics.plane_walls import PlaneWall
from lbmdem.setup.box_walls import box_walls
from lbmdem.setup.scene import Scene

SHEARED = """
simulation = { end_time = 0.01; };
domain = { size = [4.0e-3, 4.0e-3, 6.0e-3]; spacing = 2.0e-4; periodic = ["x"]; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-4; relaxation_time = 1.1; };
obstacle = ( { name = "floor"; shape = { plane = { point = [0.0, 0.0, 4.0e-4]; normal = [0.0, SLOPE, 1.0]; }; };
               velocity = [-0.02, 0.0, 0.0]; } );
grains = ( { density = 1000.0; diameters = { min = 1.0e-3; max = 1.0e-3; count = 4; };
             packing = { porosity = 0.9; low = LOW; }; } );
"""


def walls_of(low, slope=0.0):
    text = SHEARED.replace("LOW", f"{low!r}").replace("SLOPE", f"{slope!r}")
    return box_walls(Scene(configure(loads(text))))


@pytest.mark.parametrize(
    ("low", "slope", "screen"),
    [(4.0e-4, 0.0, False), (3.0e-4, 0.0, False), (5.0e-4, 0.0, True), (4.0e-4, 0.01, True), (3.0e-4, 0.01, False)],
)
def test_a_screen_is_there_where_no_plane_covers_it(low, slope, screen):
    """One at rest on a floor that slides would hold back what lies on it."""
    walls = walls_of(low, slope)
    assert walls[2].point == (0.0, 0.0, low if screen else 0.0)
    assert [wall.film for wall in walls] == [True, True, not screen, True, True]


@pytest.mark.parametrize(
    ("height", "more", "screen", "verdict"),
    [
        (1.1e-3, "", True, "ok"),
        (1.1e-3, "moving = false;", True, "ok"),
        (0.9e-3, "", False, "warn"),
        (0.9e-3, "moving = false;", False, "ok"),
    ],
)
def test_a_screen_is_there_beside_sets_of_their_own_places_above_it(height, more, screen, verdict):
    """One that starts below would be thrown out, and a fixed one is what the sample is to fall on: check says so."""
    ball = f"{{ diameter = 4.0e-4; position = [2.0e-3, 2.0e-3, {height!r}]; {more} }} );"
    text = SHEARED.replace("LOW", "8.0e-4").replace("SLOPE", "0.0")
    head, tail = text.rsplit("} );", 1)
    config = configure(loads(f"{head}}}, {ball}{tail}"))
    assert box_walls(Scene(config))[2].point == (0.0, 0.0, 8.0e-4 if screen else 0.0)
    told = next(one for one in derived(config) if one.name == "screen for grains that move")
    assert (told.value, told.verdict) == (8.0e-4 if screen else 0.0, verdict)
    assert verdict == "ok" or ("grains_2" in told.cure and told.key == ("grains", 0, "packing", "low"))


def test_a_screen_above_a_hopper_is_told():
    """Its planes would meet no grain; from 0 on a packing fills what they leave, and there is none."""

    def told(slope, *sets):
        text = SHEARED.replace("LOW", "8.0e-4").replace("SLOPE", slope)
        return [one for one in derived(configure(loads(text, sets=sets))) if one.name.startswith("screen")]

    ((hopper,), (level,)) = told("0.5"), told("0.0")
    assert hopper.verdict == "warn" and "packing.low = 0" in hopper.cure and level.verdict == "ok"
    assert not told("0.5", "grains[0].packing.low=0.0")


@pytest.mark.parametrize("d", [2, 3])
def test_a_plane_through_which_the_fluid_passes_has_contacts_and_no_film(world, pool, d):
    floor = {film: PlaneWall([0.0] * d, np.eye(d)[-1], film=film) for film in (True, False)}
    columns = grains([[0.5] * (d - 1) + [0.0505]], v=[[0.0] * (d - 1) + [-0.1]])
    forces = {}
    for film, wall in floor.items():
        dem = Dem(world, pool, box(world, (1.0,) * d), columns, ContactLaw(1.0), (wall,), film=Film(0.5, 0.01, d))
        assert (dem.fastest_film(1e-3) > 0.0) == film
        dem.advance(1e-6, 1)
        forces[film] = wall_force(dem, 0)[d - 1]
    assert forces[True] < 0.0 and forces[False] == 0.0
    columns = grains([[0.5] * (d - 1) + [0.0495]])
    dem = Dem(world, pool, box(world, (1.0,) * d), columns, ContactLaw(1.0), (floor[False],), film=Film(0.5, 0.01, d))
    assert wall_force(dem, 0)[d - 1] == pytest.approx(-5e-4, rel=1e-9)


@pytest.mark.parametrize("low", [4.0e-4, 3.0e-4, 5.0e-4])
def test_a_packing_on_a_plane_or_a_screen_falls_no_further(low):
    text = SHEARED.replace("LOW", f"{low!r}").replace("SLOPE", "0.0") + "gravity = [0.0, 0.0, -9.81];"
    config = configure(loads(text.replace("density = 1000.0; diameters", "density = 2650.0; diameters")))
    assert impact_speed(config, 0) == 0.0
