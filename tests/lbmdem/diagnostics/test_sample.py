"""Control slices of a sample."""

import numpy as np

from lbmdem.diagnostics.sample import slice_edges


def test_slices_keep_away_from_the_ends():
    np.testing.assert_allclose(slice_edges(0.0, 10.0, 0.5, 3), [0.5, 3.5, 6.5, 9.5])
    np.testing.assert_allclose(slice_edges(0.0, 2.0, 0.5, 2), [0.2, 1.0, 1.8])
