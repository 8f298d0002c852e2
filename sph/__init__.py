"""Weakly compressible smoothed particle hydrodynamics, after Minatti & Pasculli (2011), cited as (MP n), and Silvester
and Cleary (2006), cited as (SC n).
"""

from typing import TYPE_CHECKING

from hpcpic.core.lazy import lazy

if TYPE_CHECKING:
    from sph.face import Case, Run, cases, open_run

__all__ = ["Case", "Run", "cases", "open_run"]

__getattr__ = lazy(__name__, {"sph.face": __all__})
