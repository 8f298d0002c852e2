"""Weakly compressible smoothed particle hydrodynamics, after Minatti & Pasculli (2011), cited as (MP n), and Silvester
and Cleary (2006), cited as (SC n).

Departures, with their figures in docs/theory/sph.md: the cubic spline (MP 9) is normalised; the flux (MP 17) acts
between particles of fluid only; the trace of (MP 22) has the sign that takes it out; the flow of (MP 24) follows its
force; (SC 6) dissipates, and its xi is calibrated by a shear wave along the lattice; the repulsion (SC 8-10) falls to
nothing nearer than 0.4 h, where no particle comes from before the wall. Cases of paper 003 run with a symplectic step,
Wendland's kernel, Molteni's flux and artificial viscosity, where the paper has its predictor-corrector, the cubic
spline and neither (`column-impact-printed`); `poiseuille` has Cleary's viscosity; for the strain rate (MP 22-23),
`poiseuille-strain-rate`, images in mirrors have the stress at the wall and c0 is 1000 times the largest velocity, as
else a wave of two spacings grows. A particle torn off the fluid has the density of rest (strays.py).
"""

from typing import TYPE_CHECKING

from hpcpic.core.lazy import lazy

if TYPE_CHECKING:
    from sph.api import Case, Run, Simulation, cases, open_run

__all__ = ["Case", "Run", "Simulation", "cases", "open_run"]

__getattr__, __dir__ = lazy(__name__, {"sph.api": __all__})
