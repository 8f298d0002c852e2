"""Laws of the estimate: what a series that nobody asked for costs, what divides among cores, what ranks cost."""

import pytest
from app_runner import running

from hpcpic.core.case.config import load, loads
from lbmdem.app import shipped_cases
from lbmdem.case.config import LbmDemConfig
from lbmdem.configure import configure
from lbmdem.forecast.contacts import substeps
from lbmdem.forecast.cuts import first_cuts
from lbmdem.forecast.estimate import (
    SAMPLES,
    SERIES_SHARE,
    START,
    estimate,
    output_periods,
    phases,
    sample_seconds,
)
from lbmdem.forecast.films import expected_substeps
from lbmdem.forecast.node_shares import cached, porous
from lbmdem.forecast.rates import DEFAULT, SHAPES, node_ns
from lbmdem.physics.lubrication import MOST_SUBSTEPS

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


@pytest.mark.parametrize(("n", "kind"), [(32, "cached"), (64, "fixed")])
def test_links_and_threads_in_a_box_that_caches_hold_have_rates_of_their_own(n, kind):
    case, rates = config(n=n, more=GRAIN.format(moving="false")), {"link_ns cached": 7.0, "cached_core_gain": 1.2}
    one, two = (phases(case, 1, threads, DEFAULT | rates, 6) for threads in (1, 2))
    plain = phases(case, 1, 1, DEFAULT, 6)
    assert one["links"] / plain["links"] == pytest.approx(7.0 / 5.7 if kind == "cached" else 1.0)
    assert one["nodes"] / two["nodes"] == pytest.approx(1.2 if kind == "cached" else DEFAULT["wave_core_gain"])


@pytest.mark.parametrize(("n", "cold"), [(32, False), (64, True)])
def test_what_moves_finds_cold_caches_where_a_sweep_fills_them(n, cold):
    case = config(n=n, more=GRAIN.format(moving="true"))
    without = phases(case, 1, 1, DEFAULT | {"cold_us": 0.0}, 1)["moving solids"]
    more = phases(case, 1, 1, DEFAULT, 1)["moving solids"] - without
    assert more == pytest.approx(1e-6 * DEFAULT["cold_us"] if cold else 0.0)


@pytest.mark.parametrize("cache", [0.0, 1.0, 24.0, 480.0])
def test_a_node_waits_for_memory_the_more_the_larger_its_box(cache):
    """Not at all in a small box, and as was timed in one as large or larger, whatever the cache is said to hold."""
    rates = DEFAULT | {"lattice_cache_mb": cache}
    boxes = [node_ns(config(n=n), rates) for n in (16, 32, 48, 64, 80, SHAPES["D3Q19"][0], 200)]
    waits = [times.one - times.bare for times in boxes]
    assert waits == sorted(waits) and waits[0] == 0.0 < waits[-3] < waits[-2] == pytest.approx(waits[-1])
    assert boxes[-1].one == pytest.approx(1e3 / DEFAULT["mlups D3Q19 double"])


def test_a_small_box_has_the_rate_of_one_and_solids_cost_there_what_they_cost():
    small, large = config(n=32), config(n=48)
    assert cached(small) and not cached(large)
    (one, quicker), (same, unmoved) = (
        [node_ns(case, DEFAULT | {"cached_gain D3Q19": gain}) for gain in (1.0, 2.0)] for case in (small, large)
    )
    assert quicker.bare == pytest.approx(0.5 * one.bare) and quicker.one == quicker.bare
    assert quicker.beside == one.beside and same == unmoved
    bed = config(n=16, more=GRAIN.format(moving="false").replace("8.0; d", "14.0; d"))
    assert porous(bed) and cached(bed)  # measured: 12.3 ns a fluid node in 36^3, 12.7 in 96^3
    assert node_ns(bed, DEFAULT | {"cached_gain D3Q19": 2.0}) == node_ns(bed, DEFAULT)


def test_what_a_processor_holds_changes_what_is_told_and_nothing_that_is_done(monkeypatch):
    """Masks decide time and memory, and neither the samples of a series nor the rows of ranks."""
    bed, told, done = config(n=64, more=GRAIN.format(moving="false").replace("8.0; d", "56.0; d")), [], []
    for masks in (True, False):
        for module in ("lbmdem.forecast.node_shares", "hpcpic.core.app.rates"):
            monkeypatch.setattr(f"{module}.has_masks", lambda masks=masks: masks)
        needs = estimate(bed, 1, 1, {})
        told.append((needs.step_seconds, sum(needs.memory.values())))
        done.append((output_periods(bed), first_cuts(bed, 3)))
    assert told[0][0] != told[1][0] and told[0][1] < told[1][1] and done[0] == done[1]


def shipped(name: str, *sets: str) -> LbmDemConfig:
    return configure(load(shipped_cases()[name], sets))


def test_dense_grains_want_the_substeps_of_their_films_and_few_do_not(world):
    """As many as a run of the bed takes (58 to 65, told 68) but for what the nearest two are larger, and farther apart,
    than the smallest that touch.
    """
    bed = shipped("liquefaction")
    with running(world, "lbmdem", bed) as app:
        taken = []
        for _ in range(3):
            app.step()
            taken.append(app.grains._substeps_of_films())
    expected = expected_substeps(bed)
    assert bed.substeps < min(taken) <= max(taken) <= 1.1 * expected and expected < 1.5 * min(taken)
    assert phases(bed, 1, 1, DEFAULT, 1)["grains"] > 2e-9 * DEFAULT["grain_ns"] * 120 * bed.substeps
    assert expected_substeps(shipped("drafting-kissing-tumbling")) == shipped("drafting-kissing-tumbling").substeps
    given = shipped("liquefaction", "coupling.substeps=30")
    assert expected_substeps(given) == 30
    thick = shipped("liquefaction", "fluid.kinematic_viscosity=1e-4", "fluid.relaxation_time=2.0")
    assert expected_substeps(thick) <= max(thick.substeps, MOST_SUBSTEPS)


def test_films_that_take_most_of_a_step_are_told_with_the_way_to_fewer_substeps():
    """Where grains are dense in a viscous fluid; with that number given, or few grains, nothing is told."""
    dense = (
        SUSPENSION.partition("grains")[0]
        + """grains = ({ density = 1000.0;
        diameters = { min = 1.0e-3; max = 1.0e-3; count = 6; }; packing = { porosity = 0.7; }; });"""
    )

    def note(text, *sets):
        return substeps(configure(loads(text, sets=sets))).source

    soft = "contact.normal_stiffness=1.0"
    assert "films of grains that touch take up to 1000, " in (told := note(dense, soft))
    assert "coupling.substeps = 20 " in told
    assert note(dense, soft, "coupling.substeps=20") == note(dense, soft, "grains[0].diameters.count=1") == ""


SUSPENSION = """
simulation = { end_time = 1.0; };
domain = { size = [4.0e-3, 4.0e-3]; spacing = 1.0e-4; periodic = ["x"]; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-5; relaxation_time = 1.0; };
boundary = ({ face = "y+"; type = "wall"; velocity = [1.0e-3, 0.0]; });
grains = ({ diameter = 1.0e-3; density = 1000.0; position = ([1.0e-3, 1.0e-3], [2.05e-3, 1.0e-3], [3.1e-3, 1.2e-3],
            [1.0e-3, 2.6e-3], [2.2e-3, 2.6e-3]); });
contact = { normal_stiffness = 1.0; };
gravity = [0.0, -9.81];
"""


def test_substeps_of_a_suspension_are_those_of_its_narrowest_gap(world):
    """Nothing presses grains of the density of the fluid together; heavy ones will lie on each other."""
    light = configure(loads(SUSPENSION))
    with running(world, "lbmdem", light) as app:
        app.step()
        taken = app.grains._substeps_of_films()
    assert light.substeps < taken and taken == pytest.approx(expected_substeps(light), abs=1)
    heavy = configure(loads(SUSPENSION, sets=["grains[0].density=1200.0"]))
    assert expected_substeps(heavy) > 20 * taken
