"""Forces on areas of walls, as integers."""

import numpy as np

from hpcpic.core.simd.compile import njit

DIM = 3


@njit
def share(k, s, x, areas):
    """How much of the wall body in slot s belongs to area k: of its own square of one spacing, what lies in the area;
    nothing farther behind the area than the support, or more than half a spacing before it.
    """
    period, spacing, across, part = areas.period, areas.lengths[0], 0.0, 1.0
    for a in range(DIM):
        d = x[a, s] - areas.area_middle[k, a]
        if period[a] > 0.0:
            d -= period[a] * np.rint(d / period[a])
        if a == areas.area_along[k]:
            behind = d if areas.area_unit[k] > 0.0 else -d
            if not -0.5 * spacing < behind <= areas.lengths[1]:
                return 0.0
        elif areas.area_radius[k] > 0.0:
            across += d * d
        else:
            half = areas.area_half[k, a]
            over = min(d + 0.5 * spacing, half) - max(d - 0.5 * spacing, -half)
            part *= max(over, 0.0) / spacing
    if areas.area_radius[k] > 0.0:
        return min(max((areas.area_radius[k] - np.sqrt(across)) / spacing + 0.5, 0.0), 1.0)
    return part


@njit
def push(slots, walls, x, sums, factors, areas):
    """Forces [k] on areas along their normals, in units of 1 / area_unit[k], on bodies of walls[n] in slots[n]."""
    pushed = np.zeros(areas.area_unit.size, np.int64)
    for n in range(slots.size):
        s = np.uint64(slots[n])
        for k in range(pushed.size):
            if areas.area_wall[k] < 0 or areas.area_wall[k] == walls[n]:
                part = share(k, s, x, areas)
                if part > 0.0:
                    force = np.float64(sums[np.uint64(areas.area_along[k]), s]) * factors[0]
                    pushed[k] += np.int64(np.rint(force * part * areas.area_unit[k]))
    return pushed
