"""Smoothing kernels W(q), q = r / h, normalised with h = 1 in 2D and 3D, and F(q) = W'(q) / q of their gradient F r_ij.

Each is written once for numpy and once as lines of a vector kernel, which know r and per_h and leave F but for a factor
that sums are multiplied by later. The normalisation of (MP 9), missing there, is that of the cubic spline.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Smoothing:
    """A kernel: `support` / h, norm by dimension, shape(q) = W / norm, slope(q) = F / norm, and its vector lines."""

    support: float
    norm: dict[int, float]
    shape: Callable[[NDArray], NDArray]
    slope: Callable[[NDArray], NDArray]
    lines: str
    """Source of `F` / (norm `scale`)."""
    scale: float
    shape_line: str
    """Source of W without the norm, after `lines`."""

    @property
    def source(self) -> list[str]:
        """Lines that leave F h^(d + 2) / `factor`."""
        return self.lines.strip("\n").split("\n")

    def factor(self, dimensions: int) -> float:
        """What sums of the lines' F lack."""
        return self.norm[dimensions] * self.scale

    def w(self, q: NDArray, dimensions: int) -> NDArray[np.float64]:
        """W(q) h^d."""
        return self.norm[dimensions] * self.shape(np.asarray(q, np.float64))

    def f(self, q: NDArray, dimensions: int) -> NDArray[np.float64]:
        """F(q) h^(d + 2)."""
        return self.norm[dimensions] * self.slope(np.asarray(q, np.float64))


def _plus(x: NDArray) -> NDArray:
    return np.maximum(x, 0.0)


def _positive(q: NDArray) -> NDArray:
    return np.maximum(q, 1e-300)


CUBIC = Smoothing(
    2.0,
    {2: 10 / (7 * math.pi), 3: 1 / math.pi},
    lambda q: 0.25 * _plus(2 - q) ** 3 - _plus(1 - q) ** 3,
    lambda q: (3 * _plus(1 - q) ** 2 - 0.75 * _plus(2 - q) ** 2) / _positive(q),
    """
    q = maximum(r * per_h, 1e-15)
    near, far = maximum(1.0 - q, 0.0), maximum(2.0 - q, 0.0)
    F = fma(near * near, -4.0, far * far) / q""",
    -0.75,
    "fma(far * far, far * 0.25, -(near * near) * near)",
)
WENDLAND2 = Smoothing(
    2.0,
    {2: 7 / (4 * math.pi), 3: 21 / (16 * math.pi)},
    lambda q: _plus(1 - q / 2) ** 4 * (1 + 2 * q),
    lambda q: -5 * _plus(1 - q / 2) ** 3,
    """
    far = maximum(fma(r, -0.5 * per_h, 1.0), 0.0)
    F = (far * far) * far""",
    -5.0,
    "(far * far) * (far * far) * fma(r, 2.0 * per_h, 1.0)",
)
WENDLAND4 = Smoothing(
    2.0,
    {2: 9 / (4 * math.pi), 3: 495 / (256 * math.pi)},
    lambda q: _plus(1 - q / 2) ** 6 * (1 + 3 * q + 35 / 12 * q**2),
    lambda q: -7 / 3 * _plus(1 - q / 2) ** 5 * (2 + 5 * q),
    """
    far = maximum(fma(r, -0.5 * per_h, 1.0), 0.0)
    square = far * far
    F = (square * square) * (far * fma(r, 2.5 * per_h, 1.0))""",
    -14.0 / 3.0,
    "(square * square) * square * fma(r * r, 35.0 / 12.0 * per_h * per_h, fma(r, 3.0 * per_h, 1.0))",
)
QUINTIC = Smoothing(
    3.0,
    {2: 7 / (478 * math.pi), 3: 1 / (120 * math.pi)},
    lambda q: _plus(3 - q) ** 5 - 6 * _plus(2 - q) ** 5 + 15 * _plus(1 - q) ** 5,
    lambda q: -5 * (_plus(3 - q) ** 4 - 6 * _plus(2 - q) ** 4 + 15 * _plus(1 - q) ** 4) / _positive(q),
    """
    q = maximum(r * per_h, 1e-15)
    near, middle, far = maximum(1.0 - q, 0.0), maximum(2.0 - q, 0.0), maximum(3.0 - q, 0.0)
    near2, middle2, far2 = near * near, middle * middle, far * far
    near4, middle4, far4 = near2 * near2, middle2 * middle2, far2 * far2
    F = fma(near4, 15.0, fma(middle4, -6.0, far4)) / q""",
    -5.0,
    "fma(near4, near * 15.0, fma(middle4, middle * -6.0, far4 * far))",
)
SMOOTHING = {"cubic": CUBIC, "wendland2": WENDLAND2, "wendland4": WENDLAND4, "quintic": QUINTIC}
