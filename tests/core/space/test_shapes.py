import numpy as np
import pytest

from hpcpic.core.space.shapes import Box, Cylinder, Plane, Sphere

POINTS = np.random.default_rng(1).uniform(-1, 1, (400_000, 3))
ALMOST = 5 / np.sqrt(len(POINTS))  # five standard deviations of a fraction


@pytest.mark.parametrize(
    "shape, volume",
    [
        (Box((-0.5, -0.5, 0.0), (0.5, 0.25, 1.0)), 0.75),
        (Sphere((0.1, 0.0, 0.0), 0.8), 4 / 3 * np.pi * 0.8**3),
        (Cylinder((0.0, 0.0, -0.5), (0.0, 0.0, 0.75), 0.6), np.pi * 0.36 * 1.25),
        (Cylinder((-0.3, -0.3, -0.3), (0.3, 0.3, 0.3), 0.4), np.pi * 0.16 * np.sqrt(1.08)),
        (Plane((0.0, 0.0, 0.25), (0.0, 0.0, 2.0)), 5.0),
    ],
)
def test_volume_is_that_of_geometry(shape, volume):
    assert abs(shape.contains(POINTS).mean() - volume / 8) < ALMOST


def test_boundaries_count_as_inside():
    on = np.array([[1.0, 0.0]])
    for shape in (Box((0.0, 0.0), (1.0, 1.0)), Sphere((0.0, 0.0), 1.0), Plane((1.0, 5.0), (1.0, 0.0))):
        assert shape.contains(on)[0] and not shape.contains(np.nextafter(on, 2.0)[:, :1] * [1.0, 0.0])[0]
    assert Cylinder((0.0, 0.0), (1.0, 0.0), 0.1).contains(on)[0]


def test_impossible_shapes_are_refused():
    for make in (
        lambda: Box((0.0, 1.0), (1.0, 0.0)),
        lambda: Cylinder((0.0,), (0.0,), 1.0),
        lambda: Plane((0.0,), (0.0,)),
    ):
        with pytest.raises(ValueError):
            make()
