"""Viscosity at a free surface: a liquid that spins freely keeps its spin, and where a surface is the form for it is."""

import numpy as np
import pytest
from sph_scenes import by_id, column, engine, jitter, reference, tank

import sph
from hpcpic.core.errors import ConfigError

TANK = {"name": "tank", "shape": {"box": {"low": [0.0, 0.0], "high": [0.2, 0.2], "open": ["y+"]}}}
RIGID = {"type": "linear", "gradient": [0.0, -2.0, 2.0, 0.0], "centre": [0.0, 0.0]}


def liquid(shape, **more):
    return sph.Case(
        simulation={"dimensions": 2, "end_time": 1.0}, domain={"low": [-0.2, -0.2], "high": [0.3, 0.3]},
        numerics={"spacing": 0.01}, eos={"max_velocity": 0.2},
        fluid=[{"name": "oil", "shape": shape, "kinematic_viscosity": 2e-3}],
    ).changed(more)  # fmt: skip


def spin_left(form):
    """Kinetic energy after nu t = 0.08 R^2 over that at the start."""
    disc = {"sphere": {"centre": [0.0, 0.0], "radius": 0.1}}
    more = {"fluid[0].flow": RIGID, "fluid[0].initial_pressure": "flow", "numerics.tensile_correction": 0.2}
    with liquid(disc, **more, **{"numerics.viscosity_form": form}).simulation(threads=1) as sim:
        first = sim.scalars()["energy_kinetic"]
        sim.advance(until=0.4)
        return sim.scalars()["energy_kinetic"] / first


def test_a_disc_that_spins_freely_keeps_its_energy():
    """Rigid rotation strains nothing; Morris alone takes 8 nu / R^2 of the energy. 3e-3: of waves of pressure."""
    assert spin_left("full-stress") == pytest.approx(1.0, abs=3e-3)
    assert spin_left("morris") < 0.7


def numerics_of(wall=TANK, **more):
    box = {"box": {"low": [0.0, 0.0], "high": [0.2, 0.1]}}
    return liquid(box, gravity=[0.0, -9.81], wall=[wall], **more).config.numerics


def test_a_viscous_liquid_with_a_free_surface_has_the_full_stress_by_default():
    assert numerics_of().viscosity_form == "full-stress" and numerics_of().shifting
    lid = TANK | {"shape": {"box": {"low": [0.0, 0.0], "high": [0.2, 0.1]}}}
    assert numerics_of(lid).viscosity_form == "morris"
    assert numerics_of(TANK | {"type": "pressure-continuity"}).viscosity_form == "morris"
    assert numerics_of(**{"fluid[0].kinematic_viscosity": 0.0}).viscosity_form == "artificial"


def test_walls_and_liquids_that_do_not_know_it_are_refused():
    named = {"numerics.viscosity_form": "full-stress"}
    with pytest.raises(ConfigError, match=r'wall\[0\].type: "mirror-no-slip" does not know .*"full-stress"'):
        numerics_of(TANK | {"type": "mirror-no-slip"}, **named)
    above = {"shape": {"box": {"low": [0.0, 0.1], "high": [0.2, 0.15]}}, "density": 900.0, "kinematic_viscosity": 1e-3}
    first = {"shape": {"box": {"low": [0.0, 0.0], "high": [0.2, 0.1]}}, "kinematic_viscosity": 2e-3}
    with pytest.raises(ConfigError, match=r'numerics.viscosity_form: "full-stress" does not know liquids'):
        numerics_of(fluid=[first, above], **named)


def test_in_space_forces_are_those_over_all_pairs():
    """1e-11: the renormalisation is an inverse."""
    cloud = engine(d=3, size=(1.0, 1.0, 1.3), spacing=0.1, form="full-stress", viscosity=5.0, flux="none")
    jitter(cloud)
    wanted = reference(cloud).acceleration()
    cloud.evolution.evaluate_forces()
    assert np.abs(by_id(cloud, "a")[0] - wanted).max() <= 1e-11 * np.abs(wanted).max()


@pytest.mark.parametrize("kind", ["extrapolated-no-slip", "extrapolated-free-slip"])
def test_a_wall_goes_on_with_the_stress_of_the_fluid(kind):
    """Where v is linear S is constant, and its divergence zero: to rounding of S / h on a lattice, beside walls too."""
    found = []
    gradient = np.array([[1.0, 2.0], [3.0, -1.0]])
    for form in ("full-stress", "morris"):
        water = engine(gravity=(0.0, 0.0), pressure="zero", form=form, viscosity=5.0, fill=(1.0, 0.5),
                       more=tank(2, kind))  # fmt: skip
        water.storage.set_own_values("v", gradient @ water.storage.own_values("x"))
        water.evolution.evaluate_forces()
        found.append(column(water, "a"))
    x = column(water, "x")
    fluid = np.all((x > 0.0) & (x < 1.0), axis=0)
    deep = fluid & (x[1] < 0.5 - 2.0 * water.scene.h)
    scale = 5.0 / water.scene.rho0 * np.abs(gradient).sum() / water.scene.h
    difference = np.abs(found[0] - found[1])
    assert difference[:, deep].max() < 1e-9 * scale < 1e-3 * difference[:, fluid & ~deep].max()
