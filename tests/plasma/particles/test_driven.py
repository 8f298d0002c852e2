"""Accelerations of one's own, beside the uniform electric field that gives the same one."""

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
