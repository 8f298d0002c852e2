"""How grains lie at the start, against all pairs in turn."""

from types import SimpleNamespace

import numpy as np
import pytest

from lbmdem.case.config import GrainSet
from lbmdem.setup.overlap_survey import starts


def plain(sets, length, periodic):
    """Least distance of two centres, and greatest overlap of a moving grain, by the definition."""
    grains = [(np.array(p), some.diameter, some.moving) for some in sets for p in some.position]
    distances, overlaps = [np.inf], [0.0]
    for i, (x, d, moves) in enumerate(grains):
        for y, other, also in grains[:i]:
            apart = (y - x) - np.where(periodic, length * np.rint((y - x) / length), 0.0)
            distances.append(np.linalg.norm(apart))
            if moves or also:
                overlaps.append((0.5 * (d + other) - distances[-1]) / min(d, other))
        if moves:
            overlaps += [(0.5 * d - gap) / d for gap in np.minimum(x, length - x)[~periodic]]
    return min(distances), max(overlaps)


@pytest.mark.parametrize("seed", range(30))
def test_the_deepest_overlap_is_that_of_all_pairs(seed):
    rng = np.random.default_rng(seed)
    d = int(rng.integers(2, 4))
    length, periodic = rng.uniform(1.0, 2.0, d), rng.random(d) < 0.5
    sets = [
        GrainSet(position=(rng.uniform(-0.2, 1.2, (n, d)) * length).tolist(), diameter=size, moving=moves)
        for n, size, moves in ((rng.integers(1, 30), 0.2, True), (rng.integers(1, 30), 0.05, seed % 2 == 0))
    ]
    names = tuple(axis for axis, around in zip("xyz", periodic) if around)
    config = SimpleNamespace(grains=sets, obstacle=(), domain=SimpleNamespace(size=tuple(length), periodic=names))
    (nearest, deepest, _), (wanted, overlap) = starts(config), plain(sets, length, periodic)
    assert deepest == pytest.approx(overlap, abs=1e-12)  # of places a few boxes away
    assert nearest == pytest.approx(wanted, abs=1e-12) or wanted > 0.05
