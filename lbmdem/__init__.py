"""Lattice Boltzmann fluid with discrete-element grains, after Mansouri, Delenne, El Youssoufi & Seridi (2011), whose
numbered equations are cited as [1] to [7].

Departures, with their figures in docs/theory/lbmdem.md: two relaxation times and the parametrised linear wall rule are
the default beside BGK [4] and the interpolated bounce back [6], because drag then does not depend on tau; rho_w of [6]
is the density of rest, as its populations are kept without their weights; the dashpot of N_c dissipates, whichever way
its sign is read; the substeps follow from the limit of damped contacts on all sides, which is below [2]; the force [7]
is the mean of two steps, so that it has no part that alternates; nodes are marked after the grains have moved, so that
a state is what its positions say; uncovered nodes take the density of their neighbours, not the mean; gravity acts on
grains less their buoyancy, and the fluid's pressure is the one beyond its own weight.
"""

from typing import TYPE_CHECKING

from hpcpic.core.lazy import lazy

if TYPE_CHECKING:
    from lbmdem.api import Case, Run, Simulation, cases, open_run

__all__ = ["Case", "Run", "Simulation", "cases", "open_run"]

__getattr__, __dir__ = lazy(__name__, {"lbmdem.api": __all__})
