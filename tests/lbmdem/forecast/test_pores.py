"""Flow between grains that stay, with collisions whose walls lie where tau puts them, is told as it is measured."""

import math

import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived

DISCS = """
simulation = { dimensions = 2; end_time = 0.08; };
domain = { size = [1.1e-3, 1.1e-3]; spacing = 5.0e-5; periodic = ["x", "y"]; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-6; relaxation_time = 0.6; body_force = [0.0, 1.0e-3]; };
grains = ({ name = "discs"; diameter = 1.0e-3; moving = false; position = [5.5e-4, 5.5e-4]; });
"""
SPHERES = (
    "simulation.dimensions=3", "domain.size=[1.6e-3, 1.6e-3, 1.6e-3]", "domain.spacing=1.0e-4",
    'domain.periodic=["x", "y", "z"]', "fluid.body_force=[0.0, 0.0, 1.0e-3]", "grains[0].position=[8e-4, 8e-4, 8e-4]",
    "simulation.end_time=0.4",
)  # fmt: skip
FLOW = "flow between grains that stay, over TRT's"


def told(*sets):
    return next((one for one in derived(configure(loads(DISCS, sets=sets))) if one.name == FLOW), None)


def permeability(world, *sets):
    with running(world, "lbmdem", DISCS, sets=sets) as app:
        while app.time < app.scene.config.simulation.end_time:
            app.step()
        return app.scalars()["permeability"]


@pytest.mark.parametrize("collision, tau", [("central", 0.55), ("central", 1.5), ("BGK", 0.6)])
@pytest.mark.parametrize("sets", [(), SPHERES])
def test_the_flow_that_is_lost_between_grains_is_told(world, collision, tau, sets):
    """Gaps of 2 and 6 nodes: 0.40 to 1.57 of the logarithm, as a power of one length stands for all shapes of pores."""
    chosen = (*sets, f'fluid.collision="{collision}"', f"fluid.relaxation_time={tau}")
    share = permeability(world, *chosen) / permeability(world, *sets)
    ratio = math.log(told(*chosen).value) / math.log(share)
    assert 0.35 < ratio < 1.7


def test_its_cure_passes_and_a_lone_cylinder_is_no_bed():
    lost = told('fluid.collision="central"')
    assert lost.verdict == "warn" and lost.key == ("fluid", "collision") and 'collision = "TRT"' in lost.cure
    assert told() is None
    assert told('fluid.collision="central"', "domain.size=[11e-3, 11e-3]").verdict == "ok"
    assert told('fluid.collision="central"', "grains[0].moving=true", "domain.size=[2.2e-3, 2.2e-3]") is None


def test_a_packing_counts_its_own_pores():
    """Those of the whole box would be wide."""
    packed = (
        "simulation.dimensions=3", "domain.size=[4e-3, 4e-3, 40e-3]", 'domain.periodic=["x", "y"]',
        "domain.spacing=1e-4", "fluid.body_force=[0.0, 0.0, 1.0e-3]", 'fluid.collision="central"',
        "fluid.relaxation_time=0.55",
        "grains=({moving=false; diameters={min=1e-3; max=1e-3; count=40;}; packing={porosity=0.45;};})",
    )  # fmt: skip
    pore = 2.0 / 3.0 * 10.0 * 0.45 / 0.55
    assert told(*packed).value == pytest.approx(0.47 ** (3.66 / pore), rel=1e-2)
