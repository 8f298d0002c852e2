"""What a plasma run will need: memory by item, disk, time for any ranks x threads, from measured rates.

Time of a step = particles / cores x ns per particle + cells / cores x ns per cell + transform + launches + messages.
The rates come from `hpcpic bench` on this machine; what it did not measure keeps its ratio to what it did on the
authors' machine (DEFAULT).
"""

import math
from collections.abc import Mapping

from hpcpic.core.cli.forecast import Estimate
from hpcpic.plasma.config import PlasmaConfig, velocity_components
from hpcpic.plasma.plan import arrays

MIB = 2.0**20
SERIES_BYTES = 16 * 8 * 2  # of one sample: sixteen numbers, in HDF5 and as text

# Measured on the authors' machine, one core of a 2-core AMD Zen 5 at 4.1 GHz.
DEFAULT = {
    "particle_ns 2D CIC double": 3.0,
    "particle_ns 2D CIC single": 2.9,
    "particle_ns 2D NGP double": 2.6,
    "particle_ns 2D NGP single": 2.8,
    "particle_ns 2D TSC double": 4.5,
    "particle_ns 2D TSC single": 4.2,
    "particle_ns 1D CIC double": 1.38,
    "particle_ns 1D CIC single": 1.3,
    "particle_ns 1D NGP double": 1.2,
    "particle_ns 1D NGP single": 1.2,
    "particle_ns 1D TSC double": 1.7,
    "particle_ns 1D TSC single": 1.7,
    "cell_ns 2D": 6.0,  # coefficients, accumulators, gradient, fold
    "cell_ns 1D": 4.0,
    "sample_ns": 2.4,  # per particle and sample of the series
    "fft_ns": 0.2,  # per point and binary order, there and back
    "launch_us 1": 40.0,  # Python and the launches of a step on one thread
    "launch_us 2": 60.0,  # on more
    "message_us": 6.0,  # per message of a step
    "message_gb_s": 8.0,
    "cores": 2.0,
    "rank_mib": 220.0,  # Python and the libraries, kernels from the cache
    "thread_efficiency": 0.95,
}


def estimate(config: PlasmaConfig, ranks: int, threads: int, measured: Mapping[str, float]) -> Estimate:
    """Of a completed case on ranks x threads; `measured` rates of this machine take the place of DEFAULT."""
    rates = completed_rates(measured)
    step = step_seconds(config, ranks, threads, rates)
    samples = config.simulation.cycles * step + sampling_seconds(config, ranks, threads, rates)
    return Estimate(memory_items(config, ranks, threads, rates), disk_items(config), step, samples + 1.0)


def completed_rates(measured: Mapping[str, float]) -> dict[str, float]:
    """DEFAULT with the measured rates; a kernel that was not measured keeps its ratio to the standard one."""
    standard = "particle_ns 2D CIC double"
    ratio = measured.get(standard, DEFAULT[standard]) / DEFAULT[standard]
    scaled = {name: value * ratio if "_ns" in name else value for name, value in DEFAULT.items()}
    return scaled | dict(measured)


def particle_count(config: PlasmaConfig) -> int:
    return sum(species.particles for species in config.species)


def particle_bytes(config: PlasmaConfig) -> int:
    """Position, velocity and number of one particle."""
    size = 8 if config.numerics.precision == "double" else 4
    return (config.dimensions + velocity_components(config)) * size + 4


def step_seconds(config: PlasmaConfig, ranks: int, threads: int, rates: Mapping[str, float]) -> float:
    """One step: what is divided among the cores there are, what every launch costs, and the messages."""
    d = config.dimensions
    cells = math.prod(config.grid.points)
    kernel = f"particle_ns {d}D {config.numerics.shape} {config.numerics.precision}"
    components = (d + velocity_components(config)) / (2 * d)  # traffic beside that of the standard kernel
    work = particle_count(config) * rates[kernel] * components + cells * rates[f"cell_ns {d}D"]
    transforms = 1 + (d if config.numerics.gradient == "spectral" else 0)
    work += cells * rates["fft_ns"] * math.log2(max(cells, 2)) * 0.5 * (1 + transforms)
    cores = used_cores(ranks, threads, rates)
    if threads > 1 or ranks > 1:
        cores = 1 + (cores - 1) * rates["thread_efficiency"]
    launches = rates["launch_us 1" if threads == 1 else "launch_us 2"]
    return 1e-9 * work / cores + 1e-6 * launches + message_seconds(config, ranks, rates)


def used_cores(ranks: int, threads: int, rates: Mapping[str, float]) -> float:
    """Cores that do work: on one node not more than it has; beyond a node's cores, nodes of the same kind."""
    wanted = ranks * threads
    return wanted if wanted > 2 * rates["cores"] else min(wanted, rates["cores"])


def message_seconds(config: PlasmaConfig, ranks: int, rates: Mapping[str, float]) -> float:
    """Latencies and bytes of one step's messages of one rank: leavers, charge, potential, transposes."""
    if ranks == 1:
        return 0.0
    size = 8 if config.numerics.precision == "double" else 4
    points = config.grid.points
    row = points[0] if len(points) == 2 else 1
    transposes = 2 * size * math.prod(points) / ranks * (1 - 1 / ranks)
    count = 6 + 4 * (ranks - 1)
    return 1e-6 * count * rates["message_us"] + (transposes + 4 * 8 * row) / (1e9 * rates["message_gb_s"])


def sampling_seconds(config: PlasmaConfig, ranks: int, threads: int, rates: Mapping[str, float]) -> float:
    """Of the series over the whole run: every sample goes through all particles once."""
    period = config.simulation.sampling_period.energy
    samples = config.simulation.cycles // period + 1 if period else 0
    return 1e-9 * samples * particle_count(config) * rates["sample_ns"] / used_cores(ranks, threads, rates)


def memory_items(
    config: PlasmaConfig, ranks: int, threads: int, rates: Mapping[str, float]
) -> dict[str, float]:
    """Bytes per rank. The largest moment of a run is its end, when the state is put in order for the digest."""
    items = {"Python and libraries": rates["rank_mib"] * MIB}
    for array in arrays(config, ranks, threads):
        items[array.name] = array.bytes
    items["state in order of number"] = particle_count(config) / ranks * (particle_bytes(config) + 4)
    return items


def disk_items(config: PlasmaConfig) -> dict[str, float]:
    """Bytes of the whole run."""
    cycles, d = config.simulation.cycles, config.dimensions
    size = 8 if config.numerics.precision == "double" else 4
    energy = config.simulation.sampling_period.energy
    period = config.output.sampling_period
    particles, cells = particle_count(config), math.prod(config.grid.points)

    def times(every: int | None) -> int:
        return cycles // every + 1 if every else 0

    return {
        "series": times(energy) * SERIES_BYTES,
        "fields": times(period.field) * cells * size * (2 + d),
        "particles": times(period.particle) * particles * (3 * 8 + 3 * 8 + 8 + 4),
        "checkpoints, two": 2 * particles * (particle_bytes(config) + 4),
    }
