"""Damping of waves where all pair forces of the viscosity go along v_ij (Morris): a free surface then bears the stress
mu (grad v)^T n, which none is there to take, and waves lose energy by |grad v|^2, not by twice the strain rate squared
(Colagrossi et al. 2011, https://doi.org/10.1103/PhysRevE.84.026705).
"""

from collections.abc import Iterator

from hpcpic.core.case.derived import Derived
from sph.case.config import SphConfig
from sph.physics.liquids import liquids_of
from sph.physics.viscosities import VISCOSITIES
from sph.setup.speeds import lost_in_a_period
from sph.setup.tanks import free_surface

MEASURED = 0.52  # of that by linear theory: a standing wave as long as it is deep, 40 spacings
MATTERS = 0.1  # exp(-MATTERS) of a wave is left after a period


def damping(config: SphConfig) -> Iterator[Derived]:
    """A row where viscosity damps waves on a free surface within some periods."""
    form = VISCOSITIES[config.numerics.viscosity_form or "none"]
    if not (form.along_velocity and any(config.gravity) and MATTERS < lost_in_a_period(config) <= 1.0):
        return
    if free_surface(config):
        several = liquids_of(config).several
        cure = 'viscosity_form = "' + ('cleary": 1.12' if several else 'full-stress": 0.97')
        source = "a standing wave as long as it is deep, measured; a liquid that spins freely is slowed down"
        yield Derived("damping of waves by viscosity", "of theory", MEASURED, "", ">= 0.9", "warn", source, cure,
                      ("numerics", "viscosity_form"))  # fmt: skip
