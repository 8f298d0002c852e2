"""States that are no solution end a run within 100 steps, and name the particle, its place and the time."""

import numpy as np
import pytest
from seldom import seldom
from sph_scenes import TANK, engine, jitter, tank, water

from hpcpic.core.errors import Diverged
from sph.physics import stability

BEFORE = 5  # steps


def attacked(sph, attack, steps=100, every=50):
    """What ends a run that is attacked after some steps; the guard looks as seldom as in a long run."""
    for k in range(BEFORE + steps):
        if k == BEFORE:
            assert sph.guard() is None
            attack(sph)
        try:
            sph.step()
        except Diverged as error:
            return str(error)
        if (k - BEFORE) % every == every - 1 and (reason := sph.guard()):
            return reason
    return None


def one(sph):
    """A particle in the middle of the water."""
    rows = sph.storage.fluid_slots
    return rows[np.argmin(np.abs(sph.storage.physical("x", rows) - (0.45, 0.25)).sum(axis=1))]


def set_one(column, value, axis=0):
    """In order again: no bit turns behind the back of the checksums."""

    def attack(sph):
        line = sph.storage.arena[column]
        line[(sph.scene.axes.index(axis), one(sph)) if line.ndim == 2 else one(sph)] = value
        sph.sort()

    return attack


@pytest.mark.parametrize("speed", [3e3, 1e6, 1e12, -1e12])
def test_a_speed_beyond_that_of_sound(speed):
    sph = water()
    number = sph.storage.number(one(sph))
    reason = attacked(sph, set_one("v", speed))
    assert f"step {BEFORE}, t = {sph.time:.6g} s: particle {number} at (0.4" in reason and "faster than sound" in reason


@pytest.mark.parametrize("share, ends", [(0.9, False), (1.1, True)])
def test_the_speed_of_sound_is_the_limit(share, ends):
    reason = attacked(water(), lambda sph: set_one("v", share * sph.scene.c0)(sph), steps=1)
    assert ("faster than sound" in (reason or "")) == ends


@pytest.mark.parametrize("column, value", [("v", 1e200), ("v", np.nan), ("drho", np.nan), ("drho", np.inf)])
def test_what_is_no_number(column, value):
    sph = water()
    number = sph.storage.number(one(sph))
    reason = attacked(sph, set_one(column, value))
    assert "not a finite number" in reason and (column != "v" or f"particle {number} at (0.4" in reason)


@pytest.mark.parametrize("excess", [0.3, -0.3, 0.5])
def test_a_density_off_by_a_third(excess):
    sph = water()
    number = sph.storage.number(one(sph))
    reason = attacked(sph, set_one("drho", excess * 1000.0))
    assert f"density of particle {number} at (0.4" in reason and f"{1 + excess:.3g} rho0" in reason


@pytest.mark.parametrize("away", [30.0, 1e12, -1e12])
def test_a_place_in_an_open_direction_farther_than_sound_has_run(away):
    assert "outside the domain" in attacked(water(), set_one("x", abs(away), axis=1))


def test_an_acceleration_that_makes_steps_short():
    def attack(sph):
        sph.tasks.arena["external"][:] = 1e12

    reason = attacked(water(), attack)
    assert "the time step has fallen to" in reason and "particle" in reason and "m/s2" in reason


@pytest.mark.parametrize("share, ends", [(2.0, False), (0.5, True)])
def test_a_hundredth_of_the_first_step_is_the_limit(share, ends):
    def attack(sph):
        longer = sph.choose(0.0, 1e12, 0.0) / (share * 1e-2 * stability.time_step(sph.scene.config))
        sph.tasks.arena["external"][:] = 0.0, 1e12 * longer**2  # dt is as 1 / sqrt(acceleration)

    reason = attacked(water(), attack, steps=1)
    assert ("the time step has fallen to" in (reason or "")) == ends


def test_an_impulse_that_no_pressure_has_given():
    def attack(sph):
        sph.forces.impulses[0, 0] = 1e300

    assert "impulse" in attacked(water(), attack)


@pytest.mark.parametrize("share, words", [(0.8, "mean speed of all fluid"), (0.3, "total energy grew")])
def test_energy_that_nothing_has_given(share, words):
    def attack(sph):
        sph.scalars()
        rows = sph.storage.fluid_slots
        sph.storage.v[sph.scene.axes.index(1), rows] = share * sph.scene.c0  # out of the tank, all together
        sph.resume()

    assert words in attacked(water(size=(1.0, 60.0), gravity=(0.0, -9.81)), attack)


@pytest.mark.parametrize("reach", [-1e-3, np.nan, 1.0])
def test_a_reach_of_neighbours_that_cannot_be(reach):
    sph = water(integrator="rk3-tvd")
    sph.step()
    sph.skin.reach = reach
    with pytest.raises(Diverged, match="neighbours are known for"):
        sph.resume()


def drop(**settings):
    """Disordered fluid that nothing but itself acts on."""
    sph = engine(d=2, gravity=(0.0, 0.0), **settings)
    jitter(sph)
    sph.scalars()
    return sph


@pytest.mark.parametrize(
    "settings", [{}, {"flux": "rusanov", "integrator": "rk3-tvd"}, {"shifting": "true"},
                 seldom({"precision": "single"}), seldom({"corrected": "true"})], ids=str
)  # fmt: skip
def test_a_drop_keeps_its_momentum_until_a_number_changes_in_memory(settings):
    """One velocity by 1e-3 of that of sound. In single precision rounding may change more."""
    sph = drop(**settings)
    assert attacked(sph, lambda sph: sph.scalars()) is None
    reason = attacked(sph, lambda sph: set_one("v", sph.storage.v[0, one(sph)] + 1e-3 * sph.scene.c0, 0)(sph))
    assert ("jumped" in (reason or "")) == ("precision" not in settings)


def test_a_mass_that_changes_in_memory():
    sph = water()
    sph.scalars()
    assert "mass jumped" in attacked(
        sph, lambda sph: set_one("m", sph.storage.m[one(sph)] * (1 + 1e-9))(sph), steps=200
    )


@pytest.mark.parametrize("integrator", ["euler", "symplectic", "rk3-tvd"])
@pytest.mark.parametrize(
    "column, what", [("x", "positions"), ("v", "velocities"), ("drho", "densities"), (None, "impulses on walls")]
)
def test_the_last_bit_of_one_number_that_turns_between_steps(integrator, column, what):
    def attack(sph):
        row = one(sph)
        array = sph.storage.arena[column] if column else sph.forces.impulses
        place = (0, 0) if not column else row if array.ndim == 1 else (0, row)
        array[place] = np.nextafter(array[place], np.inf)

    assert attacked(water(integrator=integrator), attack).startswith(what)


@pytest.mark.parametrize("integrator", ["euler", "predictor-corrector", "symplectic", "rk3-tvd"])
def test_a_sound_run_is_left_alone(integrator):
    sph = water(fill=(0.5, 0.9), integrator=integrator)
    assert attacked(sph, lambda sph: None, steps=100) is None


def test_a_wall_may_be_faster_than_sound():
    gate = """{ name = "gate"; solid = true; type = "repulsive"; motion = { velocity = [0.0, 100.0]; };
        shape = { box = { low = [0.5, 0.0]; high = [0.6, 1.0]; }; }; } );"""
    more = tank(2, size=TANK["size"]).rstrip().removesuffix(");") + "," + gate
    assert attacked(engine(**TANK | {"fill": (0.5, 0.5)}, more=more), lambda sph: None, steps=20) is None


@pytest.mark.parametrize("share, ends", [(0.9, False), (1.6, True)])
def test_a_channel_faster_than_its_force_can_drive_it_ends(share, ends):
    """No flow from rest exceeds F L^2 / (8 nu) of (MP 24)."""
    force, nu, width = 0.01, 1e-3, 1.0
    planes = 'wall = ( { type = "mirror-no-slip"; shape = { box = { low = [0.0, 0.0]; high = [1.0, 1.0]; }; }; } );'
    channel = engine(spacing=0.1, fill=1.0, periodic=("x",), gravity=(0.0, 0.0), pressure="zero", form="morris",
                     viscosity=1000 * nu, more=f"body_force = [{force}, 0.0];{planes}")  # fmt: skip
    steady = force * width**2 / (8 * nu)
    channel.storage.set_own_values("v", share * steady * np.eye(2)[channel.scene.axes.index(0)][:, None])
    if not ends:
        channel.step()
        return
    with pytest.raises(Diverged, match="the most that its force can give the channel"):
        channel.step()
