"""What scaling scripts ask of the three programs: longer runs, larger scenes."""

from importlib import import_module

import pytest

from hpcpic.core.app.read import read_case

LATTICE = """
simulation = { dimensions = 3; end_time = 1.0e-3; };
domain = { size = [4.0e-4, 6.0e-4, 8.0e-4]; spacing = 2.0e-5; periodic = ["x", "y", "z"]; };
fluid = { viscosity = 1.0e-6; relaxation_time = 0.8; };
grains = ( { name = "bed"; diameters = { law = "beta"; min = 1.0e-4; max = 1.5e-4; count = 30; };
             packing = { porosity = 0.6; }; } );
"""


def read(program, case, sets=()):
    app = import_module(f"{program}.__main__").load_app()
    return app, read_case(app, case, sets).config


STEPS = {
    "hpcpic": lambda app, config: config.simulation.cycles,
    "sph": lambda app, config: config.simulation.end_time / app.time_step(config),  # at the start; it follows the flow
    "lbmdem": lambda app, config: config.n_steps,
}


@pytest.mark.parametrize("case", [("hpcpic", "landau-damping"), ("sph", "water-column"), ("lbmdem", "taylor-green")])
def test_a_run_of_so_many_steps(case):
    app, config = read(*case)
    _, shorter = read(*case, app.until(config, 37 * app.time_step(config)))
    assert STEPS[case[0]](app, shorter) == pytest.approx(37, rel=1e-12)


GROWING = (("hpcpic", "magnetised-thermal-2d"), ("sph", "elliptical-drop"), ("lbmdem", "lattice"))


@pytest.mark.parametrize("factor", [2, 5])
@pytest.mark.parametrize("case", GROWING)
def test_a_grown_scene_has_so_much_more_of_everything(case, factor, tmp_path):
    program, name = case
    if name == "lattice":
        name = str(tmp_path / "lattice.conf")
        (tmp_path / "lattice.conf").write_text(LATTICE)
    app, config = read(program, name)
    _, grown = read(program, name, app.grow(config, factor))
    assert app.time_step(grown) == pytest.approx(app.time_step(config), rel=1e-12) or program == "sph"
    own, larger = (app.estimate(c, 1, 1, {}).memory for c in (config, grown))
    scene = [key for key in own if "librar" not in key and own[key] > 1e4]
    assert scene
    for key in scene:
        assert larger[key] == pytest.approx(factor * own[key], rel=0.25), key  # borders grow less


def test_grains_at_given_places_do_not_grow():
    app, config = read("lbmdem", "settling-disc")
    with pytest.raises(ValueError, match="given places"):
        app.grow(config, 2)
