"""What the parts of a step take on the authors' machine: by these, work is weighed alike on all machines."""

from collections.abc import Mapping

from hpcpic.core.app.forecast import FILES
from hpcpic.plasma.case.config import PlasmaConfig, velocity_components

# Measured on the authors' machine, one core of a 2-core AMD Zen 5 at 4.1 GHz.
DEFAULT = FILES | {
    "particle_ns 2D CIC double": 2.3,  # pushed and delivered, in caches
    "particle_ns 2D CIC single": 1.9,
    "particle_ns 2D NGP double": 2.0,
    "particle_ns 2D NGP single": 1.6,
    "particle_ns 2D TSC double": 3.6,
    "particle_ns 2D TSC single": 2.6,
    "particle_ns 1D CIC double": 1.35,
    "particle_ns 1D CIC single": 1.1,
    "particle_ns 1D NGP double": 1.2,
    "particle_ns 1D NGP single": 0.9,
    "particle_ns 1D TSC double": 1.6,
    "particle_ns 1D TSC single": 1.4,
    "particle_ns 3D CIC double": 4.4,  # those of 3D by their ratio to 2D on a busy machine
    "particle_ns 3D CIC single": 4.1,
    "particle_ns 3D NGP double": 3.4,
    "particle_ns 3D NGP single": 2.8,
    "particle_ns 3D TSC double": 12.5,
    "particle_ns 3D TSC single": 10.0,
    "own_ns": 35.0,  # an acceleration of the user's own, one that is linear in the velocity: others 0.4 to 3 of it
    "memory_ns": 2.85,  # pushed and delivered, of STANDARD_BYTES, from memory
    "cache_mb": 32.0,  # last-level cache of a node
    "cell_ns 2D": 2.8,  # of the push and of the charge
    "cell_ns 1D": 2.0,
    "cell_ns 3D": 6.0,
    "tile_ns 2D": 430.0,  # more, of a tile of cells that is not empty
    "tile_ns 1D": 220.0,
    "tile_ns 3D": 900.0,
    "field_ns 2D": 6.7,  # transforms, potential and its gradient
    "field_ns 1D": 8.0,
    "field_ns 3D": 9.0,
    "field_memory_ns": 3.0,  # more, of a node that no cache holds, as transforms of 2048^2 and 4096^2 took
    "cell_memory_ns": 0.6,  # likewise; from a Zen 4, by the ratio of the fields
    "factor_ns 2D": 0.88,  # per number in the factors of LU
    "factor_ns 1D": 3.5,
    "factor_ns 3D": 3.0,
    "sample_ns": 3.4,  # of the series, per particle
    "sample_cell_ns": 8.0,
    "count_in_push": 0.7,  # a histogram's time in that of the push of its particles
    "plasma_sample_us": 75.0,
    "plasma_launch_us": 43.0,  # Python and the launches of a step
    "plasma_launch_together_us": 58.0,  # of several threads
    "plasma_exchange_us": 15.0,  # of ranks with each other: messages, or a word that all agree on
    "message_gb_s": 8.0,
    "cores": 2.0,
    "plasma_core_gain 2D": 1.65,  # of all cores of a node over one
    "plasma_rank_gain": 0.0,  # likewise by ranks in 2D: as much, unless it was measured
    "plasma_core_gain 1D": 1.5,
    "plasma_core_gain 3D": 1.65,
    "memory_core_gain": 1.3,  # and at particles that no cache holds
    "mesh_core_gain": 1.65,  # and at what cells and the field need
    "rank_mib": 220.0,  # Python and the libraries, kernels from the cache
}

# What differs without AVX-512: one core of a 2-core AMD Zen 3, beside other work.
NARROW = {
    "particle_ns 2D CIC double": 5.6,
    "particle_ns 2D CIC single": 4.6,
    "particle_ns 2D NGP double": 5.5,
    "particle_ns 2D NGP single": 3.3,
    "particle_ns 2D TSC double": 11.0,
    "particle_ns 2D TSC single": 8.2,
    "particle_ns 1D CIC double": 3.3,
    "particle_ns 1D CIC single": 2.9,
    "particle_ns 1D NGP double": 2.5,
    "particle_ns 1D NGP single": 1.8,
    "particle_ns 1D TSC double": 2.8,
    "particle_ns 1D TSC single": 2.8,
    "particle_ns 3D CIC double": 13.0,
    "particle_ns 3D CIC single": 8.7,
    "particle_ns 3D NGP double": 9.2,
    "particle_ns 3D NGP single": 7.1,
    "particle_ns 3D TSC double": 35.0,
    "particle_ns 3D TSC single": 30.0,
    "memory_ns": 6.1,
    "cell_ns 2D": 5.0,
    "cell_ns 1D": 2.8,
    "field_ns 2D": 15.0,
    "field_ns 1D": 9.5,
    "field_ns 3D": 17.0,
    "factor_ns 2D": 2.6,
    "factor_ns 1D": 5.9,
    "sample_ns": 4.8,
    "sample_cell_ns": 13.0,
    "plasma_sample_us": 350.0,
}


def kernel_ns(config: PlasmaConfig, rates: Mapping[str, float]) -> float:
    """Time of a particle in a step, in caches, ns."""
    d = config.dimensions
    components = (d + velocity_components(config)) / (2 * d)  # beside those of the standard kernel
    return rates[f"particle_ns {d}D {config.numerics.shape} {config.numerics.precision}"] * components
