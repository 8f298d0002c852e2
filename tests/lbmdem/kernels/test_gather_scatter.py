"""Lanes side by side: in order, as many as are meant, by each way to compile them."""

import numba
import numpy as np
import pytest

from hpcpic.core.simd.registers import compiled_for
from hpcpic.core.simd.vector import Vec, lanes, load
from lbmdem.kernels import gather_scatter
from lbmdem.kernels.gather_scatter import store_side_by_side

M = lanes(np.int32)
KIND = Vec(M, np.int32)


@pytest.mark.parametrize("permuted", [False, True][: 1 + compiled_for("avx2")])
def test_lanes_stand_side_by_side_in_their_order(permuted, monkeypatch):
    monkeypatch.setattr(gather_scatter, "has_masks", lambda: not permuted)

    @numba.njit
    def pack(values, chosen, target, at):
        store_side_by_side(target, at, load(KIND, values, 0), load(KIND, chosen, 0) != np.int32(0))

    rng, values = np.random.default_rng(1), np.arange(100, 100 + M, dtype=np.int32)
    for share in (0.0, 0.1, 0.5, 0.9, 1.0, *rng.random(200)):
        chosen = (rng.random(M) < share).astype(np.int32)
        target = np.full(2 * M, -1, np.int32)
        pack(values, chosen, target, 3)
        n = int(chosen.sum())
        assert target[:3].tolist() == [-1] * 3 and target[3 : 3 + n].tolist() == values[chosen == 1].tolist()
        assert (target[3 + M :] == -1).all()
