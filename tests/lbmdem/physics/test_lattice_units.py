"""Units of the lattice: what mechanics says of them, whatever spacing, step and density are."""

import pytest

from lbmdem.physics.units import Units


@pytest.mark.parametrize("d", [2, 3])
def test_units_obey_mechanics(d):
    dx, dt, rho = 3e-4, 7e-6, 850.0
    unit = Units(dx, dt, rho, d)
    assert unit.mass == pytest.approx(rho * dx**d)
    assert unit.velocity * dt == pytest.approx(dx) and unit.acceleration * dt == pytest.approx(unit.velocity)
    assert unit.force * dt == pytest.approx(unit.mass * unit.velocity)  # impulse
    assert unit.pressure * dx ** (d - 1) == pytest.approx(unit.force)  # on a side of a cell
    assert unit.torque == pytest.approx(unit.mass * unit.velocity**2)  # both are energies
