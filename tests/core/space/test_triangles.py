"""Distances from surfaces of triangles are those of the shapes that they are made of."""

import numpy as np
import pytest

from hpcpic.core.space import shapes
from hpcpic.core.space.triangles import Surface

LOW, HIGH = np.array([-1.0, -2.0, 0.5]), np.array([2.0, 1.0, 1.5])
FLAT = np.array([[0, 1, 2], [0, 2, 3]])
CUBE = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def block(low, high):
    """Corners and triangles of a box."""
    corners = np.array([[low, high][i][k] for x in np.ndindex(2, 2, 2) for k, i in enumerate(x)]).reshape(8, 3)
    return corners.astype(float), np.concatenate([face[FLAT] for face in CUBE])


def places(n=4000, margin=1.5):
    return np.random.default_rng(1).uniform(LOW - margin, HIGH + margin, (n, 3))


def test_a_block_of_triangles_has_the_distances_of_a_box():
    x = places()
    surface = Surface(*block(LOW, HIGH))
    apart, ways = surface.distances(x), surface.directions(x)
    np.testing.assert_allclose(apart, shapes.box(x, LOW, HIGH), rtol=0, atol=1e-14)
    step, far = 1e-6, np.abs(apart) > 0.01
    grows = [shapes.box(x + move, LOW, HIGH) - shapes.box(x - move, LOW, HIGH) for move in step * np.eye(3)]
    slope = np.stack(grows, axis=1) / (2 * step)
    unit = ways / np.sqrt(np.sum(ways**2, axis=1))[:, None]
    smooth = far & (np.abs(np.sqrt(np.sum(slope**2, axis=1)) - 1) < 1e-6)  # but for the ridges inside
    np.testing.assert_allclose(unit[smooth], slope[smooth], atol=1e-6)


def test_distances_know_no_order_of_triangles_nor_slivers_between_them():
    corners, faces = block(LOW, HIGH)
    x, rng = places(), np.random.default_rng(2)
    mixed = np.array([np.roll(face, k) for face, k in zip(rng.permutation(faces), rng.integers(0, 3, len(faces)))])
    whole = Surface(corners, faces).distances(x)
    np.testing.assert_allclose(Surface(corners, mixed).distances(x), whole, rtol=0, atol=1e-14)
    a, b, c = faces[0]  # a corner on the edge from a to b, off it by rounding, and the sliver that closes the gap
    middle = (corners[a] + corners[b]) / 2 + [1e-9, 1e-9, -1e-9]
    split = [[a, len(corners), c], [len(corners), b, c], [a, b, len(corners)], *faces[1:].tolist()]
    found = Surface(np.vstack([corners, middle]), np.array(split)).distances(x)
    np.testing.assert_allclose(found, whole, rtol=0, atol=1e-8)


@pytest.mark.parametrize("height", [0.2, 5.0, 40.0])
def test_what_is_beyond_a_spike_is_outside_and_in_a_notch_too(height):
    """There single faces look away from the point; the notch is the spike taken out of a block."""
    corners, faces = block([-2.0, -2.0, -height - 1.0], [2.0, 2.0, 0.0])
    top = [face for face in faces.tolist() if (corners[face, 2] == 0.0).all()]
    others = [face for face in faces.tolist() if face not in top]
    ring = [1, 5, 7, 3]  # of the top, counterclockwise
    for tip in (height, -height):
        fan = [[ring[k], ring[(k + 1) % 4], 8] for k in range(4)]
        found = Surface(np.vstack([corners, [0.3, 0.1, tip]]), np.array(others + fan))
        x = np.array([0.3, 0.1, tip]) + [0.0, 0.0, 1e-3] * np.array([[1.0], [-1.0]])
        x = np.concatenate([x + np.array(move) for move in ((0, 0, 0), (1e-5, 2e-5, 0), (-2e-5, 1e-5, 0))])
        assert (np.sign(found.distances(x)) == [1, -1, 1, -1, 1, -1]).all()


@pytest.mark.parametrize("reach", [0.0, 0.3, 2.0])
def test_within_its_reach_a_distance_is_exact_and_beyond_its_side_is(reach):
    surface, way = Surface(*block(LOW, HIGH)), np.linspace(-1.0, 1.0, 2000)[:, None]
    x = np.array([0.5, -0.5, 1.0]) + way * [4.0, 4.1, 1.3]  # points in turn that are near each other
    exact, found = surface.distances(x), surface.distances(x, reach)
    near = np.abs(exact) <= reach
    assert (found[near] == exact[near]).all() and (np.sign(found) == np.sign(exact)).all()
    assert (np.abs(found[~near]) > reach).all() and (np.abs(found) <= np.abs(exact) + 1e-14).all()
    assert np.count_nonzero(found != exact) > 1000 * (reach < 1.0)
