"""Accelerations of the user's own, and walls whose density follows from the fluid that feels them."""

import numpy as np
import pytest
from sph_scenes import by_id, config, engine, jitter, layers, tank, text
from test_extrapolated_walls import SHAKEN, expected

from hpcpic.core.case.accelerations import ACCELERATIONS, register
from hpcpic.core.comm.world import World
from sph.forecast.derived import derived
from sph.kernels.marks import EXTRAPOLATED, FLUID

SPIN = 4.0  # 1/s


def aslant(x, v, t):
    return 4.0, 3.81, 0.0


def table(x, v, t):
    """In the frame of what turns about (0.5, 0.5) at SPIN."""
    return (SPIN * SPIN * (x[0] - 0.5) + 2.0 * SPIN * v[1], SPIN * SPIN * (x[1] - 0.5) - 2.0 * SPIN * v[0], 0.0)


def swirl(x, v, t):
    return 9.0 * x[1] - 3.0 * v[0] + 70.0 * t, 8.0 * x[0] * x[1] + 2.0 * v[0], 5.0 * x[2]


@pytest.fixture(autouse=True)
def known():
    functions = {"aslant": aslant, "table": table, "swirl": swirl}
    for name, function in functions.items():
        register(name, function)
    yield
    for name in functions:
        del ACCELERATIONS[name]


def driven(case, name):
    """The case with this acceleration of all its fluids."""
    return case.replace("initial_pressure =", f'acceleration = "{name}"; initial_pressure =')


CASES = {
    "double": (text, {}, 1e-12),
    "single": (text, {"precision": "single"}, 3e-5),
    "two liquids": (layers, {}, 1e-12),
    "single, two liquids": (layers, {"precision": "single"}, 3e-5),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.validation] * name.startswith("single")) for name in CASES]
)
def test_it_acts_on_walls_as_gravity_does(name):
    """Fluid in any state has the same pressures before walls, and forces, whichever of the two gives its weight."""
    make, settings, tolerance = CASES[name]
    more = tank(2, "extrapolated-free-slip")
    by_gravity = engine(case=make(gravity=(4.0, -6.0), more=more, **settings))
    mixed = engine(case=driven(make(gravity=(0.0, -9.81), more=more, **settings), "aslant"))
    found, start = [], by_id(by_gravity, "drho")[0]
    for sph in (by_gravity, mixed):
        drho = np.empty_like(start)
        drho[np.argsort(sph.storage.own_values("id"))] = start  # else each has the pressure of rest by its own gravity
        sph.storage.set_own_values("drho", drho)
        jitter(sph)
        sph.evolution.evaluate_forces()
        found.append((by_id(sph, "drho")[0], by_id(sph, "a")[0], sph.wall_forces()["tank"][0]))
    (walls, a, force), (walls_too, a_too, force_too) = found
    assert np.count_nonzero(walls) > 30
    assert np.abs(walls - walls_too).max() < tolerance * np.abs(walls).max()
    extra = np.array([4.0, 3.81])[list(mixed.scene.axes), None] * (by_id(mixed, "flags")[0] & FLUID != 0)
    assert np.abs(a_too - extra - a).max() < 10 * tolerance * np.abs(a).max()
    assert np.abs(force - force_too).max() < 10 * tolerance * np.abs(force).max()


@pytest.mark.parametrize("motion", ["", SHAKEN])
def test_walls_have_the_mean_of_the_fluid_carried_on_with_its_own_acceleration(motion):
    """By place, velocity and time, also before walls that move."""
    sph = engine(case=driven(text(more=tank(2, "extrapolated-free-slip", more=motion)), "swirl"))
    jitter(sph)
    sph.step()
    sph.evolution.evaluate_forces()
    walls, wanted = expected(sph, lambda x, v: swirl((*x, 0.0), (*v, 0.0), sph.time)[:2])
    assert np.count_nonzero(wanted) > 30
    assert np.abs(sph.storage.drho[walls] - wanted).max() < 1e-12 * np.abs(wanted).max()


def test_what_mirrors_show_of_it_is_mirrored():
    """Walls that follow the fluid see its image in a mirror as the half of a box sees the other one."""
    box = tank(2, "extrapolated-free-slip")
    mirror = ', { type = "mirror-no-slip"; shape = { plane = { point = [0.5, 0.0]; normal = [-1.0, 0.0]; }; }; } );'
    found = []
    for wide, walls in ((1.0, box), (0.5, box[: box.rindex(");")] + mirror)):
        sph = engine(case=driven(text(fill=(wide, 0.5), more=walls), "table"))
        sph.evolution.evaluate_forces()
        rows = sph.storage.own_slots[sph.storage.own_values("flags") & EXTRAPOLATED != 0]
        x = sph.storage.physical("x", rows)
        rows = rows[(x[:, 0] > 0.0) & (x[:, 0] < 0.5) & (x[:, 1] < 0.0)]
        found.append(np.sort(sph.storage.drho[rows]))
    assert found[0].max() > 1.0
    assert found[1] == pytest.approx(found[0], rel=1e-9)


def test_fluid_at_rest_in_a_turning_frame_stays_so():
    """It has the pressure w^2 r^2 / 2. Where walls do not know of it, it runs at 0.0046 c0."""
    shape = "shape = { box = { low = [0.0, 0.0]; high = [1.0, 1.0]; }; }"
    more = f'wall = ( {{ name = "drum"; type = "extrapolated-free-slip"; {shape}; }} );'
    sph = engine(case=driven(text(fill=1.0, gravity=(0.0, 0.0), pressure="zero", more=more), "table"))
    x = sph.storage.physical("x", sph.storage.fluid_slots) - 0.5
    sph.storage.drho[sph.storage.fluid_slots] = sph.scene.rho0 / (2 * sph.scene.c0**2) * SPIN**2 * np.sum(x * x, axis=1)
    sph.evolution.forget_rates()
    fastest = 0.0
    for _ in range(200):
        sph.step()
        fastest = max(fastest, sph.extremes.speed)
    assert fastest < 1e-3 * sph.scene.c0


def test_bodies_that_do_not_feel_it_are_told():
    """Not those whose motions are all held."""
    solid = "solid = true; shape = { box = { low = [0.3, 0.3]; high = [0.6, 0.6]; }; };"
    for held, said in (('["x", "y", "rz"]', False), ('["x", "rz"]', True)):
        more = f'wall = ( {{ name = "raft"; {solid} body = {{ density = 500.0; held = {held}; }}; }} );'
        for case, driving in ((text(fill=1.0, more=more), False), (driven(text(fill=1.0, more=more), "swirl"), True)):
            found = {number.name for number in derived(config(case))}
            assert ("acceleration of raft" in found) == (said and driving)


@pytest.mark.mpi(min_size=2)
def test_ranks_find_what_one_does():
    case = driven(text(size=(2.0, 1.0), fill=(1.5, 0.5), more=tank(2, "extrapolated-free-slip", (2.0, 1.0))), "swirl")
    together, alone, threads = (
        engine(world, n, case=case) for world, n in ((World.start(), 1), (World.alone(), 1), (World.alone(), 2))
    )
    for sph in (together, alone, threads):
        jitter(sph, speed=0.1)
        for _ in range(10):
            sph.step()
    assert together.scalars() == alone.scalars() == threads.scalars()
