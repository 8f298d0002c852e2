"""What counts as torn off the fluid, and how much of it a run may have."""

import math

from sph.case.config import SphConfig
from sph.physics.stability import support_of

MAX_DENSITY_ERROR = 0.3  # |rho / rho0 - 1| of a weakly compressible fluid: fluids at 0.3 c0 that meet come to 0.19
FREE_NEIGHBOUR_SHARE = 0.5  # a stray has fewer of the neighbours inside a fluid; beside a flat surface there are 0.6
SPRAY_NEIGHBOUR_SHARE = 0.1  # spray has as few of them; a sheet in 2D, a particle thick, has 0.16
SPRAY_TENSION = 0.01  # 1 - rho / rho0 from which spray is looked for: few particles have it, and swings stay small
BURST, BURST_SHARE = 10, 0.01  # strays of one step beyond which the fluid bursts: that many, or of all particles
LIMIT = MAX_DENSITY_ERROR * (1 - 1e-9)  # for rounding


def most_strays(n: int) -> int:
    """How many of n particles may be torn off in one step."""
    return max(BURST, int(BURST_SHARE * n))


def full_neighbourhood(config: SphConfig) -> float:
    """How many neighbours a particle inside the fluid has."""
    reach = support_of(config) / config.numerics.spacing
    return (math.pi * reach**2 if config.dimensions == 2 else 4 / 3 * math.pi * reach**3) - 1
