"""Links between fluid and solid nodes: rules, populations that come back, momentum; compiled.

On the link of a fluid node x along e_i to a solid one, with y = x - e_i, z = y - e_i behind it and j opposite to i, the
sweep has bounced g_i(x) back half-way. A rule makes of it, where j arrives at x at the next step,

    out + weights . (out, g_i(y), g_j(x), g_i(z), g_j(y)) - wall term,     out = g_i(x)

`kernels.layout` says where these are: all in the slots i and j, at the node itself or at the one its pair (up, -up)
points to. No link writes what another one reads, so their order does not matter. Populations are zero-centred (f - w),
which a rule whose coefficients add up to 1 does not notice.
"""

import math

import numpy as np

from hpcpic.core.simd.jit import njit
from lbmdem.kernels.layout import arrival
from lbmdem.kernels.runs import FLUID, run, span

HALFWAY, INTERPOLATED, QUADRATIC, CLI = 0, 1, 2, 3
LINKS, FALLBACKS, LOST = 0, 1, 2  # counters: links, those without the fluid nodes of their rule, those not served


@njit(inline="always")
def coefficients(rule, q, behind):
    """Coefficients of g_i(x), g_i(y), g_j(x), g_i(z), g_j(y) and of the wall term, for the crossing at q of the link.

    `behind`: fluid nodes behind x that can be used (0, 1, 2). The wall term is 6 w e.u (Ladd 1994) times one minus
    the coefficients of g_j: a fluid that moves with the wall is left as it is. Bouzidi, Firdaouss & Lallemand, Phys.
    Fluids 13 (2001) 3452, (5); Ginzburg & d'Humieres, Phys. Rev. E 68 (2003) 066614, for CLI.
    """
    if behind == 0 or rule == HALFWAY:
        return 1.0, 0.0, 0.0, 0.0, 0.0, 1.0
    if rule == CLI:
        kappa = (1.0 - 2.0 * q) / (1.0 + 2.0 * q)
        return 1.0, kappa, -kappa, 0.0, 0.0, 1.0 + kappa
    if rule == INTERPOLATED or behind == 1:
        if q <= 0.5:
            return 2.0 * q, 1.0 - 2.0 * q, 0.0, 0.0, 0.0, 1.0
        inverse = 1.0 / (2.0 * q)
        return inverse, 0.0, 1.0 - inverse, 0.0, 0.0, inverse
    if q <= 0.5:
        return q * (2.0 * q + 1.0), 1.0 - 4.0 * q * q, 0.0, -q * (1.0 - 2.0 * q), 0.0, 1.0
    first = 1.0 / (q * (2.0 * q + 1.0))
    return first, 0.0, (2.0 * q - 1.0) / q, 0.0, -(2.0 * q - 1.0) / (2.0 * q + 1.0), first


@njit(inline="always")
def crossing(d_sq, along, e_sq, inverse):
    """Where a link leaves the fluid: d_sq = |x - c|^2 - r^2 >= 0, along = (x - c).e < 0; inverse of e_sq. In [0, 1]."""
    q = (-along - math.sqrt(max(along * along - e_sq * d_sq, 0.0))) * inverse
    return min(max(q, 0.0), 1.0)


@njit(inline="always")
def place(strides, plane, row):
    """Element of x = 0 in a slot; rows wrap, planes too when this rank has all. strides: `Layout.strides`."""
    if plane == strides[4]:
        plane = 0
    if row == strides[5]:
        row = 0
    elif row < 0:
        row = strides[5] - 1
    return plane * strides[1] + row * strides[2] + strides[3]


@njit
def buckets(centres, radii, grain, offset, low, high, start, images):
    """Lists of the images whose links start in each plane of [low, high): images[start[p - low] : start[p - low + 1]].

    Returns the length of the lists; they are filled if there is room.
    """
    start[:] = 0
    for m in range(grain.size):
        first, after = span(centres[grain[m], 2], radii[grain[m]] + 1.0, offset[m, 2], low, high)
        for p in range(first, after):
            start[p - low + 1] += 1
    for p in range(1, start.size):
        start[p] += start[p - 1]
    if start[-1] > images.size:
        return start[-1]
    place = start[:-1].copy()
    for m in range(grain.size):
        first, after = span(centres[grain[m], 2], radii[grain[m]] + 1.0, offset[m, 2], low, high)
        for p in range(first, after):
            images[place[p - low]] = m
            place[p - low] += 1
    return start[-1]


@njit
def moving_links(
    f, strides, slots, shifts, parity, e, opposite, w6, rule, open_mass, solid, shape, inner, box, low, high,
    centres, radii, ids, motion, grain, offset, start, images, sums, scale, counters,
):  # fmt: skip
    """Links of the images in planes [low, high): bounce back; what they give to sums[n, 7], int64 of 1 / scale[7].

    The sums are force, torque and the mass that the fluid gains, rounded once for each image and plane, so they do not
    depend on how planes are shared out. motion[n, 6]: velocity and angular velocity; e[q, 3], w6[q] = 6 w; solid: flat,
    of shape[3] with inner[3, 2]; box[3, 2]: nodes behind that count. start, images: `buckets` from `low` on; strides,
    slots, shifts: `kernels.layout`. open_mass: 1 to count the fluid that the wall sweeps over as momentum (Wen et al.,
    JCP 266 (2014) 161: Galilean invariant on the mean), 0 where covered and uncovered nodes are counted themselves.
    """
    height = 0
    for g in range(radii.size):
        height = max(height, np.int64(2.0 * radii[g]) + 8)
    chords = np.empty((3, 3, height), np.int64)
    gained = np.zeros(7)
    for p in range(low, high):
        for at in range(start[p - low], start[p - low + 1]):
            m = images[at]
            g = grain[m]
            links_of_plane(
                f, strides, slots, shifts, parity, e, opposite, w6, rule, open_mass, solid, shape, inner, box, p,
                centres[g], radii[g], np.int32(ids[g]), motion[g], offset[m],
                chords[0], chords[1], chords[2], gained, counters,
            )  # fmt: skip
            for a in range(7):
                sums[g, a] += np.int64(np.rint(gained[a] * scale[a]))


@njit
def _chords(centre, radius, offset, strides, inner, p, r0, r1, first, last, base):
    """Of planes p - 1 .. p + 1 and rows r0 - 1 .. r1: runs of solid nodes, local; element of the local node x = 0."""
    for c in range(3):
        dz = (p - 1 + c - offset[2]) - centre[2]
        for r in range(r0 - 1, r1 + 1):
            dy = (r - offset[1]) - centre[1]
            a, b = run(centre[0], radius * radius - dz * dz - dy * dy)
            first[c, r - r0 + 1] = a + offset[0]
            last[c, r - r0 + 1] = b + offset[0]
            base[c, r - r0 + 1] = place(strides, p - 1 + c - inner[2, 0], r - inner[1, 0]) - inner[0, 0]


@njit(inline="always")
def second_behind(f, strides, slots, shifts, parity, solid, shape, inner, p, r, x, ex, ey, ez, i, j):
    """Whether z behind y can be used too, and g_i(z), g_j(y). Only where this rank has them, periodic or not."""
    nx, ny, nz = inner[0, 1] - inner[0, 0], inner[1, 1] - inner[1, 0], inner[2, 1] - inner[2, 0]
    yx, yr, yp = (x - inner[0, 0] - ex) % nx, (r - inner[1, 0] - ey) % ny, (p - inner[2, 0] - ez) % nz
    zx, zr, zp = yx + inner[0, 0] - ex, yr + inner[1, 0] - ey, yp + inner[2, 0] - ez
    if solid[(zp * shape[1] + zr) * shape[0] + zx] != FLUID:
        return False, 0.0, 0.0
    zx, zr, zp = (zx - inner[0, 0]) % nx, (zr - inner[1, 0]) % ny, (zp - inner[2, 0]) % nz
    third = f[arrival(strides, slots, shifts, parity, yp, yr, yx, i)]
    return True, float(third), float(f[arrival(strides, slots, shifts, parity, zp, zr, zx, j)])


@njit
def links_of_plane(
    f, strides, slots, shifts, parity, e, opposite, w6, rule, open_mass, solid, shape, inner, box, p,
    centre, radius, number, motion, offset, first, last, base, gained, counters,
):  # fmt: skip
    """Links of one image that start in plane p. gained[7]: force, torque and mass."""
    r0, r1 = span(centre[1], radius + 1.0, offset[1], inner[1, 0], inner[1, 1])
    _chords(centre, radius, offset, strides, inner, p, r0, r1, first, last, base)
    dz, r_sq = (p - offset[2]) - centre[2], radius * radius
    ux, uy, uz, wx, wy, wz = motion[0], motion[1], motion[2], motion[3], motion[4], motion[5]
    force_x, force_y, force_z, mass = 0.0, 0.0, 0.0, 0.0
    torque_x, torque_y, torque_z = 0.0, 0.0, 0.0
    n_links, n_fallbacks, n_lost = 0, 0, 0
    for i in range(1, opposite.size):
        ex, ey, ez = e[i, 0], e[i, 1], e[i, 2]
        cx, cy, cz = float(ex), float(ey), float(ez)
        e_sq, weight = cx * cx + cy * cy + cz * cz, w6[i]
        inverse = 1.0 / e_sq
        step = (ez * shape[1] + ey) * shape[0] + ex
        j = opposite[i]
        slot_i, slot_j = slots[parity, i] * strides[0], slots[parity, j] * strides[0]
        odd = i % 2 == 1
        up = 1 if odd else -1  # up * e points to larger storage indices
        for r in range(r0, r1):
            row = r - r0 + 1
            sa, sb = max(first[1 + ez, row + ey] - ex, inner[0, 0]), min(last[1 + ez, row + ey] - ex + 1, inner[0, 1])
            if sa >= sb:
                continue
            a, b = first[1, row], last[1, row]
            dy = (r - offset[1]) - centre[1]
            in_box = box[1, 0] <= r - ey < box[1, 1] and box[2, 0] <= p - ez < box[2, 1]
            nodes = (p * shape[1] + r) * shape[0]
            here, there = base[1, row], base[1 + up * ez, row + up * ey] + up * ex
            at_out = slot_j + (there if odd else here)
            at_second = slot_i + (here if odd else there)
            at_outwards = slot_j + (here if odd else there)
            for x in range(sa, sb):
                k = nodes + x
                if a <= x <= b or solid[k] != FLUID:
                    continue
                if solid[k + step] != number:
                    n_lost += 1
                    continue
                dx = (x - offset[0]) - centre[0]
                along = cx * dx + cy * dy + cz * dz
                q = crossing(dx * dx + dy * dy + dz * dz - r_sq, along, e_sq, inverse)
                px, py, pz = dx + q * cx, dy + q * cy, dz + q * cz
                vx, vy, vz = ux + wy * pz - wz * py, uy + wz * px - wx * pz, uz + wx * py - wy * px
                n = np.int64(in_box and box[0, 0] <= x - ex < box[0, 1] and solid[k - step] == FLUID)
                third, fourth = 0.0, 0.0
                if rule == QUADRATIC and n == 1:
                    found, third, fourth = second_behind(
                        f, strides, slots, shifts, parity, solid, shape, inner, p, r, x, ex, ey, ez, i, j
                    )
                    n += np.int64(found)
                c0, c1, c2, c3, c4, wall = coefficients(rule, q, n)
                out = f[at_out + x]
                extra = (c0 - 1.0) * out + c1 * f[at_second + x] + c2 * f[at_outwards + x]
                if rule == QUADRATIC:
                    extra += c3 * third + c4 * fourth
                v = (out - wall * weight * (cx * vx + cy * vy + cz * vz)) + extra
                f[at_out + x] = v
                give, keep = out + v, out - v
                swept = open_mass * keep
                fx, fy, fz = give * cx - swept * vx, give * cy - swept * vy, give * cz - swept * vz
                force_x += fx
                force_y += fy
                force_z += fz
                torque_x += py * fz - pz * fy
                torque_y += pz * fx - px * fz
                torque_z += px * fy - py * fx
                mass -= keep
                n_links += 1
                n_fallbacks += n < rule_reach(rule)
    gained[0], gained[1], gained[2] = force_x, force_y, force_z
    gained[3], gained[4], gained[5], gained[6] = torque_x, torque_y, torque_z, mass
    counters[LINKS] += n_links
    counters[FALLBACKS] += n_fallbacks
    counters[LOST] += n_lost


@njit(inline="always")
def rule_reach(rule):
    """Fluid nodes behind the first that a rule reads."""
    return 0 if rule == HALFWAY else 2 if rule == QUADRATIC else 1


@njit
def fixed_links(f, offsets, start, node, weights, wall, low, high):
    """Segments [low, high) of links that stay: node[n] in a slot, weights[n, 3] of out, g_i(y), g_j(x); wall[n] off.

    Links start[s] to start[s + 1] of a segment have offsets[s, 3] from the node to these three.
    """
    for s in range(low, high):
        a, b, c = offsets[s, 0], offsets[s, 1], offsets[s, 2]
        for n in range(start[s], start[s + 1]):
            x = np.int64(node[n])
            out = f[a + x]
            extra = weights[n, 0] * out + weights[n, 1] * f[b + x] + weights[n, 2] * f[c + x]
            f[a + x] = (out - wall[n]) + extra


@njit
def far_terms(f, start, far, far_weights, wall, low, high, wall_now):
    """The wall terms of fixed_links less what a quadratic rule adds: far_weights[n, 2] of g_i(z), g_j(y) at far[n, 2].

    To be called before fixed_links, with wall_now[n] then in the place of wall[n].
    """
    for n in range(start[low], start[high]):
        extra = far_weights[n, 0] * f[far[n, 0]] + far_weights[n, 1] * f[far[n, 1]]
        wall_now[n] = wall[n] - extra


@njit
def fixed_momentum(f, offsets, start, way, node, weights, wall, body, arm, speed, low, high, sums, scale):
    """As fixed_links, and adds force, torque and mass to sums[bodies, 7], int64 of 1 / scale[7]. way[s, 3]: direction.

    arm[n, 3]: from the centre of the body to the crossing; speed[n, 3]: of the wall there.
    """
    for s in range(low, high):
        a, b, c = offsets[s, 0], offsets[s, 1], offsets[s, 2]
        ex, ey, ez = way[s, 0], way[s, 1], way[s, 2]
        for n in range(start[s], start[s + 1]):
            x = np.int64(node[n])
            out = f[a + x]
            extra = weights[n, 0] * out + weights[n, 1] * f[b + x] + weights[n, 2] * f[c + x]
            v = (out - wall[n]) + extra
            f[a + x] = v
            give, keep = out + v, out - v
            fx, fy, fz = give * ex - keep * speed[n, 0], give * ey - keep * speed[n, 1], give * ez - keep * speed[n, 2]
            px, py, pz = arm[n, 0], arm[n, 1], arm[n, 2]
            total = sums[body[n]]
            total[0] += np.int64(np.rint(fx * scale[0]))
            total[1] += np.int64(np.rint(fy * scale[1]))
            total[2] += np.int64(np.rint(fz * scale[2]))
            total[3] += np.int64(np.rint((py * fz - pz * fy) * scale[3]))
            total[4] += np.int64(np.rint((pz * fx - px * fz) * scale[4]))
            total[5] += np.int64(np.rint((px * fy - py * fx) * scale[5]))
            total[6] -= np.int64(np.rint(keep * scale[6]))
