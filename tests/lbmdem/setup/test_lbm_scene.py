"""What a scene computes of a case."""

from typing import get_args, get_type_hints

import numpy as np
import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from lbmdem.case.config import Initial
from lbmdem.configure import configure
from lbmdem.setup.flows import FLOWS
from lbmdem.setup.scene import Scene

DISC = """
simulation = { end_time = 1.0; };
domain = { size = [0.01, 0.01]; spacing = 2.0e-4; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-6; relaxation_time = 0.8; body_force = [3.0, 0.0]; };
grains = ({ diameter = 2.0e-3; density = 2650.0; position = [0.005, 0.005]; });
contact = { normal_stiffness = 1.0e4; damping = 0.5; };
gravity = [0.0, -9.81];
"""


def test_a_grain_weighs_less_by_what_it_displaces_and_is_driven_as_that():
    """[1] with the pressure of rest, rho g, which the lattice fluid does not have; what floats weighs nothing."""
    scene = Scene(configure(loads(DISC)))
    volume = np.array([1.0, 2.0])
    force = scene.constant_force(np.array([2650.0, 2000.0]), volume)
    assert np.array_equal(force, [[3000.0, -9.81 * 1650.0], [6000.0, 0.0]])


def test_every_flow_that_a_case_may_name_is_there():
    assert {*get_args(get_type_hints(Initial)["flow"])} == {*FLOWS}


CHANNEL = """
simulation = { end_time = 2.0; };
domain = { size = [2.0e-3, 1.0e-3]; spacing = 1.0e-4; };
fluid = { kinematic_viscosity = 1.0e-6; relaxation_time = 1.0; };
boundary = ({ face = "x-"; type = "pressure"; pressure = 2.0e-3; },
            { face = "x+"; type = "pressure"; pressure = 0.0; });
"""
UPWARDS = ("domain.size=[1.0e-3, 2.0e-3]", 'boundary[0].face="y-"', 'boundary[1].face="y+"')


@pytest.mark.parametrize("tau", [0.55, 1.0, 2.0])
@pytest.mark.parametrize("sets", [(), ("domain.size=[2.1e-3, 1.0e-3]",), UPWARDS], ids=["even", "odd", "upwards"])
def test_pressure_faces_leave_no_alternation_from_node_to_node(world, sets, tau):
    """Flux through the sections across the flow: a start at rest leaves one of 0.1 to 2 % for ever. The Zou-He faces
    change the flow in a layer of some nodes, which is left out."""
    with running(world, "lbmdem", CHANNEL, (*sets, f"fluid.relaxation_time={tau}")) as app:
        while app.time < 1.0:
            app.step()
        along = int(sets is UPWARDS)
        flux = app.fluid.moments()[1][..., along].sum(axis=along)
    flux /= flux.mean()
    assert np.abs(np.diff(flux, 2)[4:-4]).max() / 4.0 < 5e-4
