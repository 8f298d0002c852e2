import numpy as np
import pytest
from sph_scenes import by_id, engine, jitter, layers, reference
from test_terms import ROUNDING, SINGLE

OIL = {"densities": (1000.0, 400.0), "viscosities": (5.0, 0.5)}


def check(tolerance, **settings):
    sph = engine(case=layers(**settings))
    jitter(sph)
    expected = reference(sph)
    for name, wanted, evaluate in (
        ("a", expected.acceleration(), sph.evolution.evaluate_forces if sph.spec.split else sph.evolution.evaluate),
        ("rate", expected.rate(), sph.evolution.evaluate_rates if sph.spec.split else sph.evolution.evaluate),
    ):
        evaluate()
        found, m = by_id(sph, name, "m")
        assert np.abs(found - wanted).max() <= tolerance * np.abs(wanted).max()
        if name == "a":
            assert np.abs((m * found).sum(axis=1)).max() <= tolerance * np.abs(m * found).sum()


@pytest.mark.parametrize(
    "integrator, form, flux, more",
    [
        ("symplectic", "morris", "delta", {}),
        ("euler", "cleary", "fourtakas", {}),
        ("symplectic", "morris", "rusanov", {"densities": (1000.0, 1000.0)}),
        ("euler", "artificial", "molteni", {"continuity": "masses", "densities": (300.0, 900.0)}),
        ("symplectic", "morris", "delta", {"corrected": "true", "tensile": 0.2}),
    ],
)
def test_sums_of_two_liquids_are_those_over_all_pairs_and_keep_momentum(integrator, form, flux, more):
    check(1e-11 if "corrected" in more else ROUNDING, integrator=integrator, form=form, flux=flux, **(OIL | more))


def test_sums_of_two_liquids_in_single_precision():
    check(SINGLE, d=3, spacing=0.1, form="morris", precision="single", flux="delta", **OIL)
