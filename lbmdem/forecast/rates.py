"""What the parts of a step take on the authors' machine: by these, work is weighed alike on all machines."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from hpcpic.core.app.forecast import FILES
from lbmdem.case.config import LbmDemConfig
from lbmdem.forecast.node_shares import cached, node_bytes, population_bytes, porous
from lbmdem.physics.collision import COLLISIONS

# Measured on the authors' machine, one core of a 2-core AMD Zen 5 at 4.1 GHz.
DEFAULT = FILES | {
    "mlups D3Q19 double": 190.0,  # one step per pass over memory
    "mlups D3Q19 single": 400.0,
    "mlups D2Q9 double": 480.0,
    "mlups D2Q9 single": 1000.0,
    "wave_gain D3Q19": 1.45,  # with several steps per pass, or in a cache that holds some tens of MB
    "wave_gain D2Q9": 1.55,
    "cached_gain D3Q19": 1.0,  # beside that, with several steps per pass of a box of some MB
    "lattice_cache_mb": 24.0,  # last-level cache
    "forced": 0.4,  # more, in caches, for a sweep with a body force
    "central": 0.36,  # and for central moments
    "mixed": 0.83,  # and for nodes beside solids
    "masks": 1.0,  # 1 where porous media are held without their solid nodes (node_shares.sparse), else 0
    "sparse": 1.6,  # a fluid node held without the solid ones, over one of a fluid alone
    "link_ns fixed": 5.7,  # several steps per pass
    "link_ns cached": 5.7,  # the same in a box of some MB
    "link_ns sparse": 3.6,  # the same where the sweep does them (lbmdem.sparse)
    "link_ns fixed single": 7.0,
    "link_ns moving 2D": 17.3,
    "link_ns moving 3D": 8.4,
    "moving_link_us 2D": 0.1,  # of a grain, besides its links
    "moving_link_us 3D": 0.1,
    "moving_grain_us 2D": 1.1,  # of a grain: which nodes it covers now
    "moving_grain_us 3D": 5.3,
    "moving_us": 76.0,  # and a step
    "cold_us": 275.0,  # more for it, grains and links, where a sweep has emptied the caches
    "conserving_ns": 2.4,  # per node, where the mass of covered nodes is put back
    "grains_us": 57.0,  # a step
    "substep_us": 0.13,
    "grain_ns": 40.0,  # per grain and substep
    "lattice_sample_us": 300.0,
    "lattice_sample_ns": 10.0,  # per node
    "lattice_launch_us": 2.5,
    "lattice_launch_together_us": 10.0,  # of several threads
    "lattice_drive_us": 50.0,  # a body force that changes from step to step
    "message_us": 3.0,
    "message_gb_s": 8.0,
    "grain_exchange_us": 180.0,  # forces, ghosts and owners of grains, a step of several ranks
    "refill_plane_ns": 4.0,  # of a population of the planes beside a slab, for nodes that grains uncover
    "cores": 2.0,
    "sweep_core_gain": 1.3,  # of all cores over one on a sweep that waits for memory
    "wave_core_gain": 1.7,  # and on other work
    "cached_core_gain": 1.7,  # the same in a box of some MB, where threads wait for each other more often
    "sparse_core_gain": 1.6,  # and on nodes held without the solid ones
    "rank_mib": 200.0,
    "scipy_mib": 25.0,  # where sizes of grains follow a law
}

# What differs without AVX-512: one core of a 2-core AMD Zen 3, beside other work.
NARROW = {
    "mlups D3Q19 double": 80.0,
    "mlups D3Q19 single": 160.0,
    "mlups D2Q9 double": 230.0,
    "mlups D2Q9 single": 470.0,
    "wave_gain D3Q19": 1.2,
    "wave_gain D2Q9": 1.1,
    "cached_gain D3Q19": 0.9,
    "forced": 0.2,
    "central": 0.62,
    "mixed": 1.24,
    "masks": 0.0,
    "link_ns fixed": 11.8,
    "link_ns cached": 7.1,
    "link_ns fixed single": 6.5,
    "link_ns moving 2D": 48.0,
    "link_ns moving 3D": 22.0,
    "moving_link_us 2D": 0.34,
    "moving_grain_us 2D": 1.5,
    "moving_us": 280.0,
    "cold_us": 600.0,
    "conserving_ns": 3.0,
    "grains_us": 250.0,
    "substep_us": 0.2,
    "grain_ns": 130.0,
    "lattice_sample_us": 1400.0,
    "lattice_sample_ns": 19.0,
    "lattice_launch_us": 5.5,
    "lattice_drive_us": 190.0,
}


SHAPES = {"D2Q9": (1024, 1024), "D3Q19": (96, 96, 96)}  # of the boxes in which nodes beyond the caches are timed


class NodeTimes(NamedTuple):
    """Time of a node with a step per pass over memory and in caches, the share that its forces and its collision add to
    the latter, and what a node beside solids takes more; ns.
    """

    one: float
    bare: float
    more: float
    beside: float


def held_alone(config: LbmDemConfig, rates: Mapping[str, float]) -> bool:
    """Whether a machine with these rates holds the fluid nodes alone."""
    return bool(rates["masks"]) and porous(config)


def node_ns(config: LbmDemConfig, rates: Mapping[str, float]) -> NodeTimes:
    lattice, fluid = config.lattice, config.liquid
    timed = 1e3 / rates[f"mlups {lattice} {fluid.storage}"]
    bare = timed / rates[f"wave_gain {lattice}"]
    one, beside = bare + (timed - bare) * share_beyond(config, rates), rates["mixed"] * bare
    if cached(config) and not held_alone(config, rates):  # else as long in a small box as in a large one
        one = bare = bare / rates.get(f"cached_gain {lattice}", 1.0)
    more = rates["forced"] if any(fluid.body_force) or config.shaking else 0.0
    more += rates["central"] if COLLISIONS[fluid.collision].dearer else 0.0
    return NodeTimes(one, bare, more, beside)


def share_beyond(config: LbmDemConfig, rates: Mapping[str, float]) -> float:
    """What of the wait for memory, as it was timed, nodes have: none in half of the last-level cache, all in as many
    nodes as were timed.
    """
    timed = 1e-6 * math.prod(SHAPES[config.lattice]) * node_bytes(config)
    none = 0.5 * min(rates["lattice_cache_mb"], timed)
    return min(1.0, max(0.0, (1e-6 * population_bytes(config) - none) / (timed - none)))
