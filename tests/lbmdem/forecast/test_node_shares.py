"""The shares of vectors that the estimate expects, beside those of lattices that have been made."""

import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.simd.registers import lanes
from lbmdem.app import shipped_cases
from lbmdem.configure import configure
from lbmdem.fluid.temporal_blocking import even_depth
from lbmdem.forecast.estimate import estimate, phases, share_together
from lbmdem.forecast.node_shares import lanes_of_all, shares
from lbmdem.forecast.plan import arrays, link_count
from lbmdem.forecast.rates import DEFAULT
from lbmdem.kernels.sweep import MIXED, SKIP
from lbmdem.sizes import STORAGE

FIRST_ORDER = 0.1  # of all vectors: expected of spheres that fill 0.6 of a sample is to first order only, off by 0.07
BOX = """
simulation = {{ dimensions = {d}; end_time = 1.0; }};
domain = {{ size = {size}; spacing = 1.0e-3; periodic = {periodic}; }};
fluid = {{ density = 1000.0; viscosity = 1.0e-6; relaxation_time = 0.8; }};
"""


@pytest.mark.parametrize("case", ["poiseuille", "sphere-array", "settling-sphere", "liquefaction"])
def test_the_shares_are_those_of_the_lattice(case):
    with running(World.alone(), "lbmdem", shipped_cases()[case].read_text()) as app:
        kinds, expected, held = app.fluid.nodes.kinds, shares(app.scene.config), app.fluid.f.nbytes
        assert next(arrays(app.scene.config, 1)).bytes == held
    assert expected.skipped == pytest.approx((kinds == SKIP).mean(), abs=FIRST_ORDER)
    assert expected.mixed == pytest.approx((kinds == MIXED).mean(), abs=FIRST_ORDER)


@pytest.mark.parametrize("case", ["sphere-array", "settling-disc", "couette"])
def test_links_of_lone_solids_are_as_many_as_expected(case):
    with running(World.alone(), "lbmdem", shipped_cases()[case].read_text()) as app:
        app.step()
        assert link_count(app.scene.config) == pytest.approx(app.immersed.counts()["links"], rel=0.08)


@pytest.mark.parametrize(("case", "sets", "rel"), [
    ("sphere-array", (), 0.08),
    ("permeability", ("domain.spacing=2.0e-5",), 0.25),  # held without solid nodes; grains in contact share links
])  # fmt: skip
def test_the_plan_lists_the_arrays_that_a_run_has(case, sets, rel):
    """By name, type and, as far as it is known beforehand, size."""
    with running(World.alone(), "lbmdem", shipped_cases()[case].read_text(), sets) as app:
        planned = {array.name: array for array in arrays(app.scene.config, 1)}
        arenas = app.fluid._arena, app.immersed._fixed_links.arena
        held = {array.name: arena[array.name] for arena in arenas for array in arena.declared.values()}
    assert {name for name, values in held.items() if values.size} <= set(planned)
    for name in ("populations", "masks", "shifts", "linked", "node", "weights", "arm", "kept"):
        assert (name in held) == (name in planned)
        if name in held:
            assert planned[name].dtype == held[name].dtype.name
            assert planned[name].bytes == pytest.approx(held[name].nbytes, rel=rel), name


@pytest.mark.parametrize(
    ("vectors", "others", "periodic", "mixed"),
    [(8, (100,), ["x", "y"], 0.0), (8, (100,), ["y"], 0.25), (7.5, (100,), ["x", "y"], 1 / 8),
     (8, (100,), ["x"], 0.02), (8, (100, 50), ["x"], 1 - 0.98 * 0.96)],
)  # fmt: skip
def test_vectors_at_sides_are_counted(vectors, others, periodic, mixed):
    """Of rows of so many vectors of the registers that there are: the ends that are solid or not whole."""
    size = [1.0e-3 * n for n in (round(vectors * lanes("f8")), *others)]
    text = BOX.format(d=len(size), size=size, periodic=str(periodic).replace("'", '"'))
    found = shares(configure(loads(text)))
    assert found.skipped == 0.0 and found.mixed == pytest.approx(mixed)


@pytest.mark.parametrize("storage", ["double", "single"])
def test_rows_are_swept_by_whole_vectors(storage):
    """49 nodes along x cost what the next whole number of vectors does; what is beside sides is another matter."""
    whole = -(-49 // lanes(STORAGE[storage])) * lanes(STORAGE[storage])
    narrow, wide = (
        configure(loads(BOX.format(d=2, size=[n * 1e-3, 0.1], periodic='["x", "y"]')
                                     .replace("fluid = {", f'fluid = {{ storage = "{storage}";')))
        for n in (49, whole)
    )  # fmt: skip
    assert lanes_of_all(narrow) == lanes_of_all(wide) == whole * 100
    costs = [phases(case, 1, 1, DEFAULT | {"mixed": 0.0}, 1)["nodes"] for case in (narrow, wide)]
    assert costs[0] == costs[1]


def test_memory_of_the_end_is_counted_once_and_shared_by_the_ranks():
    """The state in order is as large as the populations, and each rank holds its part."""
    case = configure(loads(BOX.format(d=2, size=[0.064, 0.1], periodic='["x"]')))
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
