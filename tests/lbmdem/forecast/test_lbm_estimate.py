"""Laws of the estimate: what a series that nobody asked for costs, what divides among cores, what ranks cost."""

import pytest

from hpcpic.core.case.config import loads
from lbmdem.case.config import LbmDemConfig
from lbmdem.configure import configure
from lbmdem.forecast.estimate import (
    SAMPLES,
    SERIES_SHARE,
    START,
    estimate,
    output_periods,
    phases,
    sample_seconds,
)
from lbmdem.forecast.rates import DEFAULT

CASE = """
simulation = {{ dimensions = 3; end_time = {steps}.0; }};
domain = {{ size = [{n}.0, {n}.0, {n}.0]; spacing = 1.0; periodic = ["x", "y", "z"]; }};
fluid = {{ density = 1.0; viscosity = 0.1; time_step = 1.0; }};
{more}
"""
GRAIN = """grains = ( {{ diameter = 8.0; density = 2.0; moving = {moving}; position = [8.0, 8.0, 8.0]; }} );
contact = {{ normal_stiffness = 0.01; }};"""


def config(steps: int = 1000, n: int = 32, more: str = "") -> LbmDemConfig:
    return configure(loads(CASE.format(steps=steps, n=n, more=more)))


@pytest.mark.parametrize("steps", [1, 10, 1000, 10**6])
@pytest.mark.parametrize("n", [16, 96, 500])
def test_a_series_not_asked_for_costs_its_share_or_has_the_least_samples(steps, n):
    case = config(steps, n)
    period, sample = output_periods(case)["series"], sample_seconds(case, 1, 1, DEFAULT)
    samples, run = steps / period, START + steps * sum(phases(case, 1, 1, DEFAULT, 6).values())
    assert samples >= min(steps, SAMPLES[0])
    assert samples * sample <= SERIES_SHARE * run * 1.1 or samples < 2 * SAMPLES[0]
    assert samples < 2 * SAMPLES[1]


def test_a_series_that_is_asked_for_is_kept():
    assert output_periods(config(more="output = { period = { series = 7.0; }; };"))["series"] == 7


def test_grains_cost_more_when_they_move_and_ranks_when_there_are_two():
    empty, fixed, moving = (
        config(more=more) for more in ("", GRAIN.format(moving="false"), GRAIN.format(moving="true"))
    )
    steps = [estimate(case, 1, 1, {}).step_seconds for case in (empty, fixed, moving)]
    assert steps[0] < steps[1] < steps[2]
    one, two = (estimate(moving, ranks, 1, {}).phases for ranks in (1, 2))
    assert one["exchanges"] == one["messages"] == 0.0 < min(two["exchanges"], two["messages"])
    assert two["nodes"] == pytest.approx(one["nodes"] / DEFAULT["wave_core_gain"])


def test_what_was_measured_takes_the_place_of_the_default():
    case = config(more=GRAIN.format(moving="true"))
    dearer = phases(case, 1, 1, DEFAULT | {"moving_us": DEFAULT["moving_us"] + 100.0}, 1)
    assert dearer["moving solids"] - phases(case, 1, 1, DEFAULT, 1)["moving solids"] == pytest.approx(1e-4)


@pytest.mark.parametrize(("n", "cold"), [(32, False), (64, True)])
def test_what_moves_finds_cold_caches_where_a_sweep_fills_them(n, cold):
    case = config(n=n, more=GRAIN.format(moving="true"))
    without = phases(case, 1, 1, DEFAULT | {"cold_us": 0.0}, 1)["moving solids"]
    more = phases(case, 1, 1, DEFAULT, 1)["moving solids"] - without
    assert more == pytest.approx(1e-6 * DEFAULT["cold_us"] if cold else 0.0)
