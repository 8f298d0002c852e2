"""Round walls: particles lie in layers along the side, and water that turns beside one that slips goes on turning."""

import numpy as np
import pytest

import sph
from sph.setup.scene import Scene
from sph.setup.signed_distance import signed_distance

DP = 0.01
TANKS = {  # axes, shape, its room and that of the tank with three layers
    "disc": (2, {"sphere": {"centre": [0.2, 0.3], "radius": 0.1}}, np.pi * np.array([0.1**2, 0.13**2])),
    "ball": (3, {"sphere": {"centre": [0.2, 0.3, 0.1], "radius": 0.1}}, 4 / 3 * np.pi * np.array([0.1**3, 0.13**3])),
    "can": (
        3, {"cylinder": {"base": [0.2, 0.3, 0.1], "top": [0.2, 0.42, 0.26], "radius": 0.1}},
        np.pi * np.array([0.1**2 * 0.2, 0.13**2 * 0.26]),
    ),
}  # fmt: skip


SOLIDS = {
    "disc": (2, TANKS["disc"][1], np.pi * np.array([0.07**2, 0.1**2])),
    "ball": (3, TANKS["ball"][1], 4 / 3 * np.pi * np.array([0.07**3, 0.1**3])),
    "can": (3, TANKS["can"][1], np.pi * np.array([0.07**2 * 0.14, 0.1**2 * 0.2])),
}


def case(d, shape, *walls, **more):
    return sph.Case(
        simulation={"dimensions": d, "end_time": 1.0}, numerics={"spacing": DP}, eos={"max_velocity": 0.2},
        fluid=[{"name": "water", "shape": shape, **more}], wall=[{"name": "tank", "shape": shape}, *walls],
    )  # fmt: skip


@pytest.mark.parametrize("solid", [False, True], ids=["tank", "solid"])
@pytest.mark.parametrize("name", TANKS)
def test_a_round_wall_has_the_particles_of_its_layers_evenly_spread(name, solid):
    """One for the room of a spacing within the rounding of rings, none nearer than 0.85 spacings to another, normals
    into the fluid.
    """
    d, shape, (inner, outer) = (SOLIDS if solid else TANKS)[name]
    core = {"name": "core", "solid": True, "shape": shape}
    tank = {"box": {"low": [0.0] * d, "high": [0.5] * d}}
    wall = Scene((case(d, tank, core) if solid else case(d, shape)).config).walls[-1]
    ids, x, normal = wall.near(np.full(d, -1.0), np.full(d, 1.0))
    assert len(ids) * DP**d == pytest.approx(outer - inner, rel=0.015)
    np.testing.assert_allclose(np.sum(normal * normal, axis=1), 1.0, rtol=1e-12)
    ahead = signed_distance(wall.shape, x + 1e-3 * DP * normal) - signed_distance(wall.shape, x)
    assert (ahead * (1 if solid else -1) > 0.9e-3 * DP).mean() > 0.95  # at the rim of a can neither side is nearer
    places, normals = wall.at(ids)
    assert np.array_equal(places, x) and np.array_equal(normals, normal)
    apart = min(np.sort(np.sum((x - one) ** 2, axis=1))[1] for one in x[:: max(1, len(x) // 300)])
    assert apart > (0.85 * DP) ** 2
    half = [wall.near(np.array([low, *[-1.0] * (d - 1)]), np.array([high, *[1.0] * (d - 1)]))[0]
            for low, high in ((-1.0, 0.2), (0.2, 1.0))]  # fmt: skip
    assert np.array_equal(np.sort(np.concatenate(half)), ids)  # whoever asks for a part of them


def test_water_that_turns_in_a_disc_that_slips_goes_on_turning():
    """In a fifth of a turn it lost a fourth of its energy while the particles of the tank lay on a lattice."""
    flow = {"type": "linear", "gradient": [0.0, -2.0, 2.0, 0.0], "centre": [0.0, 0.0]}
    disc = {"sphere": {"centre": [0.0, 0.0], "radius": 0.1}}
    turning = case(2, disc, flow=flow, initial_pressure="flow").changed({"eos.background_pressure": 100.0})
    with turning.simulation(threads=1) as sim:
        start = sim.scalars()["energy_kinetic"]
        sim.advance(until=0.6)
        assert sim.scalars()["energy_kinetic"] == pytest.approx(start, rel=0.03)


def test_water_that_turns_around_a_disc_that_slips_goes_on_turning():
    """In half a turn it lost 7 % of its energy while the particles of the disc lay on a lattice."""
    flow = {"type": "linear", "gradient": [0.0, -2.0, 2.0, 0.0], "centre": [0.0, 0.0]}
    tank, core = ({"sphere": {"centre": [0.0, 0.0], "radius": radius}} for radius in (0.2, 0.1))
    ring = case(2, tank, {"name": "core", "solid": True, "shape": core}, flow=flow, initial_pressure="flow")
    with ring.changed({"eos.max_velocity": 0.4, "eos.background_pressure": 400.0}).simulation(threads=1) as sim:
        start = sim.scalars()["energy_kinetic"]
        sim.advance(until=1.6)
        assert sim.scalars()["energy_kinetic"] == pytest.approx(start, rel=0.02)
