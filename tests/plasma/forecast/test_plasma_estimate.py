"""Laws of the estimate: what divides among cores, what ranks cost, the period of a series that nobody asked for."""

from types import SimpleNamespace

import pytest

from hpcpic.core.case.accelerations import ACCELERATIONS
from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from hpcpic.plasma import bench
from hpcpic.plasma.case.config import PlasmaConfig
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import counts
from hpcpic.plasma.forecast.estimate import (
    SERIES_SECONDS,
    SERIES_SHARE,
    STANDARD_BYTES,
    count_seconds,
    estimate,
    phases,
    sample_seconds,
)
from hpcpic.plasma.forecast.plan import factor_nonzeros
from hpcpic.plasma.forecast.rates import DEFAULT
from hpcpic.plasma.physics.poisson import LU

CASE = """
simulation = {{ dimensions = 2; cycles = {cycles}; time_step = 0.1; space_length = [64.0, 64.0]; {period} }};
grid = {{ points = [64, 64]; }};
species = ( {{ name = "electron"; particles = {n}; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
              init_method = "random position"; thermal_velocity = 0.1; }} );
"""


def config(cycles: int = 100, n: int = 100_000, period: str = "") -> PlasmaConfig:
    return configure(loads(CASE.format(cycles=cycles, n=n, period=period)))


@pytest.mark.parametrize("cycles", [1, 1000, 30_000, 10**7])
@pytest.mark.parametrize("n", [1, 100_000, 10**9])
def test_a_series_not_asked_for_costs_its_share_or_some_seconds(cycles, n):
    case = config(cycles, n)
    step, sample = sum(phases(case, 1, 1, DEFAULT).values()), sample_seconds(case, 1, 1, DEFAULT)
    period, most = case.periods["series"], max(SERIES_SHARE * cycles * step, SERIES_SECONDS)
    assert cycles / period * sample <= most * (1 + 1e-9)
    assert period == 1 or cycles / (period - 1) * sample > most


@pytest.mark.parametrize("cycles", [1, 1000, 30_000])
def test_histograms_not_asked_for_cost_their_share_and_check_tells_of_more(cycles):
    text = CASE.format(cycles=cycles, n=10**7, period="") + 'histogram = ( { of = ["vx"]; }, { of = ["vy"]; } );'
    case = configure(loads(text))
    step, count = sum(phases(case, 1, 1, DEFAULT).values()), count_seconds(case, 1, 1, DEFAULT)
    period = case.periods["histogram"]
    assert cycles / period * count <= max(SERIES_SHARE * cycles * step, SERIES_SECONDS) * (1 + 1e-9)
    (found,) = counts(case)
    assert found.verdict == "ok" and found.value == pytest.approx(count / step / period)
    if cycles > 1:
        (found,) = counts(configure(loads(text, sets=["output.every.histograms=1"])))
        assert found.verdict == "warn" and found.value > SERIES_SHARE


@pytest.mark.parametrize("asked", [0, 1, 7])
def test_a_series_that_is_asked_for_is_kept(asked):
    case = config(10**7, 10**6, f"sampling_period = {{ energy = {asked}; }};")
    assert case.periods["series"] == asked


def test_the_field_is_solved_by_the_sample_in_every_step_and_else_by_the_step():
    every, never = (estimate(config(period=f"sampling_period = {{ energy = {k}; }};"), 1, 1, {}) for k in (1, 0))
    assert every.phases == never.phases and never.sampling == 0.0 < every.sampling
    assert never.step_seconds - every.step_seconds == pytest.approx(never.phases["field"])
    assert every.seconds > never.seconds


def test_work_divides_and_launches_do_not():
    one, two, ranks = (estimate(config(), *shape, {}).phases for shape in ((1, 1), (1, 2), (2, 1)))
    for name, what in {"particles": "plasma", "tiles": "plasma", "cells": "mesh", "field": "mesh"}.items():
        cores = DEFAULT["plasma_core_gain 2D" if what == "plasma" else "mesh_core_gain"]
        assert two[name] == ranks[name] == pytest.approx(one[name] / cores)
    assert one["launches"] == ranks["launches"] == 1e-6 * DEFAULT["plasma_launch_us"]
    assert two["launches"] == 1e-6 * DEFAULT["plasma_launch_together_us"]
    assert one["exchanges"] == two["exchanges"] == 0.0 < ranks["exchanges"]


@pytest.mark.parametrize("measured", [1.2, 1.65, 1.9, 5.0])
def test_ranks_gain_beside_threads_what_was_measured_and_not_less(measured):
    """Of particles and of the field; not more than there are cores."""
    rates = {"plasma_rank_gain": measured}
    threads, ranks = (phases(config(), *shape, DEFAULT | rates) for shape in ((1, 2), (2, 1)))
    more = max(1.0, measured / DEFAULT["plasma_core_gain 2D"])
    for name, kind in {"particles": "plasma_core_gain 2D", "field": "mesh_core_gain"}.items():
        of_ranks = min(DEFAULT[kind] * more, DEFAULT["cores"])
        assert threads[name] / ranks[name] == pytest.approx(of_ranks / DEFAULT[kind])


def test_memory_is_waited_for_by_particles_beyond_the_caches():
    held = int(0.75e6 * DEFAULT["cache_mb"] / STANDARD_BYTES)
    within, once, twice = (phases(config(n=n), 1, 1, DEFAULT)["memory"] for n in (held, 2 * held, 3 * held))
    assert within == 0.0 and twice == pytest.approx(2 * once)
    wait = DEFAULT["memory_ns"] - DEFAULT["particle_ns 2D CIC double"]
    assert once == pytest.approx(1e-9 * held * wait, rel=1e-4)  # held is a whole number


@pytest.mark.parametrize("size", ["1024K", "32768K", "491520K"])
def test_what_memory_takes_is_seen_whatever_the_cache_is_said_to_hold(tmp_path, size):
    for index, told in enumerate(("32K", size)):
        (tmp_path / f"index{index}").mkdir()
        (tmp_path / f"index{index}" / "size").write_text(told + "\n")
    cache = bench.cache_mb(tmp_path)
    assert cache == min(int(size[:-1]) * 1024e-6, bench.MOST_CACHE)
    seconds = {"tiny": 1e-6, "few": 1e-4, "empty": 1e-4, "large": 1.0, "wide": 1.0}
    trials = {name: SimpleNamespace(rest=t, field=t) for name, t in seconds.items()}
    assert 1e-9 < bench.memory_wait(trials, 1e-9, cache) < 1e-3
    assert all(1.0 < rate < 1e6 for rate in bench.wide_rates(trials, cache).values())


def test_together_cores_wait_for_one_memory():
    rates = DEFAULT | {"memory_core_gain": 1.0, "plasma_core_gain 2D": 2.0, "mesh_core_gain": 2.0}
    one, two = (sum(phases(config(n=10**9), 1, threads, rates).values()) for threads in (1, 2))
    assert two == pytest.approx(one, rel=0.02)  # of 10^9 particles a few are in caches
    nodes = phases(config(n=10**9), 4000, 2, rates)
    assert nodes["memory"] == 0.0  # all are in the caches of so many nodes


def test_a_field_by_lu_does_not_divide():
    lu = 'solver = "LU";'
    one, two, ranks = (estimate(config(period=lu), *shape, {}).phases for shape in ((1, 1), (1, 2), (2, 1)))
    assert one["field"] == two["field"] == ranks["field"] > estimate(config(), 1, 1, {}).phases["field"]


@pytest.mark.parametrize("points", [(4096,), (16, 16), (64, 64), (128, 128), (16, 1024)])
def test_numbers_in_the_factors_of_lu(points):
    """As we told what they are: SuperLU's ordering is a heuristic."""
    domain = Domain(tuple(map(float, points)), points, (True,) * len(points), (0, points[0]))
    pool = Pool(1)
    factors = LU(World.alone(), pool, domain)._factors
    pool.close()
    assert factor_nonzeros(points) == pytest.approx(factors.L.nnz + factors.U.nnz, rel=0.26)


def test_an_acceleration_of_ones_own_takes_its_time_of_its_particles(monkeypatch):
    """Ten times that of all else or more, of which nothing was told."""
    monkeypatch.setitem(ACCELERATIONS, "drag", lambda x, v, t: (-v[0], -v[1], 0.0))
    text = CASE.format(cycles=100, n=100_000, period="")
    plain, driven = (configure(loads(text, sets=sets)) for sets in ((), ("species[0].acceleration=drag",)))
    before, after = (phases(case, 1, 1, DEFAULT) for case in (plain, driven))
    assert before.pop("accelerations") == 0.0 and after.pop("accelerations") > 10 * after["particles"]
    assert before == after
