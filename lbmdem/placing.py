"""Where the grains of a case are at the start: as it says, or in a packing made for it."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks import Pool
from lbmdem.config import GrainSet, LbmDemConfig
from lbmdem.scene import GrainTable, grain_table


def place_grains(config: LbmDemConfig, world: World, pool: Pool, domain: Domain) -> GrainTable:
    """All grains, the same on all ranks. Collective: packings are made by all ranks together."""
    positions, radii = [], []
    for grains in config.grains:
        if grains.packing is not None:
            x, r = packed(config, grains, world, pool, domain)
        else:
            x, r = np.array(grains.position, np.float64), given_radii(config, grains)
        positions.append(x)
        radii.append(r)
    return grain_table(config, positions, radii)


def given_radii(config: LbmDemConfig, grains: GrainSet) -> NDArray[np.float64]:
    """Of grains whose positions the case gives, m."""
    n = len(grains.position)
    if grains.diameter is not None:
        return np.full(n, 0.5 * grains.diameter)
    from lbmdem.packing import beta_diameters

    d = grains.diameters
    return 0.5 * beta_diameters(n, d.min, d.max, d.a, d.b, config.simulation.random_seed, config.dimensions)


def packed(
    config: LbmDemConfig, grains: GrainSet, world: World, pool: Pool, domain: Domain
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres [n, d] and radii [n] of a packing, m."""
    from lbmdem.packing import make

    return make(config, grains, world, pool, domain)
