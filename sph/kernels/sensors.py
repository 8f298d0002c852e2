"""Forces on areas of walls, by chunks of slots, as integers."""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import Vec, bitmask, first_bit, floor, lanes, load, splat
from sph.kernels.marks import BODY, CODES, MINE, OWN
from sph.kernels.readings import wall_of

DIM = 3

N = lanes(np.float64)
F, I = Vec(N, np.float64), Vec(N, np.int32)


@njit
def off_middle(k, a, s, x, areas):
    """How far the body in slot s is from the middle of area k along the a-th axis of its frame, m."""
    found = 0.0
    for b in range(DIM):
        d, period = x[b, s] - areas.area_middle[k, b], areas.period[b]
        if period > 0.0:
            d -= period * np.rint(d / period)
        found += areas.area_frame[k, a, b] * d
    return found


@njit
def share(k, s, wall, x, areas):
    """How much of the wall body in slot s belongs to area k: of its own square of one spacing, what lies in the area;
    nothing farther behind the area than the support, or more than half a spacing before it. A body in the corner, which
    is behind another wall too, whose it may be, counts where its mirror image in that wall is: it bears what the corner
    has of the load.
    """
    spacing, along, across, part, in_corner = areas.lengths[0], areas.area_along[k], 0.0, 1.0, False
    behind = off_middle(k, along, s, x, areas)
    if areas.area_unit[k] < 0.0:
        behind = -behind
    if not -0.5 * spacing < behind <= areas.lengths[1]:
        return 0.0
    for a in range(DIM):
        if a == along:
            continue
        d = off_middle(k, a, s, x, areas)
        for end in areas.area_ends[k, a]:
            if abs(d) > abs(end) and d * end > 0.0:
                in_corner, d = True, 2.0 * end - d
        if areas.area_radius[k] > 0.0:
            across += d * d
        else:
            half = areas.area_half[k, a]
            over = min(d + 0.5 * spacing, half) - max(d - 0.5 * spacing, -half)
            part *= max(over, 0.0) / spacing
    if behind <= 0.0 if in_corner else 0 <= areas.area_wall[k] != wall:
        return 0.0
    if areas.area_radius[k] > 0.0:
        return min(max((areas.area_radius[k] - np.sqrt(across)) / spacing + 0.5, 0.0), 1.0)
    return part


@njit
def squares(k, b, x, areas):
    """Squares of the distances of the bodies in a vector of slots from the middle of area k, m2."""
    found = splat(F, 0.0)
    for a in range(DIM):
        d, period = load(F, x[a], b) - areas.area_middle[k, a], areas.period[a]
        if period > 0.0:
            d = d - floor(d * (1.0 / period) + 0.5) * period
        found = found + d * d
    return found


@njit
def push(chunk, chunks, flags, key, x, sums, factors, shape, scale, areas, pushed):
    """pushed[chunk, k] = force on area k along its normal, in units of 1 / area_unit[k], on the particles of walls in
    the slots of a chunk, and on images of the fluid in walls where these are in own layers.
    """
    pushed[chunk], slab = 0, areas.slab
    for b in range(chunks[chunk], chunks[chunk + 1], N):
        kinds = load(I, flags, b)
        others = (kinds & BODY == BODY) & (kinds & MINE != MINE)
        if bitmask(others) == 0:
            continue
        for k in range(areas.area_unit.size):
            near = bitmask(others & (squares(k, b, x, areas) < areas.area_reach[k]))
            normal = areas.area_frame[k, areas.area_along[k]]
            while near != 0:
                s = np.uint64(b + first_bit(near))
                near &= near - 1
                wall = wall_of(key[s], areas.wall_images)
                layer = np.int64(np.floor(x[0, s] * scale[0])) + shape[0]
                here = slab[0] <= layer < slab[1] if key[s] % CODES > 0 else flags[s] & OWN == OWN
                part = share(k, s, wall, x, areas) if wall >= 0 and here else 0.0
                if part > 0.0:
                    force = 0.0
                    for a in range(DIM):
                        force += normal[a] * np.float64(sums[a, s])
                    pushed[chunk, k] += np.int64(np.rint(force * factors[0] * part * areas.area_unit[k]))
