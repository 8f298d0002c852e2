"""Vectors of two or three components, as tuples, and symmetric matrices by their upper triangles, row by row."""

from hpcpic.core.simd.formulas import fma


def dot(a, b):
    """a . b."""
    if len(a) == 2:
        return fma(a[0], b[0], a[1] * b[1])
    return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2]))


def scaled(k, a):
    """k a."""
    if len(a) == 2:
        return k * a[0], k * a[1]
    return k * a[0], k * a[1], k * a[2]


def add_scaled(k, a, b):
    """k a + b."""
    if len(a) == 2:
        return fma(k, a[0], b[0]), fma(k, a[1], b[1])
    return fma(k, a[0], b[0]), fma(k, a[1], b[1]), fma(k, a[2], b[2])


def difference(a, b):
    """a - b."""
    if len(a) == 2:
        return a[0] - b[0], a[1] - b[1]
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def sum_of(a, b):
    """a + b of two vectors or two symmetric matrices."""
    if len(a) == 2:
        return a[0] + b[0], a[1] + b[1]
    if len(a) == 3:
        return a[0] + b[0], a[1] + b[1], a[2] + b[2]
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


def turned(m, a):
    """The symmetric matrix m times a."""
    if len(a) == 2:
        return dot((m[0], m[1]), a), dot((m[1], m[2]), a)
    return dot((m[0], m[1], m[2]), a), dot((m[1], m[3], m[4]), a), dot((m[2], m[4], m[5]), a)


def squares(a):
    """The symmetric matrix a a^T."""
    if len(a) == 2:
        return a[0] * a[0], a[0] * a[1], a[1] * a[1]
    return a[0] * a[0], a[0] * a[1], a[0] * a[2], a[1] * a[1], a[1] * a[2], a[2] * a[2]


def products(a, b):
    """The matrix a b^T, row by row."""
    if len(a) == 2:
        return a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    return (
        a[0] * b[0], a[0] * b[1], a[0] * b[2], a[1] * b[0], a[1] * b[1], a[1] * b[2], a[2] * b[0], a[2] * b[1],
        a[2] * b[2],
    )  # fmt: skip
