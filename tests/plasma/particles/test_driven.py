"""Accelerations of one's own, beside the uniform electric field that gives the same one."""

import math

import numpy as np
import pytest

import hpcpic
from hpcpic.core.case import accelerations

DT = 0.1


def falling(x, v, t):
    return 0.3, -0.2, 0.1


def run(magnetic, d, named, steps=50, dt=DT):
    """Place and velocity of a tracer, by its own acceleration or by the field."""
    push = {"acceleration": "falling"} if named else {}
    field = {"magnetic": magnetic} | ({} if named else {"electric": [0.3, -0.2, 0.1 if d == 3 else 0.0]})
    start = {"position": [[5.0] * d], "velocity": [[0.5, 0.25, -0.125][: 3 if d == 3 or any(magnetic[:2]) else d]]}
    return tracer(field, d, start, push, steps, dt)


def tracer(field, d, start, push, steps, dt):
    case = hpcpic.Case(
        simulation={"cycles": steps, "time_step": dt, "space_length": [10.0] * d}, grid={"points": [8] * d},
        numerics={"precision": "double"}, field=field,
        species=[{"name": "p", "charge": 1e-12, "mass": 1e-12, "start": start, **push}],
    )  # fmt: skip
    with case.simulation(threads=1) as sim:
        sim.advance()
        found = sim.particles("p")
        return np.asarray(found["position"])[0], np.asarray(found["velocity"])[0], found["velocity"].attrs


@pytest.fixture(autouse=True)
def named(monkeypatch):
    monkeypatch.setitem(accelerations.ACCELERATIONS, "falling", falling)


@pytest.mark.parametrize("d, magnetic", [
    (2, [0.0, 0.0, 2.0]), (3, [1.0, -0.5, 2.0]),
    pytest.param(3, [0.0, 0.0, 2.0], marks=pytest.mark.validation),  # a module of kernels for it alone
])  # fmt: skip
def test_an_acceleration_moves_a_particle_as_the_field_does(d, magnetic):
    """To rounding: half of it acts before the turn in the magnetic field and half after, also as velocities rewind."""
    (x, v, late), (expected, speed, _) = run(magnetic, d, True), run(magnetic, d, False)
    np.testing.assert_allclose(x, expected, atol=1e-11)
    np.testing.assert_allclose(v, speed, atol=1e-11)
    assert late["time_offset"] == -DT / 2


def test_a_constant_acceleration_drifts_across_itself_alone():
    """After whole turns, by a x B / B^2."""
    turns, n = 3, 200
    x, *_ = run([0.0, 0.0, 2.0], 2, True, steps=turns * n, dt=np.pi / n)
    drift = (x[:2] - 5.0) / (turns * np.pi)
    np.testing.assert_allclose(drift, [-0.1, -0.15], atol=1e-4)


def turning(x, v, t):
    """What a field of 0.5 T along z does to the tracer."""
    return 0.5 * v[1], -0.5 * v[0], 0.0


def dragging(x, v, t):
    return -0.4 * v[0], -0.4 * v[1], -0.4 * v[2]


def dragging_until_a_second(x, v, t):
    return -0.4 * v[0], -math.sqrt(0.95 - t), 0.0


def test_a_magnetic_force_of_ones_own_is_that_of_the_field_to_rounding(monkeypatch):
    """At wc dt = 6, beside another field and across an electric one, as the velocity that it sees is the mean of both
    sides of the turn; by that of half a step before it heated.
    """
    monkeypatch.setitem(accelerations.ACCELERATIONS, "turning", turning)
    start = {"position": [[5.0, 5.0]], "velocity_before": [[0.5, 0.25]]}
    (x, v, _), (expected, speed, _) = (
        tracer({"magnetic": [0.0, 0.0, b], "electric": [0.3, -0.2, 0.0]}, 2, start, push, 50, 3.0)
        for b, push in ((1.5, {"acceleration": "turning"}), (2.0, {}))
    )
    np.testing.assert_allclose(v, speed, atol=1e-11)
    np.testing.assert_allclose((x - expected + 5.0) % 10.0 - 5.0, 0.0, atol=1e-10)


def test_a_drag_of_ones_own_is_of_second_order(monkeypatch):
    """With z = (i wc - nu) dt/2 a step multiplies by (1 + z)/(1 - z), and the half step backwards of the start by the
    inverse with z/2, to a part in 1e4 as its turn is half of that of a step.
    """
    monkeypatch.setitem(accelerations.ACCELERATIONS, "dragging", dragging)
    start, z = {"position": [[5.0, 5.0]], "velocity": [[0.5, 0.25]]}, 0.5 * DT * (2j - 0.4)
    _, v, _ = tracer({"magnetic": [0.0, 0.0, 2.0]}, 2, start, {"acceleration": "dragging"}, 20, DT)
    left = abs(((1 + z) / (1 - z)) ** 20 * (1 - z / 2) / (1 + z / 2))
    assert np.linalg.norm(v) / np.hypot(0.5, 0.25) == pytest.approx(left, rel=1e-4)


def test_an_acceleration_that_is_no_number_is_named_with_its_species(monkeypatch):
    """It was a position that is not a number."""
    monkeypatch.setitem(accelerations.ACCELERATIONS, "dragging", dragging_until_a_second)
    start = {"position": [[5.0, 5.0]], "velocity": [[0.5, 0.25]]}
    with pytest.raises(hpcpic.Diverged, match="the acceleration 'dragging' of p is not a finite number at t = 1 s"):
        tracer({"magnetic": [0.0, 0.0, 2.0]}, 2, start, {"acceleration": "dragging"}, 20, DT)
