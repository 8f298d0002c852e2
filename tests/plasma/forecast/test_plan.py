"""The plan of a scene against what the program really allocates."""

import numpy as np
import pytest
from seldom import seldom

from hpcpic.core.case.config import loads
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from hpcpic.plasma.case.config import rotation
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.plan import arrays, groups, kernels, messages, plan

CASE = """
simulation = {{ dimensions = {d}; solver = "MFT"; cycles = 1; time_step = 0.1; space_length = {lengths}; }};
grid = {{ points = {points}; }};
field = {{ magnetic = {magnetic}; }};
species = (
  {{ name = "electron"; particles = {n}; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
    init_method = "random position"; drift_velocity = [0.0, 0.0, 0.0]; thermal_velocity = 0.1; }},
  {{ name = "ion"; particles = {n}; charge = 1.0; mass = 64.0; plasma_frequency = 0.125;
    init_method = "random position"; drift_velocity = [0.0, 0.0, 0.0]; thermal_velocity = 0.01; }} );
numerics = {{ shape = "{shape}"; }};
"""


def config(d=2, shape="CIC", n=5000, magnetic=(0.0, 0.0, 0.0)):
    points = [40, 24][:d]
    text = CASE.format(
        d=d, lengths=[float(p) for p in points], points=points, n=n, shape=shape, magnetic=list(magnetic)
    )
    return configure(loads(text))


@pytest.mark.parametrize(("d", "shape"), [(1, "CIC"), (2, "CIC"), seldom(2, "TSC")])
def test_planned_arrays_are_the_allocated_ones(world, d, shape):
    from hpcpic.plasma.step import Plasma

    case = config(d, shape)
    planned = {array.name: array.bytes for array in arrays(case, 1, 1)}
    pool = Pool(1)
    plasma = Plasma(case, world, pool, Timers())
    mesh, arena = plasma.mesh, plasma.cloud.arena
    assert planned["E"] == mesh.e.nbytes
    assert planned["phi"] == mesh.phi.values.nbytes
    assert planned["charge of the slab"] == mesh.charge.field.values.nbytes
    assert planned["rho"] == mesh.rho.nbytes
    # A page of a tile part is half full on average: within one page for each of the tile parts.
    page_bytes = arena["pool"][0].nbytes
    slots = len(arena["count"])
    used = int(-(-arena["count"] // 128).sum())
    assert abs(planned["particles"] - used * page_bytes) <= slots * page_bytes
    plasma.close()
    pool.close()


def test_what_a_scene_does_not_contain_is_not_planned():
    assert rotation(config()) == 0 and "no rotation" in kernels(config())[0]
    for d in (1, 2):
        assert rotation(config(d, magnetic=(0.0, 0.0, 1.0))) == 1
        assert "rotation about z" in kernels(config(d, magnetic=(0.0, 0.0, 1.0)))[0]
    assert rotation(config(magnetic=(1.0, 0.0, 0.0))) == 2
    thin = {array.name: array for array in arrays(config(), 1, 1)}
    thick = {array.name: array for array in arrays(config(magnetic=(1.0, 0.0, 0.0)), 1, 1)}
    assert thick["particles"].shape[2] == 1 + thin["particles"].shape[2]
    assert "particles" not in {array.name for array in arrays(config(n=0), 1, 1)}
    assert messages(config(), 1) == ["none: one rank sends no messages"]


def test_species_of_equal_charge_share_their_integer_charge():
    assert groups(config()) == 1  # wp^2 m / q is 1 for both, exactly


def test_the_plan_shrinks_with_the_ranks():
    one, four = (sum(array.bytes for array in arrays(config(), ranks, 1)) for ranks in (1, 4))
    assert one / 4 < four < one
    assert np.all([len(line) < 110 for line in plan(config(), 4, 2)])
