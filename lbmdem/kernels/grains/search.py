"""Who may touch whom: neighbours within a margin, in the order of ids, and one slot for each pair."""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import empty, zeros
from hpcpic.core.simd.vector import Vec, address_of, bitmask, first_bit, load, load_at, rint
from lbmdem.sizes import LANES

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
def ends(counts):
    """Make counts by bucket the ends of the buckets: whoever fills these from behind leaves where they begin."""
    count = 0
    for bucket in range(counts.size):
        count += counts[bucket]
        counts[bucket] = count


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
    ends(begins)
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
def ahead(n):
    """Bits of the lanes below n."""
    return (1 << min(n, LANES)) - 1


@njit(forceinline=True)
def near_lanes(row, wanted, margin, near, box, line, ball, at):
    """Bits of the grains from `at` on, by buckets, that are of the line and within the margin of the row; of those
    with a gap below `near`.
    """
    base, step = address_of(ball, 0) + 8 * at, 8 * ball.shape[1]
    dx, dy = load_at(F, base, 8) - row[0], load_at(F, base + step, 8) - row[1]
    dz, touch = load_at(F, base + 2 * step, 8) - row[2], load_at(F, base + 3 * step, 8) + row[3]
    dx = dx - rint(dx * box.inverses[0]) * box.lengths[0]
    dy = dy - rint(dy * box.inverses[1]) * box.lengths[1]
    dz = dz - rint(dz * box.inverses[2]) * box.lengths[2]
    square, reach, short = dx * dx + dy * dy + dz * dz, touch + margin, touch + near
    hits = (square < reach * reach) & (load(I, line, at) == wanted)
    return bitmask(hits), bitmask(hits & (square < short * short))


@njit
def same_cell(place, k):
    """True where grain k is in the cell of the one before."""
    return place[k, 0] == place[k - 1, 0] and place[k, 1] == place[k - 1, 1] and place[k, 2] == place[k - 1, 2]


@njit
def spans_around(cell, cells, low, high, spans):
    """spans[m, 3]: first and last grain by buckets of the pieces of lines around a cell, and the line; returns m."""
    m, shape, begins = 0, cells.shape, cells.begins
    buckets = begins.size - 1
    for oz in range(low[2], high[2] + 1):
        z = around(cell[2] + oz, shape[2])
        for oy in range(low[1], high[1] + 1):
            line, ox = line_of(around(cell[1] + oy, shape[1]), z), low[0]
            while ox <= high[0]:
                first = bucket_of(around(cell[0] + ox, shape[0]), line, buckets)
                last, ox = first + 1, ox + 1
                while ox <= high[0] and bucket_of(around(cell[0] + ox, shape[0]), line, buckets) == last:
                    last, ox = last + 1, ox + 1
                spans[m, 0], spans[m, 1], spans[m, 2] = begins[first], begins[last], line
                m += begins[last] > begins[first]
    return m


@njit
def neighbours(rows, ids, n_own, margin, near, box, cells, firsts, others):
    """others[firsts[k] .. firsts[k + 1]]: twice the grains whose surface is within the margin of own grain k's, by id,
    plus 1 where the gap is below `near`.

    Two grains of inverse mass 0 are no pair. Returns how many entries are wanted; beyond others.size none is stored.
    Also how many pairs have a gap below `near`, and how many a larger one.
    """
    count, pairs, close = np.int64(0), np.int64(0), np.int64(0)
    shape, place, _, grain, line, ball = cells
    low, high = empty(3, np.int64), empty(3, np.int64)
    for c in range(3):
        low[c] = -1 if shape[c] == 0 or shape[c] > 2 else 0
        high[c] = 1 if shape[c] == 0 or shape[c] > 1 else 0
    spans, m = empty((27, 3), np.int64), 0  # where the grains around a cell begin and end, and their line
    for k in range(n_own):
        firsts[k] = count
        if k == 0 or not same_cell(place, k):
            m = spans_around(place[k], cells, low, high, spans)
        row = rows[k]
        for span in range(m):
            end, wanted = spans[span, 1], spans[span, 2]
            for at in range(spans[span, 0], end, LANES):
                hits, short = near_lanes(row, wanted, margin, near, box, line, ball, at)
                hits &= ahead(end - at)
                while hits:
                    lane = first_bit(hits)
                    j, tight = grain[at + lane], short >> lane & 1
                    hits &= hits - 1
                    if j != k and (row[7] > 0.0 or rows[j, 7] > 0.0):
                        if count < others.size:
                            insert(others, firsts[k], count, 2 * j + tight, ids)
                        count += 1
                        once = j >= n_own or ids[k] < ids[j]
                        pairs += once
                        close += once & tight
    firsts[n_own] = count
    return count, close, pairs - close


@njit
def insert(others, begin, end, entry, ids):
    """Put an entry among others[begin .. end], which are in the order of ids."""
    at = end
    while at > begin and ids[others[at - 1] >> 1] > ids[entry >> 1]:
        others[at] = others[at - 1]
        at -= 1
    others[at] = entry


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
def number_slots(ids, n_own, firsts, others, far, low, high, slots):
    """Give pairs slots: those whose gap is small from slot 0 on, the others from `far` on.

    low[slot] is the grain with the smaller id; slots[entry] are as in `GrainLists.entries`.
    """
    close = 0
    for k in range(n_own):
        for at in range(firsts[k], firsts[k + 1]):
            j = others[at] >> 1
            if j >= n_own or ids[k] < ids[j]:
                if others[at] & 1:
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
            j = others[at] >> 1
            if j < n_own and ids[j] < ids[k]:
                for entry in range(firsts[j], firsts[j + 1]):
                    if others[entry] >> 1 == k:
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


@njit
def set_dashpots(low, high, n_grain_slots, inverse, law, damping):
    """Dashpots (kg/s) of slots of grains, then of walls, by the reduced mass; inverse: of masses, 0 of fixed grains."""
    for slot in range(low.size):
        total = inverse[low[slot]]
        if slot < n_grain_slots:
            total += inverse[high[slot]]
        damping[slot] = 2.0 * law.damping * np.sqrt(law.stiffness / total)


@njit
def recall_springs(low, high, n_grain_slots, named, first_wall, keys, values, springs):
    """springs[3, slots]: those that were kept as values[m, 3] under keys[m, 2], the names of both; else 0.

    named: names (ids) of grains; those of walls begin with first_wall.
    """
    m = keys.shape[0]
    buckets = 1
    while buckets < m:
        buckets *= 2
    begins, sorted_keys = zeros(buckets + 1, np.int64), empty(m, np.int64)
    for k in range(m):
        begins[keys[k, 0] & (buckets - 1)] += 1
    ends(begins)
    for k in range(m):
        bucket = keys[k, 0] & (buckets - 1)
        begins[bucket] -= 1
        sorted_keys[begins[bucket]] = k
    for slot in range(low.size):
        a, b = named[low[slot]], named[high[slot]] if slot < n_grain_slots else first_wall + high[slot]
        bucket = a & (buckets - 1)
        for c in range(3):
            springs[c, slot] = 0.0
        for at in range(begins[bucket], begins[bucket + 1]):
            k = sorted_keys[at]
            if keys[k, 0] == a and keys[k, 1] == b:
                for c in range(3):
                    springs[c, slot] = values[k, c]
