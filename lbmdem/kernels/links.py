"""Links between fluid and solid nodes: what comes back to the fluid, and the momentum that it gives; compiled.

The sweep has bounced g_i(x) of each link back half-way, to where f_j of the next step arrives at x. The rules that make
of it what `lbmdem.physics.wall_rules` says read g_i(y), g_j(x), g_i(z) and g_j(y). `kernels.layout` says where these
are: all in the slots i and j, at the node itself or at the one its pair (up, -up) points to. No link writes what
another one reads, so their order does not matter.
"""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import address_of, prefetch, prefetch_to_write
from lbmdem.kernels.link_arrays import FLUID, arrival, is_fluid
from lbmdem.physics.wall_rules import REACH, applicable, begun, coefficients, finished

AHEAD = 24  # links by which populations are fetched before they are needed: they are where the sweep has long left
LINKS, FALLBACKS, LOST = 0, 1, 2  # counters: links, those without the fluid nodes of their rule, those not served


@njit
def weigh(rule, q, behind, table):
    """table[n, 6]: coefficients of links that have so many fluid nodes behind them; see `wall_rules.coefficients`."""
    for n in range(q.size):
        found = coefficients(applicable(rule, behind[n]), q[n])
        for k in range(6):
            table[n, k] = found[k]


@njit(forceinline=True)
def second_behind(populations, parity, nodes, node, e, i, j):
    """True where z behind y = node - e is fluid too, and g_i(z), g_j(y); node: (x, row, plane) in `solid`.

    Only where this rank has all planes, periodic or not.
    """
    (x, r, p), inner, shape = node, nodes.inner, nodes.shape
    nx, ny, nz = inner[0, 1] - inner[0, 0], inner[1, 1] - inner[1, 0], inner[2, 1] - inner[2, 0]
    yx, yr, yp = (x - inner[0, 0] - e[0]) % nx, (r - inner[1, 0] - e[1]) % ny, (p - inner[2, 0] - e[2]) % nz
    zx, zr, zp = yx + inner[0, 0] - e[0], yr + inner[1, 0] - e[1], yp + inner[2, 0] - e[2]
    if nodes.solid[(zp * shape[1] + zr) * shape[0] + zx] != FLUID:
        return False, 0.0, 0.0
    zx, zr, zp = (zx - inner[0, 0]) % nx, (zr - inner[1, 0]) % ny, (zp - inner[2, 0]) % nz
    third = populations.f[arrival(populations, parity, yp, yr, yx, i)]
    return True, float(third), float(populations.f[arrival(populations, parity, zp, zr, zx, j)])


@njit
def fixed_links(f, offsets, start, node, node_b, node_c, weights, wall, low, high, kept):
    """Segments [low, high) of links that stay: node[n] in a slot; wall[n], what is taken off, or [0] for nothing.

    weights[n, 3] of out, g_i(y), g_j(x), or [n, 1] of g_i(y) less g_j(x), or [n, 0] for half-way. Links start[s] to
    start[s + 1] of a segment have offsets[s, 3] from node, node_b and node_c to these three. kept[n, 2]: what went out
    and what comes back, for `momentum`, or [0, 2].
    """
    moved, terms, keeps = wall.size > 0, weights.shape[1], kept.shape[0] > 0
    if terms == 1 and not moved:
        cli_links(f, offsets, start, node, node_b, node_c, weights, low, high, kept)
        return
    first, size, zero, one, two = address_of(f, 0), f.itemsize, np.uint64(0), np.uint64(1), np.uint64(2)
    last = start[high] - 1
    for s in range(low, high):
        a, b, c = offsets[s, 0], offsets[s, 1], offsets[s, 2]
        for n in range(np.uint64(start[s]), np.uint64(start[s + 1])):
            later = np.uint64(min(np.int64(n) + AHEAD, last))
            prefetch_to_write(first + size * (a + np.int64(node[later])))
            x = np.int64(node[n])
            out = f[np.uint64(a + x)]
            v = float(out)
            if moved:
                v -= wall[n]
            if terms:
                prefetch(first + size * (b + np.int64(node_b[later])))
                prefetch(first + size * (c + np.int64(node_c[later])))
                second, outwards = f[np.uint64(b + np.int64(node_b[n]))], f[np.uint64(c + np.int64(node_c[n]))]
                if terms == 1:
                    kappa = weights[n, zero]
                    v = float(finished(kappa, second, begun(kappa, out, outwards))) - wall[n]
                else:
                    v += weights[n, zero] * out + weights[n, one] * second + weights[n, two] * outwards
            f[np.uint64(a + x)] = v
            if keeps:
                kept[n, zero], kept[n, one] = out, v


@njit
def cli_links(f, offsets, start, node, node_b, node_c, weights, low, high, kept):
    """What fixed_links does for weights[n, 1] at walls that do not move. The last links of a segment fetch for the next
    one."""
    keeps, zero, one, last = kept.shape[0] > 0, np.uint64(0), np.uint64(1), start[high] - 1
    first, size = address_of(f, 0), f.itemsize
    for s in range(low, high):
        a, b, c = offsets[s, 0], offsets[s, 1], offsets[s, 2]
        begin, to = start[s], s
        for end in (max(begin, start[s + 1] - AHEAD), start[s + 1]):
            to_a, to_b = first + size * offsets[to, 0], first + size * offsets[to, 1]
            to_c = first + size * offsets[to, 2]
            for n in range(np.uint64(begin), np.uint64(end)):
                later = np.uint64(min(np.int64(n) + AHEAD, last))
                prefetch_to_write(to_a + size * np.int64(node[later]))
                prefetch(to_b + size * np.int64(node_b[later]))
                prefetch(to_c + size * np.int64(node_c[later]))
                at, kappa = np.uint64(a + np.int64(node[n])), weights[n, zero]
                second, outwards = f[np.uint64(b + np.int64(node_b[n]))], f[np.uint64(c + np.int64(node_c[n]))]
                out = f[at]
                v = finished(kappa, second, begun(kappa, out, outwards))
                f[at] = v
                if keeps:
                    kept[n, zero], kept[n, one] = out, v
            begin, to = end, min(s + 1, high - 1)


@njit
def finish_links(f, offsets, start, node, node_b, weights, low, high):
    """The second part of what fixed_links does, for weights[n, 1]; the sweep has done the first (kernels.sparse)."""
    zero = np.uint64(0)
    for s in range(low, high):
        a, b = offsets[s, 0], offsets[s, 1]
        for n in range(np.uint64(start[s]), np.uint64(start[s + 1])):
            at = np.uint64(a + np.int64(node[n]))
            f[at] = finished(weights[n, zero], f[np.uint64(b + np.int64(node_b[n]))], f[at])


@njit
def far_terms(f, start, far, far_weights, wall, low, high, wall_now):
    """The wall terms of fixed_links less what a quadratic rule adds: far_weights[n, 2] of g_i(z), g_j(y) at far[n, 2].

    To be called before fixed_links, with wall_now[n] then in the place of wall[n].
    """
    for n in range(start[low], start[high]):
        extra = far_weights[n, 0] * f[far[n, 0]] + far_weights[n, 1] * f[far[n, 1]]
        wall_now[n] = wall[n] - extra


@njit
def momentum(kept, start, way, body, arm, speed, low, high, sums, scale):
    """Force, torque and mass of links that fixed_links kept, added to sums[bodies, 7], int64 of 1 / scale[7].

    way[s, 3]: direction; arm[n, 3]: from the centre of the body to the crossing; speed[n, 3]: of the wall there, or
    [0, 3] when nothing moves.
    """
    for s in range(low, high):
        ex, ey, ez = way[s, 0], way[s, 1], way[s, 2]
        for n in range(start[s], start[s + 1]):
            out, v = kept[n, 0], kept[n, 1]
            give, keep = out + v, out - v
            fx, fy, fz = give * ex, give * ey, give * ez
            if speed.shape[0]:
                fx, fy, fz = fx - keep * speed[n, 0], fy - keep * speed[n, 1], fz - keep * speed[n, 2]
            add_gains(sums[body[n]], fx, fy, fz, arm[n], keep, scale)


@njit
def links_beside_grains(
    populations, parity, nodes, directions, bounce_back, low, high, links, counters, scale, sums
):  # fmt: skip
    """The links low .. high - 1 of walls where grains move: those from nodes that no grain has now bounce back, by the
    rule or by the lower one for which grains leave fluid nodes enough. What they give is added to sums[bodies, 7],
    int64 of 1 / scale[7].

    links: arrays of `fluid.surfaces.Crossings`, whose `local` are places (x, row, plane) in `solid` here.
    """
    f, (rule, open_mass), inner, speed = populations.f, bounce_back, nodes.inner, links.speed
    for n in range(low, high):
        x, r, p = links.local[n, 0], links.local[n, 1], links.local[n, 2]
        if nodes.solid[(p * nodes.shape[1] + r) * nodes.shape[0] + x] != FLUID:
            continue
        i = links.way[n]
        j, ex, ey, ez = directions.opposite[i], directions.e[i, 0], directions.e[i, 1], directions.e[i, 2]
        z, y, column = p - inner[2, 0], r - inner[1, 0], x - inner[0, 0]
        at = arrival(populations, parity, z, y, column, j)
        behind, second, outwards, third, fourth = 0, 0.0, 0.0, 0.0, 0.0
        if REACH[rule] and is_fluid(nodes, p - ez, r - ey, x - ex):
            behind = 1
            second = float(f[arrival(populations, parity, z, y, column, i)])
            outwards = float(f[arrival(populations, parity, z - ez, y - ey, column - ex, j)])
        if REACH[rule] == 2 and behind:
            further, third, fourth = second_behind(populations, parity, nodes, (x, r, p), (ex, ey, ez), i, j)
            behind += further
        counters[LINKS] += 1
        counters[FALLBACKS] += behind < REACH[rule]
        c = coefficients(applicable(rule, behind), links.q[n])
        out, push = float(f[at]), directions.w6[i] * (ex * speed[n, 0] + ey * speed[n, 1] + ez * speed[n, 2])
        v = c[0] * out + c[1] * second + c[2] * outwards + c[3] * third + c[4] * fourth - c[5] * push
        f[at] = v
        give, keep = out + v, out - v
        swept = keep * open_mass
        fx, fy, fz = give * ex - swept * speed[n, 0], give * ey - swept * speed[n, 1], give * ez - swept * speed[n, 2]
        add_gains(sums[links.body[n]], fx, fy, fz, links.arm[n], keep, scale)


@njit(forceinline=True)
def add_gains(total, fx, fy, fz, arm, keep, scale):
    """Add a force, its torque and the mass that the fluid gains, -keep."""
    px, py, pz = arm[0], arm[1], arm[2]
    total[0] += np.int64(np.rint(fx * scale[0]))
    total[1] += np.int64(np.rint(fy * scale[1]))
    total[2] += np.int64(np.rint(fz * scale[2]))
    total[3] += np.int64(np.rint((py * fz - pz * fy) * scale[3]))
    total[4] += np.int64(np.rint((pz * fx - px * fz) * scale[4]))
    total[5] += np.int64(np.rint((px * fy - py * fx) * scale[5]))
    total[6] -= np.int64(np.rint(keep * scale[6]))
