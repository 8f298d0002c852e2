import numpy as np
import pytest
from seldom import seldom
from sph_scenes import by_id, engine, jitter, layers, reference
from test_terms import ROUNDING, SINGLE

OIL = {"densities": (1000.0, 400.0), "viscosities": (5.0, 0.5)}
AIR = {"densities": (1000.0, 1.25), "viscosities": (5.0, 0.002), "ambient": 2e4}  # pushed together by a tenth


@pytest.mark.parametrize(
    "tolerance, integrator, form, flux, more",
    [
        # 1e-11: of the inverse matrices too
        seldom(1e-11, "symplectic", "morris", "delta", {"corrected": "true", "tensile": 0.2}),
        (ROUNDING, "euler", "cleary", "fourtakas", {}),
        seldom(ROUNDING, "symplectic", "morris", "rusanov", {"densities": (1000.0, 1000.0)}),
        (ROUNDING, "euler", "artificial", "molteni", {"continuity": "masses", "densities": (300.0, 900.0)}),
        seldom(SINGLE, "symplectic", "morris", "delta", {"d": 3, "spacing": 0.1, "precision": "single"}),
        (ROUNDING, "symplectic", "morris", "delta", AIR),
        seldom(ROUNDING, "euler", "artificial", "rusanov", AIR),
        seldom(ROUNDING, "symplectic", "cleary", "fourtakas", AIR | {"corrected": "true", "gamma": 6.5}),
        seldom(SINGLE, "symplectic", "artificial", "none", AIR | {"d": 3, "spacing": 0.1, "precision": "single"}),
    ],
)
def test_sums_of_two_liquids_are_those_over_all_pairs_and_keep_momentum(tolerance, integrator, form, flux, more):
    sph = engine(case=layers(integrator=integrator, form=form, flux=flux, **(OIL | more)))
    jitter(sph)
    expected = reference(sph)
    (sph.evolution.evaluate_forces if sph.spec.split else sph.evolution.evaluate)()
    a, m = by_id(sph, "a", "m")
    assert np.abs(a - expected.acceleration()).max() <= tolerance * np.abs(a).max()
    assert np.abs((m * a).sum(axis=1)).max() <= tolerance * np.abs(m * a).sum()
    if sph.spec.split:
        sph.evolution.evaluate_rates()
    rate = by_id(sph, "rate")[0]
    assert np.abs(rate - expected.rate()).max() <= tolerance * np.abs(rate).max()
