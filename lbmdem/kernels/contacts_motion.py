"""Velocity Verlet of grains, in the two halves between which contact forces are found.

Forces depend on velocities, so the first half ends with velocities predicted by the old acceleration, and the second
adds half the change of acceleration: second order, whatever the dashpots.

rows[n, 16]: x y z radius, v and inverse mass, omega and inverse inertia, orientation (quaternion, or angle 0 0 0).
Lines of forces[n, 8] and given[n, 8]: force (3), power, torque (3), nothing.
"""

import numpy as np

from hpcpic.core.simd.jit import njit


@njit
def start(first, last, rows, pull, forces, given, gravity, origin, lengths, periodic, planar, dt, farthest, place):
    """Positions at the end of the step, velocities predicted there; farthest[place] = greatest squared distance of a
    grain from origin[n, 3].
    """
    most, half = 0.0, 0.5 * dt
    for k in range(first, last):
        row, force, more, centre = rows[k], forces[k], given[k], origin[k]
        moved = 0.0
        for c in range(3):
            a = row[7] * (force[c] + more[c]) + pull[k] * gravity[c]
            x = row[c] + dt * (row[4 + c] + half * a)
            row[4 + c] += dt * a
            d = x - centre[c]
            if periodic[c]:
                if not 0.0 <= x < lengths[c]:
                    x -= lengths[c] * np.floor(x / lengths[c])
                    if not x < lengths[c]:  # what rounds up to the length
                        x = 0.0
                d -= lengths[c] * np.rint(d / lengths[c])
            row[c] = x
            moved += d * d
        turn(row, force, more, dt, planar)
        most = max(most, moved) if moved == moved else np.inf
    farthest[place] = most


@njit
def turn(row, force, more, dt, planar):
    """Orientation by the mean angular velocity of the step, angular velocity predicted at its end."""
    half = 0.5 * dt
    ax, ay, az = row[11] * (force[4] + more[4]), row[11] * (force[5] + more[5]), row[11] * (force[6] + more[6])
    wx, wy, wz = row[8] + half * ax, row[9] + half * ay, row[10] + half * az
    row[8] += dt * ax
    row[9] += dt * ay
    row[10] += dt * az
    if planar:
        row[12] += dt * wz
        return
    x, y, z = 0.25 * dt * wx, 0.25 * dt * wy, 0.25 * dt * wz
    s = x * x + y * y + z * z
    w, s = 1.0 - s, 2.0  # (1 - s, 2 x, 2 y, 2 z) is the rotation by 4 atan(|s|), to third order |omega| dt
    x, y, z = s * x, s * y, s * z
    a, b, c, d = row[12], row[13], row[14], row[15]
    q0, q1 = w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c
    q2, q3 = w * c - x * d + y * a + z * b, w * d + x * c - y * b + z * a
    scale = 1.0 / np.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    row[12], row[13], row[14], row[15] = q0 * scale, q1 * scale, q2 * scale, q3 * scale


@njit
def finish(first, last, rows, lines, begins, slots, first_wall, high, walls, forces, heat, work, half):
    """Sums of the lines of each grain, in the order of its contacts' ids, and velocities at the end of the step.

    slots[begins[k] .. begins[k + 1]] are twice the slots of grain k's contacts, plus 1 where it is the second.
    Slots from first_wall on are of walls. half: dt / 2; dt is the time over which power becomes heat and work.
    """
    for k in range(first, last):
        row, force = rows[k], forces[k]
        fx = fy = fz = tx = ty = tz = power = 0.0
        for at in range(begins[k], begins[k + 1]):
            line = lines[slots[at] >> 1]
            sign = 1.0 - 2.0 * (slots[at] & 1)
            arm = row[3] - line[7]
            fx += sign * line[0]
            fy += sign * line[1]
            fz += sign * line[2]
            power += line[3]
            tx += arm * line[4]
            ty += arm * line[5]
            tz += arm * line[6]
            if slots[at] >= 2 * first_wall:
                wall = walls[high[slots[at] >> 1]]
                work[k] += 2.0 * half * (line[0] * wall[4] + line[1] * wall[5] + line[2] * wall[6])
        if row[7] == 0.0:  # a grain that is moved from outside
            work[k] -= 2.0 * half * (fx * row[4] + fy * row[5] + fz * row[6])
            work[k] -= 2.0 * half * (tx * row[8] + ty * row[9] + tz * row[10])
        row[4] += half * row[7] * (fx - force[0])
        row[5] += half * row[7] * (fy - force[1])
        row[6] += half * row[7] * (fz - force[2])
        row[8] += half * row[11] * (tx - force[4])
        row[9] += half * row[11] * (ty - force[5])
        row[10] += half * row[11] * (tz - force[6])
        force[0], force[1], force[2], force[3] = fx, fy, fz, power
        force[4], force[5], force[6] = tx, ty, tz
        heat[k] += half * power
