"""Particles torn off the fluid fly on as drops; fluid leaves a tank over its edges, and the domain where it may."""

import numpy as np
import pytest
from sph_scenes import config, engine, listed, tank, torn, water

from hpcpic.core.errors import Diverged
from sph.particles.strays import MAX_DENSITY_ERROR, most_strays
from sph.setup.scene import Scene


def run(sph, steps):
    for _ in range(steps):
        sph.step()
        assert sph.guard() is None
    return sph


def test_a_stray_gets_the_density_of_rest_keeps_its_mass_and_falls_on(caplog):
    """A drop of two particles starts at 1.32 rho0, with one neighbour each."""
    sph = engine(case=torn())
    start = sph.scalars()
    drop = sph.storage.fluid_slots[sph.storage.drho[sph.storage.fluid_slots] > MAX_DENSITY_ERROR * sph.scene.rho0]
    numbers = sph.storage.key[drop]
    assert len(drop) == 2
    run(sph, 3)
    found = sph.scalars()
    assert found["strays"] == sph.strays.count == 2 and "2 stray particles" in caplog.text
    assert found["mass"] == start["mass"] and found["max_density_error"] < MAX_DENSITY_ERROR
    rows = np.flatnonzero(np.isin(sph.storage.key, numbers) & (sph.storage.flags > 0))
    assert np.mean(sph.storage.v[sph.scene.axes.index(1), rows]) == pytest.approx(-9.81 * sph.time, rel=1e-9)


@pytest.mark.parametrize("excess", [MAX_DENSITY_ERROR, -MAX_DENSITY_ERROR])
@pytest.mark.parametrize("place", [(0.45, 0.25), (0.45, 0.05), (0.05, 0.05)])
def test_such_a_density_inside_the_fluid_ends_the_run_and_names_the_particle(place, excess):
    """Also at the floor and in a corner, where it can have fewer neighbours."""
    sph = water()
    inside = sph.storage.fluid_slots[
        np.argmin(np.abs(sph.storage.physical("x", sph.storage.fluid_slots) - place).sum(axis=1))
    ]
    sph.storage.drho[inside] = excess * sph.scene.rho0
    x, y = place
    named = rf"the density of particle {sph.storage.number(inside)} at \({x}, {y}\) m is"
    with pytest.raises(Diverged, match=f"step 0, t = 0 s: {named}"):
        sph.step()


@pytest.mark.parametrize("kind", ["extrapolated-free-slip", "pressure-continuity"])
@pytest.mark.parametrize("place", [(0.45, 0.04), (0.04, 0.04)])
def test_a_drop_that_strikes_a_wall_is_alone_there(place, kind):
    """On the floor and in a corner, whose bodies are no fluid around it: such a drop, at half the sound speed, ended
    runs.
    """
    sph = engine(more=tank(2, kind, (1.0, 1.2)), size=(1.0, 1.2), low=(0.8, 0.0), fill=(1.0, 0.3), spacing=0.1)
    drop = sph.storage.fluid_slots[5]
    for axis, physical in enumerate(sph.scene.axes):
        sph.storage.x[axis, drop], sph.storage.v[axis, drop] = place[physical], (0.0, -sph.scene.c0 / 2)[physical]
    sph.storage.drho[drop] = 1.01 * MAX_DENSITY_ERROR * sph.scene.rho0
    sph.sort()
    run(sph, 20)
    assert sph.strays.count >= 1 and sph.scalars()["max_density_error"] < MAX_DENSITY_ERROR


KINDS = ["extrapolated-free-slip", "extrapolated-no-slip", "pressure-continuity", "mirror-no-slip"]


def drop_at_floor(kind, height, speed, excess, n=1):
    """A drop of n particles in a row, alone and without gravity, so many spacings over a floor. Yields after each step
    the largest speed, over c0, and the lowest height, in spacings.
    """
    dp = 0.05
    size = (1.0, 1.2)
    sph = engine(more=tank(2, kind, size), size=size, low=(0.8, 0.0), fill=(1.0, 0.3), spacing=dp, gravity=(0.0, 0.0))
    storage, (x, y) = sph.storage, (sph.scene.axes.index(k) for k in range(2))
    drop = storage.fluid_slots[5 : 5 + n]
    numbers = storage.numbers(drop)
    storage.x[x, drop], storage.x[y, drop] = 0.3 + dp * np.arange(n), height * dp
    storage.v[x, drop], storage.v[y, drop] = 0.0, speed * sph.scene.c0
    storage.drho[drop] = excess * sph.scene.rho0
    sph.sort()
    while True:
        sph.step()
        slots = storage.fluid_slots
        slots = slots[np.isin(storage.numbers(slots), numbers)]
        yield np.sqrt(np.sum(storage.v[:, slots] ** 2, axis=0)).max() / sph.scene.c0, storage.x[y, slots].min() / dp


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [1, 2])
def test_spray_in_tension_does_not_stick_to_a_wall(kind, n):
    """At half a spacing off the wall, where fluid is: it stays, and does not swing through the surface."""
    course = drop_at_floor(kind, 0.5, 0.0, -0.2, n)
    speeds, heights = zip(*(next(course) for _ in range(300)))
    assert max(speeds) < 0.05 and min(heights) > 0.4  # the first step still pulls two together


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("speed", [0.05, 0.2])
def test_a_drop_leaves_a_wall_as_it_came(kind, speed):
    """No faster but by the error of steps that change, and most of its speed is left: nothing holds it."""
    course = drop_at_floor(kind, 3.0, -speed, 0.0)
    found = [next(course) for _ in range(400)]
    assert speed * 0.8 < found[-1][0] < speed * 1.03
    assert found[-1][1] > 3.0


def test_water_and_a_sheet_of_it_keep_their_tension():
    """Also in the corner of a tank; but the ends of the sheet, a particle thick, which have four neighbours each."""
    sph = engine(more=tank(2, size=(2.0, 1.0)), size=(2.0, 1.0), fill=(1.0, 0.5), spacing=0.05, smoothing=2.0)
    storage, tension = sph.storage, -0.05 * sph.scene.rho0
    fluid = storage.fluid_slots
    ends = storage.numbers(fluid[[0, 11]])
    for axis, values in ((0, 1.5), (1, 0.2 + 0.045 * np.arange(12))):
        storage.x[sph.scene.axes.index(axis), fluid[:12]] = values
    storage.drho[fluid] = tension
    sph.sort()
    sph.strays.find(-tension)
    sph.strays.settle()
    slots = storage.fluid_slots
    kept = storage.drho[slots] == tension
    assert np.array_equal(kept, ~np.isin(storage.numbers(slots), ends))


def test_a_fluid_that_bursts_ends_the_run():
    """More strays in a step than there may be, each without neighbours."""
    sph = engine(size=(20.0, 20.0), fill=(1.0, 1.3), spacing=0.1, gravity=(0.0, 0.0), more=tank(2, size=(20.0, 20.0)))
    rows = sph.storage.fluid_slots[: most_strays(sph.scene.n_fluid) + 1]
    sph.storage.x[0, rows] = 5.0 + np.arange(len(rows))
    sph.storage.drho[rows] = -MAX_DENSITY_ERROR * sph.scene.rho0
    sph.sort()
    with pytest.raises(Diverged, match=f"the density of {len(rows)} particles is beyond"):
        sph.step()


# name: domain, open sides of it, tanks (low, high, faces left out)
LEAVING = {
    "overflow": ((2.0, 1.0), ["y-"], [((0.0, 0.0), (0.5, 0.1), ["y+"])]),
    "open end": ((1.0, 1.0), ["x+"], [((0.0, 0.0), (0.7, 1.0), ["y+", "x+"])]),
    "waterfall": ((1.5, 1.0), [], [((0.0, 0.3), (0.55, 1.0), ["y+", "x+"]), ((0.55, 0.0), (1.5, 0.3), ["y+"])]),
}


def leaving(name):
    size, outflow, tanks = LEAVING[name]
    bottom = min(0.3, tanks[0][0][1])
    walls = ", ".join(
        f"{{ shape = {{ box = {{ low = {listed(low)}; high = {listed(high)}; open = {listed(faces)}; }}; }}; }}"
        for low, high, faces in tanks
    )
    settings = {"size": size, "fill": (0.5, bottom + 0.5), "spacing": 0.05, "low": (0.0, bottom), "sound": 14.0}
    return engine(more=f"wall = ( {walls} );", outflow=outflow, **settings)


@pytest.mark.parametrize("name", LEAVING)
def test_fluid_that_has_gone_over_an_edge_has_not_gone_through_a_wall(name):
    sph = leaving(name)
    start, n = sph.scalars(), sph.scene.n_fluid
    assert n == 100  # nothing of it is taken for what lies in the other tank
    for _ in range(300):
        sph.step()
        assert sph.iteration % 10 or sph.guard() is None
    found = sph.scalars()
    x = sph.storage.physical("x", sph.storage.fluid_slots)
    if sph.scene.config.domain.outflow:
        assert 0 < found["outflow"] == pytest.approx(start["mass"] - found["mass"], rel=1e-9)
        assert found["mass_total"] == pytest.approx(start["mass"], rel=1e-14)
        assert len(x) < n and np.all(x[:, 1] > -0.5)
    else:
        assert found["mass"] == start["mass"] and np.count_nonzero(x[:, 1] < 0.3) > n / 10
        assert np.all(x[:, 1] > -0.05)


@pytest.mark.parametrize("look", [True, False])
def test_a_leak_is_seen_though_fluid_may_be_outside(look):
    """Also if it is no longer in the wall when the guard looks."""
    sph = leaving("overflow")
    one = sph.storage.fluid_slots[5]
    for axis, physical in enumerate(sph.scene.axes):
        sph.storage.x[axis, one], sph.storage.v[axis, one] = (0.25, -0.075)[physical], (0.0, -10.0)[physical]
    sph.sort()
    if look:
        assert "went through wall_1" in sph.guard()
    for _ in range(40):
        sph.step()
    assert sph.storage.physical("x", sph.storage.fluid_slots)[:, 1].min() > 0.0  # the wall has pushed it back
    assert "went through wall_1" in sph.guard()


@pytest.mark.parametrize("below, told", [(0.075, "went through wall_1"), (0.11, None), (0.15, None), (0.04, None)])
def test_a_drop_that_strikes_a_tank_from_outside_has_not_gone_through_it(below, told):
    """Three layers of 0.05 m: a drop that had gone over the rim of a tank ended a run of hours at its outer side."""
    sph = leaving("overflow")
    one = sph.storage.fluid_slots[5]
    for axis, physical in enumerate(sph.scene.axes):
        sph.storage.x[axis, one] = (0.25, -below)[physical]
    sph.sort()
    found = sph.guard()
    assert found is None if told is None else told in found


@pytest.mark.parametrize("place, told", [
    ((0.8, 0.7), None), ((0.8, 0.3), None),  # far from its sides: it has come in from above
    ((0.57, 0.3), "went through wall_1"), ((0.52, 0.3), None),  # in what its side is made of; hardly in it
    ((0.64, 0.3), None),  # hardly in it from the hollow
])  # fmt: skip
def test_a_drop_that_falls_into_a_hollow_column_has_not_gone_through_it(place, told):
    column = """{ solid = true; shape = { box = { low = [0.5, 0.0]; high = [1.1, 0.8]; open = ["y-", "y+"]; }; }; }"""
    sph = engine(size=(1.5, 1.0), fill=(0.3, 0.4), spacing=0.05, sound=14.0, more=f"wall = ( {column} );")
    one = sph.storage.fluid_slots[5]
    for axis, physical in enumerate(sph.scene.axes):
        sph.storage.x[axis, one] = place[physical]
    sph.sort()
    found = sph.guard()
    assert found is None if told is None else told in found


def test_when_all_has_left_the_run_goes_on():
    sph = leaving("open end")
    x = sph.scene.axes.index(0)
    sph.storage.x[x, sph.storage.fluid_slots] = 0.99 + 1e-3 * sph.storage.x[x, sph.storage.fluid_slots]
    sph.storage.v[x, sph.storage.fluid_slots] = 10.0
    sph.sort()
    run(sph, 40)
    assert len(sph.storage.fluid_slots) == 0 and sph.scalars()["outflow"] == pytest.approx(250.0)


def test_fluid_beside_a_tank_is_its_neighbours_and_what_a_tank_cannot_hold_is_clipped():
    def kept(low, high):
        return Scene(config(low=low, fill=high, size=(2.0, 1.0), spacing=0.05, more=tank(2, size=(0.5, 0.5)))).n_fluid

    assert kept((0.7, 0.0), (1.0, 0.5)) == 60
    assert kept((0.0, 0.0), (1.0, 0.5)) == 100
    assert kept((0.51, 0.0), (0.81, 0.5)) < 60  # three layers of the wall are there
