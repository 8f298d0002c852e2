"""Two liquids in one scene, or a gas over a liquid: what they share with one, and what is refused."""

import numpy as np
import pytest
from sph_scenes import by_id, config, engine, jitter, layers, tank

from hpcpic.core.errors import ConfigError, Diverged

AIR = {"densities": (1000.0, 1.25), "ambient": 2e4, "spacing": 0.0625}
OIL = {"densities": (1000.0, 250.0), "viscosities": (4.0, 0.5), "form": "morris", "flux": "delta"}
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


@pytest.mark.parametrize("ambient", [None, 2e4])
def test_units_that_differ_by_a_power_of_two_give_the_same_bits(ambient):
    """Lengths and times 8 times as large, densities 4 times: the same velocities, viscosities 32 times as large."""
    small = after(5, layers(spacing=0.0625, ambient=ambient, **OIL))
    large = {"densities": (4000.0, 1000.0), "viscosities": (128.0, 16.0), "ambient": ambient and 4 * ambient}
    case = layers(spacing=0.5, size=8.0, fill=4.0, gravity=(0.0, -9.81 / 8), form="morris", flux="delta", **large)
    large = engine(case=case)
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


def test_a_gas_has_the_pressure_of_the_liquid_beside_it_and_another_density():
    """Twice as dense at a pressure of 2^1.4 - 1 times that of rest, which is 0 in the series."""
    sph = engine(case=layers(**AIR))
    sph.storage.set_own_values("drho", sph.scene.eos.excess(2e4 * (2**1.4 - 1)))
    found = sph.particles()
    for name, density in (("oil", 2.5), ("water", 1000.0 + sph.storage.drho[sph.storage.own_slots[0]])):
        np.testing.assert_allclose(found[name].columns["density"], density, rtol=1e-6)
        np.testing.assert_allclose(found[name].columns["pressure"], 2e4 * (2**1.4 - 1), rtol=1e-5)


def test_gauges_of_the_surface_and_of_the_front_look_for_liquids():
    gauges = """gauge = ( { name = "level"; what = "elevation"; at = [0.25, 0.0]; },
        { name = "top"; what = "elevation"; at = [0.25, 0.0]; fluid = "oil"; },
        { name = "up"; what = "front"; axis = "y+"; } );"""
    sph = engine(case=layers(**AIR, more=gauges))
    found = sph.gauges.values(0.0)
    assert abs(found["level"] - 0.25) < 0.02 and abs(found["top"] - 0.5) < 0.02 and abs(found["up"] - 0.25) < 1e-12
    sph.storage.x[:, sph.storage.is_gas(sph.storage.own_slots).nonzero()[0]] += 0.2
    assert sph.scalars()["front_x"] == pytest.approx(0.5)


def test_walls_pull_at_a_gas_and_sensors_tell_its_pressure_without_the_background():
    """A gas at less than its pressure of rest in a closed tank stays where it is."""
    sensor = 'gauge = ( { name = "lid"; what = "wall-pressure"; at = [0.5, 1.0]; axis = "y+"; size = [0.5, 0.0]; } );'
    walls = tank(2, "extrapolated-free-slip").replace('open = ["y+"];', "")
    case = layers(**AIR, fill=1.0, gravity=(0.0, 0.0), more=walls + sensor)
    sph = engine(case=case.replace("eos = {", "eos = { background_pressure = 600.0;"))
    sph.storage.set_own_values("drho", sph.scene.eos.excess(-500.0))
    sph.evolution.forget_rates()
    for _ in range(20):
        sph.step()
    assert sph.gauges.values(sph.time)["lid"] == pytest.approx(-500.0, rel=0.01)
    assert sph.scalars()["max_velocity"] < 0.1  # where the corners are; it would fall away with 25 m/s


def test_a_gas_below_what_the_background_holds_is_told_once(caplog):
    sph = engine(case=layers(**AIR).replace("ambient_pressure", "background_pressure = 50.0; ambient_pressure"))
    sph.storage.set_own_values("drho", sph.scene.eos.excess(-1.5 * sph.scene.eos.background))
    for _ in range(30):
        sph.step()
    told = [record.getMessage() for record in caplog.records if "gaps open" in record.getMessage()]
    assert len(told) == 1 and told[0].startswith("1e+02 % of the gas")


@pytest.mark.parametrize("kind, mach, ends", [("water", 1.1, True), ("oil", 0.9, False), ("oil", 1.1, True)])
def test_each_fluid_has_a_sound_speed_of_its_own(kind, mach, ends):
    """The light one is faster than the sound of the heavy one, and the run goes on."""
    sph = engine(case=layers(densities=(1000.0, 10.0), spacing=0.0625, pressure="zero"))
    storage, light = sph.storage, kind == "oil"
    sph.step()  # the next one is none in which all fluids are looked at
    slots = storage.fluid_slots
    slot = slots[(storage.relative_density(slots) < 1.0) == light][0]
    storage.v[0, slot] = mach * sph.scene.c0 * (10.0 if light else 1.0)
    sph.sort()
    if not ends:
        return sph.step()
    with pytest.raises(Diverged, match=r"faster than sound, 1\.1 times"):
        sph.step()


@pytest.mark.parametrize(
    "more, words",
    [
        ({"densities": (1000.0, 1000.0), "ambient": 1e5}, "a gas is lighter than liquids"),
        ({"ambient": 1e5, "continuity": "masses"}, '"masses" does not know gases'),
    ],
)
def test_what_gases_need_is_told(more, words):
    with pytest.raises(ConfigError, match=words):
        config(layers(**(OIL | more)))


def test_a_gas_alone_is_refused():
    with pytest.raises(ConfigError, match="a gas alone is a fluid"):
        config(layers(**AIR).replace("gas = false", "gas = true"))


@pytest.mark.parametrize(
    "more, words",
    [
        ({"more": tank(2)}, "wall[0].type"),
        ({"more": tank(2, "repulsive")}, "wall[0].type"),
        ({"form": "strain-rate"}, "numerics.viscosity_form"),
        ({"shifting": "true"}, "numerics.shifting"),
        ({"more": 'outlet = ( { low = [0.4, 0.0]; high = [0.5, 0.5]; axis = "x+"; } );'}, "outlet[0]"),
    ],
)  # fmt: skip
def test_what_does_not_know_several_liquids_refuses_them(more, words):
    with pytest.raises(ConfigError, match="several densities") as error:
        config(layers(**(OIL | more)))
    assert words in error.value.message
