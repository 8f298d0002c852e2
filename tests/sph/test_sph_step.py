import numpy as np
import pytest
from sph_scenes import by_id, engine, jitter

from hpcpic.core.errors import Diverged
from sph.physics.reference import Reference

STILL = {"gravity": (0.0, 0.0), "pressure": "zero"}


def run(sph, steps):
    for _ in range(steps):
        sph.step()
    return sph


def test_a_uniform_velocity_changes_nothing_else():
    moved, at_rest = (engine(spacing=0.1, step="time_step = 5e-4;") for _ in range(2))
    for sph in (moved, at_rest):
        jitter(sph)
    moved.storage.set_own_values("v", moved.storage.own_values("v") + np.array([[3.0], [-2.0]]))
    (x, v), (x_rest, v_rest) = (by_id(run(sph, 20), "x", "v") for sph in (moved, at_rest))
    shift = np.array([[3.0], [-2.0]])[list(moved.scene.axes)]
    assert np.abs(v - v_rest - shift).max() < 1e-11  # rounding of v = 3 m/s in twenty steps, amplified by the motion
    assert np.abs(x - x_rest - shift * at_rest.time).max() < 1e-12


@pytest.mark.parametrize("precision", ["double", "single"])
def test_units_that_differ_by_a_power_of_two_give_the_same_bits(precision):
    """Lengths and times 8 times as large: the same velocities, an eighth of the gravity."""
    small = engine(spacing=0.0625, precision=precision)
    large = engine(spacing=0.5, size=8.0, fill=4.0, gravity=(0.0, -9.81 / 8), precision=precision)
    for sph in (small, large):
        jitter(sph)
        run(sph, 5)
    assert large.time == 8 * small.time
    for name, factor in (("x", 8.0), ("v", 1.0), ("drho", 1.0)):
        assert np.array_equal(by_id(large, name)[0], factor * by_id(small, name)[0]), name


def test_momentum_stays_without_walls():
    sph = engine(d=2, gravity=(0.0, 0.0))
    jitter(sph)
    m, v = by_id(sph, "m", "v")
    before, scale = (m * v).sum(axis=1), (m * np.abs(v)).sum()
    run(sph, 20)
    m, v = by_id(sph, "m", "v")
    assert np.abs((m * v).sum(axis=1) - before).max() < 1e-12 * scale


def smooth(integrator, dt, periods=8):
    """A sound wave in a periodic box."""
    sph = engine(periodic=("x", "y"), fill=1.0, spacing=0.1, flux="none", alpha=0.0, integrator=integrator,
                 step=f"time_step = {dt!r};", **STILL)  # fmt: skip
    storage = sph.storage
    storage.set_own_values("v", 0.2 * np.sin(2 * np.pi * storage.own_values("x")))
    sph.sort()  # images see it
    run(sph, round(periods * 1e-3 / dt))
    return np.concatenate([values.ravel() for values in by_id(sph, "x", "drho")])


ORDERS = {"euler": 1, "symplectic": 2, "predictor-corrector": 1, "rk3-tvd": 3}
# of x and rho where nothing is accelerated at first: the velocities of "symplectic" are those of half a step before


@pytest.mark.parametrize("integrator, order", ORDERS.items())
def test_order_of_the_integrators(integrator, order):
    """And all go to one solution: what first order leaves is as much as half the step changes. The density dominates,
    which makes volume; with distances of the start of a step "symplectic" has order 1.
    """
    coarse, middle, fine = (smooth(integrator, dt) for dt in (5e-4, 2.5e-4, 1.25e-4))
    measured = np.log2(np.abs(coarse - middle).max() / np.abs(middle - fine).max())
    assert order - 0.2 < measured < order + 0.6  # the steps are not infinitely small
    assert np.abs(fine - smooth("rk3-tvd", 1.25e-4)).max() < 1.3 * np.abs(middle - fine).max()


def test_a_step_of_the_predictor_corrector_is_that_of_the_paper():
    """(SC 11): y* = y + dt f(y); (SC 12): v = v^n + dt a(y*), rho = rho^n + dt D(y*), and x = x^n + dt v, the new v."""
    dt = 5e-4
    sph = engine(integrator="predictor-corrector", step=f"time_step = {dt!r};", periodic=("x", "y"), fill=1.0, **STILL)
    jitter(sph)
    x, v, drho, m = by_id(sph, "x", "v", "drho", "m")
    still, period = np.zeros(2), np.ones(2)
    first = Reference(sph.scene.config, x, v, drho, m, still, period)
    predicted = x + dt * v, v + dt * first.acceleration(), drho + dt * first.rate()
    second = Reference(sph.scene.config, *predicted, m, still, period)
    corrected = v + dt * second.acceleration()
    sph.step()
    away, speed, density = (a - b for a, b in zip(by_id(sph, "x", "v", "drho"), (x, corrected, drho)))
    assert np.abs(speed).max() < 1e-12 * np.abs(corrected).max()
    assert np.abs(density - dt * second.rate()).max() < 1e-12 * np.abs(dt * second.rate()).max()
    moved = away - np.rint(away)  # around the unit box
    assert np.abs(moved - dt * corrected).max() < 1e-14


def test_the_step_follows_the_fastest_criterion():
    sph = engine(spacing=0.1, cfl=0.5)
    run(sph, 1)
    h, c = sph.scene.h, sph.scene.c0 * (1 + sph.extremes.density_error / 1000) ** 3
    assert sph.time_step == pytest.approx(0.5 * h / c, rel=1e-12)
    assert engine(spacing=0.1, step="time_step = 1e-5;").choose(1.0, 1.0, 0.0) == 1e-5
    assert sph.choose(1.0, 1e9, 0.0) == pytest.approx(0.25 * np.sqrt(h / 1e9), rel=1e-12)


def test_what_is_not_finite_ends_the_run():
    sph = engine(spacing=0.1)
    sph.storage.v[0, sph.storage.fluid_slots[3]] = np.nan
    assert "not a finite number" in sph.guard()
    with pytest.raises(Diverged):
        run(sph, 1)


@pytest.mark.parametrize("integrator", ["rk3-tvd", "predictor-corrector"])
def test_neighbours_follow_the_fastest_particle(integrator):
    """Steps with neighbours known just as far as particles move, and with them known much farther: the same but for the
    order of sums. At the start nothing is known of the speed.
    """
    spare, plenty = (engine(d=2, integrator=integrator, velocity=(0.5, 0.0)) for _ in range(2))
    sorts = count_calls(spare, "sort")
    for _ in range(6):
        plenty.skin.reach = plenty.skin.farthest
        plenty.sort()
        for sph in (spare, plenty):
            sph.step()
    assert len(sorts) > 6  # the first step needed more than it had
    assert 0 < spare.skin.reach < 0.5 * spare.skin.farthest
    assert spare.time == pytest.approx(plenty.time, rel=1e-12)  # criteria from sums in another order
    for name, scale in (("x", spare.scene.spacing), ("v", 0.5)):
        both = [sph.storage.own_values(name)[:, np.argsort(sph.storage.own_values("id"))] for sph in (spare, plenty)]
        assert np.abs(both[0] - both[1]).max() <= 1e-11 * scale  # rounding of 18 sums of 20 neighbours


def count_calls(owner, name):
    """The calls of a method of `owner` from now on, one entry each."""
    calls, method = [], getattr(owner, name)

    def counted(*arguments):
        calls.append(arguments)
        return method(*arguments)

    setattr(owner, name, counted)
    return calls
