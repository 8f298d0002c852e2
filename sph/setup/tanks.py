"""Where the sides of tanks and hollow solids are, which end at edges: what has gone over an edge is elsewhere, what has
gone through a side is lost; which sides of a fluid are open; and areas of walls: their axes, and how far they are from
the other walls that meet theirs.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sph.case import config as case
from sph.case import geometry
from sph.case.config import AXES
from sph.setup import signed_distance

LEAST_ALONG = 0.1  # cosine between the axis of an area and the normal of its wall
REACH = 2.0  # spacings: nobody asks more of depths than whether they are beyond one, or which of two is nearer
TINY = 1e-6  # of a length, for rounding
HALVINGS = 50  # of an eighth of a spacing: to rounding


class Tank(Protocol):
    """What is read of a wall: its shape and closed faces, layers of particles, and the scene that it is in."""

    scene: Any
    section: case.Wall
    shape: case.Shape
    closed: set[str]
    layers: int


def rims(wall: Tank) -> set[str]:
    """Faces that are left out of a tank: over their edges fluid can leave it."""
    box, scene = wall.shape.box, wall.scene
    real = {axis for axis, repeats in zip(AXES, scene.periodic) if not repeats}
    return {face for face in box.open if face[0] in real} if box and not wall.section.solid else set()


def behind(wall: Tank, x: NDArray) -> NDArray[np.float64]:
    """How far points lie behind the closed faces of a tank and what goes on in their planes, m; negative before all.
    Beyond two spacings it is told of STL surfaces only that it is more.
    """
    shape = wall.shape
    if not shape.box:
        return signed_distance.signed_distance(shape, x, REACH * wall.scene.spacing)
    faces = beyond(wall, x, wall.closed)
    return np.max(faces, axis=1, initial=-np.inf)


def depth_in(wall: Tank, x: NDArray, skin: float = 0.0) -> NDArray[np.float64]:
    """How deep points lie in what a tank is made of, m; negative inside of it, and outside where fluid can come to over
    the edges of faces that are left out, in a skin of so many m as well. A wall is as thick as its particles; one
    without edges is so without end.
    """
    depth = behind(wall, x)
    if not rims(wall):
        return depth
    over = np.max(beyond(wall, x, rims(wall)), axis=1)
    thick = wall.layers * wall.scene.spacing - skin
    return np.where(depth <= thick, np.minimum(depth, -over), -np.inf)


def depth_in_solid(wall: Tank, x: NDArray, skin: float = 0.0) -> NDArray[np.float64]:
    """How deep points lie in a solid, m, as in `behind`; negative outside. A box of which faces are left out is as
    thick as its particles: fluid can come into its hollow over the edges, and into a skin of so many m around it.
    """
    depth, box = greatest_depth(wall, x), wall.shape.box
    if not box or not box.open:
        return depth
    thick = wall.layers * wall.scene.spacing - skin
    return np.where(np.max(beyond(wall, x, wall.closed), axis=1, initial=-np.inf) >= -thick, depth, -np.inf)


def depth_in_wall(wall: Tank, x: NDArray, skin: float = 0.0) -> NDArray[np.float64]:
    """How deep points lie in a wall of any kind, m; negative outside, and in a skin behind walls with edges."""
    return (depth_in_solid if wall.section.solid or wall.shape.plane else depth_in)(wall, x, skin)


def lost_in(wall: Tank, x: NDArray) -> NDArray[np.bool_]:
    """Which points lie more than a spacing deep in a wall. So near its outer side fluid may also be that has gone over
    its edge and struck it from there; a wall of two layers keeps half a spacing between both.
    """
    dp = wall.scene.spacing
    return depth_in_wall(wall, x, min(1.0, (wall.layers - 1) / 2) * dp) > dp


def greatest_depth(wall: Tank, x: NDArray) -> NDArray[np.float64]:
    """What the depth of points in a wall of any kind is at most, m, edges or not: it does not change by more than the
    way from one point to another.
    """
    if wall.section.solid or wall.shape.plane:
        return -signed_distance.signed_distance(wall.shape, x, REACH * wall.scene.spacing)
    return behind(wall, x)


def beyond(wall: Tank, x: NDArray, faces: set[str]) -> NDArray[np.float64]:
    """[n, face]: how far points lie beyond the planes of these faces of a box, m."""
    box = wall.shape.box
    assert box is not None
    sides = {"-": (box.low, -1.0), "+": (box.high, 1.0)}
    columns = [(x[:, AXES.index(axis)] - sides[sign][0][AXES.index(axis)]) * sides[sign][1]
               for axis, sign in map(tuple, sorted(faces))]  # fmt: skip
    return np.stack(columns, axis=1) if columns else np.zeros((len(x), 0))


def sides(wall: Tank) -> list[tuple[int, float, float]]:
    """Closed faces of a tank with edges: axis, sign s, and p so that s x > p is more than a spacing behind the face."""
    box = wall.shape.box
    if not box or not rims(wall):
        return []
    places = {"-": (-1.0, box.low), "+": (1.0, box.high)}
    found = [(AXES.index(axis), *places[sign]) for axis, sign in map(tuple, sorted(wall.closed))]
    return [(axis, sign, sign * corner[axis] + wall.scene.spacing) for axis, sign, corner in found]


def open_sides(config: case.SphConfig, fluid: case.Fluid) -> list[str]:
    """Sides of a fluid, as "y+", before whose middle there is neither a wall nor another fluid nor a period."""
    dp, (low, high) = config.numerics.spacing, geometry.bounds(fluid.shape)
    others = [geometry.bounds(other.shape) for other in config.fluid if other is not fluid]
    found = []
    for k, axis in enumerate(AXES[: config.dimensions]):
        for sign, at in (("-", low[k] - dp / 2), ("+", high[k] + dp / 2)):
            if axis in config.domain.periodic:
                continue
            place = tuple(at if n == k else (a + b) / 2 for n, (a, b) in enumerate(zip(low, high)))
            walled = any(holds(wall, np.array([place]), axis + sign)[0] for wall in config.wall)
            wet = any(all(a <= x <= b for a, x, b in zip(a, place, b)) for a, b in others)
            found += [] if walled or wet else [axis + sign]
    return found


def free_surface(config: case.SphConfig) -> bool:
    """Whether a liquid is open to a side through which nothing flows in or out."""
    through = {opening.axis[0] for opening in (*config.inlet, *config.outlet) if opening.axis}
    liquids = [fluid for fluid in config.fluid if not fluid.gas]
    return any(side[0] not in through for fluid in liquids for side in open_sides(config, fluid))


def holds(wall: case.Wall, places: NDArray, side: str) -> NDArray[np.bool_]:
    """At which places[n, d] beyond a side, to which nothing is open, a wall is."""
    off = signed_distance.signed_distance(wall.shape, places)
    left_out = wall.shape.box is not None and side in wall.shape.box.open
    return (off < 0.0 if wall.solid or wall.shape.plane else off > 0.0) & (not left_out)


def frame(scene: Any, gauge: case.Gauge) -> NDArray[np.float64]:
    """The axes [d, d] of an area of wall, lines of length 1: those of space; where its wall is inclined or round, the
    normal at its middle, on the side to which `gauge.axis` is nearest, and the tangents.
    """
    d, (along, _) = scene.dimensions, gauge.direction
    found, at = np.eye(d), np.array([gauge.at], float)
    walls = [wall for wall in scene.walls if not wall.shape.box and not wall.rigid and gauge.wall in ("", wall.name)]
    near = [wall for wall in walls if abs(signed_distance.signed_distance(wall.shape, at)[0]) < 0.5 * scene.spacing]
    if not near:
        return found
    normal = signed_distance.normals(near[0].shape, at, 1e-3 * scene.spacing)[0]
    if not LEAST_ALONG < abs(normal[along]) < 1.0 - 1e-9:
        return found
    found[along] = normal * np.sign(normal[along])
    done = [along]
    for k in set(range(d)) - {along}:
        for other in done:
            found[k] -= np.dot(found[k], found[other]) * found[other]
        found[k] /= np.linalg.norm(found[k])
        done.append(k)
    return found


def ends(scene: Any, gauge: case.Gauge) -> NDArray[np.float64]:
    """[d, 2]: how far it is from the middle of an area, down and up along each axis, to the walls that stay and meet
    its own at right angles, m; infinite where there is none within reach, the wall of the area is inclined, or the
    distance changes as the area moves.
    """
    along, sign = gauge.direction
    axes, dp = np.eye(scene.dimensions), scene.spacing
    found = np.full((scene.dimensions, 2), (-np.inf, np.inf))
    if np.any(frame(scene, gauge) != axes):
        return found
    walls = [wall for wall in scene.walls if not wall.moving and not wall.rigid]
    if any(wall.name == gauge.wall and (wall.rigid or moves_across(wall, along)) for wall in scene.walls):
        return found
    reach = (gauge.radius or max(gauge.extents(dp)) / 2) + scene.support
    starts = [np.array(gauge.at) - sign * depth * axes[along] for depth in (0.5 * dp, scene.support)]
    for k in set(range(scene.dimensions)) - {along}:
        for side, way in enumerate((-1.0, 1.0)):
            near, far = (free_way(walls, start, way * axes[k], reach, dp) for start in starts)
            if abs(near - far) < 0.5 * dp:  # else it is oblique, or the wall of the area itself, which is round
                found[k, side] = way * near
    return found


def edge(wall: Tank, gauge: case.Gauge) -> float:
    """How far an area of a solid box ends before an edge of its face, m; infinite where other walls go on beyond all of
    them, or where it is no box.
    """
    box, (along, sign), dp, nearest = wall.shape.box, gauge.direction, wall.scene.spacing, np.inf
    if not box or not wall.section.solid:
        return nearest
    for face in sorted(wall.closed):
        k, up = AXES.index(face[0]), face[1] == "+"
        if k == along:
            continue
        end, way = (box.high[k], 1.0) if up else (box.low[k], -1.0)
        beyond = np.array([gauge.at], float)
        beyond[0, along] += sign * dp / 2
        beyond[0, k] = end + way * dp / 2
        if not any(depth_in_wall(other, beyond)[0] > 0.0 for other in wall.scene.walls if other is not wall):
            half = gauge.radius or gauge.extents(dp)[k] / 2
            nearest = min(nearest, way * (end - gauge.at[k]) - half)
    return float(nearest)


def moves_across(wall: Tank, along: int) -> bool:
    """Whether a wall ever moves along another axis than this one."""
    motion = wall.section.motion
    if not motion:
        return False
    ways = motion.velocity, motion.amplitude, *(place.displacement for place in motion.path)
    return any(step for way in ways for k, step in enumerate(way) if k != along)


def slides(wall: Tank, way: NDArray[np.float64]) -> bool:
    """Whether a wall that goes along a direction slides along the fluid beside it: a plane in itself, a hollow with its
    open ends ahead, a solid box without fluid at t = 0 before and behind it.
    """
    box, plane = wall.shape.box, wall.shape.plane
    if not box:
        return plane is not None and bool(abs(np.dot(plane.normal, way)) <= TINY * np.linalg.norm(way))
    axes = [k for k in np.flatnonzero(way).tolist() if {AXES[k] + "-", AXES[k] + "+"} & wall.closed]
    if not axes or not wall.section.solid:
        return not axes
    fluids, reach = [geometry.bounds(fluid.shape) for fluid in wall.scene.config.fluid], wall.scene.support
    low, high, tiny = np.array(box.low), np.array(box.high), TINY * reach

    def wet(first: NDArray, last: NDArray) -> bool:
        return any(np.all(first + tiny < b) and np.all(last - tiny > a) for a, b in fluids)

    for k in axes:
        before, behind = high.copy(), low.copy()
        before[k], behind[k] = low[k], high[k]
        step = reach * np.eye(len(way))[k]
        if wet(low - step, before) or wet(behind, high + step):
            return False
    return wet(low - reach, high + reach)


def free_way(walls: Sequence[Tank], start: NDArray, way: NDArray, reach: float, spacing: float) -> float:
    """How far it is from a point along a direction to the first of these walls, m; not much farther than the reach."""

    def blocked(places: NDArray) -> NDArray[np.bool_]:
        return np.any([depth_in_wall(wall, start + places[:, None] * way) > 0.0 for wall in walls], axis=0)

    step = spacing / 8
    places = step * np.arange(reach / step + 2)
    first = np.flatnonzero(blocked(places)) if walls else np.zeros(0, np.int64)
    if not len(first) or not first[0]:
        return np.inf
    free, stop = places[first[0] - 1], places[first[0]]
    for _ in range(HALVINGS):
        middle = (free + stop) / 2
        free, stop = (free, middle) if blocked(np.array([middle]))[0] else (middle, stop)
    return float(free)
