"""Quantities out of columns: every reduction on a signal whose answer is known, and what is zero by symmetry."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from hpcpic.core.app.text import percent
from hpcpic.core.errors import ConfigError
from hpcpic.core.files.series import Series
from hpcpic.core.study.quantities import grown, is_nothing, parsed, telling

KNOBS = SimpleNamespace(time=10.0, quantities=lambda: [SimpleNamespace(name="energy")])
T = np.linspace(0.0, 10.0, 2001)
WAVE = 2.0 + np.exp(-0.2 * T) * np.cos(2 * np.pi * 1.37 * T + 0.4)
ENERGY = (np.exp(-0.1 * T) * np.cos(2 * np.pi * 0.41 * T)) ** 2 + 0.05  # of a damped wave, above noise
COLUMNS = {"wave": WAVE, "energy": ENERGY, "line": 3.0 * T, "grown": 1e-3 * np.exp(0.7 * T), "flat": np.ones_like(T)}


def measured(text, columns=COLUMNS, t=T):
    return parsed(text, list(columns), KNOBS).measure(Series(columns, {}, np.arange(len(t)), t))


def test_samples_that_are_the_ends_but_for_rounding_do_not_count_twice():
    t = 0.1 * np.arange(101)
    assert t[3] > 0.3
    wave = np.exp(-0.2 * t) * np.cos(2 * np.pi * 0.41 * t)
    assert measured("damping(wave, from=0.3)", {"wave": wave}, t) == pytest.approx(0.2, abs=1e-7)


@pytest.mark.parametrize(
    ("text", "value", "within"),
    [
        ("mean(line, from=4)", 21.0, 1e-12),
        ("mean(line, from=4, to=6)", 15.0, 1e-12),
        ("max(line)", 30.0, 1e-12),
        ("min(line, from=2.0012)", 6.0036, 1e-12),  # between two samples
        ("last(line, to=3.3333)", 9.9999, 1e-12),
        ("norm(line, from=0)", 30.0 / math.sqrt(3.0), 1e-6),  # trapezia of a square
        ("growth(grown)", 0.7, 1e-9),
        ("frequency(wave)", 1.37, 1e-7),
        ("damping(wave)", 0.2, 1e-7),
        ("frequency(energy)", 0.82, 1e-7),
        ("damping(energy)", 0.2, 1e-6),
        ("peak(wave)", 1.37, 3e-3),  # a parabola through Hann's lines
    ],
)
def test_a_reduction_gives_what_the_signal_was_made_of(text, value, within):
    assert measured(text) == pytest.approx(value, rel=within)


def test_a_curve_is_the_column_at_the_same_times_whatever_the_samples():
    rare = T[::7]
    coarse = measured("curve(line, to=9)", {"line": 3.0 * rare}, rare)
    assert coarse == pytest.approx(measured("curve(line, to=9)"), rel=1e-12) and len(coarse) == 17


@pytest.mark.parametrize("text", ["mean(nothing)", "average(line)", "line", "mean(line, from=11)", "mean(line, to=1e)"])
def test_what_is_no_quantity_is_refused_with_what_there_is(text):
    with pytest.raises(ConfigError) as fault:
        parsed(text, list(COLUMNS), KNOBS)
    known = ("there are wave, energy, line", "one of mean, min", "0 to 10 s", "times in s")
    assert any(word in str(fault.value) for word in known)


def test_a_constant_has_no_frequency_and_a_run_that_ended_early_no_value():
    with pytest.raises(ValueError, match="no oscillation"):
        measured("peak(flat)")
    with pytest.raises(ValueError, match="the last at t = 5"):
        measured("mean(line)", {"line": T[:1001]}, T[:1001])


def test_the_interval_of_a_mean_holds_the_truth_as_often_as_it_says():
    """Of 400 means of noise of mean 0, 95 % (93 .. 97.5 by chance) are within their interval."""
    quantity = parsed("mean(noise, from=0)", ["noise"], KNOBS)
    kept = 0
    for seed in range(400):
        noise = np.random.default_rng(seed).normal(size=len(T))
        series = Series({"noise": noise}, {}, np.arange(len(T)), T)
        kept += abs(quantity.measure(series)) <= quantity.noise(series)
    assert 0.925 <= kept / 400 <= 0.98


def test_what_is_zero_by_symmetry_is_told_from_what_is_small():
    ones = np.ones_like(T)
    series = Series(
        {
            "force_bar_x": 5.0 * ones,
            "force_bar_y": 1e-6 * np.sin(T),
            "momentum_x": 1e-5 * np.sin(T),
            "mass": ones,
            "energy_kinetic": 0.5 * T,
            "front_x": 1e-6 * T,
        },
        {},
        np.arange(len(T)),
        T,
    )
    nothing = [name for name in series if is_nothing(series, name)]
    assert nothing == ["force_bar_y", "momentum_x"]  # beside force_bar_x; beside sqrt(2 m E); front_x has no peer
    assert telling(series) == ["energy_kinetic", "front_x"]


def test_what_starts_at_rest_but_for_rounding_has_not_grown():
    """The lattice has speeds of 1e-17 at rest: what a force drives from there passed for an instability."""
    driven = np.linspace(0.0, 1e-2, 100) ** 2
    assert grown(driven) == 1.0 and grown(driven + 1e-34) == 1.0
    assert grown(1e-12 * np.exp(2.0 * T)) == pytest.approx(math.exp(20.0))  # a small wave that grows
    assert grown(np.array([1.0, np.nan])) == math.inf


def test_shares_are_said_in_percent():
    assert [percent(x) for x in (1.7, 0.05, 0.0123, 0.0)] == ["170 %", "5.0 %", "1.2 %", "0 %"]
