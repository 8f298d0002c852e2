"""What an SPH run will need: memory by item, disk, time for any ranks x threads, from measured rates."""

import math
from collections.abc import Mapping

from hpcpic.core.cli.forecast import Estimate
from sph import limits
from sph.config import SphConfig
from sph.plan import MIB, arrays, counts

SUMS = {"euler": 1.0, "predictor-corrector": 2.0, "rk3-tvd": 3.0, "symplectic": 1.46}  # pair sums of a step

# Measured on the authors' machine, one core of a 2-core AMD Zen 5 at 4.1 GHz.
DEFAULT = {
    "pair_ns 3D double": 3.0,  # of a directed pair within the support
    "pair_ns 3D single": 2.0,
    "pair_ns 2D double": 3.0,
    "pair_ns 2D single": 2.2,
    "body_ns": 80.0,  # sorting, state, criteria
    "sum_launch_us": 170.0,  # Python and the launches of an evaluation
    "images_us": 550.0,  # a step: who has images in mirrors and periodic sides
    "message_us": 30.0,
    "cores": 2.0,
    "rank_mib": 195.0,
    "thread_efficiency": 0.9,
}
SERIES_BYTES = 24 * 8 * 2


def estimate(config: SphConfig, ranks: int, threads: int, measured: Mapping[str, float]) -> Estimate:
    """Of a completed case on ranks x threads; `measured` rates of this machine take the place of DEFAULT."""
    rates = DEFAULT | dict(measured)
    one = step_seconds(config, ranks, threads, rates)
    steps = config.simulation.end_time / limits.time_step(config)
    memory = {"Python and libraries": rates["rank_mib"] * MIB}
    memory |= {array.name: float(array.bytes) for array in arrays(config, ranks)}
    return Estimate(memory, disk_items(config), one, steps * one + 2.0)


def step_seconds(config: SphConfig, ranks: int, threads: int, rates: Mapping[str, float]) -> float:
    """Pair sums and the rest of a step, divided among the cores there are."""
    fluid, walls = counts(config)
    reach, d = config.support / config.numerics.spacing, config.dimensions
    neighbours = math.pi * reach**2 if d == 2 else 4 / 3 * math.pi * reach**3
    pairs = (fluid + 0.5 * walls) * neighbours
    sums = SUMS[config.simulation.integrator] + (0.3 if config.numerics.density_flux == "delta" else 0.0)
    work = sums * pairs * rates[f"pair_ns {d}D {config.numerics.precision}"] + (fluid + walls) * rates["body_ns"]
    cores = min(ranks * threads, rates["cores"]) if ranks * threads <= 2 * rates["cores"] else ranks * threads
    cores = 1 + (cores - 1) * rates["thread_efficiency"]
    messages = 8 * sums * rates["message_us"] if ranks > 1 else 0.0
    mirrored = config.domain.periodic or any(wall.type.startswith("mirror") for wall in config.wall)
    images = rates["images_us"] if mirrored else 0.0
    return 1e-9 * work / cores + 1e-6 * (rates["sum_launch_us"] * sums + images + messages)


def disk_items(config: SphConfig) -> dict[str, float]:
    """Bytes of the whole run."""
    fluid, walls = counts(config)
    period, end = config.output.period, config.simulation.end_time
    steps = end / limits.time_step(config)

    def times(seconds: float) -> float:
        return min(end / seconds, steps) + 1 if seconds else 0.0

    shown = fluid + (walls if config.output.walls else 0)
    return {
        "series": times(period.series) * SERIES_BYTES,
        "particles": times(period.particles) * shown * (3 * 8 + 3 * 8 + 8 + 8 + 8 + 4),
        "checkpoints, two": 2 * (fluid + walls) * (8 * (2 * config.dimensions + 3)),
    }
