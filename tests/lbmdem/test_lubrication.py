"""Resistance of thin films."""

import numpy as np
import pytest
from scipy.integrate import quad

from lbmdem.lubrication import ROUGHNESS, Film


def squeezed(gap, radius, dimensions):
    """Force over velocity of the parabolic film: pressure 6 mu U R / h^2 or 3 mu U R / h^2 (Reynolds), mu = 1."""

    def height(s):
        return gap + s * s / (2 * radius)

    if dimensions == 2:
        return quad(lambda s: 6 * radius / height(s) ** 2, -np.inf, np.inf, epsabs=0, limit=500)[0]
    return quad(lambda s: 3 * radius / height(s) ** 2 * 2 * np.pi * s, 0, np.inf, epsabs=0, limit=500)[0]


@pytest.mark.parametrize("dimensions", [2, 3])
def test_resistance_is_the_film_less_that_at_the_cut_off(dimensions):
    film = Film(2.0, 0.05, dimensions)
    for gap in (0.001, 0.01, 0.04):
        wanted = 2.0 * (squeezed(gap, 0.7, dimensions) - squeezed(0.05, 0.7, dimensions))
        assert film.resistance(gap, 0.7) == pytest.approx(wanted, rel=1e-7)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_films_begin_at_the_cut_off_and_end_at_contact(dimensions):
    film = Film.of_lattice(1.0, 0.1, dimensions)
    gaps = np.linspace(0.0, film.cut_off, 200)
    values = np.array([film.resistance(gap, 0.5) for gap in gaps])
    assert np.all(np.diff(values) <= 0.0) and values[-1] == 0.0
    assert values[0] == film.resistance(ROUGHNESS * 0.5, 0.5) > 0.0
    assert film.resistance(-1e-9, 0.5) == 0.0
    assert film.resistance(0.999 * film.cut_off, 0.5) < 0.01 * values[0]


@pytest.mark.parametrize("dimensions", [2, 3])
def test_units_by_powers_of_two_give_the_same_bits(dimensions):
    one, other = Film(0.3, 0.05, dimensions), Film(0.3 * 2.0**10, 0.05 * 2.0**-20, dimensions)
    scale = 2.0**10 * (2.0**-20 if dimensions == 3 else 1.0)
    assert other.resistance(0.01 * 2.0**-20, 0.7 * 2.0**-20) == one.resistance(0.01, 0.7) * scale


def test_shearing_of_spheres():
    """The logarithms of Jeffrey & Onishi: 6 pi mu a times 1/6 for equal spheres, 8/15 at a plane."""
    film = Film(2.0, 0.04, 3)
    cut = 0.75 * 0.04
    for gap in (0.001, 0.01, 0.029):
        unit = 6 * np.pi * 2.0 * 0.5 * np.log(cut / gap)
        assert film.shear_resistance(gap, 0.5, 0.5) == pytest.approx(unit / 6)
        assert film.shear_resistance(gap, 0.5) == pytest.approx(unit * 8 / 15)
        assert film.shear_resistance(gap, 0.5, 5e8) == pytest.approx(unit * 8 / 15)
        assert film.shear_resistance(gap, 0.5, 0.2) == film.shear_resistance(gap, 0.2, 0.5)
    assert film.shear_resistance(cut, 0.5) == film.shear_resistance(-1e-9, 0.5) == 0.0
    assert Film(2.0, 0.04, 2).shear_resistance(0.001, 0.5, 0.5) == 0.0
