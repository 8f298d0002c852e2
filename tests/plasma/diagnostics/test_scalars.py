"""A scalar of one's own is a name, a unit and a function; its integrand is compiled for numbers and for vectors."""

import numpy as np
import pytest
from test_moments import plasma_of

import hpcpic
from hpcpic.core.errors import ConfigError
from hpcpic.plasma.diagnostics import scalars
from hpcpic.plasma.diagnostics.series_sums import SeriesSums
from hpcpic.plasma.physics.moments import Moment


def energy_flux(vx, vy, vz, square):
    return square * vx, square * vy, square * vz


ENERGY_FLUX = Moment(energy_flux, power=3, vector=True)


def energy_flux_x(sample):
    return sum(0.5 * species.m * species[ENERGY_FLUX][0] for species in sample.species)


def test_a_registered_scalar_is_summed_exactly_in_every_sample(world, monkeypatch):
    monkeypatch.setattr(scalars, "SCALARS", dict(scalars.SCALARS))
    scalars.register(scalars.Scalar("energy_flux_x", "W m", energy_flux_x, (ENERGY_FLUX,)))
    neutral = (f"species[{k}].{what}" for k in (0, 1) for what in ("charge=1e-30", "plasma_frequency=0.0"))
    plasma = plasma_of(world, (*neutral, 'numerics.precision="double"'))
    assert plasma.scalar_units["energy_flux_x"] == "W m"
    found, particles = plasma.scalars()["energy_flux_x"], plasma.particles()
    expected = size = 0.0
    for species in plasma.scene.species:
        v = particles[species.name].columns["velocity"]
        terms = 0.5 * species.m * (v**2).sum(axis=1) * v[:, 0]
        expected, size = expected + terms.sum(), size + np.abs(terms).sum()
    assert found == pytest.approx(expected, abs=1e-14 * size)  # the sum of numpy is rounded
    plasma.cloud.kernels = plasma.cloud.spec.kernels(plain=True)
    plasma.sums = SeriesSums(plasma.scene, world, plasma.mesh, plasma.cloud, plasma.field_scale)
    assert plasma.scalars()["energy_flux_x"] == found
    plasma.close()


def hot(sample):
    return 7.0


def cold(sample):
    return 0.0


def test_a_name_that_is_taken_is_refused_unless_its_function_is_defined_again(monkeypatch):
    monkeypatch.setattr(scalars, "SCALARS", dict(scalars.SCALARS))
    for name in ("charge", "momentum_x"):
        with pytest.raises(ValueError, match=f"another scalar '{name}': give yours another name"):
            scalars.register(scalars.Scalar(name, "K", hot))
    scalars.register(scalars.Scalar("heat", "K", hot))
    again = type(hot)(hot.__code__, hot.__globals__)  # as a cell of a notebook does that is run twice
    scalars.register(scalars.Scalar("heat", "K", again))
    with pytest.raises(ValueError, match="another scalar 'heat'"):
        scalars.register(scalars.Scalar("heat", "K", cold))


@pytest.mark.parametrize("name, owner", [("mode_1_0_re", "output.modes"), ("gauge_1", "gauge 'gauge_1'")])
def test_a_case_with_a_column_of_the_name_of_a_scalar_is_refused(monkeypatch, name, owner):
    monkeypatch.setattr(scalars, "SCALARS", dict(scalars.SCALARS))
    scalars.register(scalars.Scalar(name, "K", hot))
    case = {"simulation": {"cycles": 1, "time_step": 0.1, "space_length": [8.0, 8.0]}, "grid": {"points": [8, 8]},
            "gauge": [{"what": "phi", "at": [1.0, 1.0]}], "output": {"modes": [[1, 0]]}, "species": []}  # fmt: skip
    with pytest.raises(ConfigError, match=f"(?=.*{owner})(?=.*column {name}).*otherwise"):
        hpcpic.Case(**case)


def pressure(vx, vy, vz, square):
    return vx * vy


def across(vx, vy, vz, square):
    return square * vx, square * vx, square * vz


@pytest.mark.parametrize("moment", [Moment(pressure, 2), Moment(across, 3, vector=True)])
def test_an_integrand_that_mixes_axes_is_refused(moment):
    """Cells may have other sides along other axes: the sum would be off by powers of their ratio, in silence."""
    with pytest.raises(ValueError, match="made of square, times one component"):
        scalars.register(scalars.Scalar("mine", "J", lambda sample: 0.0, (moment,)))
    assert "mine" not in scalars.SCALARS
