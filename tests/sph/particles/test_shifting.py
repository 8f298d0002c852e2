"""Shifts keep particles evenly spread; densities know of them, so that what flows back doesn't add up."""

import math

import numpy as np
import pytest
from sph_scenes import tank, text

import sph
from hpcpic.core.case.config import loads
from hpcpic.core.errors import ConfigError
from sph.__main__ import load_app
from sph.physics.smoothing import SMOOTHING
from sph.physics.waves import shift_decay


def still(open_top, **numerics):
    sides = {"open": ["y+"]} if open_top else {}
    return sph.Case(
        simulation={"dimensions": 2, "end_time": 2.0}, gravity=[0.0, -9.81],
        fluid=[{"shape": {"box": {"low": [0.0, 0.0], "high": [0.2, 0.2]}}}],
        numerics={"spacing": 0.0125, "shifting": True, **numerics},
        wall=[{"shape": {"box": {"low": [0.0, 0.0], "high": [0.2, 0.25 if open_top else 0.2], **sides}}}],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("settings", "open_top"),
    [
        pytest.param(
            settings, top, id=f"{settings}-{'open' if top else 'closed'}", marks=[pytest.mark.validation] * late
        )
        for settings, top, late in (
            ({"smoothing": 1.3}, True, False), ({"smoothing": 1.3}, False, False), ({"smoothing": 1.5}, True, True),
            ({"smoothing": 1.5}, False, True), ({"gradient_correction": True}, True, True),
            ({"gradient_correction": True}, False, True),
        )
    ],
)  # fmt: skip
def test_still_water_keeps_its_level_and_pressure(open_top, settings):
    """Shifts and the lattice that pressure wants push against each other for ever. Where densities do not know of them,
    an open tank loses 28 % of its level with few neighbours, and the pressure of a closed one rises without end.
    """
    with still(open_top, **settings).simulation(threads=1) as sim:
        first = sim.scalars()
        sim.advance(until=2.0)  # 14 sqrt(H/g)
        last = sim.scalars()
    assert last["energy_potential"] == pytest.approx(first["energy_potential"], rel=4e-3)  # it settles by 0.3 %
    assert last["max_density_error"] < 1.15 * first["max_density_error"]


@pytest.mark.parametrize("smoothing", [1.3, 1.5])
def test_a_stream_as_fast_as_may_be_stays_uniform(smoothing):
    """Shifts go with its speed. Where they overshoot, particles go astray, here with 0.4 of that, and a channel with an
    inlet and an outlet fills with a tenth more than it holds.
    """
    u = 0.14  # of c0: the limit is 1/7
    case = sph.Case(
        simulation={"dimensions": 2, "end_time": 2.0},
        domain={"low": [0.0, 0.0], "high": [0.25, 0.25], "periodic": ["x"]},
        fluid=[{"shape": {"box": {"low": [0.0, 0.0], "high": [0.25, 0.25]}}, "velocity": [u, 0.0], "disorder": 0.1}],
        eos={"sound_speed": 1.0, "background_pressure": 20.0},
        numerics={"spacing": 0.0125, "smoothing": smoothing, "shifting": True},
        wall=[{"shape": {"box": {"low": [0.0, 0.0], "high": [0.25, 0.25], "open": ["x-", "x+"]}},
               "type": "extrapolated-free-slip"}],
    )  # fmt: skip
    with case.simulation(threads=1) as sim:
        sim.advance(until=2.0)
        v = sim.particles("fluid_1")["velocity"].values[:, :2]
    assert math.sqrt(np.mean(np.sum((v - [u, 0.0]) ** 2, axis=1))) < 0.08 * u


@pytest.mark.parametrize(("kernel", "smoothing"), [("wendland2", 1.3), ("wendland2", 1.5), ("quintic", 1.5)])
def test_shifts_of_one_over_their_decay_leave_no_displacement_larger(kernel, smoothing):
    """All particles of a periodic lattice are a little off their places; |v| dt/h times the decay is 1, then 2.5."""
    n, law = 10, SMOOTHING[kernel]
    at = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), axis=-1).reshape(-1, 2).astype(float)
    off = 1e-4 * np.random.default_rng(1).standard_normal((n * n, 2))  # in spacings
    one = law.value(1 / smoothing, 2)
    sizes = {}
    for share in (1.0, 2.5):
        now = off - off.mean(axis=0)
        for _ in range(20):
            x = at + now
            r = (x[:, None] - x + n / 2) % n - n / 2
            q = np.linalg.norm(r, axis=-1) / smoothing + 9.0 * np.eye(n * n)
            pull = np.where(q < law.support, law.gradient(q, 2) * (1 + 0.2 * (law.value(q, 2) / one) ** 4), 0.0)
            step = share / shift_decay(kernel, 2, smoothing)
            now = now - 4.0 * step * np.einsum("ij,ijk->ik", pull, r) / smoothing**2
        sizes[share] = np.linalg.norm(now) / np.linalg.norm(off)
    assert sizes[1.0] < 1.2  # waves along rows are left, which a square lattice likes
    assert sizes[2.5] > 3.0


def test_water_that_breaks_free_is_no_faster_than_its_front():
    """Near a surface nothing is shifted, and nothing faster than half of the fastest: else water that flows back would
    be the fastest, and shifted the faster for it.
    """
    height = 0.3
    case = sph.Case(
        simulation={"dimensions": 2, "end_time": 0.2}, gravity=[0.0, -9.81],
        fluid=[{"shape": {"box": {"low": [0.0, 0.0], "high": [0.3, height]}}, "kinematic_viscosity": 1e-6}],
        numerics={"spacing": 0.0125},
        wall=[{"shape": {"box": {"low": [0.0, 0.0], "high": [1.0, 0.5], "open": ["y+"]}},
               "type": "extrapolated-free-slip"}],
    )  # fmt: skip
    with case.simulation(threads=1) as sim:
        sim.advance(until=0.2)
        assert 0.5 < sim.scalars()["max_velocity"] < 2 * math.sqrt(9.81 * height)  # of the front (Ritter)


@pytest.mark.parametrize(
    ("settings", "shifts"),
    [
        ({"viscosity": 1.0, "form": "morris"}, True),
        ({"viscosity": 1.0, "form": "morris", "corrected": "true"}, False),
        ({"viscosity": 1.0, "form": "morris", "integrator": "rk3-tvd"}, False),
        ({"viscosity": 1.0, "form": "cleary"}, False),
        ({}, False),
    ],
    ids=["viscous", "corrected", "rk3", "cleary", "water"],
)
def test_by_default_what_a_viscous_fluid_needs(settings, shifts):
    case = text(more=tank(2), **settings).replace("shifting = false;", "")
    assert load_app().configure(loads(case)).numerics.shifting == shifts


@pytest.mark.parametrize("integrator", ["euler", "predictor-corrector", "rk3-tvd"])
def test_rates_that_are_found_before_the_shifts_are_refused(integrator):
    with pytest.raises(ConfigError, match=r'numerics.shifting: .* simulation.integrator = "symplectic"'):
        load_app().configure(loads(text(more=tank(2), shifting="true", integrator=integrator)))
