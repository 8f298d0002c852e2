"""Velocity Verlet of grains, in the two halves between which contact forces are found.

Forces depend on velocities, so the first half ends with velocities predicted by the old acceleration, and the second
adds half the change of acceleration: second order, whatever the dashpots.

A grain is two lines of eight values, rows[n, 16]: x y z radius, v and inverse mass; omega and inverse inertia,
orientation (quaternion, or angle 0 0 0). Lines of forces[n, 8] and given[n, 8]: force (3), power, torque (3), 0.
A line of forces with its halves exchanged lies beside what it changes: force at v, torque at omega.
"""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import (
    Vec,
    address_of,
    bitmask,
    convert,
    exchange,
    floor,
    fma,
    lane_numbers,
    lane_values,
    load_at,
    maximum,
    prefetch,
    rint,
    select,
    splat,
    store_at,
)

F, I = Vec(8, np.float64), Vec(8, np.int64)
INFINITE = np.inf
ENTRIES_AHEAD = 16  # lines of forces are prefetched: those of a grain lie where its partners' pairs are


@njit
def in_lanes(values, first, other):
    """values[0..3] in the lanes from `first` on, `other` elsewhere."""
    k = convert(F, lane_numbers(I))
    line = splat(F, other)
    for c in range(3):
        line = select(k == 1.0 * (first + c), splat(F, values[c]), line)
    return line


@njit
def start(part, grain_cuts, grains, box, gravity, planar, farthest, dt):
    """First half: positions at the end of the step, velocities predicted there.

    farthest[part, :3] are not below the greatest squared distances of a grain from its place in `origin`, and infinite
    when one is no number.
    """
    rows, pull, forces, given, _, _, origin = grains
    half, k = 0.5 * dt, convert(F, lane_numbers(I))
    at_x, at_v = k < 3.0, (k > 3.0) & (k < 7.0)
    zero, most = splat(F, 0.0), splat(F, 0.0)
    weight, length, inverse = in_lanes(gravity, 4, 0.0), in_lanes(box.lengths, 0, 0.0), in_lanes(box.inverses, 0, 0.0)
    periodic = inverse > 0.0
    grain, push, more, home = address_of(rows, 0), address_of(forces, 0), address_of(given, 0), address_of(origin, 0)
    for i in range(grain_cuts[part], grain_cuts[part + 1]):
        a, b = load_at(F, grain + 128 * i, 64), load_at(F, grain + 128 * i + 64, 64)
        force = exchange(load_at(F, push + 64 * i, 64) + load_at(F, more + 64 * i, 8), 4)
        rate = select(at_v, fma(force, splat(F, rows[i, 7]), weight * pull[i]), zero)
        goes = dt if rows[i, 7] > 0.0 else 0.0  # what stays has the velocity of its surface
        x = fma(select(at_x, exchange(fma(rate, half, a), 4), zero), splat(F, goes), a)
        out = periodic & ((x < 0.0) | (x >= length))
        if bitmask(out) != 0:
            x = select(out, fma(floor(x * inverse), -length, x), x)
            x = select(periodic & (x >= length), zero, x)  # what rounds up to the length
        d = x - load_at(F, home + 64 * i, 8)
        d = select(at_x, fma(rint(d * inverse), -length, d), zero)
        most = maximum(select(d == d, d * d, splat(F, INFINITE)), most)
        store_at(grain + 128 * i, fma(rate, dt, x), 64)
        spin = select(at_x, force, zero) * rows[i, 11]
        line = turned(fma(spin, dt, b), spin, half, dt, planar)
        store_at(grain + 128 * i + 64, line, 64)
    store_at(address_of(farthest, 8 * part), most, 8)


@njit
def signs(minuses):
    """1 in lanes, -1 where there is a bit."""
    line = splat(F, 1.0)
    for lane in range(8):
        if minuses >> lane & 1:
            line = select(lane_numbers(I) == lane, splat(F, -1.0), line)
    return line


@njit
def turned(line, spin, half, dt, planar):
    """The second line of a row, with the velocity at the end of the step, when its orientation has turned by the mean
    velocity of the step. spin: rate of the velocity.

    Of values in lanes, and nothing is loaded from a line that was just stored: such loads wait.
    """
    k, mean = convert(F, lane_numbers(I)), line - half * spin
    if planar:
        return select(k == 4.0, line + dt * exchange(exchange(mean, 4), 2), line)
    x, y, z, _, _, _, _, _ = lane_values(0.5 * half * mean)
    s = x * x + y * y + z * z
    w = 1.0 - s  # (1 - s, 2 x, 2 y, 2 z) / (1 + s) is the rotation by 4 atan(|s|), to third order that by |omega| dt
    x, y, z = 2.0 * x, 2.0 * y, 2.0 * z
    q = w * line  # product of quaternions, in the order of its terms
    q = q + x * (signs(0b01010000) * exchange(line, 1))
    q = q + y * (signs(0b10010000) * exchange(line, 2))
    q = q + z * (signs(0b00110000) * exchange(exchange(line, 1), 2))
    _, _, _, _, a, b, c, d = lane_values(q * q)
    return select(k < 4.0, line, q * (1.0 / np.sqrt(a + b + c + d)))


@njit
def finish(part, grain_cuts, grains, lines, couples, lists, film, dt):
    """Second half: sums of the lines of each grain in the order of its contacts' ids, velocities at the step's end."""
    rows, forces, half = grains.row, grains.force, 0.5 * dt
    k = convert(F, lane_numbers(I))
    zero, one = splat(F, 0.0), splat(F, 1.0)
    of_force, of_torque, of_power = k < 3.0, (k > 3.0) & (k < 7.0), select(k == 3.0, one, zero)
    at_v = select((k > 3.0) & (k < 7.0), one, zero)
    at_omega = select(of_force, one, zero)
    grain, push, line, more = address_of(rows, 0), address_of(forces, 0), address_of(lines, 0), address_of(couples, 0)
    first, end = grain_cuts[part], grain_cuts[part + 1]
    last = lists.begins[end] - 1
    for i in range(first, end):
        total, radius = splat(F, 0.0), rows[i, 3]
        for at in range(lists.begins[i], lists.begins[i + 1]):
            prefetch(line + 64 * (lists.entries[min(at + ENTRIES_AHEAD, last)] >> 1))
            slot = lists.entries[at]
            sign, arm = 1.0 - 2.0 * (slot & 1), radius - lines[slot >> 1, 7]
            shares = select(of_force, splat(F, sign), select(of_torque, splat(F, arm), of_power))
            total = fma(load_at(F, line + 64 * (slot >> 1), 64), shares, total)
            if film.cut_off > 0.0:
                total = fma(load_at(F, more + 64 * (slot >> 1), 64), splat(F, sign * arm), total)
        change = exchange(total - load_at(F, push + 64 * i, 64), 4) * half
        a, b = load_at(F, grain + 128 * i, 64), load_at(F, grain + 128 * i + 64, 64)
        store_at(grain + 128 * i, fma(change, at_v * rows[i, 7], a), 64)
        store_at(grain + 128 * i + 64, fma(change, at_omega * rows[i, 11], b), 64)
        store_at(push + 64 * i, total, 64)
        grains.heat[i] += half * lane_values(total)[3]


@njit
def count_work(part, grain_cuts, grains, contacts, lists, first_wall, walls, dt):
    """Work of moving planes on grains, and of grains that are moved from outside (not free) on others.

    Slots from first_wall on are of walls.
    """
    rows, forces, work, half = grains.row, grains.force, grains.work, 0.5 * dt
    for i in range(grain_cuts[part], grain_cuts[part + 1]):
        for at in range(lists.begins[i], lists.begins[i + 1]):
            slot = lists.entries[at] >> 1
            if slot >= first_wall:
                w = contacts.high[slot]
                for c in range(3):
                    work[i] += 2.0 * half * contacts.lines[slot, c] * walls[w, 4 + c]
        if rows[i, 7] == 0.0:
            for c in range(3):
                work[i] -= 2.0 * half * (forces[i, c] * rows[i, 4 + c] + forces[i, 4 + c] * rows[i, 8 + c])
