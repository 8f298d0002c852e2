"""One state, bit for bit, however a run is cut: ranks, threads, task blocks, restarts on others of them."""

from itertools import product

import pytest
from app_runner import check_other_arrays_are_refused, check_same, running
from plasma_cases import LINE, PLANE

from hpcpic.core.comm.world import World

STEPS = 20
SINGLE = 'numerics.precision="single"'
LAWS = {
    "2D": (PLANE,),
    "1D NGP single": (LINE, 'numerics.shape="NGP"', SINGLE),
}
MORE_LAWS = LAWS | {
    "2D single, no B": (PLANE, "field.magnetic=[0.0, 0.0, 0.0]", SINGLE),
    "1D": (LINE,),
    "2D single": (PLANE, SINGLE),
    "1D single": (LINE, SINGLE),
    "2D TSC": (PLANE, 'numerics.shape="TSC"'),
    "2D NGP single": (PLANE, 'numerics.shape="NGP"', SINGLE),
    "2D spectral": (PLANE, 'numerics.gradient="spectral"'),
    "2D, B in any direction": (PLANE, "field.magnetic=[0.3, -0.4, 0.5]"),
    "2D, primes": (PLANE, "grid.points=[97, 101]"),
    "2D LU": (PLANE, 'simulation.solver="LU"', "grid.points=[13, 17]"),
    "1D TSC single": (LINE, 'numerics.shape="TSC"', SINGLE),
    "1D, B in any direction": (LINE, "field.magnetic=[0.3, -0.4, 0.5]"),
}
THREADS, BLOCKS = (1, 2), (1, 4, 9)


def jobs(laws):
    """No particle may get lost: a digest is made of all numbers there are, or not at all."""
    made = {law: MORE_LAWS[law] for law in laws}
    return {
        law: {"program": "hpcpic", "case": case, "sets": sets, "steps": STEPS} for law, (case, *sets) in made.items()
    }


def cut(threads, blocks):
    return {"threads": threads, "sets": [f"simulation.plasma_chunks={blocks}"]}


@pytest.mark.timeout(300)  # it may have to compile a minute's worth of kernels
def test_ranks_threads_blocks_and_restarts(tmp_path):
    launches = [
        (2, [cut(1, 4), cut(2, 1)], cut(1, 4)),
        (3, [], cut(1, 9)),  # more ranks than cores take long: they go on with what two have begun
        (1, [cut(1, 1), cut(2, 9)], cut(2, 9)),
    ]
    check_same(tmp_path, jobs(LAWS), launches)


@pytest.mark.parametrize("case", [LINE, PLANE], ids=["line", "plane"])
def test_a_checkpoint_with_other_arrays_is_refused(tmp_path, case):
    with running(World.alone(), "hpcpic", case) as app:
        check_other_arrays_are_refused(app, tmp_path)


@pytest.mark.validation
@pytest.mark.timeout(900)
@pytest.mark.parametrize("law", MORE_LAWS)
def test_full_matrix(tmp_path, law):
    every = [cut(*one) for one in product(THREADS, BLOCKS)]
    check_same(tmp_path, jobs([law]), [(ranks, every, None) for ranks in (1, 2, 3, 4)])


@pytest.mark.validation
@pytest.mark.timeout(900)
def test_many_restarts(tmp_path):
    chain = [
        (1, cut(1, 1)),
        (4, cut(1, 9)),
        (2, cut(2, 4)),
        (3, cut(1, 4)),
        (1, cut(2, 1)),
        (2, cut(1, 9)),
        (4, cut(2, 1)),
        (3, cut(2, 9)),
        (1, cut(1, 4)),
        (2, cut(2, 1)),
    ]
    check_same(tmp_path, jobs(MORE_LAWS), [(1, [{}], None), *((ranks, [], one) for ranks, one in chain)])
