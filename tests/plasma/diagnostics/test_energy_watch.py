"""The total energy tells a run that is no solution from one that heats, or in which a wave grows."""

import math

import pytest

from hpcpic.plasma.diagnostics.energy_watch import GROWTH, JUMP, MIN_PARTICLES, EnergyWatch


def watched(energies, dt=0.1, particles=MIN_PARTICLES):
    watch = EnergyWatch(cold=0.0, wp=1.0, particles=particles)
    for k, energy in enumerate(energies):
        watch.see(energy, k * dt, k)
        if watch.trouble():
            return k
    return None


@pytest.mark.parametrize("dt", [0.1, 1.0, 10.0])
def test_errors_that_grow_as_fast_as_a_plasma_can_are_no_jump(dt):
    """From rounding to 10 %, at the rate 2 wp, sampled often or seldom."""
    steps = range(int(math.log(1e11) / (2 * dt)))
    assert watched([1.0 + 1e-12 * math.exp(2 * dt * k) for k in steps], dt) is None


@pytest.mark.parametrize("size", [1.5 * JUMP, -1.5 * JUMP, 3.0])
def test_a_jump_of_a_quiet_energy_is_seen_at_once(size):
    quiet = [1.0 + 1e-5 * math.sin(k) for k in range(20)]
    assert watched([*quiet, *(e + size for e in quiet)]) == 20


@pytest.mark.parametrize("energies", [[1.0] * 10 + [1.0 + 0.9 * JUMP], [1.0, 1.02, 1.0, 1.02, 1.0, 1.1], [1.0, 1.2]])
def test_small_usual_and_first_changes_are_no_jump(energies):
    assert watched(energies) is None


def test_one_encounter_of_few_particles_is_no_jump():
    assert watched([1.0] * 10 + [1.5] * 3, particles=MIN_PARTICLES - 1) is None


def test_growth_without_end_and_no_number_end_a_run():
    heating = [1.02**k for k in range(400)]
    assert 1.02 ** watched(heating) == pytest.approx(GROWTH, rel=0.02)
    assert watched([1.0, 1.0, math.nan]) == 2


def test_a_plasma_colder_than_the_grid_stands_may_heat():
    watch = EnergyWatch(cold=1.0, wp=1.0, particles=MIN_PARTICLES)
    for k, energy in enumerate((1e-9, 1e-6, 1e-3, 0.5, 20.0)):
        watch.see(energy, float(k), k)
    assert watch.trouble() is None
