"""Gauges in the fluid of the lattice: the mean over the box is the momentum, and grains are left out."""

import numpy as np
import pytest
from app_runner import running

from hpcpic.core.comm.world import World

CASE = """
simulation = { end_time = 0.04; };
domain = { size = [0.0048, 0.006]; spacing = 0.0002; periodic = ["x", "y"]; };
fluid = { kinematic_viscosity = 1.0e-6; relaxation_time = 0.8; body_force = [0.01, 0.005]; };
grains = ({ name = "posts"; diameter = 1.6e-3; moving = false; position = [0.0022, 0.0012]; });
gauge = (
  { name = "whole"; what = "velocity"; at = [0.0024, 0.003]; size = [0.0048, 0.006]; },
  { name = "post"; what = "pressure"; at = [0.0022, 0.0012]; },
  { name = "slowest"; what = "velocity"; at = [0.0024, 0.003]; size = [0.0048, 0.006]; take = "minimum"; } );
"""


def test_the_mean_velocity_is_the_momentum_over_the_mass():
    with running(World.alone(), "lbmdem", CASE) as app:
        for _ in range(40):
            app.step()
        values = app.scalars()
        assert {name: app.scalar_units[name] for name in ("whole_x", "whole_y", "post")} == {
            "whole_x": "m/s", "whole_y": "m/s", "post": "Pa",
        }  # fmt: skip
        velocity, solid = app.fields()["velocity"].values, app.fields()["solid"].values > 0
    assert values["whole_x"] > 0
    for axis in "xy":  # momentum weighs by density, which differs by Ma^2
        assert values[f"whole_{axis}"] == pytest.approx(values[f"momentum_{axis}"] / values["mass"], rel=1e-3)
    assert np.isnan(values["post"])  # a node in a grain has no pressure
    assert values["slowest_x"] == velocity[~solid][:, 0].min()
