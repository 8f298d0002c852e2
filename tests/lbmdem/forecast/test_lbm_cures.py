"""Cures of `check` pass when they are taken, and what it says names the grain."""

import numpy as np
import pytest
from app_runner import running
from lattice_scenes import SPHERE

from hpcpic.core.app.read import read_case
from hpcpic.core.case.config import loads
from hpcpic.core.cli.cures import cures
from hpcpic.core.errors import ConfigError
from lbmdem.app import APP
from lbmdem.case.config import whole_spacing
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived
from lbmdem.forecast.knobs import knobs_of


def told(*sets):
    return {one.name: one for one in derived(configure(loads(SPHERE, sets=sets)))}


@pytest.mark.parametrize(
    "name, key, sets",
    [
        ("nodes across a grain", "domain.spacing", ("domain.spacing=0.005",)),
        ("nodes across a grain", "domain.spacing", ("domain.spacing=0.0047", "domain.size=[0.0987, 0.0987, 0.1598]")),
        ("overlap at rest", "contact.normal_stiffness", ("contact.normal_stiffness=0.01",)),
        ("overlap at rest", "contact.normal_stiffness", ("contact.normal_stiffness=0.1", "grains[0].density=1100")),
    ],
)
def test_a_cure_passes(name, key, sets):
    found = told(*sets)[name]
    assert found.verdict != "ok"
    setting, value = found.cure.split(" = ")[0], found.cure.split(" = ")[1].split()[0]
    assert key.endswith(setting)
    assert told(*sets, f"{key}={value}")[name].verdict == "ok"


def test_a_spacing_that_all_sides_hold_is_offered():
    with pytest.raises(ConfigError, match=r"domain\.spacing = 0\.00285714286 along all axes"):
        told("domain.spacing=0.0033")
    told("domain.spacing=0.00285714286")
    assert whole_spacing((0.1, 0.1), 0.03) == 0.025
    assert whole_spacing((1.0, 0.7310001), 0.1) == 0.0


def test_a_light_grain_is_told_to_gain_speed_slowly():
    found = told("grains[0].density=9.6")["density ratio"]
    assert found.verdict == "warn" and "times as heavy" in found.cure
    assert told()["density ratio"].verdict == "ok"


@pytest.mark.parametrize("place, name", [("[0.05, 0.05, 0.157]", "overlap at the start"),
                                         ("[0.05, 0.05, 0.3]", "grains outside the box")])  # fmt: skip
def test_the_grain_that_cannot_start_is_named(place, name):
    found = told(f"grains=({{diameter=0.015; density=1120.0; position=([0.05, 0.05, 0.05], {place});}})")[name]
    assert found.verdict == "fail" and found.cure.startswith("grains[0].position[1]: ")


@pytest.mark.parametrize(
    "refill, sets",
    [
        ("mass-conserving", ()),
        ("mass-conserving", ('domain.periodic=["x", "y", "z"]',)),
        ("local", ('boundary=({face="z-"; type="pressure"; density=960.0;})',)),
        ("local", ("grains[0].moving=false",)),
        ("local", ("coupling.frozen=true",)),
        ("average", ('coupling.refill="average"',)),
    ],
)
def test_what_moving_grains_take_of_a_closed_box_is_given_back_unless_a_case_says_otherwise(refill, sets):
    assert configure(loads(SPHERE, sets=sets)).coupling.refill == refill


@pytest.mark.parametrize("gap, soft", [(0.94e-3, True), (0.85e-3, False)])
def test_arrays_of_a_heap_at_rest_are_told_that_its_contacts_are_soft(tmp_path, gap, soft):
    """What an earlier run ended with overlaps by its weight; far deeper, or placed by hand, grains fly apart."""
    np.savez(tmp_path / "heap.npz", position=[[0.005, 0.005], [0.005 + gap, 0.005]])
    case = f"""
    simulation = {{ end_time = 0.1; }};
    domain = {{ size = [0.01, 0.01]; }};
    contact = {{ normal_stiffness = 2.0e5; }};
    grains = ({{ diameter = 1.0e-3; start = {{ file = "{tmp_path / "heap.npz"}"; }}; }});
    """
    by_hand = case.split("start")[0] + f"position = ([0.005, 0.005], [{0.005 + gap}, 0.005]); }});"
    for text, given in ((case, True), (by_hand, False)):
        found = next(one for one in derived(configure(loads(text))) if one.name == "overlap at the start")
        assert ("normal_stiffness = 1.2e+06 where it was made" in found.cure) == (given and soft)
        assert ("move it" in found.cure) != (given and soft)


@pytest.mark.parametrize("sets", [(), ("fluid.kinematic_viscosity=1.0e-5",), ("fluid.relaxation_time=0.503",)])
def test_a_way_out_says_whether_the_case_runs_then(tmp_path, sets):
    """Fast water past a disc, in too long steps and on a coarse lattice: most ways cure one of the two."""
    path = tmp_path / "case.conf"
    path.write_text(
        """
simulation = { end_time = 1.0; };
domain = { size = [0.1, 0.02]; spacing = 1.0e-3; periodic = ["y"]; };
fluid = { kinematic_viscosity = 1.0e-6; relaxation_time = 1.0; };
boundary = ({ face = "x-"; type = "velocity"; velocity = [0.15, 0.0]; },
            { face = "x+"; type = "pressure"; pressure = 0.0; });
grains = ({ diameter = 8.0e-3; moving = false; position = [0.03, 0.01]; });
"""
    )
    app = APP
    read = read_case(app, str(path), sets)
    refused = [number for number in app.derived(read.config, 1) if number.verdict == "fail"]
    assert refused
    for number in refused:
        ways = [line.split(": ", 1) for line in cures(app, read, sets, number, 1)]
        still = []
        for setting, words in ways:
            taken = setting.removeprefix("--set ").split(" --set ") if setting != "--force" else []
            after = app.derived(read_case(app, str(path), (*sets, *taken)).config, 1)
            fails = [one for one in after if one.verdict == "fail" and not (setting == "--force" and one.forceable)]
            assert bool(fails) == ("still refuse" in words)
            assert (
                fails
                or "without a warning" not in words
                or ("others warn" in words) == any(one.verdict == "warn" for one in after)
            )
            still += [bool(fails)] if setting != "--force" else []
        assert still == sorted(still)  # what ends all refusals comes first


SLIT = """
simulation = { end_time = 1.0; };
domain = { size = [1.0e-3, 1.0e-3]; spacing = 5.0e-5; };
fluid = { kinematic_viscosity = 1.0e-6; relaxation_time = 1.0; };
boundary = ({ face = "y-"; type = "pressure"; pressure = 0.01; }, { face = "y+"; type = "pressure"; pressure = 0.0; });
"""


def test_the_length_between_pressure_faces_is_told(world):
    """The flow of a slit is that of the gradient between its last nodes: of first order in the spacing, as the knob of
    `tradeoff` has it.
    """

    def gradient(*sets):
        return next(n for n in derived(configure(loads(SLIT, sets=sets))) if n.name.startswith("gradient along y"))

    told = gradient()
    assert told.verdict == "warn"
    assert gradient(f"domain.spacing={told.cure.split('domain.spacing = ')[1].split()[0]}").verdict == "ok"
    with running(world, "lbmdem", SLIT) as app:
        while app.time < 1.0:
            app.step()
        flow = app.scalars()["flow_rate_y"]
    assert flow / (0.01 / 1.0e-3 * 1e-9 / (12.0 * 1.0e-3)) == pytest.approx(1.0 + told.value, abs=0.01)
    order = {knob.name: knob.order for knob in knobs_of(configure(loads(SLIT))).knobs}
    inflow = SLIT.replace('"pressure"; pressure = 0.01', '"velocity"; velocity = [0.0, 1e-4]')
    assert order["dx"] == 1.0 and knobs_of(configure(loads(inflow))).knobs[0].order == 2.0


CYLINDER = """
simulation = { end_time = 9.0; };
domain = { size = [2.2, 0.41]; spacing = 0.01; };
fluid = { density = 1.0; kinematic_viscosity = 1.0e-3; time_step = 4.0e-4; };
boundary = ({ face = "x-"; type = "velocity"; velocity = [1.0, 0.0]; profile = "parabolic"; },
            { face = "x+"; type = "pressure"; pressure = 0.0; });
"""
DISC = "grains = ({ diameter = 0.1; moving = false; position = [0.2, 0.2]; });"
WALL = "obstacle = ({ shape = { box = { low = [0.15, 0.15]; high = [0.25, 0.25]; }; }; });"


@pytest.mark.parametrize("solid", [DISC, WALL])
@pytest.mark.parametrize(
    "sets, value, verdict",
    [
        ((), 15.0, "warn"),  # it diverges at 0.8 s
        (("fluid.kinematic_viscosity=1.5e-3",), 10.0, "warn"),  # at 1.7 s
        (("domain.spacing=0.005",), 7.5, "ok"),
        (('fluid.collision="central"',), 15.0, "ok"),
        (('fluid.collision="BGK"', "domain.spacing=0.005"), 7.5, "warn"),  # at 0.1 s, with nodes of 0.01 m
        (("fluid.kinematic_viscosity=3.0e-4",), 50.0, "fail"),
    ],
)
def test_a_coarse_flow_past_solids_is_warned_of(solid, sets, value, verdict):
    """No shear layer without walls says how coarse it may be: that holds up to 43."""

    def number(*sets, text=CYLINDER + solid):
        return next(one for one in derived(configure(loads(text, sets=sets))) if one.name == "grid Reynolds number")

    found = number(*sets)
    assert (found.value, found.verdict) == (pytest.approx(value), verdict)
    assert verdict == "fail" or number(*sets, text=CYLINDER).verdict == "ok"
    if found.cure:
        spacing = found.cure.split("domain.spacing = ")[1].split()[0]
        for cure in ('fluid.collision="central"', f"domain.spacing={spacing}"):
            assert number(*sets, cure).verdict == "ok"
