"""Gauges in the plasma's fields: they read what snapshots hold, and the mean density over the box is N / L."""

import numpy as np
import pytest
from app_runner import running

CASE = """
simulation = { cycles = 3; time_step = 0.2; space_length = [16.0, 8.0]; };
grid = { points = [16, 8]; };
species = (
  { name = "e"; particles = 2000; charge = -1.0; mass = 1.0; plasma_frequency = 1.0; thermal_velocity = 0.1; },
  { name = "i"; particles = 2000; charge = 1.0; mass = 100.0; plasma_frequency = 0.1; } );
gauge = (
  { name = "box"; what = "n_e"; at = [8.0, 4.0]; size = [16.0, 8.0]; },
  { name = "node"; what = "E"; at = [3.0, 5.0]; },
  { name = "deepest"; what = "phi"; at = [8.0, 4.0]; size = [16.0, 8.0]; take = "minimum"; } );
output = { fields = ["phi", "E"]; };
"""


@pytest.mark.mpi(min_size=2)
def test_gauges_on_ranks_read_the_same(world):
    from mpi4py import MPI

    alone = type(world)(MPI.COMM_SELF, MPI.COMM_SELF)
    with running(world, "hpcpic", CASE) as here, running(alone, "hpcpic", CASE) as there:
        assert here.scalars() == there.scalars()


def test_gauges_read_the_fields(world):
    with running(world, "hpcpic", CASE) as app:
        app.step()
        values, fields = app.scalars(), app.fields()
        assert set(fields) == {"phi", "E"}  # a gauge of n_e adds none
        assert app.scalar_units["box"] == "1/m2" and app.scalar_units["node_y"] == "V/m"
        e = app.scene.species[0]
    assert values["box"] == pytest.approx(e.n * e.m / e.section.mass / 128.0, rel=1e-12)
    assert [values["node_x"], values["node_y"]] == fields["E"].values[5, 3].tolist()
    assert values["deepest"] == np.min(fields["phi"].values)
