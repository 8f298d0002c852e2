"""Laws of relaxation rates. That the compiled collisions follow them is held by the tests of the fluid."""

import pytest

from lbmdem.physics.collision import COLLISIONS, Collision
from lbmdem.physics.velocity_sets import D2Q9


@pytest.mark.parametrize("tau", [0.501, 0.6, 1.0, 3.0])
@pytest.mark.parametrize("magic", [1 / 12, 3 / 16, 1 / 4])
def test_two_rates_have_the_magic_number(tau, magic):
    """(1/even - 1/2)(1/odd - 1/2) (Ginzburg 2005, Lambda), on which alone the place of half-way walls depends."""
    even, odd = Collision(D2Q9, COLLISIONS["TRT"], tau, magic).rates
    assert even == 1 / tau
    assert (1 / even - 0.5) * (1 / odd - 0.5) == pytest.approx(magic, rel=1e-12)


def test_one_rate_is_two_that_are_equal():
    tau = 0.8
    for scheme, magic in ((COLLISIONS["BGK"], 0.1), (COLLISIONS["TRT"], (tau - 0.5) ** 2)):
        assert Collision(D2Q9, scheme, tau, magic).rates == pytest.approx((1 / tau, 1 / tau), rel=1e-15)
