"""Damping of waves where the pair forces of the viscosity go along v_ij (Morris): a free surface then bears the stress
mu (grad v)^T n, which none is there to take, and waves lose energy by |grad v|^2, not by twice the strain rate squared
(Colagrossi et al. 2011, https://doi.org/10.1103/PhysRevE.84.026705).
"""

from collections.abc import Iterator

from hpcpic.core.case.derived import Derived
from sph.case.config import SphConfig
from sph.physics.viscosities import VISCOSITIES
from sph.setup.speeds import lost_in_a_period
from sph.setup.tanks import open_sides

MEASURED = 0.48  # of that by theory: a standing wave as long as it is deep, 40 and 60 spacings; h/dp 2.0: 0.51
MATTERS = 0.1  # exp(-MATTERS) of a wave is left after a period


def damping(config: SphConfig) -> Iterator[Derived]:
    """A row where viscosity damps waves on a free surface within some periods."""
    form = VISCOSITIES[config.numerics.viscosity_form or "none"]
    if not (form.along_velocity and any(config.gravity) and MATTERS < lost_in_a_period(config) <= 1.0):
        return
    if any(open_sides(config, fluid) for fluid in config.fluid if not fluid.gas):
        source = "a standing wave as long as it is deep, measured; a liquid that spins freely is slowed down"
        yield Derived("damping of waves by viscosity", "of theory", MEASURED, "", ">= 0.9", "warn", source,
                      'viscosity_form = "cleary": 0.98 to 1.02', ("numerics", "viscosity_form"))  # fmt: skip
