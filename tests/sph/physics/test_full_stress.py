"""Viscosity at a free surface: a liquid that spins freely keeps its spin, and where a surface is the form for it is."""

import numpy as np
import pytest
from seldom import seldom
from sph_scenes import by_id, column, engine, jitter, layers, reference, tank

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


def disc(radius, name="oil", density=1000.0, nu=2e-3):
    shape = {"sphere": {"centre": [0.0, 0.0], "radius": radius}}
    start = {"flow": RIGID, "initial_pressure": "zero"}
    return {"name": name, "shape": shape, "density": density, "kinematic_viscosity": nu} | start


def spin_left(form, *within, **more):
    """Kinetic energy after nu t = 0.08 R^2 over that at the start, of a disc with others within."""
    fluids = [*within, disc(0.1) | more]
    case = liquid(fluids[0]["shape"], fluid=fluids, **{"numerics.tensile_correction": 0.2})
    with case.changed({"numerics.viscosity_form": form}).simulation(threads=1) as sim:
        first = sim.scalars()["energy_kinetic"]
        sim.advance(until=0.4)
        return sim.scalars()["energy_kinetic"] / first


@pytest.mark.validation
def test_a_disc_that_spins_freely_keeps_its_energy():
    """Rigid rotation strains nothing; Morris alone takes 8 nu / R^2 of the energy. 3e-3: of waves of pressure."""
    assert spin_left("full-stress", initial_pressure="flow") == pytest.approx(1.0, abs=3e-3)
    assert spin_left("morris", initial_pressure="flow") < 0.7


@pytest.mark.parametrize(("density", "nu"), [seldom(1000.0, 2e-2), (700.0, 3e-4)])
def test_so_does_one_with_another_liquid_within(density, nu):
    """6e-3: waves of pressure, which start with it here (`flow` does not know several densities)."""
    assert spin_left("full-stress", disc(0.05, "core", density, nu)) == pytest.approx(1.0, abs=6e-3)


def numerics_of(wall=TANK, **more):
    box = {"box": {"low": [0.0, 0.0], "high": [0.2, 0.1]}}
    return liquid(box, gravity=[0.0, -9.81], wall=[wall], **more).config.numerics


def test_a_viscous_liquid_with_a_free_surface_has_the_full_stress_by_default():
    assert numerics_of().viscosity_form == "full-stress" and numerics_of().shifting
    lid = TANK | {"shape": {"box": {"low": [0.0, 0.0], "high": [0.2, 0.1]}}}
    assert numerics_of(lid).viscosity_form == "morris"
    assert numerics_of(TANK | {"type": "pressure-continuity"}).viscosity_form == "morris"
    assert numerics_of(**{"fluid[0].kinematic_viscosity": 0.0}).viscosity_form == "artificial"
    above = {"shape": {"box": {"low": [0.0, 0.1], "high": [0.2, 0.15]}}, "density": 900.0, "kinematic_viscosity": 1e-3}
    first = {"shape": {"box": {"low": [0.0, 0.0], "high": [0.2, 0.1]}}, "kinematic_viscosity": 2e-3}
    assert numerics_of(fluid=[first, above]).viscosity_form == "full-stress"


def test_walls_that_do_not_know_it_are_refused():
    with pytest.raises(ConfigError, match=r'wall\[0\].type: "mirror-no-slip" does not know .*"full-stress"'):
        numerics_of(TANK | {"type": "mirror-no-slip"}, **{"numerics.viscosity_form": "full-stress"})


@pytest.mark.validation
def test_in_space_forces_are_those_over_all_pairs():
    """1e-11: the renormalisation is an inverse."""
    cloud = engine(d=3, size=(1.0, 1.0, 1.3), spacing=0.1, form="full-stress", viscosity=5.0, flux="none")
    jitter(cloud)
    wanted = reference(cloud).acceleration()
    cloud.evolution.evaluate_forces()
    assert np.abs(by_id(cloud, "a")[0] - wanted).max() <= 1e-11 * np.abs(wanted).max()


@pytest.mark.parametrize("kind, several", [("no", False), ("free", False), seldom("no", True)])
def test_a_wall_goes_on_with_the_stress_of_the_fluid(kind, several):
    """Where v is linear S is constant, and its divergence zero: to rounding of S / h on a lattice, beside walls too. So
    it is of liquids that hardly differ.
    """
    found = []
    walls = tank(2, f"extrapolated-{kind}-slip")
    settings = {"gravity": (0.0, 0.0), "pressure": "zero", "fill": (1.0, 0.5), "more": walls}
    gradient = np.array([[1.0, 2.0], [3.0, -1.0]])
    for form in ("full-stress", "morris"):
        water = engine(form=form, viscosity=5.0, **settings)
        if several:
            water = engine(case=layers((1000.0, 1000.0), (5.0, 5.0 * (1 + 2.0**-42)), form=form, **settings))
        water.storage.set_own_values("v", gradient @ water.storage.own_values("x"))
        water.evolution.evaluate_forces()
        found.append(column(water, "a"))
    x = column(water, "x")
    fluid = np.all((x > 0.0) & (x < 1.0), axis=0)
    deep = fluid & (x[1] < 0.5 - 2.0 * water.scene.h)
    scale = 5.0 / water.scene.rho0 * np.abs(gradient).sum() / water.scene.h
    difference = np.abs(found[0] - found[1])
    assert difference[:, deep].max() < 1e-9 * scale < 1e-3 * difference[:, fluid & ~deep].max()
