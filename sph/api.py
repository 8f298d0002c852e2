"""The names that `import sph` offers: cases, runs and simulations in memory."""

from hpcpic.core.api import case
from hpcpic.core.api.program import Program
from hpcpic.core.api.results import Run
from hpcpic.core.api.simulation import Simulation
from sph.__main__ import load_app

__all__ = ["Case", "Run", "Simulation", "cases", "open_run"]
cases, open_run = Program(load_app).cases, Program(load_app).open_run


class Case(case.Case):
    __doc__ = case.Case.__doc__
    load_app = staticmethod(load_app)
