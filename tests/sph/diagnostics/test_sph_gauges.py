"""Gauges and scalars on fields that are known: what is linear or at rest is read as it is."""

from types import SimpleNamespace

import numpy as np
import pytest
from sph_scenes import engine, jitter, tank

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from sph.case import columns
from sph.case.config import GAUGES, GaugeKind
from sph.configure import configure
from sph.diagnostics.gauges import Gauges
from sph.step import Sph

POOL = """
simulation = { dimensions = 2; end_time = 1.0; };
domain = { low = [0.0, -0.1]; high = [2.0, 1.5]; PERIODIC };
gravity = [0.0, -9.81];
fluid = ( { shape = { box = { low = [0.0, 0.0]; high = [HIGH, 1.0]; }; }; velocity = [0.5, 0.0]; } );
eos = { sound_speed = 40.0; max_velocity = 4.0; };
numerics = { spacing = 0.04; };
gauge = ( GAUGE );
"""


def Still(gauge="", high=2.0, periodic='periodic = ["x"];'):
    """A run at t = 0, of which gauges and scalars see the particles."""
    text = POOL.replace("GAUGE", gauge).replace("HIGH", str(high)).replace("PERIODIC", periodic)
    return Sph(configure(loads(text)), World.alone(), Pool(1), Timers())


def reading(gauge, **more):
    sph = Still(f'{{ name = "g"; {gauge} }}', **more)
    return Gauges(sph.storage, sph.sensors).values(0.0)


@pytest.mark.parametrize("kind", [GaugeKind(("m", "m")), GaugeKind(("K", "K"), at_point=True)])
def test_a_kind_that_nothing_reads_is_told(kind, monkeypatch):
    sph = Still('{ name = "g"; what = "elevation"; at = [0.3, 0.5]; }')
    monkeypatch.setitem(GAUGES, "elevation", kind)
    with pytest.raises(ValueError, match="g: nothing reads"):
        Gauges(sph.storage, sph.sensors).values(0.0)


@pytest.mark.parametrize("x", [0.0, 0.31, 1.999])
def test_the_level_of_water_at_rest(x):
    found = reading(f'what = "elevation"; at = [{x}, 0.0];')
    assert found["g"] == pytest.approx(1.0, abs=0.1 * 0.04)  # a tenth of a spacing


STEP = "solid = true; shape = { box = { low = [1.4, 0.0]; high = [1.6, 0.2]; }; };"


@pytest.mark.parametrize("at, wall, height", [
    (1.5, "shape = { plane = { point = [0.0, 0.0]; normal = [0.0, 1.0]; }; };", 0.0),
    (1.5, "shape = { plane = { point = [1.0, 0.0]; normal = [-0.6, 0.8]; }; };", 0.375),
    (1.5, 'shape = { box = { low = [0.0, -0.05]; high = [2.0, 1.5]; open = ["y+"]; }; };', -0.05),
    (1.5, STEP, 0.2), (1.2, STEP, -0.1), (1.5, STEP + "motion = { velocity = [0.0, 0.1]; };", -0.1),
])  # fmt: skip
def test_a_dry_level_is_that_of_the_bed(at, wall, height):
    gauge = f'what = "elevation"; at = [{at}, 0.0]; }} ); wall = ( {{ {wall}'
    assert reading(gauge, high=1.0, periodic="")["g"] == pytest.approx(height, abs=1e-9)


def test_no_water_is_the_lowest_level_and_no_pressure():
    assert reading('what = "elevation"; at = [1.5, 0.0];', high=1.0, periodic="")["g"] == pytest.approx(-0.1)
    assert reading('what = "pressure"; at = [1.5, 0.1];', high=1.0, periodic="")["g"] == 0.0


@pytest.mark.parametrize("y", [0.0, 0.003, 0.5, 0.93])
def test_pressure_is_that_of_rest_even_at_the_floor(y):
    """To 0.3 %: the compression of the fluid between the particles and the gauge is left out."""
    found = reading(f'what = "pressure"; at = [0.02, {y}];')["g"]
    assert found == pytest.approx(1000 * 9.81 * (1.0 - y), rel=4e-3)


def test_velocity_and_flow_of_a_uniform_stream():
    found = reading('what = "velocity"; at = [0.7, 0.4];')
    assert found == pytest.approx({"g_x": 0.5, "g_y": 0.0}, abs=1e-9)  # 2^-40 of c0 for each of 20 particles
    still = reading('what = "flow"; at = [0.7, 0.5]; axis = "x+";')["g"]
    assert still == pytest.approx(0.5 * 1.0, rel=5e-3)  # density is up to 0.6 % above rho0
    half = reading('what = "flow"; at = [0.7, 0.25]; axis = "x-"; size = [0.0, 0.48];')["g"]
    assert half == pytest.approx(-0.5 * 0.48, rel=5e-3)


def test_the_front_is_the_edge_of_the_fluid():
    assert reading('what = "front"; axis = "x+";', high=1.2, periodic="")["g"] == pytest.approx(1.2)
    assert reading('what = "front";', high=1.2, periodic="")["g"] == pytest.approx(1.2)
    assert reading('what = "front"; axis = "y+";')["g"] == pytest.approx(1.0)


def test_a_gauge_with_a_period_is_read_at_its_multiples_only():
    text = '{ name = "a"; what = "front"; axis = "y+"; period = 0.1; }, { name = "b"; what = "front"; axis = "y+"; }'
    still = Still(text)
    gauges = Gauges(still.storage, still.sensors)
    expected = {0.0: ["a", "b"], 0.04: ["b"], 0.1: ["a", "b"], 0.19: ["b"], 0.21: ["a", "b"], 0.3: ["a", "b"]}
    for time, names in expected.items():
        assert sorted(gauges.values(time)) == names
        gauges.sampled(time)
        assert sorted(gauges.values(time)) == names  # who looks twice reads the same
    later = Gauges(gauges.storage, gauges.sensors, since=0.21)
    assert sorted(later.values(0.25)) == ["b"]


def test_what_was_due_between_the_last_sample_and_a_stop_is_read_after_the_restart():
    """A run that is told to stop takes no sample more; what its next one would have read was lost."""
    text = '{ name = "a"; what = "front"; axis = "y+"; period = 0.1; }, { name = "b"; what = "front"; period = 0.3; }'
    run, again = Still(text), Still(text)
    run.sampled()
    run.clock.time = 0.15  # here it stops
    kept = {name: shard.local for name, shard in run.state().items()}
    reader = SimpleNamespace(step=9, time=0.15, names=list(kept))
    reader.read = lambda name, *rows: kept[name][slice(*rows or (None,))]
    again.restore(reader)
    for sph in (run, again):
        sph.clock.time = 0.16
        assert {"a", "b"} & sph.scalars().keys() == {"a"}


def test_readings_and_scalars_do_not_depend_on_the_order_of_the_particles():
    text = ", ".join(
        f'{{ name = "g{k}"; what = "{what}"; at = [0.7, 0.5]; {axis} }}'
        for k, (what, axis) in enumerate(
            (("pressure", ""), ("velocity", ""), ("elevation", 'axis = "y+";'), ("flow", 'axis = "x+";'))
        )
    )
    still = Still(text)
    before = still.scalars()
    storage = still.storage
    rows, mixed = storage.own_slots, np.random.default_rng(5).permutation(storage.own_slots)
    storage.state[:, rows] = storage.state[:, mixed]
    assert still.scalars() == before
    assert set(before) == set(columns.scalar_units(still.scene.config) | columns.gauge_units(still.scene.config))


def test_energies_of_a_stream_at_rest_pressure():
    still = Still()
    found = still.scalars()
    mass = 2000.0
    assert found["mass"] == pytest.approx(mass, rel=1e-12)
    assert found["energy_kinetic"] == pytest.approx(0.5 * mass * 0.25, rel=1e-12)
    assert found["energy_potential"] == pytest.approx(mass * 9.81 * 0.5, rel=1e-12)
    assert found["momentum_x"] == pytest.approx(mass * 0.5, rel=1e-12) and abs(found["momentum_y"]) < 1e-12
    # compression by p: p^2 / (2 rho0 c0^2) per volume, to the order of (p / rho0 c0^2)
    elastic = 2.0 * (1000 * 9.81) ** 2 / 3 / (2 * 1000 * 1600)
    assert found["energy_internal"] == pytest.approx(elastic, rel=0.02)


@pytest.mark.parametrize("gamma", [7.0, 1.0, 6.5])
def test_internal_energy_is_the_work_of_pressure(gamma):
    """u' = p / rho^2."""
    still = engine(gamma=gamma)
    scene, mass = still.scene, still.storage.own_values("m").sum()

    def energy(drho):
        still.storage.set_own_values("drho", drho)
        return still.scalars()["energy_internal"] / mass

    for drho in (-20.0, 0.0, 80.0):
        slope = (energy(drho + 1e-3) - energy(drho - 1e-3)) / 2e-3
        # the difference of two energies has lost their first five digits or so
        assert slope == pytest.approx(float(scene.eos.pressure(drho)) / (1000 + drho) ** 2, rel=1e-5, abs=1e-9)


def test_scalars_are_the_sums_over_the_fluid():
    """As numpy adds them, to its rounding; what walls hold is not counted."""
    sph = engine(d=3, spacing=0.125, more=tank(3))
    jitter(sph)
    found, fluid = sph.scalars(), sph.storage.own_values("wall") == 0
    assert not fluid.all()
    x, v, m = sph.storage.physical("x")[fluid], sph.storage.physical("v")[fluid], sph.storage.own_values("m")[fluid]
    assert found["mass"] == pytest.approx(m.sum(), rel=1e-13)
    assert found["energy_kinetic"] == pytest.approx((0.5 * m * (v * v).sum(axis=1)).sum(), rel=1e-13)
    assert found["energy_potential"] == pytest.approx(-(m * (x @ sph.scene.gravity)).sum(), rel=1e-13)
    for k, axis in enumerate("xyz"):
        assert found[f"momentum_{axis}"] == pytest.approx((m * v[:, k]).sum(), abs=1e-12 * (m * abs(v[:, k])).sum())
    assert found["max_velocity"] == pytest.approx(np.sqrt((v * v).sum(axis=1).max()), rel=1e-15)
    assert found["front_x"] == pytest.approx(x[:, 0].max() + 0.5 * 0.125, rel=1e-15)


def test_what_is_not_a_number_is_said():
    still = Still()
    still.storage.v[0, still.storage.fluid_slots[3]] = np.nan
    assert np.isnan(still.scalars()["energy_kinetic"])
