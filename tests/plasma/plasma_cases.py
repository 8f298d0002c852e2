"""Two small plasmas for tests, of two species, some of them fast; and plasmas of any case."""

from hpcpic.core.case.config import loads
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from hpcpic.plasma.configure import configure
from hpcpic.plasma.step import Plasma

PLANE = """
simulation = { cycles = 20; time_step = 0.1; space_length = [37.0, 60.0]; random_seed = 7; };
grid = { points = [37, 40]; };
field = { magnetic = [0.0, 0.0, 1.0]; };
species = (
  { name = "electrons"; particles = 6000; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
    drift_velocity = [3.0, 2.0]; thermal_velocity = 1.5; init_method = "random position"; },
  { name = "ions"; particles = 4000; charge = 1.0; mass = 20.0; plasma_frequency = 0.3;
    drift_velocity = [-1.0, 0.5]; thermal_velocity = 0.3; init_method = "quiet"; } );
"""
LINE = """
simulation = { cycles = 20; time_step = 0.1; space_length = [97.0]; random_seed = 5; };
grid = { points = [301]; };
species = (
  { name = "beam"; particles = 5000; charge = -1.0; mass = 1.0; plasma_frequency = 0.7;
    drift_velocity = [3.0]; thermal_velocity = 0.5; init_method = "random position"; },
  { name = "other"; particles = 5000; charge = -1.0; mass = 1.0; plasma_frequency = 0.7;
    drift_velocity = [-3.0]; thermal_velocity = 0.2; init_method = "quiet";
    perturbation = { mode = [2]; amplitude = 0.1; }; } );
"""


def advanced(text, world, sets=(), threads=1, steps=None):
    """The plasma of a case, with settings of its own, after so many steps; by default all of the case."""
    config = configure(loads(text, sets=sets))
    plasma = Plasma(config, world, Pool(threads), Timers())
    for _ in range(config.simulation.cycles if steps is None else steps):
        plasma.step()
    return plasma
