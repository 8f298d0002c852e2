"""Signed distances: negative inside, and the nearest point of the surface is so far away, along the gradient."""

from functools import partial

import numpy as np
import pytest

from hpcpic.core.space import shapes

SHAPES = {  # name -> distance in d dimensions, and a point inside
    "box": (lambda d: partial(shapes.box, low=np.full(d, -0.4), high=np.arange(1.0, d + 1)), lambda d: np.zeros(d)),
    "ball": (lambda d: partial(shapes.ball, centre=np.full(d, 0.2), radius=0.7), lambda d: np.full(d, 0.1)),
    "cylinder": (
        lambda d: partial(shapes.cylinder, base=np.zeros(d), top=np.linspace(0.5, 1.0, d), radius=0.3),
        lambda d: np.linspace(0.2, 0.4, d),
    ),
    "plane": (
        lambda d: partial(shapes.plane, point=np.full(d, 0.1), normal=np.arange(1.0, d + 1)),
        lambda d: -np.ones(d),
    ),
}


ANVIL = [(0.0, 0.0), (1.0, 0.0), (0.7, 0.4), (1.2, 0.8), (-0.2, 0.9), (0.3, 0.4)]  # hollow on both sides
SHAPES["polygon"] = (lambda d: partial(shapes.polygon, corners=ANVIL), lambda d: np.full(d, 0.5))


@pytest.mark.parametrize("name, d", [(name, d) for name in SHAPES for d in (2, 3) if (name, d) != ("polygon", 3)])
def test_along_its_gradient_a_signed_distance_leads_to_the_surface(name, d):
    make, inside = SHAPES[name]
    distance = make(d)
    assert distance(inside(d)[None])[0] < 0
    x = np.random.default_rng(1).uniform(-2, 3, (4000, d))
    found, step = distance(x), 1e-6
    gradient = np.stack([distance(x + e) - distance(x - e) for e in step * np.eye(d)], axis=1) / (2 * step)
    smooth = np.abs(np.linalg.norm(gradient, axis=1) - 1) < 1e-6  # else between two nearest points
    assert smooth.mean() > 0.99 and (found < 0).any() and (found > 0).any()
    surface = x - found[:, None] * gradient
    assert np.abs(distance(surface)[smooth]).max() < 1e-5  # of the differences
    between = distance(0.5 * (x + surface))[smooth]
    np.testing.assert_allclose(between, 0.5 * found[smooth], atol=1e-5)
