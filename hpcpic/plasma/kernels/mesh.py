"""Loops over the rows of a slab: charge of the blocks to rho, phi to E, and sums over nodes as integers."""

import numpy as np

from hpcpic.core.simd.compile import njit

GOOD, OVERFLOW = 0, 3
LARGEST = 2**62  # parts of a particle on a node
LIMIT = 2.0**900  # terms beyond it are no numbers of a solution
_1, _2 = np.uint64(1), np.uint64(2)  # signed indices would keep the loops scalar


@njit
def padded_row(r, plane_rows, gap):
    """Row r of planes of so many rows in an array whose planes have `gap` rows more; 1D and 2D: no gap."""
    return r + r // plane_rows * gap


@njit
def add_row(row, patch):
    """row += patch, equally long."""
    for i in range(row.size):
        row[i] += patch[i]


@njit
def copy_row(to, row):
    """to = row, equally long: numba takes seconds to compile it as an assignment of arrays."""
    for i in range(row.size):
        to[i] = row[i]


@njit
def collect(first, last, ring, patches, places, parts_of_rows):
    """parts_of_rows[group, first:last, columns] = sum of the blocks' patches, whose edges overlap.

    places[block] = (where its patch [group, row, column] starts in `patches`, its first column, its columns); the
    columns of the slab are a ring, or lie between ghosts and none is outside.
    """
    groups, rows, columns = parts_of_rows.shape
    for group in range(groups):
        for r in range(first, last):
            line = parts_of_rows[group, r]
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
def density(first, last, below, left, plane_rows, gap, weight, parts, rho_rows, source):
    """rho_rows[first:last, columns] = sum over groups of weight[group] x parts, `below` ghost rows and `left` ghost
    columns apart, and in 3D `gap` more rows from plane to plane (5.1), C/m^d.

    source[plane] gets it too, its rows one after the other, of one row in 1D and 2D: the solver changes its own.
    Returns OVERFLOW when a node holds so many parts that the next step could exceed an integer.
    """
    over = False
    for r in range(first, last):
        row = rho_rows[r]
        row[:] = 0
        for group in range(parts.shape[0]):
            here = parts[group, below + padded_row(r, plane_rows, gap), left : left + row.size]
            over |= add_weighted(row, weight[group], here)
        at = r % plane_rows * row.size
        copy_row(source[r // plane_rows, at : at + row.size], row)
    return OVERFLOW if over else GOOD


@njit
def embed(first, last, row, column, n_columns, plane_rows, phi_gap, solved, phi_rows):
    """phi_rows[row:, column:] = the rows first:last of what the solver found: solved[plane], its rows of n_columns one
    after the other (1D and 2D: one). In 3D planes of phi_rows have phi_gap rows more.
    """
    for r in range(first, last):
        at = r % plane_rows * n_columns
        to = phi_rows[row + padded_row(r, plane_rows, phi_gap), column : column + n_columns]
        copy_row(to, solved[r // plane_rows, at : at + n_columns])


@njit
def minus_gradient_1d(first, last, phi, e, per_2dx, e0_x):
    """E_x(i) = e0_x + (phi(i - 1) - phi(i + 1)) / (2 dx) on nodes first..last - 1 of e[0].

    phi has one node more than e on each side: phi[nx + 3] with one ghost left and two right for e[1, nx + 1]
    with one ghost right, or wider; per_2dx = 1 / (2 dx).
    """
    for i in range(np.uint64(first), np.uint64(last)):
        e[0, i] = e0_x + per_2dx * (phi[i] - phi[i + _2])


@njit
def minus_gradient_2d(first, last, phi, e, per_2dx, per_2dy, e0_x, e0_y):
    """E = e0 - grad phi (5.13) on rows first..last - 1 of e; the bits do not depend on how rows are cut.

    phi has one node more than e on each side: phi[ny + 3, nx + 3] with one ghost row below and two above, one
    ghost column left and two right for e[2, ny + 1, nx + 1] (components x and y), or wider;
    per_2dx = 1 / (2 dx), per_2dy = 1 / (2 dy); the uniform external field (e0_x, e0_y) is added.
    """
    for j in range(first, last):
        below, here, above = phi[j], phi[j + 1], phi[j + 2]
        e_x, e_y = e[0, j], e[1, j]
        for i in range(np.uint64(e_x.size)):
            e_x[i] = e0_x + per_2dx * (here[i] - here[i + _2])
            e_y[i] = e0_y + per_2dy * (below[i + _1] - above[i + _1])


@njit
def minus_gradient_3d(first, last, phi, e, per_2dx, per_2dy, per_2dz, e0_x, e0_y, e0_z):
    """minus_gradient_2d with planes first..last - 1 of e[3, nz + 1, ny + 1, nx + 1] and phi[nz + 3, ny + 3, nx + 3]."""
    for k in range(first, last):
        for j in range(e.shape[2]):
            below, here, above = phi[k + 1, j], phi[k + 1, j + 1], phi[k + 1, j + 2]
            under, over = phi[k, j + 1], phi[k + 2, j + 1]
            e_x, e_y, e_z = e[0, k, j], e[1, k, j], e[2, k, j]
            for i in range(np.uint64(e_x.size)):
                e_x[i] = e0_x + per_2dx * (here[i] - here[i + _2])
                e_y[i] = e0_y + per_2dy * (below[i + _1] - above[i + _1])
                e_z[i] = e0_z + per_2dz * (under[i + _1] - over[i + _1])


@njit
def bounded(magnitude):
    """The magnitude, infinity if it is beyond LIMIT or not a number."""
    return magnitude if magnitude < LIMIT else np.inf


@njit
def node_sums(first, last, share, corners, background, per_scale, rho_rows, phi_rows, e_x, limbs, columns, most):
    """Sums over rows first .. last of rho_rows[rows, columns], into [share] of limbs, columns and most.

    limbs[share, 3]: (rho + background) phi, per_scale[0] = 1 / scale (core.space.exact); columns[share, columns]:
    E_x in units of 1 / per_scale[1], rounded; both are garbage beyond their scale. most[share, 2]: the largest
    magnitude of a term of each, or infinity. corners[2, 4]: row and column where the slab begins in phi_rows and in
    e_x, rows of a plane (see padded_row) and the gap after them.
    """
    limbs, columns, most = limbs[share], columns[share], most[share]
    limbs[:], columns[:], most[:] = 0, 0, 0
    left, column, plane_rows = corners[0, 1], corners[1, 1], corners[0, 2]
    for i in range(first, last):
        in_phi = corners[0, 0] + padded_row(i, plane_rows, corners[0, 3])
        in_e = corners[1, 0] + padded_row(i, plane_rows, corners[1, 3])
        high, middle, low = np.int64(0), np.int64(0), np.int64(0)
        energy = field = 0.0
        for j in range(rho_rows.shape[1]):
            term = (rho_rows[i, j] + background) * phi_rows[in_phi, left + j]
            t = term * per_scale[0] * 2.0**31
            h = np.rint(t)
            t = (t - h) * 2.0**32
            m = np.rint(t)
            high += np.int64(h)
            middle += np.int64(m)
            low += np.int64(np.rint((t - m) * 2.0**32))
            e = e_x[in_e, column + j]
            columns[j] += np.int64(np.rint(e * per_scale[1]))
            energy, field = max(energy, bounded(abs(term))), max(field, bounded(abs(e)))
        limbs[0] += high
        limbs[1] += middle
        limbs[2] += low
        most[0], most[1] = max(most[0], energy), max(most[1], field)
