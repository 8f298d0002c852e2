"""Cases: what is refused and where, what is filled in, and that a case as used is the same case."""

import pytest

import sph
from hpcpic.core.case.cases import read_header
from hpcpic.core.case.config import load, loads
from hpcpic.core.case.dump import dump
from hpcpic.core.errors import ConfigError
from sph.app import shipped_cases
from sph.configure import configure

BASE = """
simulation = { dimensions = 2; end_time = 1.0; };
gravity = [0.0, -9.81];
fluid = ( { shape = { box = { low = [0.0, 0.0]; high = [1.0, 0.5]; }; }; } );
numerics = { spacing = 0.05; };
"""

DISC = "{ sphere = { centre = [0.0, 0.0]; radius = 1.0; }; }"
BOX = "{ box = { low = [0.0, 0.0]; high = [1.0, 1.0]; }; }"
FRONT = '{ name = "a"; what = "front"; axis = "x+"; }'


def refused(text):
    with pytest.raises(ConfigError) as error:
        configure(loads(text))
    return error.value.message


@pytest.mark.parametrize("name", shipped_cases())
def test_a_shipped_case_is_headed_and_reads_back_as_used(name):
    path = shipped_cases()[name]
    header = read_header(path)
    assert all((header.what, header.source, header.expected, header.time))
    config = configure(load(str(path)))
    assert configure(loads(dump(config))) == config


def test_what_is_not_given_follows_from_what_is():
    config = configure(loads(BASE))
    assert config.fluid[0].name == "fluid_1"
    assert config.eos.max_velocity == pytest.approx((2 * 9.81 * 0.5) ** 0.5)
    assert config.sound_speed == pytest.approx(10 * config.eos.max_velocity)
    assert (config.domain.low, config.domain.high) == ((0.0, 0.0), (1.0, 0.5))
    numerics = config.numerics
    assert (numerics.density_flux, numerics.flux_coefficient) == ("delta", 0.1)
    assert (numerics.viscosity_form, numerics.artificial_viscosity) == ("artificial", 0.02)
    assert 0.5 < config.simulation.cfl < 1.1


@pytest.mark.parametrize(
    ("shape", "d"),
    [
        ({"box": {"low": [0.0, 0.0, 0.0], "high": [1.0, 1.0, 0.5]}}, 3),
        ({"polygon": {"corners": [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]}}, 2),
        ({"sphere": {"centre": [0.0, 0.0], "radius": 0.5}}, 2),
        ({"cylinder": {"base": [0.0, 0.0, 0.0], "top": [0.0, 0.0, 1.0], "radius": 0.5}}, 3),
    ],
)
def test_a_scene_has_the_dimensions_of_its_shapes(shape, d):
    fluid = [{"shape": shape}]
    case = sph.Case(simulation={"end_time": 1.0}, fluid=fluid, numerics={"spacing": 0.1}, eos={"sound_speed": 10.0})
    assert case.config.simulation.dimensions == d
    with pytest.raises(ConfigError, match=r"fluid\[0\].shape"):
        case.changed({"simulation.dimensions": 5 - d}).check()


@pytest.mark.parametrize(
    "key, text",
    [
        ("numerics.kernel", 'numerics = { spacing = 0.05; kernel = "cubik"; };'),
        ("numerics.spacing", "numerics = { spacing = -1.0; };"),
        ("simulation.dimensions", "simulation = { dimensions = 1; end_time = 1.0; };"),
        ("gravity", "gravity = [0.0, 0.0, -9.81];"),
        ("domain.high", "domain = { low = [0.0, 0.0]; high = [1.0, -1.0]; };"),
        ("domain.periodic[0]", 'domain = { low = [0.0, 0.0]; high = [1.0, 1.0]; periodic = ["z"]; };'),
        ("domain", 'domain = { periodic = ["x"]; };'),
        ("fluid[0].shape", "fluid = ( { shape = { }; } );"),
        ("fluid[0].shape", "fluid = ( { shape = { box = { low = [0.0, 0.0]; high = [1.0, 2.0e5]; }; }; } );"),
        ("fluid[0].shape.box.high", "fluid = ( { shape = { box = { low = [0.0, 0.0]; high = [0.0, 1.0]; }; }; } );"),
        ("domain", "domain = { low = [0.0, 0.0]; high = [1.0, 1.0e7]; };"),
        ("fluid[0].shape.box", "fluid = ( { shape = { box = { low = [0.0, 0.0]; high = [1.0, 0.01]; }; }; } );"),
        ("fluid[0].shape.plane", "fluid = ( { shape = { plane = { point = [0.0, 0.0]; normal = [0.0, 1.0]; }; }; } );"),
        ("fluid[0].shape.stl", 'fluid = ( { shape = { stl = { file = "a.stl"; }; }; } );'),
        ("wall[0].type", f'wall = ( {{ shape = {DISC}; type = "repulsive"; }} );'),
        ("wall[0].shape.box.open", f'wall = ( {{ shape = {BOX[:-5]} open = ["z+"]; }}; }}; }} );'),
        ("gauge[0]", 'gauge = ( { what = "pressure"; } );'),
        ("gauge[0]", 'gauge = ( { what = "flow"; at = [0.5, 0.5]; } );'),
        ("gauge[1].name", f"gauge = ( {FRONT}, {FRONT} );"),
        ("gauge[1].name", 'gauge = ( { name = "a"; what = "velocity"; at = [0.5, 0.5]; }, '
                          '{ name = "a_x"; what = "front"; } );'),
        ("gauge[0].name", 'gauge = ( { name = "mass"; what = "front"; } );'),
        ("gauge[0].size", 'gauge = ( { what = "flow"; axis = "x+"; at = [0.5, 0.5]; size = [0.0, -1.0]; } );'),
        ("wall[0].name", f'wall = ( {{ name = "a/b"; shape = {BOX}; }} );'),
        ("wall[0].name", f'wall = ( {{ name = "fluid_1"; shape = {BOX}; }} );'),
        ("wall[1].name", f'wall = ( {{ shape = {BOX}; }}, {{ name = "wall_1"; shape = {BOX}; }} );'),
        ("numerics.viscosity_form", 'numerics = { spacing = 0.05; viscosity_form = "cleary"; };'),
        ("eos", "gravity = [0.0, 0.0];"),
    ],
)  # fmt: skip
def test_a_fault_is_told_with_its_place_and_key(key, text):
    name = text.split(" ", 1)[0]
    kept = "\n".join(line for line in BASE.splitlines() if not line.startswith(name))
    message = refused(kept + "\n" + text)
    last = len(kept.splitlines()) + 1
    assert f": {key}: " in message
    if name in ("domain", "gravity", "fluid", "wall", "gauge", "numerics", "simulation") and key != "eos":
        assert f"{last}:" in message


def test_all_faults_are_told_at_once():
    message = refused(BASE.replace("0.05", "-1.0") + 'eos = { gama = 7.0; };\nwall = ( { type = "soft"; } );')
    assert all(key in message for key in ("numerics.spacing", "eos.gama", "did you mean 'gamma'", "wall[0].type"))


FLOW = BASE.replace("}; } );", '}; flow = { type = "linear"; gradient = [0.0, -2.0, 2.0, 0.0]; }; } );')


def test_a_linear_flow_has_no_velocity_in_the_middle_of_its_fluid_unless_the_case_says_where():
    assert configure(loads(FLOW)).fluid[0].flow.centre == (0.5, 0.25)
    assert configure(loads(FLOW.replace("0.0]; };", "0.0]; centre = [0.0, 0.0]; };"))).fluid[0].flow.centre == (0, 0)


def test_a_wave_on_the_interface_of_two_fluids_is_one_flow():
    water, oil = configure(load(shipped_cases()["interfacial-wave"])).fluid
    assert water.flow == oil.flow


def test_a_gradient_is_a_matrix():
    assert refused(FLOW.replace("[0.0, -2.0, 2.0, 0.0]", "[0, 1]")) == (
        "case:4:100: fluid[0].flow.gradient: needs 4 numbers in 2D, row by row (got 2)"
    )


@pytest.mark.parametrize("name", ["time", "step"])
def test_a_gauge_is_not_called_as_the_columns_that_tell_when(name):
    gauge = FRONT.replace('"a"', f'"{name}"')
    assert refused(f"{BASE} gauge = ( {gauge} );") == (
        "case:6:14: gauge[0].name: step and time are columns of every series: another name"
    )


def test_what_a_gauge_may_name_is_told_where_there_is_one_or_none():
    gauge = '{ what = "elevation"; at = [0.5, 0.0]; fluid = "oil"; wall = "floor"; }'
    told = refused(f"{BASE} gauge = ( {gauge} );")
    assert "gauge[0].fluid: must be 'fluid_1' (got 'oil')" in told
    assert "gauge[0].wall: there is none in this case (got 'floor')" in told


def test_a_name_that_two_gauges_have_is_told_once():
    told = refused(f"{BASE} gauge = ( {FRONT}, {FRONT} );")
    assert "'a' is taken by gauge[0]" in told and told.count("gauge[1].name") == 1


def test_a_tank_that_shall_turn_is_told_what_can_be_done():
    wall = f"wall = ( {{ shape = {BOX}; motion = {{ angular_velocity = [1.0]; }}; }} );"
    told = refused(BASE + wall)
    assert "wall[0].motion.angular_velocity: unknown key; walls do not turn" in told
    assert "fluid.acceleration" in told and 'held = ["x", "y", "rz"]' in told and "did you mean" not in told
    assert "did you mean 'velocity'" in refused(BASE + wall.replace("angular_", "angular_v_"))


def test_a_domain_of_the_lattice_is_answered_by_corners():
    told = refused(BASE + "domain = { size = [1.0, 1.0]; };")
    assert "domain.size: unknown key; the corners are low = [0.0, 0.0] and high = [Lx, Ly]" in told


def test_an_stl_file_is_looked_for_beside_the_case(tmp_path):
    case = tmp_path / "case.conf"
    case.write_text(
        BASE.replace("dimensions = 2", "dimensions = 3").replace("[0.0, -9.81]", "[0.0, 0.0, -9.81]")
        .replace("[1.0, 0.5]", "[1.0, 1.0, 0.5]").replace("low = [0.0, 0.0]", "low = [0.0, 0.0, 0.0]")
        + 'wall = ( { shape = { stl = { file = "ship.stl"; }; }; solid = true; } );'
    )  # fmt: skip
    with pytest.raises(ConfigError) as error:
        configure(load(str(case)))
    assert str(tmp_path / "ship.stl") in error.value.message


@pytest.mark.parametrize(
    "name, kept",
    [("elliptical-drop", ("mass", "energy_total", "momentum_x", "momentum_y")), ("poiseuille", ("mass",))],
)
def test_a_scene_keeps_what_nothing_takes_from_it(name, kept):
    assert configure(load(shipped_cases()[name])).conserved == kept


@pytest.mark.parametrize(
    ("key", "wall"),
    [
        ("shape", "solid = true; shape = { box = { low = [0.9, 0.0]; high = [1.1, 0.1]; }; };"),
        ("shape", "solid = true; shape = { sphere = { centre = [0.1, 0.5]; radius = 0.2; }; };"),
        ("shape", "shape = { sphere = { centre = [0.5, 0.5]; radius = 0.6; }; };"),
        ("shape", "shape = { cylinder = { base = [-0.1, 0.5]; top = [1.1, 0.6]; radius = 0.2; }; };"),
        ("shape.box", "shape = { box = { low = [0.0, 0.0]; high = [0.9, 1.0]; }; };"),
        ("shape.plane.normal", "shape = { plane = { point = [0.0, 0.0]; normal = [0.1, 1.0]; }; };"),
        ("shape", "solid = true; motion = { velocity = [0.5, 0.0]; }; "
                  "shape = { box = { low = [0.7, 0.0]; high = [0.8, 0.1]; }; };"),
        ("shape", 'solid = true; motion = { amplitude = [0.3, 0.0]; }; '
                  "shape = { box = { low = [0.2, 0.0]; high = [0.4, 0.1]; }; };"),
    ],
)  # fmt: skip
def test_walls_lie_within_a_period_or_go_through_it(key, wall):
    text = BASE + 'domain = { low = [0.0, 0.0]; high = [1.0, 1.0]; periodic = ["x"]; };\n'
    assert f": wall[0].{key}: " in refused(text + f"wall = ( {{ {wall} }} );")
    accepted = wall.replace("0.9, 0.0]", "0.5, 0.0]").replace("1.1, 0.1]", "0.7, 0.1]")
    if accepted != wall:
        configure(loads(text + f"wall = ( {{ {accepted} }} );"))


def test_output_is_asked_for_in_steps_or_in_seconds():
    from sph_scenes import config, engine

    from hpcpic.core.run.outputs import trigger_of
    from hpcpic.core.run.triggers import Every, EveryTime
    from sph.forecast.estimate import disk_items

    more = "output = { every = { particles = 5; series = 0; }; period = { checkpoint = 0.25; }; };"
    app = engine(spacing=0.1, more=more)
    asked = [trigger_of(app, kind, False) for kind in ("particle", "series", "checkpoint")]
    assert asked == [Every(5), None, EveryTime(0.25)]
    fixed = {"step": "time_step = 0.001;", "spacing": 0.1}
    steps, seconds = "every = { particles = 50; series = 10; };", "period = { particles = 0.05; series = 0.01; };"
    one, other = (disk_items(config(**fixed, more=f"output = {{ {words} }};")) for words in (steps, seconds))
    assert one == pytest.approx(other, rel=1e-12)
