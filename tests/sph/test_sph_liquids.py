"""Two liquids in one scene: what they share with one, and what is refused."""

import numpy as np
import pytest
from sph_scenes import by_id, config, engine, jitter, layers, tank

from hpcpic.core.errors import ConfigError

OIL = {"densities": (1000.0, 250.0), "viscosities": (4.0, 0.5), "form": "morris"}
ROUNDING = 1e-11  # of ten steps, relative to the largest value


def after(steps, case, disorder=0.1):
    sph = engine(case=case)
    jitter(sph, amount=disorder, speed=0.1, density=0.0)
    for _ in range(steps):
        sph.step()
    return sph


def test_liquids_that_hardly_differ_go_as_one():
    """But for the flux of density, which does not act between liquids."""
    settings = {"pressure": "zero", "flux": "none", "form": "morris", "spacing": 0.1}
    one = after(10, layers((1000.0, 1000.0), (5.0, 5.0), **settings))
    two = after(10, layers((1000.0, 1000.0 * (1 + 2.0**-42)), (5.0, 5.0 * (1 + 2.0**-42)), **settings))
    assert two.spec.densities and two.spec.viscosities and not one.spec.densities and not one.spec.viscosities
    for name in ("x", "v", "drho"):
        a, b = by_id(one, name)[0], by_id(two, name)[0]
        assert np.abs(a - b).max() <= ROUNDING * np.abs(a).max()


def test_the_order_and_names_of_liquids_do_not_matter():
    plain, swapped = (engine(case=layers(spacing=0.1, swapped=way, **OIL)) for way in (False, True))
    for sph in (plain, swapped):
        for _ in range(10):
            sph.step()
    for name in ("x", "v", "drho", "m"):
        a, b = by_id(plain, name)[0], np.roll(by_id(swapped, name)[0], -(plain.scene.n_fluid // 2), axis=-1)
        assert np.abs(a - b).max() <= ROUNDING * np.abs(a).max()


def test_units_that_differ_by_a_power_of_two_give_the_same_bits():
    """Lengths and times 8 times as large, densities 4 times: the same velocities, viscosities 32 times as large."""
    small = after(5, layers(spacing=0.0625, **OIL))
    large = {"densities": (4000.0, 1000.0), "viscosities": (128.0, 16.0), "form": "morris"}
    large = engine(case=layers(spacing=0.5, size=8.0, fill=4.0, gravity=(0.0, -9.81 / 8), **large))
    jitter(large, amount=0.1, speed=0.1, density=0.0)
    for _ in range(5):
        large.step()
    assert large.time == 8 * small.time
    for name, factor in (("x", 8.0), ("v", 1.0), ("drho", 4.0), ("m", 256.0)):
        assert np.array_equal(by_id(large, name)[0], factor * by_id(small, name)[0]), name


def test_layers_start_at_rest_with_the_weight_of_those_above():
    """The pressure goes on through the interface at 0.25 m; below it grows by that of water."""
    gauges = "".join(f'{{ name = "{one}"; what = "elevation"; at = [0.25, 0.0]; fluid = "{one}"; }},'
                     for one in ("oil", "water"))  # fmt: skip
    sph = engine(case=layers(spacing=0.05, more=f"gauge = ( {gauges[:-1]} );"))
    x, drho = by_id(sph, "x", "drho")
    height, p = x[list(sph.scene.axes).index(1)], sph.scene.eos.pressure(drho)
    exact = 9.81 * (400.0 * np.minimum(0.5 - height, 0.25) + 1000.0 * np.maximum(0.25 - height, 0.0))
    assert np.abs(p / exact - 1).max() < 0.01  # g H / (2 c0^2), by which water is denser below
    found = sph.particles()
    assert np.abs(found["water"].columns["density"] / 1000.0 - 1).max() < 0.01
    assert np.abs(found["oil"].columns["density"] / 400.0 - 1).max() < 0.01
    surfaces = sph.gauges.values(0.0)
    assert abs(surfaces["water"] - 0.25) < 0.01 and abs(surfaces["oil"] - 0.5) < 0.01


def test_a_wall_that_falls_with_the_fluids_has_their_pressure():
    """Whatever their densities: gravity less its acceleration is none."""
    swing = "motion = { amplitude = [0.01, 0.0]; };"
    sph = engine(case=layers(spacing=0.1, fill=(1.0, 0.5), more=tank(2, "extrapolated-free-slip", more=swing)))
    jitter(sph)
    sph.storage.set_own_values("drho", 3.0)
    sph.walls.acceleration[:] = sph.scene.acceleration
    sph.evolution.evaluate_forces()
    kinds, drho = sph.storage.own_values("wall"), sph.storage.own_values("drho")
    wet = (kinds > 0) & (drho > 0.0)  # others have no fluid before them
    assert wet.sum() > 20 and np.abs(drho[wet] - 3.0).max() < 1e-12


@pytest.mark.parametrize(
    "more, words",
    [
        ({"more": tank(2)}, "wall[0].type"),
        ({"more": tank(2, "repulsive")}, "wall[0].type"),
        ({"form": "strain-rate"}, "numerics.viscosity_form"),
        ({"shifting": "true"}, "numerics.shifting"),
        ({"more": 'outlet = ( { low = [0.4, 0.0]; high = [0.5, 0.5]; axis = "x+"; } );'}, "outlet[0]"),
        ({"more": """wall = ( { name = "raft"; solid = true; body = { density = 500.0; };
            shape = { box = { low = [0.1, 0.1]; high = [0.3, 0.3]; }; }; } );"""}, "wall[0].body"),
    ],
)  # fmt: skip
def test_what_does_not_know_several_liquids_refuses_them(more, words):
    with pytest.raises(ConfigError, match="several densities") as error:
        config(layers(**(OIL | more)))
    assert words in error.value.message
