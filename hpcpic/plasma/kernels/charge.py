"""Charge from the blocks' patches to the rows of the slab, as integers, and to rho as numbers."""

from hpcpic.core.simd.compile import njit

GOOD, OVERFLOW = 0, 3
LARGEST = 2**62  # parts of a particle on a node


@njit
def add_row(row, patch):
    """row += patch, equally long."""
    for i in range(row.size):
        row[i] += patch[i]


@njit
def collect(first, last, ring, patches, places, slab):
    """slab[group, first:last, columns] = sum of the blocks' patches, whose edges overlap.

    places[block] = (where its patch [group, row, column] starts in `patches`, its first column, its columns); the
    columns of the slab are a ring, or lie between ghosts and none is outside.
    """
    groups, rows, columns = slab.shape
    for group in range(groups):
        for r in range(first, last):
            line = slab[group, r]
            line[:] = 0
            for block in range(places.shape[0]):
                width = places[block, 2]
                start = places[block, 0] + (group * rows + r) * width
                done = 0
                while done < width:
                    column = places[block, 1] + done
                    if ring:
                        column %= columns
                    n = min(width - done, columns - column)
                    add_row(line[column : column + n], patches[start + done : start + done + n])
                    done += n


@njit
def add_weighted(row, weight, parts):
    """row += weight x parts; whether any has more than LARGEST parts. Without a way out, so that it goes by vectors."""
    over = False
    for i in range(row.size):
        over |= (parts[i] > LARGEST) | (parts[i] < -LARGEST)
        row[i] += weight * parts[i]
    return over


@njit
def density(first, last, below, weight, slab, rho, source):
    """rho[first:last, columns] = sum over groups of weight[group] x slab, `below` ghost rows apart (5.1), C/m^d.

    source[first:last] gets it too, in wider rows: the solver changes its own. Returns OVERFLOW when a node holds so
    many parts that the next step could exceed an integer.
    """
    over = False
    for r in range(first, last):
        row = rho[r]
        row[:] = 0
        for group in range(slab.shape[0]):
            over |= add_weighted(row, weight[group], slab[group, below + r])
        source[r, : row.size] = row
    return OVERFLOW if over else GOOD
