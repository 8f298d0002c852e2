"""Each extreme of a case ends as it should: accurate (ok), degraded with a warning (warn), refused (fail)."""

import numpy as np
import pytest

from hpcpic.core.case.config import loads
from hpcpic.core.case.derived import enforce
from hpcpic.core.errors import ConfigError
from sph.configure import configure
from sph.forecast.derived import derived
from sph.physics.smoothing import SMOOTHING
from sph.physics.terms import artificial_viscosity

TANK = """
simulation = { dimensions = 2; end_time = 1.0; integrator = "symplectic"; cfl = 0.4; };
domain = { low = [0.0, 0.0]; high = [1.0, 1.0]; };
gravity = [0.0, -9.81];
fluid = ( { shape = { box = { low = [0.0, 0.0]; high = [1.0, 0.5]; }; }; } );
numerics = { spacing = 0.05; kernel = "cubic"; density_flux = "rusanov"; };
wall = ( { name = "tank"; shape = { box = { low = [0.0, 0.0]; high = [1.0, 1.0]; open = ["y+"]; }; }; } );
"""


def numbers(**changes):
    """Derived numbers by name, with the groups of the case changed: numerics='kernel = "cubic";' and so on."""
    text = TANK
    for group, more in changes.items():
        text += f"{group} = {{ {more} }};\n"
    tree = loads(merged(text))
    return {number.name: number for number in derived(configure(tree))}


def merged(text):
    """Groups given twice: the later keys win."""
    groups: dict[str, dict[str, str]] = {}
    lines = []
    for line in text.strip().splitlines():
        name, _, rest = line.partition(" = ")
        if rest.startswith("{ ") and name in ("simulation", "numerics", "eos", "domain"):
            body = rest.strip()[2:-2].strip().rstrip(";").removesuffix(" }")
            for setting in filter(None, (part.strip() for part in body.replace("};", "").split(";"))):
                key, _, value = setting.partition(" = ")
                groups.setdefault(name, {})[key] = value
        else:
            lines.append(line)
    told = [f"{name} = {{ {' '.join(f'{k} = {v};' for k, v in group.items())} }};" for name, group in groups.items()]
    return "\n".join([*told, *lines])


RUSANOV, NONE = 'density_flux = "rusanov";', 'density_flux = "none"; viscosity_form = "none";'


@pytest.mark.parametrize(
    "integrator, cfl, flux, verdict",
    [
        ("rk3-tvd", 0.25, RUSANOV, "ok"), ("rk3-tvd", 0.4, RUSANOV, "ok"), ("symplectic", 0.4, RUSANOV, "ok"),
        ("euler", 0.4, RUSANOV, "ok"), ("predictor-corrector", 0.25, RUSANOV, "ok"),
        ("euler", 0.7, RUSANOV, "fail"), ("predictor-corrector", 0.45, RUSANOV, "fail"),
        ("rk3-tvd", 1.1, RUSANOV, "fail"), ("symplectic", 0.85, RUSANOV, "fail"),
        ("rk3-tvd", 2.0, RUSANOV, "fail"), ("symplectic", 2.0, NONE, "fail"),
        ("euler", 0.01, NONE, "fail"), ("euler", 0.04, NONE, "fail"),
        ("symplectic", 1.5, NONE, "ok"), ("rk3-tvd", 1.5, NONE, "ok"), ("predictor-corrector", 0.85, NONE, "ok"),
    ],
)  # fmt: skip
def test_the_courant_number(integrator, cfl, flux, verdict):
    number = numbers(simulation=f'integrator = "{integrator}"; cfl = {cfl};', numerics=flux)["Courant number"]
    assert number.verdict == verdict
    assert (number.cure != "") == (verdict != "ok")


@pytest.mark.parametrize("flux", [RUSANOV, 'density_flux = "delta";'])
@pytest.mark.parametrize("integrator", ["rk3-tvd", "symplectic", "predictor-corrector"])
def test_the_default_courant_number_is_legal_and_the_cure_is_too(integrator, flux):
    text = TANK.replace("cfl = 0.4; ", "").replace('"symplectic"', f'"{integrator}"').replace(RUSANOV, flux)
    assert all(n.verdict != "fail" for n in derived(configure(loads(text))))
    bad = numbers(simulation=f'integrator = "{integrator}"; cfl = 3.0;', numerics=flux)["Courant number"]
    cure = bad.cure.split(" is ")[0]
    assert numbers(simulation=f'integrator = "{integrator}"; {cure};', numerics=flux)["Courant number"].verdict == "ok"


@pytest.mark.parametrize("factor, verdict", [(2, "fail"), (5, "warn"), (10, "ok"), (20, "ok"), (100, "warn")])
def test_the_sound_speed(factor, verdict):
    assert numbers(eos=f"sound_speed_factor = {factor}.0;")["sound speed factor"].verdict == verdict


def test_force_is_told_which_limit_it_does_not_lift():
    """Waves slower than the fluid are no water at all; those a little faster are, with an error."""
    text = TANK.replace(RUSANOV, "")
    trees = [loads(text, sets=[f"eos.sound_speed={c0}"]) for c0 in (1.0, 6.0)]
    with pytest.raises(ConfigError) as error:
        enforce(derived(configure(trees[0])), trees[0], force=True)
    assert all("does not lift this limit" in fault for fault in error.value.messages)
    told = enforce(derived(configure(trees[1])), trees[1], force=True)
    assert any("sound speed factor" in warning and "refused without --force" in warning for warning in told)


@pytest.mark.parametrize(
    "ratio, kernel, verdict",
    [(0.6, "cubic", "fail"), (0.8, "cubic", "warn"), (1.2, "cubic", "ok"), (1.5, "cubic", "ok"),
     (2.0, "wendland2", "ok"), (3.0, "cubic", "warn"), (1.6, "quintic", "warn")],
)  # fmt: skip
def test_the_smoothing_length(ratio, kernel, verdict):
    found = numbers(numerics=f'smoothing = {ratio}; kernel = "{kernel}";', simulation="cfl = 0.05;")
    assert found["smoothing length"].verdict == verdict


@pytest.mark.parametrize("step, verdict", [(1e-3, "ok"), (4e-2, "fail")])
def test_a_fixed_viscous_step(step, verdict):
    text = TANK.replace("cfl = 0.4;", f"time_step = {step};")
    text = text.replace("0.5]; }; }; }", "0.5]; }; }; dynamic_viscosity = 50.0; }")
    found = {n.name: n for n in derived(configure(loads(text)))}
    assert found["viscous step"].verdict == verdict


@pytest.mark.parametrize("viscosity, kind, alpha, verdict", [
    (1e-3, "extrapolated-no-slip", 0.0, "warn"),
    (1e-3, "extrapolated-no-slip", 0.02, "ok"),
    (1e-3, "extrapolated-free-slip", 0.0, "ok"),
    (10.0, "extrapolated-no-slip", 0.0, "ok"),
])  # fmt: skip
def test_a_viscosity_that_a_spacing_does_not_resolve_is_told_where_walls_stick(viscosity, kind, alpha, verdict):
    text = f"""simulation = {{ dimensions = 2; end_time = 1.0; }}; gravity = [0.0, -9.81];
        fluid = ( {{ dynamic_viscosity = {viscosity};
            shape = {{ box = {{ low = [0.0, 0.0]; high = [1.0, 0.5]; }}; }}; }} );
        numerics = {{ spacing = 0.05; artificial_viscosity = {alpha}; }};
        wall = ( {{ type = "{kind}"; shape = {{ plane = {{ point = [0.0, 0.0]; normal = [0.0, 1.0]; }}; }}; }} );"""
    number = {n.name: n for n in derived(configure(loads(text)))}["Reynolds number of a spacing"]
    assert number.value == pytest.approx((2 * 9.81 * 0.5) ** 0.5 * 0.05 * 1000.0 / viscosity)
    assert number.source.startswith("u = 3.13 m/s, eos.max_velocity")
    assert number.verdict == verdict and bool(number.cure) == (verdict == "warn")


@pytest.mark.parametrize("d, ratio", [(2, 1.5), (2, 2.0), (3, 1.5), (3, 2.0)])
def test_the_viscosity_of_alpha_is_that_by_which_a_shear_wave_decays(d, ratio):
    """The terms of the code on a lattice: v_x = sin(k y), 60 spacings long."""
    flat = ", ".join(["0.0"] * d), ", ".join(["1.0"] * d)
    config = configure(
        loads(f"""simulation = {{ dimensions = {d}; end_time = 1.0; }};
        fluid = ( {{ shape = {{ box = {{ low = [{flat[0]}]; high = [{flat[1]}]; }}; }}; }} );
        eos = {{ sound_speed = 20.0; max_velocity = 2.0; }};
        numerics = {{ spacing = 0.1; smoothing = {ratio}; artificial_viscosity = 0.05; }};""")
    )
    number = {n.name: n for n in derived(config)}["kinematic viscosity of alpha"]
    h, k = config.h, 2 * np.pi / 6.0
    offsets = np.stack(np.meshgrid(*[0.1 * np.arange(-4, 5)] * d), -1).reshape(-1, d)  # x_j - x_i
    r = np.sqrt((offsets**2).sum(axis=1))
    offsets, r = offsets[r > 0], r[r > 0]
    y = 0.1 * np.arange(60)
    faster = np.sin(k * y)[:, None] - np.sin(k * (y[:, None] + offsets[:, 1]))
    near = faster * -offsets[:, 0] / (r**2 + 0.01 * h**2)
    push = artificial_viscosity(0.0, near, 1e-3, 1e-3, -0.5 * 0.05 * 20.0 * h)
    F = SMOOTHING["wendland2"].gradient(r / h, d) / h ** (d + 2)
    slower = (-1000.0 * 0.1**d * push * F * -offsets[:, 0]).sum(axis=1)
    decay = -(slower * np.sin(k * y)).sum() / (np.sin(k * y) ** 2).sum()
    assert decay / k**2 == pytest.approx(number.value, rel=0.13)  # along a lattice less than at an angle
    assert number.value == pytest.approx(0.05 * 20.0 * h / (16 if d == 2 else 20))
    assert number.verdict == "ok" and not number.limit
    assert f"Re = vmax L/nu = {2.0 / number.value:.3g}" in number.source


def test_a_fluid_without_alpha_has_no_viscosity_of_it():
    assert "kinematic viscosity of alpha" not in numbers(numerics="artificial_viscosity = 0.0;")


@pytest.mark.parametrize("g", [0.0981, 9.81, 981.0])
def test_the_sound_speed_follows_gravity(g):
    text = TANK.replace("-9.81", f"-{g}").replace(RUSANOV, "")
    found = {n.name: n for n in derived(configure(loads(text)))}
    assert found["sound speed"].value == pytest.approx(10 * (2 * g * 0.5) ** 0.5)
    assert all(n.verdict == ("warn" if n.name == "gravity" else "ok") for n in found.values())


def test_no_fluid_is_a_legal_case():
    text = TANK.replace(TANK.splitlines()[4], "").replace("numerics", "eos = { max_velocity = 1.0; };\nnumerics", 1)
    assert all(n.verdict == "ok" for n in derived(configure(loads(text))))


DISC = "sphere = { centre = [0.5, 0.5]; radius = 0.4; };"


@pytest.mark.parametrize(
    ("wall", "verdict", "words"),
    [
        ('name = "w"; shape = { sphere = { centre = [0.5, 0.5]; radius = 0.4; }; };', "ok", ""),
        ('name = "w"; shape = { sphere = { centre = [0.5, 0.5]; radius = 0.3; }; };', "warn", "as a tank does"),
        ('name = "w"; shape = { plane = { point = [0.5, 0.4]; normal = [0.2, 1.0]; }; };', "warn", "normal of w"),
    ],
)
def test_a_round_fluid_that_fills_its_tank_loses_nothing_and_planes_tell_their_side(wall, verdict, words):
    text = TANK.replace("box = { low = [0.0, 0.0]; high = [1.0, 0.5]; };", DISC)
    walls = f"wall = ( {{ {wall} }} );"
    config = configure(loads(text[: text.index("wall = (")] + walls))
    number = next(n for n in derived(config) if n.name == "fluid_1 clipped by w")
    assert number.verdict == verdict and words in number.cure and ("solid" in number.cure) == ("tank" in words)
    assert int(number.limit.split()[1]) == pytest.approx(np.pi * 0.4**2 / 0.05**2, rel=0.05)  # the square has 256


def test_what_was_clipped_is_told():
    outside = TANK.replace("high = [1.0, 0.5]", "high = [1.5, 0.5]")
    outside = outside.replace("high = [1.0, 1.0]; };\ng", "high = [2.0, 1.0]; };\ng")
    found = {n.name: n for n in derived(configure(loads(outside)))}
    number = found["fluid_1 clipped by tank"]
    assert (number.verdict, number.value) == ("warn", 100)
    gone = TANK.replace("low = [0.0, 0.0]; high = [1.0, 0.5]", "low = [0.1, 1.2]; high = [0.9, 1.5]")
    numbers = {n.name: n for n in derived(configure(loads(gone)))}
    assert numbers["fluid_1 clipped by the domain"].verdict == "fail"
    for high, verdict in (("[0.2, 0.2]", "ok"), ("[0.9, 0.9]", "warn")):  # of a solid that should have been hollow
        shape = f"box = {{ low = [0.0, 0.0]; high = {high}; }};"
        block = f'wall = ( {{ name = "block"; solid = true; shape = {{ {shape} }}; }} );'
        numbers = {n.name: n for n in derived(configure(loads(TANK[: TANK.index("wall = (")] + block)))}
        number = numbers["fluid_1 clipped by block"]
        assert number.verdict == verdict and ("solid" in number.cure) == (verdict == "warn")


@pytest.mark.parametrize("low, high, verdict", [
    ("[0.0, 0.0]", "[1.0, 0.3]", "ok"), ("[0.1, 0.1]", "[0.9, 0.3]", "ok"), ("[0.0, 0.0]", "[1.0, 1.0]", "ok"),
    ("[0.3, 0.0]", "[1.0, 0.3]", "warn"), ("[0.0, 0.4]", "[1.0, 0.6]", "warn"),
])  # fmt: skip
def test_a_box_that_fills_a_round_tank_to_its_top_is_meant(low, high, verdict):
    """It reaches around the tank but above; of one that ends elsewhere inside, part may be in a wrong place."""
    text = TANK.replace("low = [0.0, 0.0]; high = [1.0, 0.5]", f"low = {low}; high = {high}")
    text = text[: text.index("wall = (")] + f'wall = ( {{ name = "disc"; shape = {{ {DISC} }}; }} );'
    number = next(n for n in derived(configure(loads(text))) if n.name == "fluid_1 clipped by disc")
    assert number.verdict == verdict


def test_a_wall_thinner_than_the_spacing_is_refused():
    gate = '{ name = "gate"; shape = { box = { low = [0.5, 0.0]; high = [0.52, 1.0]; }; }; solid = true; } );'
    text = TANK.rstrip().removesuffix(");") + ", " + gate
    found = {n.name: n for n in derived(configure(loads(text)))}
    assert found["thickness of gate"].verdict == "fail"


def test_a_domain_shorter_than_three_supports_is_refused():
    found = numbers(domain='high = [0.25, 1.0]; periodic = ["x"];')
    assert found["period along x"].verdict == "fail"


@pytest.mark.parametrize(
    "form, factor, verdicts", [("strain-rate", 10, ["fail"]), ("strain-rate", 50, ["ok"]), ("morris", 10, [])]
)
def test_a_form_that_leaves_a_checkerboard_undamped_needs_stiff_rows_beside_mirrors(form, factor, verdicts):
    mirrors = TANK.replace('open = ["y+"]; }; };', 'open = ["y+"]; }; }; type = "mirror-no-slip";')
    text = mirrors.replace("0.5]; }; };", "0.5]; }; }; dynamic_viscosity = 0.001;")
    text = text.replace(
        "};\nwall", f'viscosity_form = "{form}"; }};\neos = {{ sound_speed_factor = {factor}.0; }};\nwall'
    )
    found = derived(configure(loads(text)))
    assert [number.verdict for number in found if number.name == "stiffness of rows beside mirrors"] == verdicts


@pytest.mark.parametrize(
    "kind, speed, verdict", [("pressure-continuity", 6.0, "ok"), ("pressure-continuity", 1e3, "fail"),
                             ("repulsive", 1e3, None)]
)  # fmt: skip
def test_a_wall_that_rattles_the_fluid_is_refused(kind, speed, verdict):
    gate = f"""{{ name = "gate"; type = "{kind}"; motion = {{ velocity = [0.0, {speed}]; }}; solid = true;
        shape = {{ box = {{ low = [0.5, 0.0]; high = [0.6, 1.0]; }}; }}; }} );"""
    text = "eos = { sound_speed = 31.0; };" + TANK.rstrip().removesuffix(");") + ", " + gate
    found = {n.name: n.verdict for n in derived(configure(loads(text)))}
    assert found.get("speed of gate") == verdict


@pytest.mark.parametrize(
    "kind, size, more, verdict",
    [("repulsive", 0.2, "measure_force = true;", "warn"), ("repulsive", 0.3, "measure_force = true;", "ok"),
     ("repulsive", 0.2, "", None), ("pressure-continuity", 0.2, "measure_force = true;", None)],
)  # fmt: skip
def test_a_small_repulsive_body_whose_force_is_asked_for_is_told(kind, size, more, verdict):
    body = f"""{{ name = "body"; type = "{kind}"; solid = true; {more}
        shape = {{ box = {{ low = [0.4, 0.1]; high = [{0.4 + size}, 0.4]; }}; }}; }} );"""
    text = TANK.rstrip().removesuffix(");") + ", " + body
    found = {n.name: n.verdict for n in derived(configure(loads(text)))}
    assert found.get("size of body") == verdict


@pytest.mark.parametrize("spacing", [0.3, 0.27, 0.2, 0.15])
def test_a_spacing_that_stretches_is_told_one_that_does_not(spacing):
    told = numbers(numerics=f"spacing = {spacing};")["stretch of the spacing in fluid_1"]
    if told.verdict == "warn":
        better = told.cure.split()[2]
        assert float(better) <= spacing
        assert numbers(numerics=f"spacing = {better};")["stretch of the spacing in fluid_1"].verdict == "ok"
    assert "  " not in str(told)


@pytest.mark.parametrize("periodic, told", [('periodic = ["x"];', False), ("", True)])
def test_a_gauge_beyond_the_domain_is_told_but_not_through_a_period(periodic, told):
    gauge = 'gauge = ( { name = "far"; what = "flow"; axis = "x+"; at = [2.5, 0.2]; } );\n'
    text = TANK.replace("high = [1.0, 1.0]; };", f"high = [1.0, 1.0]; {periodic} }};", 1) + gauge
    found = {n.name for n in derived(configure(loads(text)))}
    assert ("far beyond the domain" in found) is told


@pytest.mark.parametrize("shape, verdict", [
    ("box = { low = [-0.1, 0.0, 0.0]; high = [0.0, 1.0, 1.0]; }; }; solid = true", "fail"),
    ("plane = { point = [0.0, 0.0, 0.0]; normal = [1.0, 0.0, 0.0]; }; }", None),
])  # fmt: skip
def test_more_images_than_a_particle_can_have_are_told_before_the_run(shape, verdict):
    """A tank without a lid and a piston in it: (1 + 3) (1 + 4) (1 + 3) images, or (1 + 2) (1 + 2) (1 + 1)."""
    text = TANK.replace("[0.0, 0.0]", "[0.0, 0.0, 0.0]").replace("[1.0, 0.5]", "[1.0, 1.0, 0.5]")
    text = text.replace("[1.0, 1.0];", "[1.0, 1.0, 1.0];").replace("dimensions = 2", "dimensions = 3")
    text = text.replace("[0.0, -9.81]", "[0.0, 0.0, -9.81]").replace('"y+"', '"z+", "x-"')
    kind = 'type = "point-symmetric-free-slip";'
    text = text.replace('name = "tank";', f'name = "tank"; {kind}').rstrip().removesuffix(");")
    text += f", {{ {kind} shape = {{ {shape}; }} );"
    found = {n.name: n.verdict for n in derived(configure(loads(text)))}
    assert found.get("images of a particle") == verdict
