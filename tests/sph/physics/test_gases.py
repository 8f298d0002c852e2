import numpy as np
import pytest
from sph_scenes import engine, jitter, layers

from sph.physics import equation_of_state as gases

ROUNDING = 1e-15


def test_the_density_is_that_of_the_adiabatic_law():
    """To rounding, and to 1e-7 at the ends; beyond them it stays."""
    u = np.geomspace(1 / 16, 16, 201)
    assert np.abs(gases.compression(u) / u ** (5 / 7) - 1).max() < 4 * ROUNDING
    ends = np.array([gases.LEAST, gases.MOST])
    np.testing.assert_allclose(gases.compression(ends), ends ** (5 / 7), rtol=1e-7)
    assert np.array_equal(gases.compression(np.array([-3.0, 0.0, 1e3])), gases.compression(ends)[[0, 0, 1]])


def test_the_work_of_compression_is_the_integral_of_pressure_over_volume():
    y = np.linspace(0.3, 4.0, 2001)  # rho / rho0
    volume, p = 1 / y, y**gases.ADIABATIC - 1
    done = np.concatenate([[0.0], np.cumsum(-0.5 * (p[1:] + p[:-1]) * np.diff(volume))])
    found = gases.compression_work(y**gases.ADIABATIC, y)
    assert np.abs((found - found[0]) - done).max() < 1e-5


@pytest.mark.parametrize("gamma, background", [(7.0, 0.0), (6.5, 300.0)])
def test_the_internal_energy_is_the_work_of_pressure_on_all_particles(gamma, background):
    """Of gas and liquid, the background counted: integrals of (p + background) / rho^2 in small steps of drho."""
    case = layers((1000.0, 2.0), ambient=1e4, spacing=0.1, gamma=gamma)
    sph = engine(case=case.replace("eos = {", f"eos = {{ background_pressure = {background};"))
    jitter(sph, density=8.0)
    storage, scene = sph.storage, sph.scene
    slots = storage.fluid_slots
    path = np.linspace(0.0, storage.drho[slots], 4001)
    p = scene.eos.pressure(path) + background
    rho = scene.rho0 + path
    gas = storage.is_gas(slots)
    rho[:, gas] = scene.rho0 * (1 + scene.eos.pressure(path[:, gas]) / 1e4) ** (1 / 1.4)
    work = np.sum(0.5 * (p[1:] + p[:-1]) * -np.diff(1 / rho, axis=0), axis=0)  # per mass of the reference liquid
    exact = float(np.sum(storage.m[slots] / storage.relative_density(slots) * work))
    assert 0 < gas.sum() < len(gas) and np.ptp(rho[-1, gas]) > 0.1 * scene.rho0
    assert sph.scalars()["energy_internal"] == pytest.approx(exact, rel=1e-6)
