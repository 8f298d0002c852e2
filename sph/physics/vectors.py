"""Vectors of two or three components, as tuples, matrices row by row, symmetric ones by their upper triangles."""

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
    """a + b of two vectors or two matrices."""
    if len(a) == 2:
        return a[0] + b[0], a[1] + b[1]
    if len(a) == 3:
        return a[0] + b[0], a[1] + b[1], a[2] + b[2]
    if len(a) == 4:
        return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]
    most = a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]
    return most if len(a) == 6 else (*most, a[6] + b[6], a[7] + b[7], a[8] + b[8])


def crossed(w, a):
    """w x a; in two dimensions w is one number."""
    if len(a) == 2:
        return -(w * a[1]), w * a[0]
    return w[1] * a[2] - w[2] * a[1], w[2] * a[0] - w[0] * a[2], w[0] * a[1] - w[1] * a[0]


def times(m, a):
    """The matrix m, row by row, times a."""
    if len(a) == 2:
        return dot((m[0], m[1]), a), dot((m[2], m[3]), a)
    return dot((m[0], m[1], m[2]), a), dot((m[3], m[4], m[5]), a), dot((m[6], m[7], m[8]), a)


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
