"""One state, bit for bit, however a run is cut: ranks, threads, task blocks, restarts on others of them."""

from itertools import product

import pytest
from plasma_runner import LINE, PARTICLES, PLANE, outcomes

STEPS = 20
SINGLE = 'numerics.precision="single"'
LAWS = {"2D": (PLANE,), "2D single": (PLANE, SINGLE), "1D": (LINE,), "1D single": (LINE, SINGLE)}
MORE_LAWS = LAWS | {
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


def job(law, threads, blocks, steps=STEPS, **more):
    case, *sets = MORE_LAWS[law]
    sets = [*sets, f"simulation.plasma_chunks={blocks}"]
    return {"case": case, "sets": sets, "threads": threads, "steps": steps} | more


def check_equal(folder, laws, cuts):
    """cuts[ranks] = (threads, blocks)s: all give each law's digest, scalars and charge bit for bit."""
    found = {law: {} for law in laws}
    for ranks, cut in cuts.items():
        asked = list(product(laws, cut))
        made = outcomes(folder, ranks, [job(law, *parts) for law, parts in asked])
        for (law, parts), outcome in zip(asked, made, strict=True):
            found[law][ranks, *parts] = outcome
    for law, made in found.items():
        one = made[1, 1, 1]
        assert {cut: outcome for cut, outcome in made.items() if outcome != one} == {}, law
        assert one["particles"] == PARTICLES and len(made) == sum(map(len, cuts.values()))
    assert len({made[1, 1, 1]["digest"] for made in found.values()}) == len(laws)  # it does tell states apart


def check_restarted(folder, laws, cuts):
    """cuts = (ranks, threads, blocks)s, one after the other, each from the checkpoint of the one before."""
    whole = outcomes(folder, 1, [job(law, 1, 1) for law in laws])
    for k, (ranks, *parts) in enumerate(cuts, start=1):
        jobs = []
        for law in laws:
            steps = STEPS * k // len(cuts)
            kept = folder / law
            kept.mkdir(exist_ok=True)
            resume = {"resume": str(kept)} if k > 1 else {}
            jobs.append(job(law, *parts, steps, save=str(kept), **resume))
        made = outcomes(folder, ranks, jobs)
    assert made == whole


def test_ranks_threads_and_blocks(tmp_path):
    cuts = {1: list(product(THREADS, BLOCKS)), 2: [(1, 4), (2, 1)], 3: [(1, 9)], 4: [(1, 1)]}
    check_equal(tmp_path, LAWS, cuts)


def test_restart_on_other_ranks(tmp_path):
    check_restarted(tmp_path, LAWS, [(2, 1, 4), (3, 1, 1), (1, 2, 9)])


@pytest.mark.validation
@pytest.mark.timeout(900)
@pytest.mark.parametrize("law", MORE_LAWS)
def test_full_matrix(tmp_path, law):
    check_equal(tmp_path, [law], {ranks: list(product(THREADS, BLOCKS)) for ranks in (1, 2, 3, 4)})


@pytest.mark.validation
@pytest.mark.timeout(900)
def test_many_restarts(tmp_path):
    chain = [
        (1, 1, 1),
        (4, 1, 9),
        (2, 2, 4),
        (3, 1, 4),
        (1, 2, 1),
        (2, 1, 9),
        (4, 2, 1),
        (3, 2, 9),
        (1, 1, 4),
        (2, 2, 1),
    ]
    check_restarted(tmp_path, MORE_LAWS, chain)
