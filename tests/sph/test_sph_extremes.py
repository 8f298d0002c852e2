"""States at the edge of what can be: each goes on, or ends with words that say why."""

import logging

import numpy as np
import pytest
from sph_scenes import TANK, column, engine, jitter, tank, water

from hpcpic.core.errors import Diverged


def fluid(sph):
    return sph.storage.fluid_slots


def put(sph, which, x, v=(0.0, 0.0)):
    """The fluid particles `which` to x with v, in physical order."""
    for axis, physical in enumerate(sph.scene.axes):
        sph.storage.x[axis, which], sph.storage.v[axis, which] = x[physical], v[physical]
    sph.migrate()
    sph.sort()


def end(sph, steps=20):
    """None after so many steps, or what ends the run."""
    for _ in range(steps):
        if reason := sph.guard():
            return reason
        try:
            sph.step()
        except Diverged as error:
            return str(error)
    return sph.guard()


@pytest.mark.parametrize(
    "x, v, reason",
    [
        ((0.5, 2.0), (0.0, 0.0), None), ((0.5, 1.0), (0.0, 19.0), None),  # thrown out of the tank
        ((0.5, 1e6), (0.0, 0.0), "outside the domain"), ((0.5, 1e12), (0.0, 0.0), "outside the domain"),
        ((0.5, 1.0), (0.0, 1e4), "faster than sound"),
        ((0.0, 0.2), (0.0, 0.0), None), ((0.0, 0.0), (0.0, 0.0), None),  # on a wall, in a corner
        ((0.5, -0.2), (0.0, 0.0), "went through tank"), ((-0.2, 0.5), (0.0, 0.0), "went through tank"),
        ((-1e3, 0.5), (0.0, 0.0), "outside the domain"), ((1e6, 0.2), (0.0, 0.0), "outside the domain"),
    ],
)  # fmt: skip
def test_a_particle_may_leave_by_the_open_side_only(x, v, reason):
    sph = water()
    put(sph, fluid(sph)[5], x, v)
    n = sph.storage.n
    told = end(sph)
    assert told is None if reason is None else reason in told
    assert sph.storage.n < n + 300  # it does not take the walls and cells of its way with it
    assert len(fluid(sph)) == sph.scene.n_fluid


@pytest.mark.parametrize("column", ["x", "v", "drho"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_particle_that_is_no_number_ends_the_run(column, value):
    sph = water()
    sph.storage.arena[column][..., fluid(sph)[5]] = value
    reason = end(sph)
    assert any(words in reason for words in ("not a finite number", "density of", "no room", "moved farther"))


@pytest.mark.parametrize("many", [2, 50])
def test_particles_at_one_place_do_not_push_each_other(many):
    sph = water()
    own = fluid(sph)
    ids = sph.storage.key[own[:many]]
    sph.storage.drho[own[:many]] = 1.0
    put(sph, own[:many], sph.storage.physical("x")[sph.storage.own_slots == own[0]][0])
    sph.evolution.evaluate_forces()
    chosen = np.isin(sph.storage.key[sph.storage.own_slots], ids)
    a = column(sph, "a")[:, chosen]
    most = np.abs(column(sph, "a")).max()
    sph.evolution.evaluate_rates()
    assert a.shape == (2, many) and np.isfinite(a).all() and np.isfinite(column(sph, "rate")[chosen]).all()
    assert np.ptp(a, axis=1).max() < 1e-12 * most  # all are pushed alike, by the others


@pytest.mark.parametrize(
    "settings",
    [
        {"fill": (0.1, 0.1)}, {"fill": (0.2, 0.1)},  # one particle, two
        {"fill": (1.0, 0.1)},  # a film of one layer
        {"size": (0.15, 1.2), "fill": (0.15, 0.5), "spacing": 0.05},  # walls nearer than the support
        {"gravity": (0.0, 0.0)}, {"gravity": (0.0, -1000.0), "sound": 320.0},
    ],
)  # fmt: skip
def test_little_water_and_much_gravity(settings):
    sph = water(**settings)
    assert end(sph, 60) is None
    assert sph.extremes.speed < 0.05 * sph.scene.c0  # it settles by less than a spacing


@pytest.mark.parametrize("excess, ends", [(1.001, None), (1.01, None), (1.1, None), (10.0, "density of 50 particles")])
def test_water_that_starts_too_dense(excess, ends):
    sph = water()
    sph.storage.drho[fluid(sph)] = 1000.0 * (excess - 1)
    sph.resume()
    told = end(sph)
    assert told is None if ends is None else ends in told


@pytest.mark.parametrize(
    "kind, motion", [("repulsive", "velocity = [0.0, 1000.0];"), ("pressure-continuity", "velocity = [0.0, 6.0];"),
                     ("pressure-continuity", "velocity = [0.0, 5.0]; stop = 1e-12;")]
)  # fmt: skip
def test_a_gate_as_fast_as_can_be(kind, motion):
    gate = f"""{{ name = "gate"; solid = true; type = "{kind}"; motion = {{ {motion} }};
        shape = {{ box = {{ low = [0.5, 0.0]; high = [0.6, 1.0]; }}; }}; }} );"""
    more = tank(2, size=(1.0, 1.2)).rstrip().removesuffix(");") + "," + gate
    sph = engine(**TANK | {"fill": (0.5, 0.5)}, more=more)
    assert end(sph, 60) is None


@pytest.mark.parametrize("speed, told", [(1.0, False), (4.0, True)])
def test_a_velocity_that_the_sound_speed_was_not_chosen_for_is_told_once(speed, told, caplog):
    sph = water()
    sph.storage.v[sph.scene.axes.index(0), fluid(sph)[30]] = speed
    with caplog.at_level(logging.WARNING, "hpcpic.sph"):
        end(sph, 3)
    assert len([record for record in caplog.records if "max_velocity" in record.message]) == int(told)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("away", [1e8, -1e8])
def test_neighbours_are_found_however_far_from_the_domain(axis, away):
    """A place there is known to 3e-8 m, which is 6e-7 of a spacing."""
    sph = engine(gravity=(0.0, 0.0), size=(1.0, 1.2), fill=(0.5, 0.5), flux="none", integrator="euler")
    jitter(sph)
    sph.evolution.evaluate()
    before = column(sph, "a")[:, np.argsort(sph.storage.own_values("id"))]
    sph.storage.x[axis, fluid(sph)] += away
    sph.sort()
    sph.evolution.evaluate()
    after = column(sph, "a")[:, np.argsort(sph.storage.own_values("id"))]
    np.testing.assert_allclose(after, before, atol=1e-4 * np.abs(before).max())


def test_particles_thrown_far_apart_end_the_run_before_the_memory():
    sph = engine(gravity=(0.0, 0.0), size=(1.0, 1.2), fill=(0.9, 0.9), flux="none", spacing=0.02)
    x = sph.storage.x[:, fluid(sph)]
    x[1, ::7], x[1, 1::7] = 1e9, -1e9
    sph.storage.x[:, fluid(sph)] = x
    with pytest.raises(Diverged, match="too far from each other"):
        sph.sort()
