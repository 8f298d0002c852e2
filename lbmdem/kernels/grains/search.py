"""Who may touch whom: neighbours within a margin, in the order of ids, and one slot for each pair."""

import numpy as np

from hpcpic.core.simd.compile import njit

FAR = 1 << 40  # cell numbers of a grain thrown away stay integers


@njit
def hash_of(x, y, z, mask):
    """Index in `head` of the cell (x, y, z)."""
    return (x * 73856093 ^ y * 19349663 ^ z * 83492791) & mask


@njit
def locate(rows, size, box, cells):
    """Put all grains into cells of the size, or a little larger along periodic axes."""
    shape, place, head, chain = cells
    head[:] = -1
    for k in range(chain.size - 1, -1, -1):
        for c in range(3):
            if shape[c] > 0:
                place[k, c] = max(0, min(np.int64(rows[k, c] * box.inverses[c] * shape[c]), shape[c] - 1))
            else:
                place[k, c] = np.int64(np.floor(min(max(rows[k, c] / size, -FAR), FAR)))
        h = hash_of(place[k, 0], place[k, 1], place[k, 2], head.size - 1)
        chain[k] = head[h]
        head[h] = k


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
def neighbours(rows, ids, n_own, margin, box, cells, firsts, others):
    """others[firsts[k] .. firsts[k + 1]]: grains whose surface is within the margin of own grain k's, by id.

    Two grains of inverse mass 0 are no pair. Returns how many entries are wanted; beyond others.size none is stored.
    """
    count = np.int64(0)
    shape, place, head, chain = cells
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for c in range(3):
        low[c] = -1 if shape[c] == 0 or shape[c] > 2 else 0
        high[c] = 1 if shape[c] == 0 or shape[c] > 1 else 0
    for k in range(n_own):
        firsts[k] = count
        row = rows[k]
        for ox in range(low[0], high[0] + 1):
            x = around(place[k, 0] + ox, shape[0])
            for oy in range(low[1], high[1] + 1):
                y = around(place[k, 1] + oy, shape[1])
                for oz in range(low[2], high[2] + 1):
                    z = around(place[k, 2] + oz, shape[2])
                    j = head[hash_of(x, y, z, head.size - 1)]
                    while j >= 0:
                        other = rows[j]
                        if place[j, 0] == x and place[j, 1] == y and place[j, 2] == z and j != k:
                            reach = row[3] + other[3] + margin
                            near = distance_sq(row, other, box) < reach * reach
                            if near and (row[7] > 0.0 or other[7] > 0.0):
                                if count < others.size:
                                    insert(others, firsts[k], count, j, ids)
                                count += 1
                        j = chain[j]
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
