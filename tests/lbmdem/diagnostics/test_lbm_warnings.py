"""What a run says when something goes wrong offers what would help."""

from types import SimpleNamespace

import pytest
from app_runner import running

CLOSED = """
simulation = {{ end_time = 0.01; }};
domain = {{ size = [0.004, 0.004]; spacing = 2.0e-4; }};
fluid = {{ density = 1000.0; kinematic_viscosity = 1.0e-6; relaxation_time = 0.6; }};
grains = ({{ diameter = 2.0e-3; density = 2000.0; position = [0.002, 0.002]; }});
coupling = {{ refill = "{refill}"; }};
"""


@pytest.mark.parametrize("refill, helps", [("mass-conserving", False), ("conserving", False), ("average", True)])
def test_a_refill_that_keeps_the_mass_is_no_cure_where_it_is_on(world, caplog, refill, helps):
    with running(world, "lbmdem", CLOSED.format(refill=refill)) as app:
        app.diagnostics._of_fluid(SimpleNamespace(fastest=0.0, drift=-2e-3, scalars=lambda *_: {}), 1)
    told = [one.getMessage() for one in caplog.records if "mean density" in one.getMessage()]
    assert len(told) == (world.rank == 0) and all(("mass-conserving" in text) == helps for text in told)
