"""What a plasma run will need: memory by item, disk, time for any ranks x threads, from measured rates.

A step is the work on particles, on cells and on the field, divided by the gain of the cores, and what does not divide:
Python with the launches, and the exchanges between ranks. Particles and nodes beyond those that the caches hold are
waited for, and all cores share one memory. A sample of the series goes through all particles and nodes. The rates
come from `hpcpic bench` on this machine; what it did not measure keeps its ratio to what it did on a machine of the
authors (rates.DEFAULT, rates.NARROW).
"""

import math
from collections.abc import Callable, Mapping

from hpcpic.core.app.forecast import Estimate, gain, writing_seconds
from hpcpic.core.app.rates import usual
from hpcpic.plasma.case.config import PlasmaConfig, velocity_components
from hpcpic.plasma.forecast.plan import arrays, factor_nonzeros
from hpcpic.plasma.forecast.rates import DEFAULT, NARROW, kernel_ns
from hpcpic.plasma.forecast.scales import particle_count
from hpcpic.plasma.physics.species_fields import MESH_FIELDS, SPECIES_FIELDS
from hpcpic.plasma.sizes import EDGE

MIB = 2.0**20
SERIES_BYTES = 16 * 8 * 2  # of one sample: sixteen numbers, in HDF5 and as text
SERIES_SHARE = 0.05  # of a run that samples of a series, or histograms, that nobody has asked for may take,
SERIES_SECONDS = 1.0  # or as many seconds of a core: the shortest runs have all their steps in the series
COUNTS_OF_A_RUN = 100  # of histograms, at most, unless the case asks for more
START = 1.0  # s: interpreter, libraries, kernels from the cache
HELD = 0.75  # of the last-level cache, by particles: fields and what else runs want the rest
STANDARD_BYTES = 36  # of a particle in two dimensions and double precision
NODE_BYTES = 32  # of a node, by the rows and columns of its transform, which are read again within a field
LEVELS = {3: 18, 2: 18, 1: 16}  # log2 of the nodes for which `field_ns` holds: a transform's work grows with it


def estimate(config: PlasmaConfig, ranks: int, threads: int, measured: Mapping[str, float]) -> Estimate:
    """Memory, disk and time of a completed case on ranks x threads; `measured` rates of this machine take the place of
    usual ones.
    """
    rates = completed_rates(measured)
    cycles, period = config.simulation.cycles, config.periods["series"]
    whole = phases(config, ranks, threads, rates)
    shown = {name: seconds for name, seconds in whole.items() if name != "field" or period != 1}
    sampling = (cycles // period + 1 if period else 0) * sample_seconds(config, ranks, threads, rates)
    if counted := config.periods["histogram"]:
        sampling += (cycles // counted + 1) * count_seconds(config, ranks, threads, rates)
    disk = disk_items(config)
    written = config.output.every
    snapshots = sum(cycles // every + 1 for every in (written.fields, written.particles) if every)
    seconds = START + cycles * sum(whole.values()) + sampling + writing_seconds(disk, snapshots, rates)
    return Estimate(
        memory_items(config, ranks, threads, rates), disk, sum(shown.values()), seconds, whole, sampling, START
    )


def completed_rates(measured: Mapping[str, float]) -> dict[str, float]:
    """Usual rates with the measured ones; a kernel that was not measured keeps its ratio to the standard one."""
    standard, rates = "particle_ns 2D CIC double", usual(DEFAULT, NARROW)
    ratio = measured.get(standard, rates[standard]) / rates[standard]
    scaled = {name: value * ratio if "_ns" in name else value for name, value in rates.items()}
    return scaled | dict(measured)


def particle_bytes(config: PlasmaConfig) -> int:
    """Position, velocity and number of one particle."""
    size = 8 if config.numerics.precision == "double" else 4
    return (config.dimensions + velocity_components(config)) * size + 4


def phases(config: PlasmaConfig, ranks: int, threads: int, rates: Mapping[str, float]) -> dict[str, float]:
    """Seconds of one step by what it does. With a sample in every step the field is solved there, not in the step."""
    if not particle_count(config):
        return {"launches": 1e-6}
    d, cells = config.dimensions, math.prod(config.points)
    cores, mesh = (1e9 * gain_of(what, ranks, threads, rates) for what in (f"plasma_core_gain {d}D", "mesh_core_gain"))
    tiles = math.prod(-(-n // EDGE[d]) for n in config.points)
    filled = sum(filled_tiles(species.particles, tiles) for species in config.species)
    away = beyond_caches(cells, NODE_BYTES, max(1.0, ranks * threads / rates["cores"]), rates) / NODE_BYTES
    driven = sum(species.particles for species in config.species if species.acceleration)
    return {
        "particles": particle_count(config) * kernel_ns(config, rates) / cores,
        "accelerations": driven * rates["own_ns"] / cores,
        "memory": memory_seconds(config, ranks, threads, rates),
        "tiles": filled * rates[f"tile_ns {d}D"] / cores,
        "cells": (cells * rates[f"cell_ns {d}D"] + away * rates["cell_memory_ns"]) / mesh,
        "field": field_seconds(config, 1e-9 * mesh, away, rates),
        "launches": 1e-6 * rates["plasma_launch_us" if threads == 1 else "plasma_launch_together_us"],
        "exchanges": exchange_seconds(config, ranks, rates),
    }


def gain_of(what: str, ranks: int, threads: int, rates: Mapping[str, float]) -> float:
    """The speed-up over one core in work for which all cores of a node have the rate `what`, by threads; ranks, each
    with memory of its own, gain more by as much as was measured of particles in two dimensions.
    """
    by_ranks = rates["plasma_rank_gain"] / rates["plasma_core_gain 2D"]
    return gain(ranks, threads, rates, rates[what] * (max(1.0, by_ranks) if threads == 1 else 1.0))


def field_seconds(config: PlasmaConfig, cores: float, away: float, rates: Mapping[str, float]) -> float:
    """Seconds of one field, of which no cache holds `away` nodes. With LU every rank solves the whole of it, on one
    thread.
    """
    d, spectral = config.dimensions, config.numerics.gradient == "spectral"
    if config.simulation.solver == "LU":
        return 1e-9 * factor_nonzeros(config.points) * rates[f"factor_ns {d}D"]
    transforms = 1 + 0.5 * d * spectral  # beside those of differences
    cells = math.prod(config.points)
    work = cells * max(1.0, math.log2(cells)) / LEVELS[d] * rates[f"field_ns {d}D"] + away * rates["field_memory_ns"]
    return 1e-9 * work * transforms / cores


def beyond_caches(n: int, size: int, nodes: float, rates: Mapping[str, float]) -> float:
    """Bytes that come from memory in every step, of n things of so many bytes."""
    return max(0.0, n * size - nodes * 1e6 * HELD * rates["cache_mb"])


def memory_seconds(config: PlasmaConfig, ranks: int, threads: int, rates: Mapping[str, float]) -> float:
    """Seconds that memory adds to a step, for particles that no cache holds: all of their time on these cores, less
    that of their work.
    """
    nodes = max(1.0, ranks * threads / rates["cores"])
    n = beyond_caches(particle_count(config), particle_bytes(config), nodes, rates) / STANDARD_BYTES
    kinds = "memory_core_gain", "plasma_core_gain 2D"
    memory, cores = (gain_of(what, ranks, threads, rates) for what in kinds)
    return 1e-9 * n * max(0.0, rates["memory_ns"] / memory - rates["particle_ns 2D CIC double"] / cores)


def filled_tiles(particles: int, tiles: int) -> float:
    """How many of so many tiles are not empty when each particle may be in any of them."""
    return tiles * -math.expm1(-particles / tiles)


def exchanges(d: int, ranks: int) -> int:
    """Messages of a step that ranks wait for one after the other."""
    return 5 if d == 1 else 4 + 2 * (ranks - 1)


def exchange_seconds(config: PlasmaConfig, ranks: int, rates: Mapping[str, float]) -> float:
    """Seconds of messages of one step: leavers, the word that says whether more are to come, charge, potential and
    transposes, whose bytes travel between nodes only.
    """
    if ranks == 1:
        return 0.0
    size = 8 if config.numerics.precision == "double" else 4
    away = max(0.0, 1 - rates["cores"] / ranks)
    transposes = 2 * size * math.prod(config.points) / ranks * away
    count = exchanges(config.dimensions, ranks)
    return 1e-6 * count * rates["plasma_exchange_us"] + transposes / (1e9 * rates["message_gb_s"])


def sample_seconds(config: PlasmaConfig, ranks: int, threads: int, rates: Mapping[str, float]) -> float:
    """Seconds of one sample of the series beside the field, which the next step would have solved."""
    work = particle_count(config) * rates["sample_ns"] + math.prod(config.points) * rates["sample_cell_ns"]
    cores = gain_of(f"plasma_core_gain {config.dimensions}D", ranks, threads, rates)
    return 1e-9 * work / cores + 1e-6 * rates["plasma_sample_us"]


def count_seconds(config: PlasmaConfig, ranks: int, threads: int, rates: Mapping[str, float]) -> float:
    """Seconds of counting all histograms once: so many parts of the push of their particles."""
    sizes = {species.name: species.particles for species in config.species}
    step = phases(config, ranks, threads, rates)
    counted = sum(sizes[histogram.species] for histogram in config.histogram) / max(1, particle_count(config))
    return rates["count_in_push"] * counted * (step.get("particles", 0.0) + step.get("memory", 0.0))


def affordable_period(config: PlasmaConfig, seconds: Callable[..., float]) -> int:
    """Steps between samples that a run can afford, each of so many `seconds(config, ranks, threads, rates)`; by DEFAULT
    rates, so the same on any machine.
    """
    cycles = config.simulation.cycles
    steps = cycles * sum(phases(config, 1, 1, DEFAULT).values())
    affordable = max(SERIES_SHARE * steps, SERIES_SECONDS)
    return max(1, math.ceil(cycles * seconds(config, 1, 1, DEFAULT) / affordable))


def default_periods(config: PlasmaConfig) -> dict[str, int]:
    """Steps between samples of the series and between counts of the histograms where the case does not say."""
    counts = max(affordable_period(config, count_seconds), config.simulation.cycles // COUNTS_OF_A_RUN)
    return {"series": affordable_period(config, sample_seconds), "histograms": counts if config.histogram else 0}


def memory_items(config: PlasmaConfig, ranks: int, threads: int, rates: Mapping[str, float]) -> dict[str, float]:
    """Bytes per rank. The largest moment of a run is its end, when the state is put in order for the digest."""
    items = {"Python and libraries": rates["rank_mib"] * MIB}
    for array in arrays(config, ranks, threads):
        items[array.name] = array.bytes
    items["state in order of number"] = particle_count(config) / ranks * (particle_bytes(config) + 4)
    return items


def stored_components(config: PlasmaConfig) -> int:
    """Numbers of a node in a snapshot of the fields; vectors are stored with three components."""
    names = config.output.fields
    of_mesh = sum(3 if field.vector else 1 for name, field in MESH_FIELDS.items() if name in names)
    of_species = sum(3 if field.vector else 1 for name, field in SPECIES_FIELDS.items() if name in names)
    return of_mesh + len(config.species) * of_species


def disk_items(config: PlasmaConfig) -> dict[str, float]:
    """Bytes of the whole run."""
    cycles = config.simulation.cycles
    series, period = config.periods["series"], config.output.every
    particles, cells = particle_count(config), math.prod(config.points)

    def times(every: int | None) -> int:
        return cycles // every + 1 if every else 0

    return {
        "series": times(series) * SERIES_BYTES,
        "fields": times(period.fields) * cells * 8 * stored_components(config),
        "particles": times(period.particles) * particles * (3 * 8 + 3 * 8 + 8 + 4),
        "histograms": (cycles // counted + 1) * 8 * sum(math.prod(one.bins) + 1 for one in config.histogram)
        if (counted := config.periods["histogram"])
        else 0,
        "checkpoints, two": 2 * particles * (particle_bytes(config) + 4),
    }
