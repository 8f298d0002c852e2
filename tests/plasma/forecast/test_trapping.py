"""What check says of waves so large that they trap what would damp them."""

import pytest
from forecast_numbers import numbers

from hpcpic.plasma.physics.dispersion import Beam, root_near, susceptibility

WAVE = """
simulation = { cycles = 100; time_step = 0.1; space_length = [12.566370614359172]; };
grid = { points = [64]; };
species = ( { name = "electrons"; charge = -1.0; mass = 1.0; plasma_frequency = 1.0; thermal_velocity = 1.0;
              particles = 4096; init_method = "quiet"; perturbation = { mode = [1]; amplitude = 0.02; }; } );
"""


def told(*sets):
    return numbers(sets, WAVE)[0].get("wB/gamma")


@pytest.mark.parametrize("ratio", [0.25, 0.3, 0.35, 0.4, 0.5, 0.6])
def test_the_bounce_of_trapped_particles_is_told_over_the_damping_of_the_root(ratio):
    root = root_near(
        complex((1 + 3 * ratio**2) ** 0.5, -0.05), lambda w: 1.0 - susceptibility(w, ratio, [Beam(1.0, 0.0, 1.0)])
    )
    number = told(f"simulation.space_length=[{6.283185307179586 / ratio!r}]")
    assert number.value == pytest.approx(0.1 / -root.imag, rel=0.05)  # wB of each of two waves of half of 2 %
    assert not number.limit and "2 pi/wB = 62.8 s" in number.source


@pytest.mark.parametrize("setting", [
    "species[0].thermal_velocity=0.2", "species[0].thermal_velocity=2.0", "species[0].drift_velocity=[1.0]",
    "field.magnetic=[0, 0, 1]", "field.equation.c=-1", "species[0].perturbation.amplitude=0.0",
])  # fmt: skip
def test_what_landau_does_not_damp_alone_is_not_told(setting):
    assert told(setting) is None
