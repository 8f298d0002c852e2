"""What an LBM-DEM run will need: memory by item, disk, time for any ranks x threads, from measured rates.

A step costs the nodes at the rate of the sweep, the links of grains, the grains in every DEM substep, and messages.
Where nothing moves in the fluid, several steps are done in a pass over memory and share its launch.
"""

import math
from collections.abc import Mapping

from hpcpic.core.cli.forecast import Estimate
from lbmdem.config import LbmDemConfig
from lbmdem.plan import BYTES, VELOCITIES, arrays, face_bytes, grain_count, link_count, moving

MIB = 2.0**20
SERIES_BYTES = 16 * 8 * 2
DEPTH = 6  # steps per pass at most (lbmdem.wavefront)

# Measured on the authors' machine, one core of a 2-core AMD Zen 5 at 4.1 GHz.
DEFAULT = {
    "mlups D3Q19 double": 150.0,
    "mlups D3Q19 single": 290.0,
    "mlups D2Q9 double": 300.0,
    "mlups D2Q9 single": 600.0,
    "link_ns fixed": 7.0,
    "link_ns moving": 22.0,
    "grain_ns": 150.0,  # per grain and DEM substep
    "lattice_launch_us": 80.0,
    "message_us": 6.0,
    "message_gb_s": 8.0,
    "cores": 2.0,
    "core_gain": 1.15,  # of the second core on the sweep, which memory limits
    "wave_gain": 1.5,  # of several steps per pass on one core, and
    "wave_core_gain": 1.7,  # of the second core then
    "beside_solids": 0.5,  # more for a sweep with solids everywhere, which is a link in five nodes
    "rank_mib": 200.0,
}


def estimate(config: LbmDemConfig, ranks: int, threads: int, measured: Mapping[str, float]) -> Estimate:
    """Of a completed case on ranks x threads; `measured` rates of this machine take the place of DEFAULT."""
    rates = DEFAULT | dict(measured)
    step = step_seconds(config, ranks, threads, rates)
    memory = {"Python and libraries": rates["rank_mib"] * MIB}
    memory |= {array.name: float(array.bytes) for array in arrays(config, ranks)}
    return Estimate(memory, disk_items(config), step, config.n_steps * step + 1.0)


def step_seconds(config: LbmDemConfig, ranks: int, threads: int, rates: Mapping[str, float]) -> float:
    """One fluid step; the sweep is bound by memory, the rest divides among the cores."""
    wanted = ranks * threads
    cores = wanted if wanted > 2 * rates["cores"] else min(wanted, rates["cores"])
    rest = 0.0
    if moving(config):
        rest += grain_count(config) * config.substeps * rates["grain_ns"]
    together = steps_per_pass(config, ranks, threads)
    seconds = 1e-6 * rates["lattice_launch_us"] / together
    if config.fluid:
        seconds += sweep_seconds(config, cores, together, rates) + message_seconds(config, ranks, rates)
        kind = "link_ns moving" if moving(config) and not config.coupling.frozen else "link_ns fixed"
        rest += link_count(config) * rates[kind]
    return seconds + 1e-9 * rest / cores


def steps_per_pass(config: LbmDemConfig, ranks: int, threads: int) -> int:
    """1 where solids move or something drives the fluid from step to step."""
    driven = config.shaking is not None or any(face.pressure_rate for face in config.boundary)
    if not config.fluid or moving(config) or driven:
        return 1
    lag = 2 if config.grains or config.obstacle or config.boundary else 1
    return max(1, min(DEPTH, config.points[-1] // (ranks * threads * 2 * lag)))


def sweep_seconds(config: LbmDemConfig, cores: float, together: int, rates: Mapping[str, float]) -> float:
    nodes = math.prod(config.points)
    sweep = 1e-6 * nodes / rates[f"mlups {config.simulation.lattice} {config.fluid.storage}"]
    sweep *= 1 + rates["beside_solids"] * min(1.0, 5.0 * link_count(config) / nodes)
    sweep, gain = (sweep / rates["wave_gain"], "wave_core_gain") if together > 1 else (sweep, "core_gain")
    shared = min(cores, rates["cores"])  # of one node
    return sweep / (1 + (shared - 1) * (rates[gain] - 1)) / (cores / shared)


def message_seconds(config: LbmDemConfig, ranks: int, rates: Mapping[str, float]) -> float:
    if ranks == 1:
        return 0.0
    return 4e-6 * rates["message_us"] + 2 * face_bytes(config) / (1e9 * rates["message_gb_s"])


def disk_items(config: LbmDemConfig) -> dict[str, float]:
    """Bytes of the whole run."""
    nodes, d, periods = math.prod(config.points), config.dimensions, config.periods

    def times(every: int) -> int:
        return config.n_steps // every + 1 if every else 0

    populations = VELOCITIES[config.simulation.lattice] * BYTES[config.fluid.storage] if config.fluid else 0
    return {
        "series": times(periods["series"]) * SERIES_BYTES,
        "fields": times(periods["field"]) * nodes * 8 * (1 + d),
        "grains": times(periods["particle"]) * grain_count(config) * 8 * 12,
        "checkpoints, two": 2 * (nodes * populations + grain_count(config) * 8 * 13),
    }
