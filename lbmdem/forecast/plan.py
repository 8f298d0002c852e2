"""What a case makes the program do and hold: kernels, arrays and messages of a step, before anything is allocated.

`check --plan` prints it and `estimate` adds it up, so what a scene does not contain shows as missing lines and bytes.
"""

import math
from collections.abc import Iterator

from hpcpic.core.app.forecast import imports
from hpcpic.core.space.cuts import even_cuts
from hpcpic.core.space.declared import Array
from lbmdem.case.config import AXES, LbmDemConfig
from lbmdem.forecast.node_shares import grains
from lbmdem.grains.arrays import expected
from lbmdem.layout import Layout
from lbmdem.physics.velocity_sets import LATTICES
from lbmdem.sizes import STORAGE

LINKS = {2: 3.07, 3: 5.74}  # per node of a grain's perimeter or surface: half the sum of |e . n|, any direction n


def grain_count(config: LbmDemConfig) -> int:
    return sum(group.count for group in config.grains)


def link_count(config: LbmDemConfig) -> int:
    """Links between fluid and grains, of all ranks; grains in contact share some, which is not looked at."""
    d = config.dimensions
    surface = sum(n * math.pi * (2 * r) ** (d - 1) for group in config.grains for r, n in grains(config, group))
    return round(surface * LINKS[d])


def moving(config: LbmDemConfig) -> bool:
    return any(group.moving for group in config.grains)


def kernels(config: LbmDemConfig) -> list[str]:
    """The compiled kernels of a step, with what they are made for."""
    lines = fluid_kernels(config) if config.fluid else []
    if moving(config):
        lines.append(f"contacts   {config.contact.tangential} friction, velocity Verlet")
    return lines


def fluid_kernels(config: LbmDemConfig) -> list[str]:
    fluid, coupling = config.liquid, config.coupling
    forced = ", body force" if any(fluid.body_force) or config.shaking else ""
    lines = [f"sweep      {config.lattice}, {fluid.collision}, {fluid.storage}{forced}, in place"]
    kinds = sorted({face.type for face in config.boundary if face.type != "wall"})
    lines += [f"faces      {' and '.join(kinds)} (Zou & He)"] if kinds else []
    moved = moving(config) and not coupling.frozen
    if config.grains or config.obstacle:
        kind = "moving grains" if moved else "fixed, coefficients kept"
        lines.append(f"links      {coupling.bounce_back}, {kind}")
    return lines + (["solid      incremental", f"refill     {coupling.refill}"] if moved else [])


def arrays(config: LbmDemConfig, ranks: int) -> Iterator[Array]:
    if config.fluid:
        yield from fluid_arrays(config, ranks)
    if moving(config):
        yield from expected(grain_count(config) // ranks + 1, config.dimensions)


def fluid_arrays(config: LbmDemConfig, ranks: int) -> Iterator[Array]:
    points, real = config.points[::-1], STORAGE[config.liquid.storage]
    own = (even_cuts(points[0], ranks)[1], *points[1:])
    around = tuple(axis in config.domain.periodic for axis in AXES[: config.dimensions][::-1])
    layout = Layout.of(LATTICES[config.lattice], own, around, min(ranks, points[0]) == 1, real)
    yield from layout.arrays(real)
    if config.grains or config.obstacle:
        kept = 4 if moving(config) and not config.coupling.frozen else 9  # of fixed ones also arm, last two steps
        yield Array("links", (link_count(config) // ranks, kept), "float64")


def node_bytes(config: LbmDemConfig) -> int:
    """Bytes of the populations of a node."""
    q = LATTICES[config.lattice].q
    return Array("node", (q,), STORAGE[config.liquid.storage]).bytes


def face_bytes(config: LbmDemConfig) -> int:
    """Bytes of the populations that cross one face of a slab."""
    lattice = LATTICES[config.lattice]
    leaving = sum(e[-1] > 0 for e in lattice.velocities)
    return math.prod(config.points[:-1]) * leaving * node_bytes(config) // lattice.q


def messages(config: LbmDemConfig, ranks: int) -> list[str]:
    """What one rank sends in a step."""
    if ranks == 1:
        return ["none: one rank sends no messages"]
    lines = [f"populations  2 of {face_bytes(config)} bytes"] if config.fluid else []
    if moving(config):
        lines.append("grains       2, those near a slab's ends; in every substep")
    return lines + (["forces       2, fixed point"] if moving(config) and config.fluid else [])


def plan(config: LbmDemConfig, ranks: int, threads: int) -> list[str]:
    """Lines for `check --plan`."""
    lines = ["kernels of a step", *(f"  {line}" for line in kernels(config)), "arrays per rank"]
    for array in arrays(config, ranks):
        shape = " x ".join(map(str, array.shape))
        lines.append(f"  {array.name:<26}{shape:<24}{array.dtype:<12}{array.bytes / 2**20:10.2f} MiB")
    lines += ["messages of a step, per rank", *(f"  {line}" for line in messages(config, ranks))]
    return lines + imports(*["scipy.special"] * any(grains.diameters for grains in config.grains))
