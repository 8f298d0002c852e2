"""The numbers that a plasma case is judged by, of a small case and of any text."""

from hpcpic.core.case.config import loads
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import derived

CASE = """
simulation = { cycles = 1000; time_step = 0.2; space_length = [64.0, 32.0]; };
grid = { points = [64, 32]; };
species = (
  { name = "electrons"; particles = 32768; charge = -1.0; mass = 1.0; thermal_velocity = 1.0;
    init_method = "random position"; plasma_frequency = 1.0; }
);
"""


def numbers(sets=(), text=CASE, ranks=1):
    tree = loads(text, sets=sets)
    config = configure(tree)
    return {number.symbol: number for number in derived(config, ranks)}, tree
