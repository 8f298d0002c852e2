"""Gaps between discs that stay, and beside walls, are told in nodes; a finer spacing cures narrow ones."""

import math

import numpy as np
import pytest

from hpcpic.core.case.config import loads
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived
from lbmdem.forecast.throats import closed, throats

CASE = """
simulation = { dimensions = 2; end_time = 1.0; };
domain = { size = [0.02, 0.02]; spacing = 0.001; periodic = ["x", "y"]; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-6; body_force = [0.0, 1.0e-4]; };
grains = ({ diameter = 0.005; moving = false; position = [0.01, 0.01]; });
"""
DISCS, WALL = "narrowest gap between discs that stay", "narrowest gap between a disc that stays and a wall"


def told(*sets):
    return {one.name: one for one in throats(configure(loads(CASE, sets=sets)))}


@pytest.mark.parametrize(
    "name, gap, sets",
    [
        (DISCS, 15.0, ()),
        (DISCS, 3.0, ("grains[0].position=([0.004, 0.01], [0.012, 0.01])",)),
        (DISCS, 2.0, ("grains[0].position=([0.001, 0.01], [0.014, 0.01])",)),  # across a periodic side
        (DISCS, 4.0, ("grains[0].position=([0.001, -1e-20], [0.010, 0.020])",)),
        (DISCS, math.hypot(6.0, 6.0) - 5.0, ("grains[0].position=([0.018, 0.003], [0.004, 0.017])",)),
        (DISCS, 1.0, ('domain.periodic=["y"]', "domain.size=[0.02, 0.006]")),
        (WALL, 1.5, ('domain.periodic=["y"]', "grains[0].position=([0.004, 0.01], [0.005, 0.002])")),
    ],
)
def test_the_narrowest_gap_is_told_and_its_cure_passes(name, gap, sets):
    found = told(*sets)[name]
    assert found.value == pytest.approx(gap)
    assert found.verdict == ("ok" if gap > 5.0 else "warn")
    if found.verdict != "ok":
        setting, value = found.cure.split()[0], found.cure.split()[2]
        assert told(*sets, f"{setting}={value}")[name].verdict == "ok"


def test_what_is_closed_moves_or_is_open_makes_no_throat():
    """Two discs that touch, and one beside a face that lets fluid through; spheres have ways beside their gaps."""
    touching = "grains[0].position=([0.005, 0.01], [0.01, 0.01])"
    opened = told(touching, "domain.periodic=[]", 'boundary=({face="x-";type="pressure";pressure=0.0;})')
    assert opened[WALL].value == pytest.approx(7.5)
    assert DISCS not in told(touching, "domain.periodic=[]")
    assert not told("grains[0].moving=true")
    cube = "domain.size=[0.02, 0.02, 0.02]", "grains[0].position=[0.01, 0.01, 0.01]"
    assert not told("simulation.dimensions=3", "fluid.body_force=[0.0, 0.0, 1e-4]", *cube)


@pytest.mark.parametrize(
    ("nodes", "moving", "side", "verdict"),
    [(8, "false", 0.006, "warn"), (10, "false", 0.006, "ok"), (8, "true", 0.006, "ok"), (8, "false", 0.0085, "ok")],
)
def test_dense_spheres_at_given_places_need_more_nodes(nodes, moving, side, verdict):
    """Their drag is off by where their centres lie between nodes: 20 % at 7 and 8 across."""
    box = f"size = [{side}, {side}, {side}]; spacing = {side / round(200 * nodes * side)}; periodic"
    text = CASE.replace("dimensions = 2; ", "").replace("size = [0.02, 0.02]; spacing = 0.001; periodic", box)
    sets = f"grains[0].moving={moving}", "grains[0].position=[0.003, 0.003, 0.003]", "fluid.body_force=[]"
    found = derived(configure(loads(text, sets=sets)))
    assert next(one.verdict for one in found if one.name == "nodes across a grain") == verdict


def test_a_disc_that_leaves_the_fluid_no_other_way_has_its_gaps_told():
    """Where it moves and fills more than half of the room between walls, or planes; measured 2 nodes are enough."""
    channel = "grains[0].moving=true", 'domain.periodic=["y"]', "grains[0].diameter=0.017"
    found = told(*channel)["gaps beside grains_1 in the middle between walls"]
    assert found.value == pytest.approx(1.5) and found.verdict == "warn"
    assert not [
        one for one in told(*channel, f"domain.spacing={found.cure.split()[2]}").values() if one.verdict != "ok"
    ]
    assert not told(*channel[1:]).keys() & {found.name} and not told(*channel, "grains[0].diameter=0.009")
    assert not told(*channel, 'domain.periodic=["x", "y"]') and not told(*channel, "coupling.frozen=true")
    plane = "obstacle=({ shape = { plane = { point = [0.001, 0.0]; normal = [1.0, 0.0]; }; }; })"
    assert told(*channel, plane)[found.name].value == pytest.approx(1.0)


def test_many_discs_have_the_narrowest_of_all_pairs():
    """Against every pair, with the images of each."""
    x, n = np.random.default_rng(5).uniform(0.0, 1.0, (60, 2)), 60
    moved = (np.array([i, j]) for i in (-1, 0, 1) for j in (-1, 0, 1))
    away = np.min([np.linalg.norm(x[:, None] - x + shift, axis=2) for shift in moved], axis=0)
    away[np.arange(n), np.arange(n)] = 1.0
    half = 0.4 * float(away.min())
    sets = "domain.size=[1.0, 1.0]", f"grains[0].diameter={2 * half}", f"grains[0].position=({str(x.tolist())[1:-1]})"
    assert told(*sets, "domain.spacing=0.001")[DISCS].value == pytest.approx((away.min() - 2.0 * half) / 0.001)


def test_beds_of_discs_that_move_have_closed_pores():
    """A column of 120 discs stood under water, of which a dry one ran out by 3.6 of its widths."""
    column = "(" + ", ".join(f"[{0.003 + 0.005 * i}, {0.003 + 0.005 * j}]" for j in range(4) for i in range(3)) + ")"
    piled = "gravity=[0.0, -9.81]", "domain.periodic=[]", "grains[0].moving=true", f"grains[0].position={column}"

    def names(*sets):
        return [one.name for one in closed(configure(loads(CASE, sets=(*piled, *sets))))]

    assert names() == ["pores between discs of grains_1 that touch"]
    assert not names("grains[0].position=([0.003, 0.003], [0.01, 0.003])")  # a layer encloses none
    assert not names("grains[0].moving=false") and not names("coupling.frozen=true")
    assert not names("gravity=[0.0, 0.0]", "domain.size=[0.04, 0.04]")
    packed = "grains=({diameters={min=1e-3; max=1e-3; count=150;}; packing={porosity=0.25;};})"
    assert names(packed)
