"""Knobs of LBM-DEM: settings mean what they say, every case knows what it is about."""

import math

import numpy as np
import pytest
from app_runner import running
from knob_cases import made_again, reader, sizes_of

from hpcpic.core.cli.main import build
from hpcpic.core.files.series import Series
from lbmdem.app import APP, shipped_cases
from lbmdem.configure import configure
from lbmdem.forecast.knobs import knobs_of

CASES = sorted(shipped_cases())


read = reader(configure, shipped_cases)


@pytest.mark.parametrize("case", CASES)
def test_its_own_sizes_are_the_case_itself(case):
    config, again = made_again(read, knobs_of, case)
    assert again.points == config.points and again.substeps == config.substeps
    assert again.time_step == pytest.approx(config.time_step, rel=1e-12)
    assert again.simulation.end_time == config.simulation.end_time


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("factor", [1.9, 0.6])
def test_settings_are_valid_and_never_coarser_than_asked(case, factor):
    config = read(case)
    knobs = knobs_of(config)
    wanted = {name: factor * size for name, size in sizes_of(knobs, config).items()}
    made = read(case, knobs.settings(wanted, 0.5 * knobs.time))
    for name, size in sizes_of(knobs, made).items():
        assert size <= wanted[name] * (1 + 1e-9), name
    if config.fluid:  # the spacing divides the box
        assert all(abs(length / made.spacing - n) <= 1e-6 * n for length, n in zip(made.domain.size, made.points))


CHANNEL = (  # 41 x 88: no common divisor
    "domain.size=[0.088, 0.041]", "domain.spacing=1.0e-3", "domain.periodic=[]", "fluid.relaxation_time=0.8",
    "fluid.kinematic_viscosity=1.0e-5", "fluid.body_force=[]",
)  # fmt: skip
INLET = 'face = "x-"; type = "velocity"; velocity = [0.01, 0.0];'
OUTLET = 'face = "x+"; type = "pressure"; pressure = 0.0;'
OPEN = (f"boundary=({{ {INLET} }}, {{ {OUTLET} }})",)
LID = ('boundary=({ face = "x+"; type = "wall"; velocity = [0.0, 1.0e-4]; })',)


@pytest.mark.parametrize("factor", [1.9, 1.25, 1.1, 0.95, 0.6])
def test_a_spacing_of_any_factor_is_there_where_sides_have_no_common_divisor(factor):
    """An outlet moves by at most half a spacing; the upper wall of the longer side stays where it is, as a plane."""
    for faces in (OPEN, LID):
        config = read("poiseuille", (*CHANNEL, *faces))
        knobs = knobs_of(config)
        made = read("poiseuille", (*CHANNEL, *faces, *knobs.settings({"dx": factor * config.spacing}, knobs.time)))
        assert 0.9 * factor * config.spacing < made.spacing <= factor * config.spacing * (1 + 1e-9)
        assert made.domain.size[1] == pytest.approx(0.041, rel=1e-12)
        if faces is OPEN:
            assert abs(made.domain.size[0] - 0.088) <= 0.5 * made.spacing and not made.obstacle
        else:
            wall = made.obstacle[0]
            assert wall.shape.plane.point == (0.088, 0.0) and wall.velocity == (0.0, 1.0e-4)
            assert 0.088 < made.domain.size[0] < 0.088 + made.spacing


def test_the_momentum_of_a_closed_box_is_not_asked_for():
    config = read("poiseuille", (*CHANNEL, *LID))
    assert [quantity.name for quantity in knobs_of(config).quantities()] == ["energy"]


POST = ('grains=({ name = "post"; diameter = 8.0e-3; position = [0.03, 0.02]; moving = false; })',)
BAR = ('obstacle=({ name = "bar"; shape = { box = { low = [0.03, 0.01]; high = [0.04, 0.02]; }; }; })',)
FALL = (f'boundary=({{ face = "x-"; type = "pressure"; pressure = 1.0; }}, {{ {OUTLET} }})',)
PUSH = ('domain.periodic=["x"]', "fluid.body_force=[1.0e-3, 0.0]")


@pytest.mark.parametrize(
    ("sets", "name"),
    [((*OPEN, *POST), "drag"), ((*FALL, *POST), "drag"), ((*OPEN, *BAR), "drag"), ((*PUSH, *POST), "flow-rate"),
     ((*PUSH, *BAR), "flow-rate"), ((*PUSH, *POST, "coupling.frozen=true"), "flow-rate"), (OPEN, "momentum"),
     (FALL, "momentum"), (PUSH, "momentum"), (LID, "energy")],
)  # fmt: skip
def test_a_flow_past_solids_is_about_their_drag_or_how_much_a_force_drives_past_them(sets, name, world):
    """And no reason says that nothing drives a flow that something drives; the series shows what is asked for."""
    config = read("poiseuille", (*CHANNEL, *sets))
    about = knobs_of(config).quantities()[0]
    assert about.name == name
    assert about.why.startswith("no steady push") == (name == "energy")
    column = {"drag": "force_bar_x" if sets[-1] in BAR else "force_post_x", "flow-rate": "flow_rate_x"}.get(name)
    if column:
        with running(world, "lbmdem", config) as app:
            assert column in app.scalar_units


def test_the_drag_is_the_mean_force_over_the_second_half_of_the_run():
    config = read("poiseuille", (*CHANNEL, *OPEN, *POST))
    (drag, *_), end = knobs_of(config).quantities(), config.simulation.end_time
    t = np.linspace(0.0, end, 101)
    force = np.where(t < 0.5 * end - 1e-9, 1e6, 3.0)
    series = Series({"force_post_x": force}, {}, np.arange(101), t)
    assert drag.time == end and drag.measure(series) == pytest.approx(3.0)


def test_grains_that_come_to_rest_are_not_asked_for_what_is_left_of_their_energy():
    config = read("settling-pile")
    (about, *_), end = knobs_of(config).quantities(), config.simulation.end_time
    t = np.linspace(0.0, end, 101)
    energy = {"energy_kinetic_grains": np.where(t < 0.5 * end, 2.0, 1e-9)}
    assert about.measure(Series(energy, {}, np.arange(101), t)) == pytest.approx(1.0, rel=0.02)


def test_each_knob_turns_alone():
    config = read("poiseuille")
    knobs = knobs_of(config)
    own = sizes_of(knobs, config)
    finer = read("poiseuille", knobs.settings({**own, "dx": own["dx"] / 2}, knobs.time))
    assert finer.tau == config.tau and finer.time_step == pytest.approx(config.time_step / 4)
    slower = read("poiseuille", knobs.settings({**own, "tau": own["tau"] / 2}, knobs.time))
    assert slower.points == config.points and slower.time_step == pytest.approx(config.time_step / 2)
    assert knobs.work(finer) == pytest.approx(16 * knobs.work(config), rel=0.01)


@pytest.mark.parametrize("sets", [("domain.size=[1.0e-4, 1.0e-4, 1.0e-4]",), ("fluid.body_force=[1.0, 0.0, 0.0]",)])
def test_permeability_is_asked_for_where_it_is_measured(sets, world):
    """A flow along another axis than the last one has none in the series."""
    config = read("sphere-array", ("domain.spacing=1.0e-5", "domain.size=[1.0e-4, 1.0e-4, 1.0e-4]", *sets))
    asked = "permeability" in [quantity.name for quantity in knobs_of(config).quantities()]
    with running(world, "lbmdem", config) as app:
        assert ("permeability" in app.scalar_units) == asked == (not config.fluid.body_force[0])


@pytest.mark.parametrize("case", CASES)
def test_every_case_knows_what_it_is_about(case):
    knobs = knobs_of(read(case))
    quantities = knobs.quantities()
    assert quantities and all(0 < quantity.time <= knobs.time for quantity in quantities)
    about = {"taylor-green": "energy", "poiseuille": "momentum", "couette": "momentum", "sphere-array": "permeability"}
    assert quantities[0].name == about.get(case, quantities[0].name)
    assert math.isfinite(knobs.horizon) and knobs.horizon > 0


def test_what_no_knob_turns_is_turned_where_the_refusal_says(capfd):
    """Soft grains: the stiffness is no knob of the accuracy, yet the nearest legal one is told, and what it costs."""
    with pytest.raises(SystemExit) as end:
        build(lambda: APP, "lbmdem", "").main(["check", "settling-disc", "--set", "contact.normal_stiffness=1.0"])
    told = capfd.readouterr().out
    assert end.value.code == 3 and "fail: overlap at rest" in told
    ways = [line for line in told.splitlines() if line.startswith("  --set contact.normal_stiffness=")]
    assert len(ways) == 2 and "the nearest legal one" in ways[0] and "without a warning" in ways[1]
    assert all("times the cost" in way for way in ways)


def test_only_grains_whose_sizes_or_places_are_drawn_have_another_seed():
    for case in ("poiseuille", "settling-disc", "sphere-array"):  # no grains, placed ones, a lattice of them
        assert knobs_of(read(case)).seed is None, case
    assert knobs_of(read("liquefaction")).seed(3) == ("simulation.random_seed=3",)
