"""The shares of vectors that the estimate expects, beside those of lattices that have been made."""

import pytest
from app_runner import running

from hpcpic.core.comm.world import World
from hpcpic.core.files.config import loads
from hpcpic.core.files.schema import validate
from lbmdem.cases import shipped_cases
from lbmdem.config import LbmDemConfig
from lbmdem.kernels.sweep import MIXED, SKIP
from lbmdem.plan import link_count
from lbmdem.vectors import shares

FIRST_ORDER = 0.1  # of all vectors: expected of spheres that fill 0.6 of a sample is to first order only, off by 0.07
BOX = """
simulation = {{ dimensions = {d}; end_time = 1.0; }};
domain = {{ size = {size}; spacing = 1.0e-3; periodic = {periodic}; }};
fluid = {{ density = 1000.0; viscosity = 1.0e-6; relaxation_time = 0.8; }};
"""


@pytest.mark.parametrize("case", ["poiseuille", "sphere-array", "settling-sphere", "liquefaction"])
def test_the_shares_are_those_of_the_lattice(case):
    with running(World.alone(), "lbmdem", shipped_cases()[case].read_text()) as app:
        kinds, expected = app.fluid._kinds, shares(app.scene.config)
    assert expected.skipped == pytest.approx((kinds == SKIP).mean(), abs=FIRST_ORDER)
    assert expected.mixed == pytest.approx((kinds == MIXED).mean(), abs=FIRST_ORDER)


@pytest.mark.parametrize("case", ["sphere-array", "settling-disc"])
def test_links_of_lone_grains_are_as_many_as_expected(case):
    with running(World.alone(), "lbmdem", shipped_cases()[case].read_text()) as app:
        app.step()
        assert link_count(app.scene.config) == pytest.approx(app.immersed.counts()["links"], rel=0.08)


@pytest.mark.parametrize(
    ("size", "periodic", "mixed"),
    [((0.064, 0.1), ["x", "y"], 0.0), ((0.064, 0.1), ["y"], 0.25), ((0.06, 0.1), ["x", "y"], 1 / 8),
     ((0.064, 0.1), ["x"], 0.02), ((0.064, 0.1, 0.05), ["x"], 1 - 0.98 * 0.96)],
)  # fmt: skip
def test_vectors_at_sides_are_counted(size, periodic, mixed):
    text = BOX.format(d=len(size), size=list(size), periodic=str(periodic).replace("'", '"'))
    found = shares(validate(LbmDemConfig, loads(text)))
    assert found.skipped == 0.0 and found.mixed == pytest.approx(mixed)
