"""What users write: what cannot run is told before a step, at its key; what can comes out as physics says."""

import numpy as np
import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from hpcpic.core.case.derived import enforce
from hpcpic.core.errors import ConfigError
from lbmdem.app import shipped_cases
from lbmdem.configure import configure
from lbmdem.forecast import estimate as estimates
from lbmdem.forecast.derived import derived

DX = 2.0e-4
BOX = f"""
simulation = {{ end_time = 0.1; }};
domain = {{ size = [{32 * DX!r}, {64 * DX!r}]; spacing = {DX}; periodic = ["x"]; }};
fluid = {{ viscosity = 1.0e-6; relaxation_time = 0.53; }};
"""
INLET = 'boundary = ({ face = "y-"; type = "velocity"; velocity = [0.0, 0.0125]; }'
OUTLET = ', { face = "y+"; type = "pressure"; pressure = 0.0; });'
STILL = f"grains = ({{ diameter = {10 * DX!r}; moving = false; position = [{16.3 * DX!r}, {20 * DX!r}]; }});"


def refused(text: str, ranks: int = 1, force: bool = False) -> str:
    tree = loads(text)
    with pytest.raises(ConfigError) as caught:
        enforce(derived(configure(tree), ranks), tree, force)
    return str(caught.value)


SAMPLE = shipped_cases()["quick-condition"].read_text()


def test_a_gauge_of_a_case_without_fluid_has_no_field_to_read():
    dry = BOX.split("fluid =")[0] + STILL.replace("moving = false; ", "")
    gauge = 'gauge = ({ what = "velocity"; at = [0.001, 0.001]; });'
    assert refused(dry + gauge).endswith(": gauge[0].what: there is none in this case (got 'velocity')")


def packing(count: int, words: str) -> str:
    law = f"diameters = {{ min = 1.0e-3; max = 2.0e-3; count = {count}; }}"
    return f'{BOX}grains = ({{ name = "bed"; {law}; packing = {{ {words} }}; moving = false; }});'


@pytest.mark.parametrize(
    "text, said",
    [
        (packing(300, "porosity = 0.5"), "grains[0].packing.porosity: top of bed z = 0.1473 m (limit <= 0.0128"),
        (packing(20, "porosity = 0.5; high = 0.012"), "limit 0.012, as packing.high says"),
        (packing(20, "porosity = 0.02"), "void fraction of bed n = 0.02 (limit >= 0.204"),
        (packing(300, ""), "grains[0].packing: void fraction of bed n = -4"),
        (packing(20, "porosity = 0.5").replace("false", "true") + "output = { stress_slices = 65; };", "slices = 64"),
        (f"{BOX.replace('0.1;', '1.0;')}{INLET});", "boundary[0].velocity: mean density at the end rho/rho0 = 1.977"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_made(text, said):
    assert said in refused(text)


@pytest.mark.parametrize(
    "text, said",
    [
        (
            OUTLET.replace(", {", "boundary = ({ velocity = [0.1, 0.1];"),
            "boundary[0].velocity: has a part along y, which",
        ),
        ("contact = { tangential_stiffness = 5.0; };", "contact.tangential_stiffness: is of the springs"),
        (f"{STILL} output = {{ stress_slices = 3; }};", "output.stress_slices: needs grains that move"),
    ],
)
def test_what_would_do_nothing_is_not_passed_over(text, said):
    assert said in refused(BOX + text)


def test_a_sample_denser_than_grains_grow_is_refused_before_it_is_made():
    """Mansouri's porosity between plates: with 0.36 the made packing overlaps by 1.3 %, with 0.37 by 0.4 %."""
    for porosity, least in ((0.349, "0.361"), (0.36, "0.361")):
        said = refused(SAMPLE.replace("low = 1.5e-4;", f"low = 1.5e-4; porosity = {porosity};"))
        assert f"void fraction of sample n = {porosity} (limit >= {least}" in said
        assert "porosity = 0.37 or more" in said
    numbers = derived(configure(loads(SAMPLE.replace("low = 1.5e-4;", "low = 1.5e-4; porosity = 0.37;"))))
    assert [n.verdict for n in numbers if n.name == "void fraction of sample"] == ["ok"]


@pytest.mark.parametrize("words, falls", [("", True), ("porosity = 0.5", False)])
def test_a_void_fraction_before_grains_settle_is_called_so(words, falls):
    """They end with 0.4, not with the half from which they fall."""
    found = next(n for n in derived(configure(loads(packing(20, words)))) if n.name == "void fraction of bed")
    assert ("begin to fall" in found.source) == falls


def test_an_inlet_without_an_outlet_is_warned_of():
    numbers = derived(configure(loads(f"{BOX}{INLET});")))
    assert [n.verdict for n in numbers if n.name == "mean density at the end"] == ["warn"]
    numbers = derived(configure(loads(BOX + INLET + OUTLET)))
    assert not any(n.name == "mean density at the end" for n in numbers)


def test_the_quadratic_rule_on_two_ranks_is_refused_beforehand():
    text = f'{BOX}{STILL} coupling = {{ bounce_back = "quadratic"; }};'
    derived(configure(loads(text)), 1)
    assert "coupling.bounce_back: ranks of the quadratic rule R = 2" in refused(text, 2, force=True)


def test_the_grain_that_lies_wrong_is_named():
    """Its own line of the case, be there ever so many."""

    def said(third):
        places = f"[0.002, 0.002],\n[0.002, 0.006],\n{third},\n[0.002, 0.010]"
        return refused(f"{BOX}grains = ({{ diameter = 2.0e-3; position = (\n{places}\n); }});")

    assert ":8:1: grains[0].position[2]: overlap" in said("[0.0025, 0.0075]")
    assert "grains[0].position[2]: grains outside the box" in said("[0.002, 0.05]")
    assert "grains[0].position[2]: least distance" in said("[0.002, 0.006]")


def test_a_relaxation_time_that_is_offered_is_legal():
    """A hopeless speed needs a tau of 1/2 and a little: all its digits are told."""
    said = refused(BOX + STILL.replace("({", "({ velocity = [200.0, 0.0];"))
    offered = float(said.split("relaxation_time = ")[1].split()[0])
    assert 0.5 < offered < 0.5001 and "compressibility error" not in said


def of_run(world, text, names):
    rows = []
    with running(world, "lbmdem", text) as run:
        for _ in range(run.n_steps):
            run.step()
            values = run.scalars()
            rows.append([values[name] for name in names])
    return np.array(rows).T


def test_a_fluid_between_an_inlet_and_an_outlet_flows_at_once(world):
    """As an incompressible one does: from rest its mass would swing by 4 % for ever."""
    text = BOX.replace("0.1;", "0.05;") + INLET + OUTLET
    mass, momentum = of_run(world, text, ("mass", "momentum_y"))
    assert np.ptp(mass) < 1e-9 * mass[0]
    np.testing.assert_allclose(momentum, 0.0125 * mass, rtol=1e-9)


def test_the_sound_of_a_grain_in_an_inlets_flow_is_small(world):
    mass, *_ = of_run(world, BOX.replace("0.1;", "0.5;") + INLET + OUTLET + STILL, ("mass",))
    assert np.ptp(mass) < 0.02 * mass[0]  # 9 % from rest


def test_the_torque_on_a_turning_disc(world):
    """In a square box: between those of the circles in and round it, 4 pi mu a2 w / (1 - a2/R2)."""
    side, a, omega = 48 * DX, 6 * DX, 0.5
    text = f"""
    simulation = {{ end_time = 0.6; }};
    domain = {{ size = [{side!r}, {side!r}]; spacing = {DX}; }};
    fluid = {{ viscosity = 1.0e-5; relaxation_time = 1.1; }};
    grains = ({{ diameter = {2 * a!r}; moving = false; angular_velocity = [{omega}];
                position = [{0.5 * side + 0.2 * DX!r}, {0.5 * side!r}]; }});
    """
    with running(world, "lbmdem", text) as run:
        while run.iteration < run.n_steps:
            run.step()
        found = run.particles()["grains_1"]
    alone = 4.0 * np.pi * 1.0e-2 * a * a * omega
    assert found.units["fluid_torque"] == "N m/m" and not found.columns["fluid_torque"][0, :2].any()
    least, most = (alone / (1.0 - (a / radius) ** 2) for radius in (side / 2**0.5, side / 2))
    assert 0.99 * least < -found.columns["fluid_torque"][0, 2] < 1.01 * most


def test_the_porosity_of_a_medium_that_repeats_is_that_of_the_whole_box(world):
    """Not of the slice from the lowest to the highest point of its sphere (0.80 of 0.875)."""
    with running(world, "lbmdem", shipped_cases()["sphere-array"].read_text()) as run:
        assert run.scalars()["porosity"] == pytest.approx(0.875, abs=2e-3)


@pytest.mark.parametrize(("tau", "most", "verdict"), [(0.52, 0.7, "warn"), (0.505, 0.05, "ok")])
def test_shaking_that_sound_cannot_follow_is_warned_of(world, tau, most, verdict):
    """A disc as heavy as the fluid stays where the closed box takes it; a fluid that gives way takes it along."""
    text = f"""
    simulation = {{ end_time = 0.1; }};
    domain = {{ size = [0.01, 0.01]; spacing = {DX}; }};
    fluid = {{ viscosity = 1.0e-6; relaxation_time = {tau}; collision = "central"; }};
    grains = ({{ diameter = 2.4e-3; density = 1000.0; position = [0.0051, 0.0049]; }});
    contact = {{ normal_stiffness = 100.0; }};
    shaking = {{ acceleration = [0.1, 0.0]; frequency = 10.0; }};
    """
    said = [n.verdict for n in derived(configure(loads(text))) if n.name == "shaking against sound"]
    fastest = 0.0
    with running(world, "lbmdem", text) as run:
        while run.iteration < run.n_steps:
            run.step()
            fastest = max(fastest, abs(float(run.dem.grains.v[0, 0])))
    share = fastest / (0.1 / (20.0 * np.pi))  # of the speed of the frame
    assert said == [verdict] and 0.2 * most < share < most


def test_grains_alone_are_not_charged_for_calls_that_they_share():
    """Many of their steps are one call: what a call costs was told for each, six times the time of a hundred grains."""
    config = configure(loads(shipped_cases()["settling-pile"].read_text()))
    of_grains = 1e-9 * 200 * estimates.DEFAULT["grain_ns"]
    told = estimates.estimate(config, 1, 1, estimates.DEFAULT)
    assert of_grains < told.step_seconds < 1.1 * of_grains
