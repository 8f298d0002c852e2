"""Who may touch whom: neighbours within a margin, in the order of ids, and one slot for each pair."""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import Vec, address_of, bitmask, first_bit, load, load_at, rint
from lbmdem.physics.contact_law import LANES

F, I = Vec(LANES, "float64"), Vec(LANES, "int64")
FAR = 1 << 40  # cell numbers of a grain thrown away stay integers
SCATTER = -7046029254386353131  # 2^64 over the golden ratio


@njit
def bucket_of(x, line, buckets):
    """Bucket of a cell: cells of a line follow each other, lines begin anywhere. buckets: a power of two."""
    return (x + (line * SCATTER >> 32)) & (buckets - 1)


@njit
def line_of(y, z):
    """Number of a line of cells along x, not shared by lines that are near each other."""
    return y + (z << 32)


@njit
def locate(rows, size, box, cells):
    """Put all grains into cells of the size, or a little larger along periodic axes, and sort them by buckets."""
    shape, place, begins, grain, line, ball = cells
    begins[:] = 0
    buckets, n = begins.size - 1, grain.size
    for k in range(n):
        for c in range(3):
            if shape[c] > 0:
                place[k, c] = max(0, min(np.int64(rows[k, c] * box.inverses[c] * shape[c]), shape[c] - 1))
            else:
                place[k, c] = np.int64(np.floor(min(max(rows[k, c] / size, -FAR), FAR)))
        begins[bucket_of(place[k, 0], line_of(place[k, 1], place[k, 2]), buckets)] += 1
    count = 0
    for bucket in range(buckets + 1):
        count += begins[bucket]
        begins[bucket] = count
    for k in range(n - 1, -1, -1):
        of_k = line_of(place[k, 1], place[k, 2])
        bucket = bucket_of(place[k, 0], of_k, buckets)
        begins[bucket] -= 1
        at = begins[bucket]
        grain[at], line[at] = k, of_k
        for c in range(4):
            ball[c, at] = rows[k, c]


@njit
def around(cell, cells):
    """Cell one beyond the end of a periodic axis (cells > 0) to the other end."""
    if cells > 0:
        if cell < 0:
            return cell + cells
        if cell >= cells:
            return cell - cells
    return cell


@njit
def distance_sq(row, other, box):
    """Squared distance of two centres, of nearest images."""
    square = 0.0
    for c in range(3):
        d = other[c] - row[c]
        d -= box.lengths[c] * np.rint(d * box.inverses[c])
        square += d * d
    return square


@njit
def ahead(n):
    """Bits of the lanes below n."""
    return (1 << min(n, LANES)) - 1


@njit(forceinline=True)
def near_lanes(row, wanted, margin, box, line, ball, at):
    """Bits of the grains from `at` on, by buckets, that are of the line and near the row."""
    base, step = address_of(ball, 0) + 8 * at, 8 * ball.shape[1]
    dx, dy = load_at(F, base, 8) - row[0], load_at(F, base + step, 8) - row[1]
    dz, reach = load_at(F, base + 2 * step, 8) - row[2], load_at(F, base + 3 * step, 8) + row[3] + margin
    dx = dx - rint(dx * box.inverses[0]) * box.lengths[0]
    dy = dy - rint(dy * box.inverses[1]) * box.lengths[1]
    dz = dz - rint(dz * box.inverses[2]) * box.lengths[2]
    return bitmask((dx * dx + dy * dy + dz * dz < reach * reach) & (load(I, line, at) == wanted))


@njit
def neighbours(rows, ids, n_own, margin, box, cells, firsts, others):
    """others[firsts[k] .. firsts[k + 1]]: grains whose surface is within the margin of own grain k's, by id.

    Two grains of inverse mass 0 are no pair. Returns how many entries are wanted; beyond others.size none is stored.
    """
    count = np.int64(0)
    shape, place, begins, grain, line, ball = cells
    buckets = begins.size - 1
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for c in range(3):
        low[c] = -1 if shape[c] == 0 or shape[c] > 2 else 0
        high[c] = 1 if shape[c] == 0 or shape[c] > 1 else 0
    for k in range(n_own):
        firsts[k] = count
        row, x = rows[k], place[k, 0]
        for oz in range(low[2], high[2] + 1):
            z = around(place[k, 2] + oz, shape[2])
            for oy in range(low[1], high[1] + 1):
                wanted, ox = line_of(around(place[k, 1] + oy, shape[1]), z), low[0]
                while ox <= high[0]:
                    first = bucket_of(around(x + ox, shape[0]), wanted, buckets)
                    last, ox = first + 1, ox + 1
                    while ox <= high[0] and bucket_of(around(x + ox, shape[0]), wanted, buckets) == last:
                        last, ox = last + 1, ox + 1
                    for at in range(begins[first], begins[last], LANES):
                        hits = near_lanes(row, wanted, margin, box, line, ball, at) & ahead(begins[last] - at)
                        while hits:
                            j = grain[at + first_bit(hits)]
                            hits &= hits - 1
                            if j != k and (row[7] > 0.0 or rows[j, 7] > 0.0):
                                if count < others.size:
                                    insert(others, firsts[k], count, j, ids)
                                count += 1
    firsts[n_own] = count
    return count


@njit
def insert(others, begin, end, j, ids):
    """Put j among others[begin .. end], which are in the order of ids."""
    at = end
    while at > begin and ids[others[at - 1]] > ids[j]:
        others[at] = others[at - 1]
        at -= 1
    others[at] = j


@njit
def near_walls(rows, n_own, margin, walls, n_walls, found):
    """found[m, 2] = (grain, wall) within the margin, by grain then wall; returns m, stored while there is room."""
    count = 0
    for k in range(n_own):
        if rows[k, 7] > 0.0:
            for w in range(n_walls):
                gap = -rows[k, 3]
                for c in range(3):
                    gap += (rows[k, c] - walls[w, c]) * walls[w, 8 + c]
                if gap < margin:
                    if count < found.shape[0]:
                        found[count, 0] = k
                        found[count, 1] = w
                    count += 1
    return count


@njit
def gap_between(row, other, box):
    """Distance of the surfaces of two grains, below 0 where they overlap."""
    return np.sqrt(distance_sq(row, other, box)) - row[3] - other[3]


@njit
def count_slots(rows, ids, n_own, near, box, firsts, others):
    """How many pairs have a gap below `near`, and how many a larger one."""
    close, far = 0, 0
    for k in range(n_own):
        for at in range(firsts[k], firsts[k + 1]):
            j = others[at]
            if j >= n_own or ids[k] < ids[j]:
                if gap_between(rows[k], rows[j], box) < near:
                    close += 1
                else:
                    far += 1
    return close, far


@njit
def number_slots(rows, ids, n_own, near, box, firsts, others, far, low, high, slots):
    """Give pairs slots: those with a gap below `near` from slot 0 on, the others from `far` on.

    low[slot] is the grain with the smaller id; slots[entry] are as in `GrainLists.entries`.
    """
    close = 0
    for k in range(n_own):
        for at in range(firsts[k], firsts[k + 1]):
            j = others[at]
            if j >= n_own or ids[k] < ids[j]:
                if gap_between(rows[k], rows[j], box) < near:
                    slot = close
                    close += 1
                else:
                    slot = far
                    far += 1
                second = ids[k] > ids[j]
                low[slot], high[slot] = (j, k) if second else (k, j)
                slots[at] = 2 * slot + second
    for k in range(n_own):
        for at in range(firsts[k], firsts[k + 1]):
            j = others[at]
            if j < n_own and ids[j] < ids[k]:
                for entry in range(firsts[j], firsts[j + 1]):
                    if others[entry] == k:
                        slots[at] = slots[entry] + 1


@njit
def join_walls(n_own, firsts, slots, found, first_slot, lists):
    """Fill the lists: entries of grains, then those of walls; found[m, 2] by grain has the slot first_slot + m."""
    m, count = 0, 0
    for k in range(n_own):
        lists.begins[k] = count
        for at in range(firsts[k], firsts[k + 1]):
            lists.entries[count] = slots[at]
            count += 1
        while m < found.shape[0] and found[m, 0] == k:
            lists.entries[count] = 2 * (first_slot + m)
            count += 1
            m += 1
    lists.begins[n_own] = count
