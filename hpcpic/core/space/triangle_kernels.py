"""The nearest point of a surface of triangles, by a binary tree of boxes around them."""

import numpy as np

from hpcpic.core.simd.compile import formula, njit
from hpcpic.core.simd.scratch import empty

FACE, CORNER, EDGE = 0, 1, 4  # what a point is on: the face, CORNER + k, EDGE + k from corner k to the next
DEEPEST = 64  # nodes that wait: one for each level of the tree


def gap(low, high, node, p):
    """Square of the distance of a point p[3] from the box of a node, m2."""
    square = 0.0
    for k in range(3):
        beyond = max(low[node, k] - p[k], p[k] - high[node, k], 0.0)
        square += beyond * beyond
    return square


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def less(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def along(a, t, way):
    return (a[0] + t * way[0], a[1] + t * way[1], a[2] + t * way[2])


def nearest_of(triangle, p):
    """The point of a triangle[3, 3] that is nearest to p, and what of it that is on (Ericson 2005, Real-Time Collision
    Detection, 5.1.5).
    """
    a, b, c = triangle
    ab, ac, bc = less(b, a), less(c, a), less(c, b)
    ap, bp, cp = less(p, a), less(p, b), less(p, c)
    d1, d2, d3, d4, d5, d6 = dot(ab, ap), dot(ac, ap), dot(ab, bp), dot(ac, bp), dot(ab, cp), dot(ac, cp)
    if d1 <= 0.0 and d2 <= 0.0:
        return along(a, 0.0, ab), CORNER
    if d3 >= 0.0 and d4 <= d3:
        return along(b, 0.0, ab), CORNER + 1
    if d6 >= 0.0 and d5 <= d6:
        return along(c, 0.0, ab), CORNER + 2
    of_c, of_b, of_a = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if of_c <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return along(a, d1 / (d1 - d3), ab), EDGE
    if of_a <= 0.0 and d4 >= d3 and d5 >= d6:
        return along(b, (d4 - d3) / ((d4 - d3) + (d5 - d6)), bc), EDGE + 1
    if of_b <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return along(a, d2 / (d2 - d6), ac), EDGE + 2
    whole = of_a + of_b + of_c
    return along(along(a, of_b / whole, ab), of_c / whole, ac), FACE


for one in (gap, dot, less, along, nearest_of):
    formula(one)


@njit
def nearest(p, triangles, low, high, waiting):
    """The nearest point to p, the triangle that it is on, and what of it. Of those as near as each other it is the
    first one that is found.
    """
    leaves, best, n = len(low) // 2, np.inf, 1
    found, triangle, part = p, 0, FACE
    waiting[0] = 1
    while n > 0:
        n -= 1
        node = waiting[n]
        if gap(low, high, node, p) >= best:
            continue
        if node < leaves:
            first = gap(low, high, 2 * node, p) <= gap(low, high, 2 * node + 1, p)
            waiting[n], waiting[n + 1] = 2 * node + first, 2 * node + 1 - first
            n += 2
            continue
        a, b, c = triangles[node - leaves]
        foot, on = nearest_of(((a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2])), p)
        off = less(p, foot)
        if dot(off, off) < best:
            best, found, triangle, part = dot(off, off), foot, node - leaves, on
    return found, triangle, part


@njit
def distances(x, triangles, normals, low, high, reach, apart, ways):
    """apart[n] = distances of points x[n, 3] from triangles[m, 3, 3], m, negative where normals[m, 7, 3] of what is
    nearest tell so; ways[n, 3] from there, the normals on it. Beyond `reach` some are less: the distance of an earlier
    point less the way from it, ways 0. That saves the search where points in turn are near each other.

    low[2 n, 3], high[2 n, 3]: boxes of the nodes 1 .. 2 n - 1 of a tree; those of node k hold those of 2 k and 2 k + 1,
    and node n + i has triangle i.
    """
    waiting = empty(DEEPEST, np.int64)
    known, last = 0.0, (0.0, 0.0, 0.0)
    for i in range(len(x)):
        p = (x[i, 0], x[i, 1], x[i, 2])
        step = less(p, last)
        least = abs(known) - np.sqrt(dot(step, step))
        if least > reach:
            apart[i] = least if known > 0.0 else -least
            ways[i] = 0.0
            continue
        foot, triangle, part = nearest(p, triangles, low, high, waiting)
        off, normal = less(p, foot), normals[triangle, part]
        known, last = np.sqrt(dot(off, off)), p
        if dot(off, normal) < 0.0:
            known = -known
        apart[i] = known
        for k in range(3):
            ways[i, k] = off[k] if known != 0.0 else normal[k]
