"""The layer of fluid at a plate that swings in its plane (Stokes' second problem), thinner than a spacing or not."""

import math

import numpy as np
import pytest
from test_sph_physics import Done, told

pytestmark = [pytest.mark.validation, pytest.mark.timeout(3600)]

PLATE = """
simulation = {{ dimensions = 2; end_time = 3.0; }};
domain = {{ low = [0.0, {below}]; high = [{long}, {above}]; periodic = ["x"]; }};
eos = {{ max_velocity = {speed}; }};
fluid = ( {{ shape = {{ box = {{ low = [0.0, 0.0]; high = [{long}, {high}]; }}; }}; kinematic_viscosity = {nu}; }} );
numerics = {{ spacing = {dp}; }};
wall = (
  {{ name = "plate"; solid = true; shape = {{ box = {{ low = [0.0, {below}]; high = [{long}, 0.0]; }}; }};
     motion = {{ amplitude = [{swing}, 0.0]; period = 1.0; }}; measure_force = true; }},
  {{ solid = true; shape = {{ box = {{ low = [0.0, {high}]; high = [{long}, {above}]; }}; }}; }}
);
output = {{ period = {{ series = 0.01; }}; }};
"""


@pytest.mark.parametrize("spacings, drag", [(0.25, 0.42), (0.5, 0.81), (1.0, 1.15), (2.0, 1.09), (4.0, 1.03)])
def test_a_plate_that_swings_is_dragged(world, spacings, drag):
    """Force in phase with the velocity, which alone takes energy, over mu U / delta, delta = (2 nu / omega)^0.5, which
    is so many spacings.
    """
    nu, omega, swing = 1e-3, 2 * math.pi, 0.05
    delta = math.sqrt(2 * nu / omega)
    dp = delta / spacings
    high, long, deep = max(24, round(6 * spacings)) * dp, 24 * dp, 6 * dp
    sizes = {"below": -deep, "above": high + deep, "high": high, "long": long, "dp": dp}
    done = Done(world, PLATE.format(speed=swing * omega, nu=nu, swing=swing, **sizes), period=0.01)
    late = done.t > 2.0
    phases = np.stack([np.cos(omega * done.t[late]), np.sin(omega * done.t[late])], axis=1)
    (found, _), *_ = np.linalg.lstsq(phases, done.series("force_plate_x")[late])
    theory = 1000.0 * nu * swing * omega / delta * long
    ratio = told(f"layer of {spacings:g} spacings: drag in phase over theory", -found / theory, "1")
    assert ratio == pytest.approx(drag, abs=0.02)
