"""What an SPH run will need: memory by item, disk, time for any ranks x threads, from measured rates.

A step is pair sums and what every particle and image of one costs, divided by the gain of the cores, and what does not
divide: launches, finding images in mirrors and periodic sides, walls and the forces on them, and the exchanges between
ranks. A sample needs the accelerations that the next step begins with, and leaves them to it.
"""

import math
from collections.abc import Mapping

import numpy as np

from hpcpic.core.app.forecast import FILES, Estimate, gain, writing_seconds
from hpcpic.core.app.rates import usual
from sph.case.config import SphConfig, shapes_of
from sph.forecast.plan import MIB, arrays, counts, images
from sph.physics import stability
from sph.physics.fluxes import FLUXES
from sph.physics.integrators import INTEGRATORS
from sph.physics.stability import support_of
from sph.physics.viscosities import viscosity_of
from sph.physics.wall_rules import rule_of
from sph.sizes import LEVELS

# Evaluations of all pair sums that these take as long as, in two and in three dimensions; measured.
DELTA = 1.0, 1.4  # renormalised gradients
SHIFTS = 0.6, 0.7
STRAIN = 0.9, 1.7  # (MP 22), and the stress of it
FULL_STRESS = 2.0, 2.7
SERIES_BYTES = 24 * 8 * 2
START = 1.4  # s: interpreter, libraries, kernels from the cache
TRIMESH_MIB, TRIANGLE_BYTES = 52.0, 1370  # of what reads STL files, and of each triangle in them; measured

# Measured on the authors' machine, one core of a 2-core AMD Zen 5 at 4.1 GHz.
DEFAULT = FILES | {
    "pair_ns 3D double": 2.0,  # of a directed pair within the support
    "pair_ns 3D single": 1.4,
    "pair_ns 2D double": 1.65,
    "pair_ns 2D single": 1.45,
    "body_ns 3D": 50.0,  # sorting, state, criteria
    "body_ns 2D": 40.0,
    "step_us euler": 145.0,  # Python and the launches of a step beside its sums
    "step_us predictor-corrector": 170.0,
    "step_us rk3-tvd": 195.0,
    "step_us symplectic": 140.0,
    "sums_us euler": 35.0,  # and of these
    "sums_us predictor-corrector": 70.0,
    "sums_us rk3-tvd": 105.0,
    "sums_us symplectic": 50.0,
    "images_us": 60.0,  # a step: who has images in mirrors and periodic sides
    "symmetric_us": 95.0,  # the same with point symmetry
    "image_refresh_us": 30.0,  # and an evaluation
    "walls_us": 10.0,  # a step: whether the fluid comes to where walls are not made yet
    "force_us": 120.0,  # and the force on a wall, which its impulse needs
    "rigid_us": 220.0,  # a step and rigid body, beside the force on it
    "mooring_us": 170.0,  # and where bodies hang on lines
    "opening_us": 500.0,  # a step of an inlet or outlet: who is in its box and before it
    "sph_sample_us": 70.0,
    "gauge_ns": 60.0,  # of a sample, a particle and level of a gauge of elevation
    "ghost_exchange_us": 150.0,  # a step of several ranks: who is a ghost where, leavers, the time step
    "image_exchange_us": 150.0,  # and who has images there
    "refresh_us": 30.0,  # of ghosts, an evaluation
    "ghost_ns": 200.0,  # of one ghost, a step
    "cores": 2.0,
    "pair_core_gain": 1.7,  # of all cores of a node over one
    "rank_mib": 195.0,
}

# What differs without AVX-512: one core of a 2-core AMD Zen 3, beside other work.
NARROW = {
    "pair_ns 3D double": 5.4,
    "pair_ns 3D single": 2.5,
    "pair_ns 2D double": 3.0,
    "pair_ns 2D single": 2.4,
    "body_ns 3D": 130.0,
    "body_ns 2D": 40.0,
    "step_us euler": 460.0,
    "step_us predictor-corrector": 510.0,
    "step_us rk3-tvd": 580.0,
    "step_us symplectic": 520.0,
    "sums_us euler": 38.0,
    "sums_us predictor-corrector": 73.0,
    "sums_us rk3-tvd": 97.0,
    "sums_us symplectic": 86.0,
    "images_us": 290.0,
    "symmetric_us": 240.0,
    "image_refresh_us": 100.0,
    "walls_us": 24.0,
    "force_us": 330.0,
    "rigid_us": 740.0,
    "mooring_us": 520.0,
    "sph_sample_us": 210.0,
}


def estimate(config: SphConfig, ranks: int, threads: int, measured: Mapping[str, float]) -> Estimate:
    """Memory, disk and time of a completed case on ranks x threads; `measured` rates of this machine take the place of
    usual ones.
    """
    rates = usual(DEFAULT, NARROW) | dict(measured)
    whole = phases(config, ranks, threads, rates)
    one, first = sum(whole.values()), first_seconds(config, whole, rates)
    steps, samples = config.simulation.end_time / stability.time_step(config), times(config, "series")
    step = one - first if samples > 0.5 * steps else one  # the median one, as runs tell it
    sampling = samples * sample_seconds(config, rates)
    memory = {"Python and libraries": rates["rank_mib"] * MIB}
    memory |= {"surfaces of triangles": surface_bytes(config)} if any(shape.stl for shape in shapes_of(config)) else {}
    memory |= {array.name: float(array.bytes) for array in arrays(config, ranks)}
    disk = disk_items(config)
    writing = writing_seconds(disk, round(times(config, "particles")), rates)
    return Estimate(memory, disk, step, START + steps * one + sampling + writing, whole, sampling, START)


def surface_bytes(config: SphConfig) -> float:
    """Bytes of the surfaces that are read from STL files."""
    from sph.case.stl import mesh

    files = {shape.stl for shape in shapes_of(config) if shape.stl}
    return TRIMESH_MIB * MIB + TRIANGLE_BYTES * sum(len(mesh(stl).faces) for stl in files)


def phases(config: SphConfig, ranks: int, threads: int, rates: Mapping[str, float]) -> dict[str, float]:
    """Seconds of one step by what it does, when no sample was taken before it."""
    fluid, walls = counts(config)
    d, others = config.dimensions, walls + images(config)
    pairs = (fluid + 0.5 * others) * len(around(support_of(config) / config.numerics.spacing, d))
    cores = 1e9 * gain(ranks, threads, rates, rates["pair_core_gain"])
    kind = config.simulation.integrator
    symmetric = any(rule_of(wall.type).layer_images for wall in config.wall)
    finding = rates["symmetric_us" if symmetric else "images_us"]
    finding += INTEGRATORS[kind].evaluations * rates["image_refresh_us"]
    return {
        "pairs": sums(config) * pairs * rates[f"pair_ns {d}D {config.numerics.precision}"] / cores,
        "particles": (fluid + others) * rates[f"body_ns {d}D"] / cores,
        "launches": 1e-6 * (rates[f"step_us {kind}"] + rates[f"sums_us {kind}"]),
        "images": 1e-6 * finding if imaged(config) else 0.0,
        "walls": wall_seconds(config, rates),
        "bodies": body_seconds(config, rates),
        "openings": 1e-6 * (len(config.inlet) + len(config.outlet)) * rates["opening_us"],
        "exchanges": exchange_seconds(config, ranks, rates),
    }


def around(reach: float, d: int) -> np.ndarray:
    """Steps[n, d] from a point of a lattice to its neighbours nearer than `reach` spacings."""
    line = np.arange(-int(reach), int(reach) + 1)
    steps = np.stack(np.meshgrid(*[line] * d), axis=-1).reshape(-1, d)
    squares = np.sum(steps**2, axis=1)
    return steps[(squares > 0) & (squares < reach * reach)]


def exchange_seconds(config: SphConfig, ranks: int, rates: Mapping[str, float]) -> float:
    """Seconds of messages in one step of several ranks: leavers, the time step, and ghosts, as many as a compact body
    of fluid shows.
    """
    if ranks == 1:
        return 0.0
    d, (fluid, walls) = config.dimensions, counts(config)
    ghosts = min(2, ranks - 1) * (fluid + walls) ** (1 - 1 / d) * support_of(config) / config.numerics.spacing
    fixed = rates["ghost_exchange_us"] + (rates["image_exchange_us"] if imaged(config) else 0.0)
    fixed += INTEGRATORS[config.simulation.integrator].evaluations * rates["refresh_us"]
    return 1e-6 * fixed + 1e-9 * ghosts * rates["ghost_ns"]


def imaged(config: SphConfig) -> bool:
    """Whether particles have images."""
    return bool(config.domain.periodic) or any(rule_of(wall.type).images for wall in config.wall)


def wall_seconds(config: SphConfig, rates: Mapping[str, float]) -> float:
    """Seconds of walls in one step: those of particles, and the forces that are measured."""
    made = any(not rule_of(wall.type).images for wall in config.wall)
    measured = sum(wall.measure_force for wall in config.wall)
    return 1e-6 * (made * rates["walls_us"] + measured * rates["force_us"])


def body_seconds(config: SphConfig, rates: Mapping[str, float]) -> float:
    """Seconds of rigid bodies in one step, without those of the force on them; contacts take them while they touch."""
    bodies = [wall.body for wall in config.wall if wall.body]
    return 1e-6 * (len(bodies) * rates["rigid_us"] + any(body.mooring for body in bodies) * rates["mooring_us"])


def sample_seconds(config: SphConfig, rates: Mapping[str, float]) -> float:
    """Seconds of one line of the series: sums, forces, and the columns of fluid over gauges of elevation."""
    d, reach, (fluid, _) = config.dimensions, support_of(config) / config.numerics.spacing, counts(config)
    near = min(fluid, 2 * reach * fluid**0.5 if d == 2 else math.pi * reach**2 * fluid ** (1 / 3))
    columns = sum(gauge.kind.column for gauge in config.gauge)
    measured = sum(wall.measure_force for wall in config.wall)
    fixed = 1e-6 * (rates["sph_sample_us"] + measured * rates["force_us"])
    levels = 2 * LEVELS * reach  # within the support of a particle, above and below it
    return fixed + 1e-9 * columns * near * levels * rates["gauge_ns"]


def sums(config: SphConfig) -> float:
    """Evaluations of all pair sums that a step is worth."""
    integrator, numerics = INTEGRATORS[config.simulation.integrator], config.numerics
    viscosity = viscosity_of(numerics.viscosity_form)
    more = [(DELTA, "g" in FLUXES[numerics.density_flux].columns), (SHIFTS, numerics.shifting)]
    more += [(STRAIN, viscosity.stress), (FULL_STRESS, viscosity.transposed is not None)]
    return integrator.work + integrator.evaluations * sum(cost[config.dimensions - 2] for cost, used in more if used)


def first_seconds(config: SphConfig, whole: Mapping[str, float], rates: Mapping[str, float]) -> float:
    """Seconds of the first evaluation of a step, which it finds done where a sample was taken."""
    kind = config.simulation.integrator
    return INTEGRATORS[kind].first_work / INTEGRATORS[kind].work * (whole["pairs"] + 1e-6 * rates[f"sums_us {kind}"])


def times(config: SphConfig, kind: str) -> float:
    """How often this kind of output is written; a step may exceed its period in seconds."""
    end, dt = config.simulation.end_time, stability.time_step(config)
    seconds, every = getattr(config.output.period, kind), getattr(config.output.every, kind)
    if every:
        return end / (every * dt) + 1
    return min(end / seconds, end / dt) + 1 if seconds else 0.0


def disk_items(config: SphConfig) -> dict[str, float]:
    """Bytes of the whole run."""
    fluid, walls = counts(config)
    shown = fluid + (walls if config.output.walls else 0)
    return {
        "series": times(config, "series") * SERIES_BYTES,
        "particles": times(config, "particles") * shown * (3 * 8 + 3 * 8 + 8 + 8 + 8 + 4),
        "checkpoints, two": 2 * (fluid + walls) * (8 * (2 * config.dimensions + 3)),
    }
