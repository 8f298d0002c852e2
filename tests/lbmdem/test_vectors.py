"""The shares of vectors that the estimate expects, beside those of lattices that have been made."""

import pytest
from app_runner import running

from hpcpic.core.comm.world import World
from hpcpic.core.files.config import loads
from hpcpic.core.files.schema import validate
from lbmdem.app import shipped_cases
from lbmdem.config import LbmDemConfig
from lbmdem.estimate import DEFAULT, estimate, phases, share_together
from lbmdem.kernels.sweep import MIXED, SKIP
from lbmdem.plan import link_count
from lbmdem.vectors import lanes_of_all, shares
from lbmdem.wavefront import even_depth

FIRST_ORDER = 0.1  # of all vectors: expected of spheres that fill 0.6 of a sample is to first order only, off by 0.07
BOX = """
simulation = {{ dimensions = {d}; end_time = 1.0; }};
domain = {{ size = {size}; spacing = 1.0e-3; periodic = {periodic}; }};
fluid = {{ density = 1000.0; viscosity = 1.0e-6; relaxation_time = 0.8; }};
"""


@pytest.mark.parametrize("case", ["poiseuille", "sphere-array", "settling-sphere", "liquefaction"])
def test_the_shares_are_those_of_the_lattice(case):
    with running(World.alone(), "lbmdem", shipped_cases()[case].read_text()) as app:
        kinds, expected = app.fluid.kinds, shares(app.scene.config)
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


@pytest.mark.parametrize(("storage", "whole"), [("double", 56), ("single", 64)])
def test_rows_are_swept_by_whole_vectors(storage, whole):
    """50 nodes along x cost what 56, or 64 in single precision, do; what is beside sides is another matter."""
    narrow, wide = (
        validate(LbmDemConfig, loads(BOX.format(d=2, size=[n * 1e-3, 0.1], periodic='["x", "y"]')
                                     .replace("fluid = {", f'fluid = {{ storage = "{storage}";')))
        for n in (50, whole)
    )  # fmt: skip
    assert lanes_of_all(narrow) == lanes_of_all(wide) == whole * 100
    costs = [phases(case, 1, 1, DEFAULT | {"mixed": 0.0}, 1)["nodes"] for case in (narrow, wide)]
    assert costs[0] == costs[1]


def test_memory_of_the_end_is_counted_once_and_shared_by_the_ranks():
    """The state in order is as large as the populations, and each rank holds its part."""
    case = validate(LbmDemConfig, loads(BOX.format(d=2, size=[0.064, 0.1], periodic='["x"]')))
    one, four = (estimate(case, ranks, 1, {}).memory["state in order of rows"] for ranks in (1, 4))
    assert one == 64 * 100 * 9 * 8 and four == one / 4


@pytest.mark.parametrize("depth", range(1, 7))
@pytest.mark.parametrize("period", [1, 2, 3, 7, 13, 100])
def test_the_share_of_steps_that_are_done_together(depth, period):
    left, alone = period, 0
    while left:
        steps = even_depth(depth, left)
        assert steps <= depth
        left, alone = left - steps, alone + (steps == 1)
    assert share_together(depth, period) == pytest.approx(1.0 - alone / period)
