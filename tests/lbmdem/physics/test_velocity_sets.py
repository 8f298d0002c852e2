import numpy as np
import pytest

from lbmdem.kernels.layout import Layout, storage_order
from lbmdem.physics.velocity_sets import CS2, LATTICES


@pytest.mark.parametrize("lattice", LATTICES.values(), ids=list(LATTICES))
def test_moments_are_isotropic_to_fourth_order(lattice):
    e, w, d = lattice.e, lattice.w, lattice.dimensions
    one = np.eye(d)
    assert w.sum() == pytest.approx(1.0, abs=1e-15)
    assert not e.sum(axis=0).any()
    np.testing.assert_allclose(np.einsum("q,qa,qb->ab", w, e, e), CS2 * one, atol=1e-16)
    fourth = np.einsum("q,qa,qb,qc,qd->abcd", w, e, e, e, e)
    pairs = np.einsum("ab,cd->abcd", one, one) + np.einsum("ac,bd->abcd", one, one) + np.einsum("ad,bc->abcd", one, one)
    np.testing.assert_allclose(fourth, CS2**2 * pairs, atol=1e-16)


@pytest.mark.parametrize("lattice", LATTICES.values(), ids=list(LATTICES))
def test_pairs_are_opposite_and_point_up(lattice):
    assert not lattice.e[0].any() and lattice.q == len({tuple(e) for e in lattice.e})
    for i, j in lattice.pairs:
        assert (lattice.e[i] == -lattice.e[j]).all() and lattice.opposite[i] == j and lattice.opposite[j] == i
        assert storage_order(lattice, i) > (0, 0, 0)


@pytest.mark.parametrize("lattice", LATTICES.values(), ids=list(LATTICES))
def test_arrivals_of_a_periodic_slab_share_no_element(lattice):
    """The storage is a bijection between (node, direction) and elements, at either parity."""
    from lbmdem.kernels.layout import arrival

    shape = (3, 4, 5)[-lattice.dimensions :]
    layout = Layout.of(lattice, shape, (True,) * lattice.dimensions, True, np.float64)
    nodes = [(z, y, x) for z in range(layout.planes) for y in range(layout.rows) for x in range(layout.nx)]
    for parity in range(2):
        places = {
            int(arrival(layout.strides, layout.slots, layout.shifts, parity, *node, i))
            for node in nodes
            for i in range(lattice.q)
        }
        assert len(places) == len(nodes) * lattice.q
        assert min(places) >= 0 and max(places) < layout.size
