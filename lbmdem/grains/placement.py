"""Where the grains of a case are at the start: as it says, or in a packing made for it."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from lbmdem.case.config import GrainSet, LbmDemConfig
from lbmdem.setup.scene import GrainTable, grain_table


def place_grains(config: LbmDemConfig, world: World, pool: Pool, domain: Domain) -> GrainTable:
    """All grains, the same on all ranks. Collective: packings are made by all ranks together."""
    positions, radii = [], []
    for grains in config.grains:
        if grains.packing is not None:
            x, r = packed(config, grains, world, pool, domain)
        else:
            x, r = np.array(grains.centres, np.float64), given_radii(config, grains)
        positions.append(x)
        radii.append(r)
    return grain_table(config, positions, radii)


def given_radii(config: LbmDemConfig, grains: GrainSet) -> NDArray[np.float64]:
    """Radii of grains whose positions the case gives, m [n]."""
    n, own = len(grains.centres), grains.own_diameters
    if own is not None:
        return 0.5 * np.asarray(own, float)
    from lbmdem.grains.packing import beta_diameters

    d = grains.law
    return 0.5 * beta_diameters(n, d.min, d.max, d.a, d.b, config.simulation.random_seed, config.dimensions)


def mean_diameters(config: LbmDemConfig) -> tuple[float, float]:
    """<d>, and Sauter's <d^3> / <d^2> of the area they offer to a flow, of all grains, m."""
    from lbmdem.grains.packing import beta_diameters

    parts = []
    for grains in config.grains:
        law = grains.diameters
        if law is None:
            parts.append(2.0 * given_radii(config, grains))
        else:
            parts.append(beta_diameters(law.count, law.min, law.max, law.a, law.b, 0, config.dimensions))
    d = np.concatenate(parts)
    return float(d.mean()), float((d**3).sum() / (d**2).sum())


def packed(
    config: LbmDemConfig, grains: GrainSet, world: World, pool: Pool, domain: Domain
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres [n, d] and radii [n] of a packing, m."""
    from lbmdem.grains.packing import make

    return make(config, grains, world, pool, domain)
