"""How far areas of walls are from the other walls that meet theirs."""

import numpy as np
from numpy.typing import NDArray

from sph.case.config import Gauge
from sph.setup.scene import Scene, Wall
from sph.setup.tanks import depth_in_wall

HALVINGS = 50  # of an eighth of a spacing: to rounding


def ends(scene: Scene, gauge: Gauge) -> NDArray[np.float64]:
    """[d, 2]: how far it is from the middle of an area, down and up along each axis, to the walls that stay and meet
    its own at right angles, m; infinite where there is none within reach. An area that moves has none.
    """
    along, sign = gauge.direction
    axes, dp = np.eye(scene.dimensions), scene.spacing
    found = np.full((scene.dimensions, 2), (-np.inf, np.inf))
    walls = [wall for wall in scene.walls if not wall.moving and not wall.rigid]
    if gauge.wall and gauge.wall not in [wall.name for wall in walls]:
        return found
    reach = (gauge.radius or max(gauge.extents(dp)) / 2) + scene.support
    starts = [np.array(gauge.at) - sign * depth * axes[along] for depth in (0.5 * dp, scene.support)]
    for k in set(range(scene.dimensions)) - {along}:
        for side, way in enumerate((-1.0, 1.0)):
            near, far = (free_way(walls, start, way * axes[k], reach, dp) for start in starts)
            if abs(near - far) < 0.5 * dp:  # else it is oblique, or the wall of the area itself, which is round
                found[k, side] = way * near
    return found


def free_way(walls: list[Wall], start: NDArray, way: NDArray, reach: float, spacing: float) -> float:
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
