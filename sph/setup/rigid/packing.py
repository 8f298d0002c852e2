"""Fluid at rest whose lattice a wall cuts, as round or inclined ones do, and boxes whose faces lie between its planes:
it has the mass of the space that it fills, and its particles are packed evenly before the run (Colagrossi, Bouscasse,
Antuono and Marrone 2012). So are those of a liquid that rests and starts with disorder, for
some rounds.

A lattice that is cut lies crowded in some places before the wall and leaves gaps in others, and so does one that is
disordered. Densities have a history: where particles even out later, pressures lose what the crowd had in excess, and
the fluid rings. So they even out first, at no pressure.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.shapes import lengths
from sph.case.config import AXES
from sph.case.shapes import Shape
from sph.physics.smoothing import SMOOTHING
from sph.setup import obstacles, periodic_walls
from sph.setup.particle_lattices import Box, Grid, cross, flagged
from sph.setup.rigid import fit
from sph.setup.signed_distance import normals, signed_distance
from sph.setup.tanks import open_sides

Reals = NDArray[np.float64]
DEPTH = 6.0  # spacings before a wall in which particles are packed
BESIDE_WALLS, DISORDERED = (40, 0.3, 0.9), (10, 0.6, 0.0)  # rounds; part of h^2 sum V grad W that particles go in
# one, and of their last way. The second leaves half of the disorder, and still water as quiet as on its lattice
LONGEST = 0.1  # spacings in a round
LEAST = 0.1  # spacings off a wall, whose particles leave gaps
CLEAR = 0.9  # spacings off particles of a solid: nearer it pushes more, as in the run
TOUCHING = 0.6  # spacings off a wall: nearer, its normal tells whether it is oblique
LEVEL = 1e-6  # 1 - |cosine| between a normal and an axis, for rounding
ALIGNED = 0.01  # spacings by which a face may lie off the middle between two planes of the lattice
PARTS = 2  # along each axis, of a cell that a wall cuts
FAR = 2.0  # spacings off a side: farther it is not measured
STEP = 1e-3  # of a spacing: over which normals are differences


def oblique(scene: Any, fluid: Any) -> list[Any]:
    """The walls and bodies beside which a fluid is packed: those with layers of particles, at rest or not, that cut its
    lattice where it lies at rest under gravity; tanks that are boxes do not.
    """
    if not _presses(scene, fluid):
        return []
    return [wall for wall in scene.walls if fluid.n and fit.fits(wall) and _cuts(wall, fluid)]


def rests_disordered(scene: Any, fluid: Any) -> bool:
    """Whether a liquid starts disordered, stays at rest under gravity, and is evened out. Not one that runs out beside
    it, whose front would strike more at once; nor one beside another: what is left of its disorder is little, and an
    interface of lattices is stiff.
    """
    if not (_presses(scene, fluid) and fluid.section.disorder) or scene.liquids.densities:
        return False
    k = int(np.argmax(np.abs(scene.gravity)))
    up = AXES[k] + "+-"[int(scene.gravity[k] > 0.0)]
    return all(side == up for one in scene.config.fluid for side in open_sides(scene.config, one))


def _presses(scene: Any, fluid: Any) -> bool:
    """Whether a fluid starts with the pressure of its depth, and not from arrays."""
    return fluid.given is None and fluid.section.initial_pressure == "hydrostatic" and bool(scene.gravity.any())


def _cuts(wall: Any, fluid: Any) -> bool:
    """Whether somewhere where particles of a fluid touch a wall its normal is along no axis, or its face is off the
    middle between two planes of the lattice.
    """
    step = fluid.step

    def touches(x: Reals) -> NDArray[np.bool_]:
        return np.abs(signed_distance(wall.shape, x, step)) < step

    near = np.setdiff1d(flagged(fluid.grid, fit.around(wall), touches), fluid.removed, assume_unique=True)
    x = fluid.grid.points(fluid.grid.unflat(near))
    off, normal, way = signed_distance(wall.shape, x), normals(wall.shape, x, STEP * step), TOUCHING * step
    gone = signed_distance(wall.shape, x + way * normal) - off
    face = gone > (1.0 - LEVEL) * way  # as near to two faces, it goes off them more slowly
    along = np.abs(normal).max(axis=1, initial=0.0) > 1.0 - LEVEL
    steps = np.array([line[1] - line[0] if len(line) > 1 else step for line in fluid.grid.coordinates])
    apart = np.abs(off) / steps[np.argmax(np.abs(normal), axis=1)]
    askew = ~along & (np.abs(off) < way)  # farther off, corners have such normals
    return bool(np.any(face & (askew | along & (np.abs(apart - 0.5) > ALIGNED))))


def sides_of(fluid: Any) -> list[tuple[Shape, float]]:
    """What is askew to the lattice of a fluid, the fluid outside of it (1) or inside (-1): oblique walls, and its own
    shape but for a box.
    """
    own = fluid.section.shape
    return [(wall.shape, fit.outward(wall)) for wall in fluid.oblique] + ([] if own.box else [(own, -1.0)])


def share(fluid: Any, others: NDArray[np.int64]) -> float:
    """Volume that oblique walls leave to a fluid, over that of the cells of its particles. others: flat indices of the
    points of its lattice that something else than its shape and these walls has taken.
    """
    cells, step, sides = fluid.grid, fluid.step, sides_of(fluid)
    d = len(cells.shape)
    band = math.sqrt(d) / 2 * step

    def within(x: Reals) -> Reals:
        return np.min([side * signed_distance(shape, x, 2 * band) for shape, side in sides], axis=0)

    whole = np.setdiff1d(flagged(cells, None, lambda x: within(x) > band), others)
    cut = np.setdiff1d(flagged(cells, None, lambda x: np.abs(within(x)) <= band), others)
    x, filled = cells.points(cells.unflat(cut)), np.zeros(len(cut))
    for part in cross([np.arange(PARTS)] * d):
        at = x + step * ((part + 0.5) / PARTS - 0.5)
        filled += np.min([part_before(side * signed_distance(shape, at, 2 * band) * PARTS / step,
                                      normals(shape, at, STEP * step)) for shape, side in sides], axis=0)  # fmt: skip
    return (len(whole) + math.fsum(filled) / PARTS**d) / fluid.n


def part_before(off: Reals, normal: Reals) -> Reals:
    """Part[n] of a cube of side 1 before a plane with a normal[n, d], from which its middle is off[n] on that side."""
    slopes = np.maximum(np.abs(normal), 1e-4)
    d = slopes.shape[1]
    total, reach = np.zeros(len(off)), off + slopes.sum(axis=1) / 2
    for corner in range(1 << d):
        chosen = np.array([corner >> k & 1 for k in range(d)])
        rest = np.maximum(reach - np.sum(slopes * chosen, axis=1), 0.0)
        total += (-1.0) ** chosen.sum() * np.prod([rest] * d, axis=0)
    return np.clip(total / (math.factorial(d) * np.prod(slopes, axis=1)), 0.0, 1.0)


def packed(scene: Any, fluid: Any, asked: Reals) -> tuple[NDArray[np.int64], Reals]:
    """Ascending ids[n] of the particles of a fluid that are packed, and where they are, x[n, d] m. What surrounds them
    stays: particles of walls, the lattice deeper in the fluid, and the lattice as it would go on beyond its sides, half
    a spacing clear of those that are askew. Of a disordered fluid all particles are packed that may have to do with
    those at the points asked[., d] of the lattice, the least that a rank can do: the others along its slab are not.
    """
    step, reach, shape = fluid.step, scene.support, fluid.section.shape
    whole = rests_disordered(scene, fluid)
    depth, far = (2 * scene.diagonal, scene.diagonal) if whole else (DEPTH * step, DEPTH * step + reach + step)

    def off(x: Reals) -> Reals:
        found = np.full(len(x), far)
        for one, side in sides_of(fluid):
            np.minimum(found, side * signed_distance(one, x, far), out=found)
        return found

    more = np.where(_all_round(scene, fluid), 0, math.ceil(reach / step))
    grid = Grid(tuple(_longer(line, step, n) for line, n in zip(fluid.grid.coordinates, more)))
    box = _around(scene, fluid, asked) if whole else None
    flat = flagged(grid, box, lambda x: np.abs(off(x) - depth / 2) < depth / 2 + reach)
    at, x = grid.unflat(flat) - more, grid.points(grid.unflat(flat))
    inside, apart = np.flatnonzero(np.all((at >= 0) & (at < fluid.grid.shape), axis=1)), off(x)
    index = fluid.grid.flat(at[inside])
    kept = ~np.isin(index, fluid.removed)
    ids = fluid.first + index[kept] - np.searchsorted(fluid.removed, index[kept])
    beyond = np.ones(len(x), bool)
    beyond[inside] = signed_distance(shape, x[inside]) > 0.0
    beyond |= apart >= 0.5 * step
    beyond[inside[kept]] = False
    own, beyond, free = scene.from_lattice(fluid, ids), x[beyond], apart[inside[kept]] < depth
    beyond = beyond if shape.box else fit.cleared(shape, beyond, step, 1.0)
    beyond = fit.beside(scene.walls, beyond[~_in_walls(scene, fluid, beyond)], step)
    low, high = own.min(axis=0) - 2 * reach, own.max(axis=0) + 2 * reach
    low, high = np.where(scene.periodic, scene.low, low), np.where(scene.periodic, scene.high, high)
    solid = [wall.near(low, high)[1] for wall in scene.walls if wall.rule.layered]
    x = np.concatenate([own[free], own[~free], beyond, *solid])
    first = np.minimum([line[0] for line in grid.coordinates], scene.low) - 2 * reach if whole else None
    return ids[free], spread(scene, fluid, x, int(np.count_nonzero(free)), sum(map(len, solid)), first)


def _around(scene: Any, fluid: Any, asked: Reals) -> Box:
    """The box of the points that may have to do with those asked[n, d], from one end of the domain to the other but for
    the axis of the slabs.
    """
    low, high = np.full(scene.dimensions, -math.inf), np.full(scene.dimensions, math.inf)
    if not scene.periodic[0]:
        margin = (_rounds(fluid)[0] + 1) * (scene.support + fluid.step)
        low[0], high[0] = asked[:, 0].min() - margin, asked[:, 0].max() + margin
    return low, high


def _rounds(fluid: Any) -> tuple[int, float, float]:
    return BESIDE_WALLS if fluid.oblique else DISORDERED


def _all_round(scene: Any, fluid: Any) -> NDArray[np.bool_]:
    """Along which axes the lattice of a fluid goes through a whole period."""
    length = np.array([line[-1] - line[0] for line in fluid.grid.coordinates])
    return scene.periodic & (length > scene.high - scene.low - 1.5 * fluid.step)


def _longer(line: Reals, step: float, n: int) -> Reals:
    """A line of the lattice that goes on by n places on both sides."""
    step = (line[-1] - line[0]) / (len(line) - 1) if len(line) > 1 else step
    further = np.arange(1, n + 1) * step
    return np.concatenate([line[0] - further[::-1], line, line[-1] + further])


def _in_walls(scene: Any, fluid: Any, x: Reals) -> NDArray[np.bool_]:
    """Which points x[n, d] of the lattice of a fluid lie where walls have particles."""
    ends = np.array([(line[0], line[-1]) for line in fluid.grid.coordinates])
    found = np.zeros(len(x), bool)
    for wall in scene.walls:
        if fit.fits(wall):
            found |= fit.taken_by(wall, fluid.step, x)
        elif wall.rule.layered:
            found |= obstacles.too_near(wall, ends, obstacles.NEAR * scene.spacing, x)
    return found


def spread(scene: Any, fluid: Any, x: Reals, n: int, solids: int, first: Reals | None) -> Reals:
    """Where the first n of the points x[., d] come to as they go down the slope of sum W. The last are of solids. The
    same bits of any part of all points need the same corner first[d] of the cells; by default it is that of the points.
    """
    step, d, reach, period = fluid.step, scene.dimensions, scene.support, scene.high - scene.low
    sides = [(shape, side, LEAST * step) for shape, side in sides_of(fluid)]
    if fluid.oblique and fluid.section.shape.box:
        sides.append((periodic_walls.endless(fluid.section.shape, scene.config.domain), -1.0, 0.5 * step))
    left = np.full((len(sides), n), -np.inf)  # m that particles can go before they may be too near to a side
    rounds, push, kept = _rounds(fluid)
    gain = push * abs(SMOOTHING["wendland2"].factor(d)) * (SMOOTHING["wendland2"].support * step / reach) ** d
    way = np.zeros((n, d))
    for _ in range(rounds):
        before = x[:n].copy()
        way = kept * way + gain * slopes(scene, x, n, solids, first)
        way *= np.minimum(1.0, LONGEST * step / np.maximum(lengths(way), 1e-300))[:, None]
        x[:n] += way
        left -= lengths(way)
        for k, (shape, side, least) in enumerate(sides):
            asked = np.flatnonzero(left[k] < 0.0)
            left[k, asked] = np.minimum(side * signed_distance(shape, x[asked], FAR * step), FAR * step) - least
            near = asked[left[k, asked] < 0.0]
            x[near] = fit.cleared(shape, x[near], 2 * least, side)
            left[:, near] = -np.inf
        way = x[:n] - before
        x[:n] -= np.where(scene.periodic, period * np.floor((x[:n] - scene.low) / period), 0.0)
    return x[:n].copy()  # without the points around them


def slopes(scene: Any, x: Reals, n: int, solids: int, first: Reals | None = None) -> Reals:
    """sum (1 - r / reach)^3 r_ij [n, d] over the points x[., d] for the first n, m: that of Wendland's C2 kernel; the
    last points, of solids, keep a core clear.
    """
    from sph.kernels.packing import N, into_cells, pushes  # other cases load no compiler

    reach, d = scene.support, scene.dimensions
    solid = np.arange(len(x)) >= len(x) - solids
    for k in np.flatnonzero(scene.periodic).tolist():
        period = (scene.high[k] - scene.low[k]) * np.eye(d)[k]
        below, above = x[:, k] < scene.low[k] + reach, x[:, k] >= scene.high[k] - reach
        x = np.concatenate([x, x[below] + period, x[above] - period])
        solid = np.concatenate([solid, solid[below], solid[above]])
    low, edge, shape = x.min(axis=0) if first is None else first, reach / 2, np.ones(3, np.int64)
    shape[3 - d :] = ((x.max(axis=0) - low) / edge).astype(np.int64) + 1
    start, order = np.empty(np.prod(shape) + 1, np.int32), np.empty(len(x), np.int32)
    placed, found = np.zeros((4, len(x) + N)), np.empty((n, d))
    into_cells(x, solid, low, edge, shape, start, order, placed)
    pushes(n, reach, CLEAR * scene.spacing, shape, start, order, placed, found)
    return found
