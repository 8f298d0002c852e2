"""What a case makes the program do and hold: kernels, arrays and messages of a step, before anything is allocated.

`check --plan` prints it and `estimate` adds it up, so what a scene does not contain shows as missing lines and bytes.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from hpcpic.core.app.forecast import array_lines, imports, listed, slabs
from hpcpic.core.space.declared import Array
from lbmdem.case.boundaries import Obstacle
from lbmdem.case.config import AXES, LbmDemConfig
from lbmdem.coupling.arrays import MOVING_LINKS
from lbmdem.fluid.arrays import MOVED_NODES, fixed_links
from lbmdem.forecast.cuts import first_cuts
from lbmdem.forecast.node_shares import fluid_share, grains, links_of, node_bytes, sparse
from lbmdem.grains.arrays import expected
from lbmdem.layout import Layout, place_type, sparse_arrays
from lbmdem.physics.velocity_sets import LATTICES
from lbmdem.physics.wall_rules import RULES
from lbmdem.sizes import SPARSE_BLOCK, STORAGE


def grain_count(config: LbmDemConfig) -> int:
    return sum(group.count for group in config.grains)


def link_count(config: LbmDemConfig) -> int:
    """Links between fluid and solids, of all ranks: as many as surfaces of this size have on the mean. Grains in
    contact share links, and the contacts of a packing are not known before a run has made it.
    """
    to_grains = sum(n * links_of(r, config.dimensions) for group in config.grains for r, n in grains(config, group))
    return round(to_grains + sum(obstacle_links(config, obstacle) for obstacle in config.obstacle))


def obstacle_links(config: LbmDemConfig, obstacle: Obstacle) -> float:
    """Links to an obstacle of which no part is outside the box."""
    d, velocities = config.dimensions, LATTICES[config.lattice].velocities
    plane, box = obstacle.shape.plane, obstacle.shape.box

    def per_node(normal: Sequence[float]) -> float:
        return 0.5 * sum(abs(sum(a * b for a, b in zip(e, normal))) for e in velocities)

    if plane is not None:  # its area is that of its projection along the axis that it is most across to
        axis = max(range(d), key=lambda k: abs(plane.normal[k]))
        across = math.prod(n for k, n in enumerate(config.points) if k != axis)
        return across * per_node(plane.normal) / abs(plane.normal[axis])
    assert box is not None
    sides = [(b - a) / config.spacing for a, b in zip(box.low, box.high)]
    return 2.0 * per_node([1.0] + [0.0] * (d - 1)) * sum(math.prod(sides) / side for side in sides)


def kernels(config: LbmDemConfig) -> list[str]:
    """The compiled kernels of a step, with what they are made for."""
    lines = fluid_kernels(config) if config.fluid else []
    if config.grains_move:
        lines.append(f"contacts   {config.contact.tangential} friction, velocity Verlet")
    return lines


def fluid_kernels(config: LbmDemConfig) -> list[str]:
    fluid, coupling = config.liquid, config.coupling
    forced = ", body force" if any(fluid.body_force) or config.shaking else ""
    lines = [f"sweep      {config.lattice}, {fluid.collision}, {fluid.storage}{forced}, in place"]
    kinds = sorted({face.type for face in config.boundary if face.is_open})
    lines += [f"faces      {' and '.join(kinds)} (Zou & He)"] if kinds else []
    moved = config.grains_move and not coupling.frozen
    if config.grains or config.obstacle:
        kind = "moving grains" if moved else "fixed, coefficients kept"
        lines.append(f"links      {coupling.bounce_back}, {kind}")
    return lines + (["solid      incremental", f"refill     {coupling.refill}"] if moved else [])


def arrays(config: LbmDemConfig, ranks: int) -> Iterator[Array]:
    if config.fluid:
        yield from fluid_arrays(config, ranks)
    if config.grains_move:
        films = bool(config.fluid and config.coupling.lubrication and not config.coupling.frozen)
        yield from expected(grain_count(config) // ranks + 1, config.dimensions, films)


def fluid_arrays(config: LbmDemConfig, ranks: int) -> Iterator[Array]:
    points, real = config.points[::-1], STORAGE[config.liquid.storage]
    rows = max(high - low for low, high in pairwise(first_cuts(config, ranks)))
    own = (rows, *points[1:])
    around = tuple(axis in config.domain.periodic for axis in AXES[: config.dimensions][::-1])
    layout = Layout.of(LATTICES[config.lattice], own, around, min(ranks, points[0]) == 1, real)
    yield from fluid_nodes(config, layout, real) if sparse(config) else layout.arrays(real)
    if config.grains_move and not config.coupling.frozen:
        n = grain_count(config) // ranks + 1
        sizes = {"shares": layout.planes, "cuts": layout.planes + 1, "grains": n, "images": 2 * n, "parts": n}
        sizes |= {"blocks": 1, "block_ends": 2, "changes": 64, "changed": 64}
        yield from (array.sized(sizes) for array in (*MOVED_NODES, *MOVING_LINKS))
    elif config.grains or config.obstacle:
        yield from linked_once(config, layout, link_count(config) // ranks, real)


def linked_once(config: LbmDemConfig, layout: Layout, links: int, real: str) -> Iterator[Array]:
    """The arrays of so many links to solids that stay."""
    segments, rule = layout.planes * (layout.lattice.q - 1), RULES[config.coupling.bounce_back]
    sizes = {"links": links, "segments": segments, "ends": segments + 1, "shares": 1}
    sizes["bodies"] = grain_count(config) + len(config.obstacle)
    speeds = [*(solid.velocity for solid in config.obstacle), *(group.velocity for group in config.grains)]
    moved = any(map(any, (*speeds, *(group.angular_velocity for group in config.grains))))
    declared = fixed_links(rule, real, place_type(layout.slot_stride), sparse=sparse(config), moved=moved)
    return (array.sized(sizes) for array in declared if array.sized(sizes).bytes)


def fluid_nodes(config: LbmDemConfig, layout: Layout, real: str) -> Iterator[Array]:
    """The arrays of the fluid nodes of a slab alone, with about as many other pieces of memory as there are links."""
    nodes = layout.planes * layout.rows * layout.nx * fluid_share(config)
    vectors = math.ceil(nodes / layout.lanes + 0.5 * layout.planes)  # every plane begins one
    links = round(link_count(config) * layout.planes / config.points[-1])
    sizes = {"slot": (vectors + 1) * layout.lanes, "planes": layout.planes + 1, "vectors": vectors, "ends": vectors + 1}
    sizes |= {"blocks": vectors // SPARSE_BLOCK + layout.planes, "pieces": links, "ruled": vectors, "links": links}
    around = next(array.shape for array in layout.arrays(real) if array.name == "solid")
    places = place_type(sizes["slot"] * layout.lattice.q)
    declared = sparse_arrays(layout.lattice, tuple(int(n) for n in around), real, places)
    return (array.sized(sizes) for array in declared)


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
    if config.grains_move:
        lines.append("grains       2, those near a slab's ends; in every substep")
    return lines + (["forces       2, fixed point"] if config.grains_move and config.fluid else [])


def plan(config: LbmDemConfig, ranks: int, threads: int) -> list[str]:
    """Lines for `check --plan`."""
    lines = listed("kernels of a step", kernels(config)) + slabs(first_cuts(config, ranks))
    lines += listed("arrays per rank", array_lines(arrays(config, ranks)))
    if config.fluid and (config.grains or config.obstacle) and (not config.grains_move or config.coupling.frozen):
        lines.append("  links: as many as surfaces of this size have on the mean; a run finds them when it starts")
    lines += listed("messages of a step, per rank", messages(config, ranks))
    return lines + imports(*["scipy.special"] * any(grains.diameters for grains in config.grains))
