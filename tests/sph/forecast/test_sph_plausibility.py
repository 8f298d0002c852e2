"""What is most likely not meant is told with a number, a limit and a cure, or refused."""

import math

import pytest

from hpcpic.core.app.read import read_case
from hpcpic.core.case.config import loads
from hpcpic.core.cli.cures import cures
from hpcpic.core.errors import ConfigError
from sph.__main__ import load_app
from sph.configure import configure
from sph.forecast.derived import derived

PARTS = {
    "simulation": "{ dimensions = 2; end_time = 1.0; }",
    "gravity": "[0.0, -9.81]",
    "domain": "{ low = [0.0, 0.0]; high = [1.0, 1.0]; }",
    "fluid": '( { name = "water"; shape = { box = { low = [0.0, 0.0]; high = [1.0, 0.3]; }; }; } )',
    "eos": "{ }",
    "numerics": "{ spacing = 0.05; }",
    "wall": '( { name = "tank"; shape = { box = { low = [0.0, 0.0]; high = [1.0, 1.0]; open = ["y+"]; }; }; } )',
    "gauge": "( )",
}
LEVEL = '( {{ name = "level"; what = "elevation"; at = {}; }} )'
SLOW = "{ sound_speed = 1.0; }"


def told(**parts):
    """Derived numbers by name."""
    text = "\n".join(f"{name} = {value};" for name, value in (PARTS | parts).items())
    return {number.name: number for number in derived(configure(loads(text)))}


def gate(motion, kind="repulsive"):
    solid = f"""{{ name = "gate"; solid = true; type = "{kind}"; motion = {{ {motion} }};
        shape = {{ box = {{ low = [0.5, 0.3]; high = [0.6, 0.9]; }}; }}; }} )"""
    return PARTS["wall"][:-1] + "," + solid


def sensor(place):
    return f'( {{ name = "sensor"; what = "wall-pressure"; axis = "x+"; {place} }} )'


def swing(n):
    """A path of n points from rest to rest: half a metre up and down in a second."""
    places = [(k / n, 0.25 * (1 - math.cos(2 * math.pi * k / n))) for k in range(n + 1)]
    return f"path = ( {', '.join(f'{{ time = {t}; displacement = [0.0, {y}]; }}' for t, y in places)} );"


def surface(z):
    return PARTS["fluid"].replace("shape", f"surface = {z}; shape", 1)


@pytest.mark.parametrize(
    "name, verdict, parts",
    [
        ("density of water at rest at its bottom", "ok", {}),
        ("density of water at rest at its bottom", "fail",
         {"eos": "{ sound_speed = 0.01; max_velocity = 0.001; }"}),
        ("density of water at rest at its bottom", "ok", {"fluid": surface(0.6)}),
        ("density of water at rest at its bottom", "fail", {"fluid": surface(300.0)}),
        ("gravity", "warn", {"gravity": "[0.0, -981.0]"}),
        ("gravity along y", "fail", {"gravity": "[0.0, 9.81]"}),
        ("gravity along the periodic x", "fail",
         {"gravity": "[1.0, -9.81]", "domain": '{ low = [0.0, 0.0]; high = [1.0, 1.0]; periodic = ["x"]; }'}),
        ("steps to the end", "ok", {}),
        ("steps to the end", "fail", {"simulation": "{ dimensions = 2; end_time = 1e30; }"}),
        ("walls under water", "warn",
         {"fluid": PARTS["fluid"].replace("[0.0, 0.0]; high = [1", "[2.0, 0.0]; high = [3"), "domain": "{ }"}),
        ("walls under water", "warn", {"wall": '( { name = "lid"; solid = true; shape = { box = { low = [0.0, 0.4];'
                                               ' high = [1.0, 0.6]; }; }; } )'}),
        ("level beyond the domain", "warn", {"gauge": LEVEL.format("[1.5, 0.0]")}),
        ("way of gate in a step", "ok", {"wall": gate("velocity = [0.0, 3.0];")}),
        ("way of gate in a step", "fail",
         {"wall": gate("path = ( { time = 0.5; displacement = [0.0, 0.0]; }, "
                       "{ time = 0.500001; displacement = [0.0, 0.6]; } );")}),
        ("impact by jumps of the speed of gate", "ok", {"wall": gate(swing(400))}),
        ("impact by jumps of the speed of gate", "warn", {"wall": gate(swing(8))}),
        ("particles across water along y", "ok", {}),
        ("particles across water along y", "warn", {"numerics": "{ spacing = 0.15; }"}),
        ("speed of gate", "ok", {"wall": gate("velocity = [0.0, 3.0];", "pressure-continuity")}),
        ("speed of gate", "fail", {"wall": gate("velocity = [0.0, 50.0];", "pressure-continuity")}),
        ("speed of gate", "fail", {"wall": gate("velocity = [0.0, 50.0];", "extrapolated-free-slip")}),
        ("wall behind sensor", "fail", {"gauge": sensor("at = [0.5, 0.3]; size = [0.0, 0.2];")}),
        ("width of sensor", "ok", {"gauge": sensor("at = [1.0, 0.3]; size = [0.0, 0.2];")}),
        ("width of sensor", "warn", {"gauge": sensor("at = [1.0, 0.3]; radius = 0.001;")}),
        ("sensor behind another wall", "warn", {"gauge": sensor("at = [1.0, 0.05]; radius = 0.06;")}),
    ],
)  # fmt: skip
def test_a_limit_holds_on_both_sides(name, verdict, parts):
    number = told(**parts)[name]
    assert number.verdict == verdict
    assert bool(number.cure) == (verdict != "ok")


def test_fluid_that_something_holds_and_levels_in_the_domain_are_fine():
    drop = PARTS["fluid"].replace("low = [0.0, 0.0]; high = [1.0, 0.3]", "low = [0.4, 0.5]; high = [0.6, 0.8]")
    bed = '( { name = "bed"; shape = { plane = { point = [0.0, -0.2]; normal = [0.1, 1.0]; }; }; } )'
    leaves = '{ low = [0.0, 0.0]; high = [1.0, 1.0]; outflow = ["y-"]; }'
    for parts in ({}, {"fluid": drop}, {"wall": bed, "domain": "{ low = [0.0, -0.5]; high = [1.0, 1.0]; }"},
                  {"wall": "( )", "domain": leaves}, {"gauge": LEVEL.format("[0.5, -7.0]")}):  # fmt: skip
        assert not {"walls under water", "level beyond the domain"} & told(**parts).keys()


def test_a_sensor_in_a_wall_that_moves_names_it():
    piston = '{ name = "piston"; solid = true; shape = { box = { low = [0.7, 0.0]; high = [1.0, 1.0]; }; };'
    wall = PARTS["wall"][:-1] + f", {piston} motion = {{ amplitude = [0.1, 0.0]; }}; }} )"
    place = "at = [0.7, 0.1]; size = [0.0, 0.1];"
    number = told(wall=wall, gauge=sensor(place))["sensor stays, piston moves"]
    assert number.verdict == "warn" and 'wall = "piston"' in number.cure
    assert "sensor stays, piston moves" not in told(wall=wall, gauge=sensor(place + ' wall = "piston";'))
    assert "sensor stays, piston moves" not in told(wall=wall, gauge=sensor(place.replace("0.7", "1.0")))


def test_a_sensor_down_to_the_floor_is_not_behind_it():
    assert "sensor behind another wall" not in told(gauge=sensor("at = [1.0, 0.05]; radius = 0.05;"))


@pytest.mark.parametrize(
    ("low", "left_out", "middle", "apart"),
    [(0.0, "", 0.5, 0.0), (0.0, "", 0.45, 1.0), (0.0, "", 0.39, None), (0.0, "", 0.1, None),
     (0.2, "", 0.3, 0.0), (0.2, 'open = ["y-"];', 0.3, None)],
)  # fmt: skip
def test_a_sensor_beside_an_edge_of_a_block_is_told(low, left_out, middle, apart):
    """Where the block stands on the floor there is none; in the air there is one below too, unless it is left out."""
    box = f"shape = {{ box = {{ low = [0.7, {low}]; high = [0.9, 0.6]; {left_out} }}; }};"
    wall = PARTS["wall"][:-1] + f', {{ name = "block"; solid = true; {box} }} )'
    found = told(wall=wall, gauge=sensor(f"at = [0.7, {middle}]; size = [0.0, 0.2];")).get("edge beside sensor")
    assert (found is None) == (apart is None)
    assert found is None or (found.verdict == "warn" and found.value == pytest.approx(apart, abs=1e-9))
    above = "shape = { box = { low = [0.7, 0.6]; high = [0.8, 0.8]; }; };"
    wall = wall[:-1] + f', {{ name = "above"; solid = true; {above} }} )'
    gauge = sensor("at = [0.7, 0.5]; size = [0.0, 0.2];")
    assert "edge beside sensor" not in told(wall=wall, gauge=gauge)  # the face goes on


@pytest.mark.parametrize("sign", ["-", "+"])
@pytest.mark.parametrize("low, high", [(0.15, 0.2), (0.6, 0.7)])
def test_a_sensor_finds_the_wall_that_it_is_pushed_to(sign, low, high):
    """On both sides of slabs one and two spacings thick: their particles begin half a spacing behind the face."""
    box = f"shape = {{ box = {{ low = [0.3, {low}]; high = [0.7, {high}]; }}; }};"
    wall = PARTS["wall"][:-1] + f', {{ name = "slab"; solid = true; {box} }} )'
    place = f"at = [0.5, {high if sign == '-' else low}]; size = [0.2, 0.0];"
    assert "wall behind sensor" not in told(wall=wall, gauge=sensor(place).replace("x+", f"y{sign}"))


def test_pressures_of_first_contact_last_sixteen_spacings_of_way():
    found = told(gauge=sensor("at = [1.0, 0.3]; size = [0.0, 0.2];"), eos="{ max_velocity = 4.0; }")
    assert found["first contact on sensor"].value == pytest.approx(16 * 0.05 / 4.0)


@pytest.mark.parametrize("speed", [3.0, 50.0])
def test_a_gate_does_not_raise_the_sound_speed_but_a_piston_does(speed):
    plain = told()["sound speed"].value
    assert plain == pytest.approx(10 * math.sqrt(2 * 9.81 * 0.3))
    assert told(wall=gate(f"velocity = [0.0, {speed}];"))["sound speed"].value == plain
    swinging = told(wall=gate(f"amplitude = [{speed / (2 * math.pi)}, 0.0];"))["sound speed"].value
    assert swinging == pytest.approx(10 * speed)


def test_a_body_in_other_units_is_far_from_all_fluid():
    body = '{{ name = "body"; solid = true; shape = {{ box = {{ low = [{0}, {0}]; high = [{1}, {1}]; }}; }}; }} )'
    walls = [PARTS["wall"][:-1] + "," + body.format(*ends) for ends in ((0.4, 0.6), (400.0, 600.0))]
    name = "distance of body from all fluid and tanks"
    assert name not in told(wall=walls[0])
    number = told(wall=walls[1], domain="{ }")[name]
    assert number.verdict == "warn" and number.value == pytest.approx(399 * math.sqrt(2))


@pytest.mark.parametrize(
    ("parts", "told_of"),
    [
        ({}, True),
        ({"inlet": '( { low = [0.0, 0.0]; high = [0.2, 0.3]; axis = "x+"; velocity = 2.0; } )'}, False),
        ({"inlet": '( { low = [0.8, 0.0]; high = [1.0, 0.3]; axis = "x-"; velocity = 2.0; } )'}, True),
        ({"fluid": PARTS["fluid"].replace("shape", "velocity = [4.0, 0.0]; shape", 1)}, False),
    ],
)
def test_a_plate_that_a_jet_reaches_is_not_told_to_be_beside_all_fluid(parts, told_of):
    plate = '( { name = "plate"; solid = true; shape = { box = { low = [2.0, 0.0]; high = [2.2, 0.3]; }; }; } )'
    assert ("distance of plate from all fluid and tanks" in told(wall=plate, domain="{ }", **parts)) == told_of


def test_gravity_along_a_period_says_how_a_slope_is_told():
    slope = {"domain": '{ low = [0.0, 0.0]; high = [1.0, 1.0]; periodic = ["x"]; }', "body_force": "[0.5, 0.25]"}
    cure = told(gravity="[1.5, -9.5]", **slope)["gravity along the periodic x"].cure
    assert "gravity = [0, -9.5] and body_force = [2, 0.25]" in cure and "floor" not in cure


def test_the_defaults_of_a_new_case_are_told():
    found = told()
    assert found["density flux, delta"].value == 0.1 and found["artificial viscosity"].value == 0.02
    assert told(numerics='{ spacing = 0.05; viscosity_form = "none"; }')["artificial viscosity"].value == 0.0
    assert found["stray particles in a step"].value == 10


@pytest.mark.parametrize(
    "key, text",
    [("gauge[0].size", '( { what = "pressure"; at = [1.0, 0.1]; size = [0.01, 0.01]; } )'),
     ("gauge[0].axis", '( { what = "velocity"; at = [1.0, 0.1]; axis = "x+"; } )')],
)  # fmt: skip
def test_a_key_of_another_gauge_is_refused(key, text):
    with pytest.raises(ConfigError) as error:
        told(gauge=text)
    assert key in str(error.value)


def air(top=1.0):
    box = f"shape = {{ box = {{ low = [0.0, 0.0]; high = [1.0, {top}]; }}; }};"
    return PARTS["fluid"][:-1] + f', {{ name = "air"; gas = true; density = 1.2; {box} }} )'


@pytest.mark.parametrize(
    "sides, parts",
    [
        ("y+", {}),
        ("", {"wall": PARTS["wall"].replace('open = ["y+"];', "")}),
        ("y+", {"wall": PARTS["wall"].replace('open = ["y+"];', ""), "fluid": air(0.8)}),
        ("", {"wall": PARTS["wall"][:-1] + """, { name = "lid"; shape = { plane = { point = [0.0, 1.0];
            normal = [0.0, -1.0]; }; }; } )"""}),
        ("", {"wall": PARTS["wall"][:-1] + """, { name = "lid"; solid = true; shape = { box = { low = [0.0, 0.8];
            high = [1.0, 1.0]; }; }; } )""", "fluid": air(0.8)}),
        ("x- x+", {"wall": PARTS["wall"].replace("y+", 'x-", "x+')}),
        ("", {"wall": PARTS["wall"].replace("y+", 'x-", "x+'),
              "domain": '{ low = [0.0, 0.0]; high = [1.0, 1.0]; periodic = ["x"]; }'}),
    ],
)  # fmt: skip
def test_sides_through_which_a_gas_flies_away_are_told(sides, parts):
    number = told(**({"fluid": air()} | parts))["open sides of air"]
    assert number.symbol == sides and number.verdict == ("warn" if sides else "ok")


def test_the_background_beside_gases_is_nothing_where_a_liquid_has_an_open_surface():
    """There the pressure is its negative, and all that is read below is too low by as much."""
    beside = """( { name = "water"; shape = { box = { low = [0.0, 0.0]; high = [0.4, 0.5]; }; }; },
        { name = "air"; gas = true; density = 1.2; shape = { box = { low = [0.4, 0.0]; high = [1.0, 0.5]; }; }; } )"""
    assert "open sides of water" not in told(fluid=beside) and "open sides of water" not in told(fluid=air())
    given = told(fluid=beside, eos="{ background_pressure = 100.0; }")["open sides of water"]
    assert (given.symbol, given.verdict, given.cure) == ("y+", "warn", "background_pressure = 0")
    assert "100 Pa too low" in given.source


def test_a_wall_that_swings_as_fast_as_sound_goes_through_the_fluid_is_told():
    """Without gravity the sound speed follows from the speed of the wall alone."""
    wall = (
        PARTS["wall"][:-1]
        + """, { name = "rod"; solid = true; motion = { amplitude = [0.004, 0.0]; period = 0.5; };
        shape = { sphere = { centre = [0.5, 0.25]; radius = 0.1; }; }; } )"""
    )
    number = told(wall=wall, gravity="[0.0, 0.0]")["swing of rod beside sound"]
    assert number.verdict == "warn" and number.value > 10
    quick = told(wall=wall, gravity="[0.0, 0.0]", eos="{ " + number.cure + "; }")["swing of rod beside sound"]
    assert quick.verdict == "ok" and quick.value == pytest.approx(0.5, rel=0.02)
    assert "swing of rod beside sound" not in told(wall=wall)


@pytest.mark.parametrize(
    ("shape", "way", "pushes"),
    [
        ("plane = { point = [0.0, 0.0]; normal = [0.0, 1.0]; };", "[0.004, 0.0]", False),
        ("plane = { point = [0.0, 0.0]; normal = [0.0, 1.0]; };", "[0.004, 0.001]", True),
        ("box = { low = [0.0, -0.2]; high = [1.0, 0.0]; };", "[0.004, 0.0]", False),
        ("box = { low = [0.0, -0.2]; high = [1.0, 0.0]; };", "[0.0, 0.004]", True),
    ],
)
def test_a_floor_that_swings_within_itself_pushes_no_fluid(shape, way, pushes):
    motion = f"motion = {{ amplitude = {way}; period = 0.5; }};"
    wall = f'( {{ name = "floor"; solid = true; {motion} shape = {{ {shape} }}; }} )'
    domain = '{ low = [0.0, -0.2]; high = [1.0, 0.5]; periodic = ["x"]; }'
    assert ("swing of floor beside sound" in told(wall=wall, domain=domain, gravity="[0.0, 0.0]")) == pushes


@pytest.mark.parametrize("ratio, verdict", [(0.9, "warn"), (1.0, "warn"), (1.29, "warn"), (1.3, "ok"), (1.5, "ok")])
def test_too_few_neighbours_for_waves_are_told_and_lead_to_the_default(ratio, verdict):
    """Cases of papers keep 1.3, which is told without a verdict."""
    name = "error of the period of waves"
    number = told(numerics=f"{{ spacing = 0.05; smoothing = {ratio}; }}")[name]
    assert number.verdict == verdict and number.cure.startswith("smoothing = 1.5") == (verdict == "warn")
    assert name not in told(numerics=f'{{ spacing = 0.05; smoothing = {ratio}; kernel = "cubic"; }}')


def test_cures_of_a_smoothing_length_lead_to_the_default_where_nothing_warns_of_it(tmp_path):
    case = tmp_path / "few.conf"
    parts = PARTS | {"numerics": "{ spacing = 0.05; smoothing = 0.5; }"}
    case.write_text("\n".join(f"{name} = {value};" for name, value in parts.items()))
    read = read_case(load_app(), str(case))
    refused = next(number for number in derived(read.config) if number.verdict == "fail")
    assert refused.cure.startswith("smoothing = 1.5")
    good = [line for line in cures(load_app(), read, (), refused, 1) if "without a warning" in line]
    assert len(good) == 1 and good[0].startswith("--set numerics.smoothing=1.5: the default")


def test_a_gas_tells_what_it_costs_and_whether_its_pressure_holds():
    found = told(fluid=air())
    assert found["step over that without gases"].value == pytest.approx(math.sqrt(1.2 / 1000))
    assert [found[name].verdict for name in ("ambient pressure", "density ratio of liquids")] == ["ok", "ok"]
    assert told(fluid=air(), eos="{ ambient_pressure = 1e3; }")["ambient pressure"].verdict == "warn"


@pytest.mark.parametrize("side", ["x", "z-", "x+"])
def test_a_side_of_outflow_is_one_of_the_domain_that_is_not_periodic(side):
    domain = f'{{ low = [0.0, 0.0]; high = [1.0, 1.0]; periodic = ["x"]; outflow = ["{side}"]; }}'
    with pytest.raises(ConfigError, match=r"domain.outflow\[0\]: must be one of y-, y\+"):
        told(domain=domain)


KEYS = {
    "simulation.end_time": 1, "simulation.cfl": 1, "simulation.time_step": 1, "eos.sound_speed": 1, "eos.gamma": 1,
    "eos.sound_speed_factor": 1, "eos.max_velocity": 1, "eos.background_pressure": 1, "numerics.spacing": 1,
    "numerics.smoothing": 1, "numerics.flux_coefficient": 1, "numerics.artificial_viscosity": 1, "fluid[0].density": 1,
    "fluid[0].viscosity": 1, "fluid[0].surface": 1, "fluid[0].velocity": 2, "gravity": 2, "body_force": 2,
    "domain.high": 2,    "fluid[0].shape.box.high": 2, "wall[0].shape.box.high": 2, "output.period.series": 1,
}  # fmt: skip


@pytest.mark.parametrize("value", ["1e-320", "1e-60", "1e-35", "1e35", "1e60", "1.7e308", "-1.7e308"])
@pytest.mark.parametrize("key", KEYS)
def test_numbers_at_the_edge_of_floating_point_are_judged(key, value):
    """With words, whatever they say: neither a traceback nor a number that is none."""
    text = "\n".join(f"{name} = {part};" for name, part in PARTS.items())
    given = value if KEYS[key] == 1 else f"[{value}, {value}]"
    try:
        config = configure(loads(text, sets=(f"{key}={given}",)))
        numbers = derived(config)
    except ConfigError:
        return
    assert not any(math.isnan(number.value) for number in numbers)


def test_settings_that_are_told_to_cure_a_number_leave_no_other_one_beyond_its_limit(tmp_path):
    """A sound speed that suits the density at rest may be too low for the waves."""
    case = tmp_path / "slow.conf"
    case.write_text("\n".join(f"{name} = {value};" for name, value in (PARTS | {"eos": SLOW}).items()))
    read = read_case(load_app(), str(case))
    refused = [number for number in derived(read.config) if number.verdict == "fail"]
    assert len(refused) == 2
    for number in refused:
        ways = dict(line.removeprefix("--set ").split(": ", 1) for line in cures(load_app(), read, (), number, 1))
        legal, good = (setting for setting, words in ways.items() if "legal" in words or "without" in words)
        after = [derived(read_case(load_app(), str(case), (way,)).config) for way in (legal, good)]
        verdicts = [{number.verdict for number in numbers} for numbers in after]
        assert "fail" not in verdicts[0] and verdicts[1] == {"ok"}


def test_the_impact_of_a_path_is_that_of_its_sharpest_corner_and_falls_with_its_points():
    name = "impact by jumps of the speed of gate"
    path = "path = ( { time = 0.4; displacement = [0.3, 0.4]; }, { time = 0.6; displacement = [0.3, 0.6]; } );"
    number, c0 = told(wall=gate(path))[name], told()["sound speed"].value
    assert number.value == pytest.approx(1000.0 * c0 * 0.5 / 0.4)  # from rest, along a slope: 1.25 m/s
    coarse, fine = (told(wall=gate(swing(n)))[name].value for n in (50, 100))
    assert coarse / fine == pytest.approx(2.0, rel=0.01)


BESIDE = "low = [1.0, 0.0]; high = [1.1, 0.9];"  # of water that ends at x = 1
HOLLOW = 'low = [0.2, 0.0]; high = [0.6, 0.9]; open = ["y-", "y+"];'


@pytest.mark.parametrize("shape, motion, speed", [
    (f"box = {{ {BESIDE} }};", "velocity = [0.3, 0.0];", 0.3),
    (f"box = {{ {BESIDE} }};", "velocity = [0.3, 0.4];", 0.5),
    (f"box = {{ {BESIDE} }};", "amplitude = [0.1, 0.0]; period = 0.5;", 0.4 * math.pi),
    (f"box = {{ {BESIDE} }};", "velocity = [-0.3, 0.0]; amplitude = [0.2, 0.0]; period = 4.0;", 0.3 - 0.1 * math.pi),
    (f"box = {{ {BESIDE} }};", "velocity = [0.3, 0.0]; start = 0.2; stop = 0.6;", 0.3),
    (f"box = {{ {BESIDE} }};", "velocity = [0.3, 0.0]; start = 2.0;", 0.0),  # when all is over
    (f"box = {{ {BESIDE} }};", "velocity = [0.0, 3.0];", 0.0),  # along the water
    (f"box = {{ {HOLLOW} }};", "velocity = [0.0, 3.0];", 0.0),
    (f"box = {{ {HOLLOW} }};", "velocity = [0.3, 0.4];", 0.5),
    ("plane = { point = [0.0, 0.0]; normal = [0.6, 0.8]; };", "velocity = [0.8, -0.6];", 0.0),
    ("plane = { point = [0.0, 0.0]; normal = [0.6, 0.8]; };", "velocity = [0.6, 0.8];", 1.0),
    ("sphere = { centre = [0.5, 0.2]; radius = 0.1; };", "velocity = [0.3, 0.4];", 0.5),
])  # fmt: skip
def test_a_wall_that_starts_at_full_speed_has_the_impact_of_a_jump_but_where_it_slides(shape, motion, speed):
    wall = f'{PARTS["wall"][:-1]}, {{ name = "gate"; solid = true; shape = {{ {shape} }}; motion = {{ {motion} }}; }} )'
    number, c0 = told(wall=wall)["impact by jumps of the speed of gate"], told()["sound speed"].value
    assert number.value == pytest.approx(1000.0 * c0 * abs(speed), rel=1e-9, abs=1e-9)
    assert number.verdict == ("ok" if abs(speed) < 0.05 * told()["sound speed"].value / 10 else "warn")


def test_a_tank_that_moves_with_its_water_makes_no_sound():
    shape = PARTS["wall"][PARTS["wall"].index("shape") : -4]
    wall = f'( {{ name = "gate"; motion = {{ velocity = [0.5, 0.2]; }}; {shape} }} )'
    name, c0 = "impact by jumps of the speed of gate", told()["sound speed"].value
    assert told(wall=wall)[name].value == pytest.approx(1000.0 * c0 * math.hypot(0.5, 0.2))
    for velocity, speed in (("[0.5, 0.2]", 0.0), ("[0.5, 0.0]", 0.2)):
        water = PARTS["fluid"].replace("shape", f"velocity = {velocity}; shape", 1)
        number, c0 = told(fluid=water, wall=wall)[name], told(fluid=water, wall=wall)["sound speed"].value
        assert number.value == pytest.approx(1000.0 * c0 * speed, abs=1e-9)


def test_two_bodies_that_overlap_are_told_once():
    body = """{{ name = "{}"; solid = true; body = {{ density = 500.0; }};
        shape = {{ box = {{ low = [{}, 0.5]; high = [{}, 0.8]; }}; }}; }}"""
    found = told(wall=f"{PARTS['wall'][:-1]}, {body.format('a', 0.2, 0.5)}, {body.format('b', 0.4, 0.7)} )")
    gaps = {name: number.verdict for name, number in found.items() if name.startswith("gap between")}
    assert gaps == {"gap between a and b": "fail", "gap between b and tank": "ok"}
