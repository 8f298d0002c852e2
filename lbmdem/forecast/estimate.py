"""What an LBM-DEM run will need: memory by item, disk, time for any ranks x threads, from measured rates.

A step sweeps all nodes, those beside solids at a higher price; links, grains and their substeps, and what moving solids
need, come on top. Where nothing moves in the fluid several steps are done in a pass over memory: they share its launch
and do not wait for memory. Work divides among the cores, launches and exchanges do not.
"""

import math
from collections.abc import Mapping

from hpcpic.core.app.forecast import Estimate, gain, writing_seconds
from hpcpic.core.app.rates import usual
from hpcpic.core.case.words import in_steps
from lbmdem.case.config import LbmDemConfig
from lbmdem.forecast.films import expected_substeps
from lbmdem.forecast.node_shares import (
    cached,
    fluid_share,
    lanes_of_all,
    node_bytes,
    population_bytes,
    shares,
)
from lbmdem.forecast.plan import arrays, face_bytes, grain_count, link_count
from lbmdem.forecast.rates import DEFAULT, NARROW, held_alone, node_ns
from lbmdem.physics.velocity_sets import LATTICES
from lbmdem.sizes import (
    CACHE_OF_WHOLE_PLANES,
    GRAINS_OF_ONE_THREAD,
    STEPS_OWED,
    STEPS_PER_CALL,
    STEPS_PER_PASS,
)

MIB = 2.0**20
SERIES_BYTES = 16 * 8 * 2
SERIES_SHARE = 0.05  # of a run, its start included, that samples of a series may take whose period no case gives
SAMPLES = 20, 100  # of such a series, at least and at most
START = 1.0  # s: interpreter, libraries, kernels from the cache
BLOCK = 16 * MIB  # of all ranks' state, which the first one reads for the digest


def estimate(config: LbmDemConfig, ranks: int, threads: int, measured: Mapping[str, float]) -> Estimate:
    """What a completed case needs on ranks x threads; `measured` rates of this machine take the place of usual ones."""
    rates = usual(DEFAULT, NARROW) | dict(measured)
    every = output_periods(config)
    depth, period = steps_per_pass(config, ranks, threads), every["series"]
    single = phases(config, ranks, threads, rates, 1)
    whole = phases(config, ranks, threads, rates, depth) if depth > 1 else single
    together = share_together(depth, period or config.n_steps)
    step = sum((whole if together >= 0.5 else single).values())
    mean = together * sum(whole.values()) + (1 - together) * sum(single.values())
    sampling = (config.n_steps // period + 1) * sample_seconds(config, ranks, threads, rates) if period else 0.0
    memory = memory_items(config, ranks, rates)
    disk = disk_items(config)
    snapshots = sum(config.n_steps // every[kind] + 1 for kind in ("field", "particle") if every[kind])
    seconds = START + config.n_steps * mean + sampling + writing_seconds(disk, snapshots, rates)
    return Estimate(memory, disk, step, seconds, whole if together >= 0.5 else single, sampling, START)


def memory_items(config: LbmDemConfig, ranks: int, rates: Mapping[str, float]) -> dict[str, float]:
    """Bytes per rank. The largest moment of a run is its end, when the state is put in order for the digest."""
    libraries = rates["rank_mib"] + (rates["scipy_mib"] if any(group.diameters for group in config.grains) else 0.0)
    memory = {"Python and libraries": libraries * MIB}
    memory |= {array.name: float(array.bytes) for array in arrays(config, ranks)}
    if config.fluid:
        memory["state in order of rows"] = population_bytes(config) / ranks
        if ranks > 1:  # as they come from others, and as they are put together (core.run.checkpoint)
            memory["blocks of the digest"] = 2 * min(BLOCK, population_bytes(config))
    return memory


def phases(
    config: LbmDemConfig, ranks: int, threads: int, rates: Mapping[str, float], together: int
) -> dict[str, float]:
    """Seconds of one step by what it does, with so many steps per pass over memory."""
    cores = 1e9 * gain(ranks, threads, rates, rates["wave_core_gain"])
    launch = rates["lattice_launch_us" if threads == 1 else "lattice_launch_together_us"]
    launch += rates["lattice_drive_us"] if config.fluid and config.shaking else 0.0
    own = any(group.acceleration for group in config.grains)  # it depends on where they are
    calls = 1 / (together if config.fluid else 1 if own else STEPS_PER_CALL)
    seconds = {"launches": 1e-6 * launch * calls}
    if config.fluid:
        seconds |= sweep_seconds(config, ranks, threads, rates, together)
        seconds["links"] = link_seconds(config, ranks, threads, rates, together)
        seconds["messages"] = message_seconds(config, ranks, rates)
    if config.grains_move:
        n, substeps = grain_count(config), expected_substeps(config)
        seconds["grains"] = 1e-6 * (rates["grains_us"] * calls + substeps * rates["substep_us"])
        rate = 1e9 if n <= GRAINS_OF_ONE_THREAD * threads else cores
        seconds["grains"] += n * substeps * rates["grain_ns"] / rate
        if config.fluid and not config.coupling.frozen:
            each = grain_count(config) * rates[f"moving_grain_us {config.dimensions}D"]
            cold = 0.0 if cached(config) else rates["cold_us"]
            seconds["moving solids"] = 1e-6 * (rates["moving_us"] + cold + each)
            if config.coupling.keeps_mass:
                put_back = math.prod(config.points) * rates["conserving_ns"] / cores
                seconds["moving solids"] += put_back / (1 if config.coupling.refill == "conserving" else STEPS_OWED)
        seconds["exchanges"] = exchange_seconds(config, rates) if ranks > 1 else 0.0
    return seconds


def link_seconds(config: LbmDemConfig, ranks: int, threads: int, rates: Mapping[str, float], together: int) -> float:
    """Bounce back at solids."""
    links, d = link_count(config), config.dimensions
    if config.grains_move and not config.coupling.frozen:
        work = links * rates[f"link_ns moving {d}D"] + 1e3 * grain_count(config) * rates[f"moving_link_us {d}D"]
        return 1e-9 * work / gain(ranks, threads, rates, rates["wave_core_gain"])
    near, far = "cached" if cached(config) else "fixed", "fixed single"
    if held_alone(config, rates):
        near, far = "sparse", "fixed"
    kind = near if together > 1 or cached(config) else far
    return 1e-9 * links * rates[f"link_ns {kind}"] / gain(ranks, threads, rates, rates[core_gain(config, rates)])


def core_gain(config: LbmDemConfig, rates: Mapping[str, float]) -> str:
    """The rate of what all cores gain on sweeps and links that do not wait for memory."""
    if held_alone(config, rates):
        return "sparse_core_gain"
    return "cached_core_gain" if cached(config) else "wave_core_gain"


def steps_per_pass(config: LbmDemConfig, ranks: int, threads: int) -> int:
    """1 where solids move or something drives the fluid from step to step."""
    driven = config.shaking is not None or any(face.pressure_rate for face in config.boundary)
    if not config.fluid or config.grains_move or driven:
        return 1
    lag = 2 if config.grains or config.obstacle or config.boundary else 1
    depth = min(STEPS_PER_PASS, config.points[-1] // (ranks * threads * 2 * lag))
    if lag > 1:
        wave = population_bytes(config) / config.points[-1] * threads
        depth = min(depth, int((CACHE_OF_WHOLE_PLANES / wave - 1) // 2))
    return max(1, depth)


def share_together(depth: int, period: int) -> float:
    """The share of the steps between two looks that are done several per pass, in passes of nearly the same."""
    alone = period if depth == 1 else period % 2 if depth == 2 else int(period == 1)
    return 1.0 - alone / period


def sweep_seconds(
    config: LbmDemConfig, ranks: int, threads: int, rates: Mapping[str, float], together: int
) -> dict[str, float]:
    """Arithmetic of all nodes with fluid, and the wait for memory where one step is done per pass."""
    found, (one, bare, more, beside) = shares(config), node_ns(config, rates)
    places = 1e-9 * (math.prod(config.points) if held_alone(config, rates) else lanes_of_all(config))
    wet = 1 - found.skipped
    if held_alone(config, rates):
        wet = fluid_share(config)
        work = places * bare * wet * (rates["sparse"] + more)
    else:
        work = places * (bare * wet * (1 + more) + beside * found.mixed)
    seconds = {"nodes": work / gain(ranks, threads, rates, rates[core_gain(config, rates)])}
    if together == 1:
        both = (one / gain(ranks, threads, rates, rates["sweep_core_gain"])
                - bare / gain(ranks, threads, rates, rates[core_gain(config, rates)]))  # fmt: skip
        seconds["memory"] = places * wet * max(0.0, both)
    return seconds


def message_seconds(config: LbmDemConfig, ranks: int, rates: Mapping[str, float]) -> float:
    """Every step's populations cross both ends of a slab, also within a pass."""
    if ranks == 1:
        return 0.0
    return 1e-6 * rates["message_us"] + 2 * face_bytes(config) / (1e9 * rates["message_gb_s"])


def exchange_seconds(config: LbmDemConfig, rates: Mapping[str, float]) -> float:
    """Seconds of exchanging forces and owners of moving grains, and planes beside a slab where they uncover nodes."""
    planes = 0
    if config.fluid and not config.coupling.frozen:
        planes = 2 * math.prod(config.points[:-1]) * LATTICES[config.lattice].q
    return 1e-6 * rates["grain_exchange_us"] + 1e-9 * planes * rates["refill_plane_ns"]


def sample_seconds(config: LbmDemConfig, ranks: int, threads: int, rates: Mapping[str, float]) -> float:
    """Seconds of one sample of the series, which goes through all nodes."""
    nodes = math.prod(config.points) if config.fluid else 0
    return 1e-6 * rates["lattice_sample_us"] + 1e-9 * nodes * rates["lattice_sample_ns"] / gain(
        ranks, threads, rates, rates["wave_core_gain"]
    )


def series_period(config: LbmDemConfig) -> int:
    """Steps between samples where the case does not say; by DEFAULT rates, so the same on any machine."""
    step = sum(phases(config, 1, 1, DEFAULT, steps_per_pass(config, 1, 1)).values())
    affordable = SERIES_SHARE * (START + config.n_steps * step) / sample_seconds(config, 1, 1, DEFAULT)
    least, most = SAMPLES
    return max(1, config.n_steps // max(least, min(most, int(affordable))))


def output_periods(config: LbmDemConfig) -> dict[str, int]:
    """Steps between samples of series, fields and grains, checkpoints; 0 = never."""
    every, seconds = config.output.every, config.output.period

    def steps(kind: str) -> int:
        return in_steps(getattr(every, kind), getattr(seconds, kind), config.time_step)

    return {
        "series": steps("series") or series_period(config),
        "field": steps("fields") if config.fluid else 0,
        "particle": steps("grains") if config.grains else 0,
        "checkpoint": steps("checkpoint"),
    }


def disk_items(config: LbmDemConfig) -> dict[str, float]:
    """Bytes of the whole run."""
    nodes, periods = math.prod(config.points), output_periods(config)

    def times(every: int) -> int:
        return config.n_steps // every + 1 if every else 0

    populations = node_bytes(config) if config.fluid else 0
    fluid = 2 * (config.fluid is not None)  # force and torque
    forces = fluid + config.grains_move  # of contacts
    return {
        "series": times(periods["series"]) * SERIES_BYTES,
        "fields": times(periods["field"]) * nodes * 8 * (1 + 3),  # vectors have three components
        "grains": times(periods["particle"]) * grain_count(config) * 8 * (13 + 3 * forces),
        "checkpoints, two": 2 * (nodes * populations + grain_count(config) * 8 * 13),
    }
