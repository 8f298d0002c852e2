"""Smoothing kernels W(q), q = r / h, in 2D and 3D, and F(q) = W'(q) / q of their gradient F r_ij / h^(d + 2).

A kernel is two formulas, used by the pair sums, by numpy and by the analysis of stability alike. They take r and 1 / h
rather than q, so that a product with q needs one rounding: fma(r, 2.0 * per_h, 1.0) is 1 + 2 q.

    from sph.physics.smoothing import Smoothing, register

    register(Smoothing("mine", support=2.0, norm={2: ..., 3: ...}, w=my_w, f=my_f))

in a file of one's own adds one, which cases then name as numerics.kernel.
"""

import hashlib
import linecache
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd import frozen
from hpcpic.core.simd.formulas import VECTORS, fma, maximum
from hpcpic.core.simd.own import enter

LEAST_Q = 1e-15  # that is divided by
ROUGH = 1e-3  # of 1, of the largest slope: what is farther off in a kernel is a mistake


@dataclass(frozen=True)
class Smoothing:
    """A kernel: W h^d = norm[d] w(r, 1 / h), F h^(d + 2) = norm[d] slope f(r, 1 / h), 0 from `support` h on.

    `norm` by dimension, such that the integral of W is 1. `slope` is a factor that the sums apply at their end.
    `dense`: h / dp beyond which `check` warns, as particles pair (Dehnen & Aly 2012).
    """

    name: str
    support: float
    norm: dict[int, float]
    w: Callable[[Any, Any], Any]
    f: Callable[[Any, Any], Any]
    slope: float = 1.0
    dense: float = 2.5

    def factor(self, d: int) -> float:
        """What sums of f lack in d dimensions."""
        return self.norm[d] * self.slope

    def value(self, q: NDArray | float, d: int) -> NDArray[np.float64]:
        """W(q) h^d in d dimensions."""
        return self.norm[d] * of_many(self.w, q)

    def gradient(self, q: NDArray | float, d: int) -> NDArray[np.float64]:
        """F(q) h^(d + 2) in d dimensions."""
        return of_many(self.f, q) * self.norm[d] * self.slope

    def require_sound(self) -> None:
        """Raise ValueError where the integral of W is not 1, or F r not its slope."""
        q = np.linspace(0.0, self.support, 4001)
        middle, step = (q[1:] + q[:-1]) / 2, q[1] - q[0]
        for d, norm in self.norm.items():
            shell = 2 * math.pi * middle if d == 2 else 4 * math.pi * middle**2
            found = float(np.sum(shell * self.value(middle, d)) * step)
            if not abs(found - 1.0) < ROUGH:
                raise ValueError(f"kernel {self.name!r}: W has the integral {found:.6g} in {d} dimensions, not 1 "
                                 f"(norm[{d}] = {norm:.6g})")  # fmt: skip
            slope = np.diff(self.value(q, d)) / step
            if not np.abs(slope - self.gradient(middle, d) * middle).max() < ROUGH * np.abs(slope).max():
                raise ValueError(f"kernel {self.name!r}: slope f is not dW/dq / q (slope = {self.slope:.6g})")

    @property
    def digest(self) -> str:
        """A hash of the files that the formulas are in and of what they read, by which compiled code is known."""
        files = sorted({formula.__code__.co_filename for formula in (self.w, self.f)})
        text = "".join(line for file in files for line in linecache.getlines(file))
        return hashlib.sha256(text.encode() + frozen.digest_of(self.w, self.f)).hexdigest()


def of_many(formula: Callable[[Any, Any], Any], q: NDArray | float) -> NDArray[np.float64]:
    """The formula at every q, of h = 1. An error says what to write in place of `if`; numpy speaks of a.any()."""
    try:
        return formula(np.asarray(q, np.float64), 1.0)
    except (TypeError, ValueError) as error:
        if "array" in str(error):
            error.args = (f"a formula has many q at once, for which there is no `if`, `and`, max() or math; {VECTORS}",)
        raise


SMOOTHING: dict[str, Smoothing] = {}


def register(smoothing: Smoothing) -> None:
    """Make a kernel known by its name. ValueError where another one has it, unless its formulas are defined again, and
    where W has another integral than 1, or f is not its slope.
    """
    smoothing.require_sound()
    enter(SMOOTHING, "kernel", smoothing.name, smoothing, lambda one: one.w)
    frozen.keep(f"kernel {smoothing.name!r}", smoothing.w, smoothing.f)


def cubic_w(r, per_h):
    """(MP 9): (2 - q)^3 / 4 - (1 - q)^3, each where it is positive."""
    q = r * per_h
    near, far = maximum(1.0 - q, 0.0), maximum(2.0 - q, 0.0)
    return fma(far * far, far * 0.25, -(near * near) * near)


def cubic_f(r, per_h):
    """((2 - q)^2 - 4 (1 - q)^2) / q."""
    q = maximum(r * per_h, LEAST_Q)
    near, far = maximum(1.0 - q, 0.0), maximum(2.0 - q, 0.0)
    return fma(near * near, -4.0, far * far) / q


def wendland2_w(r, per_h):
    """(1 - q / 2)^4 (1 + 2 q), Wendland 1995."""
    far = maximum(fma(r, -0.5 * per_h, 1.0), 0.0)
    return (far * far) * (far * far) * fma(r, 2.0 * per_h, 1.0)


def wendland2_f(r, per_h):
    """(1 - q / 2)^3."""
    far = maximum(fma(r, -0.5 * per_h, 1.0), 0.0)
    return (far * far) * far


def wendland4_w(r, per_h):
    """(1 - q / 2)^6 (1 + 3 q + 35 / 12 q^2), Wendland 1995."""
    far = maximum(fma(r, -0.5 * per_h, 1.0), 0.0)
    square = far * far
    return (square * square) * square * fma(r * r, 35.0 / 12.0 * per_h * per_h, fma(r, 3.0 * per_h, 1.0))


def wendland4_f(r, per_h):
    """(1 - q / 2)^5 (1 + 5 / 2 q)."""
    far = maximum(fma(r, -0.5 * per_h, 1.0), 0.0)
    square = far * far
    return (square * square) * (far * fma(r, 2.5 * per_h, 1.0))


def quintic_w(r, per_h):
    """(3 - q)^5 - 6 (2 - q)^5 + 15 (1 - q)^5, each where it is positive; Morris et al. 1997."""
    q = r * per_h
    near, middle, far = maximum(1.0 - q, 0.0), maximum(2.0 - q, 0.0), maximum(3.0 - q, 0.0)
    near2, middle2, far2 = near * near, middle * middle, far * far
    near4, middle4, far4 = near2 * near2, middle2 * middle2, far2 * far2
    return fma(near4, near * 15.0, fma(middle4, middle * -6.0, far4 * far))


def quintic_f(r, per_h):
    """((3 - q)^4 - 6 (2 - q)^4 + 15 (1 - q)^4) / q."""
    q = maximum(r * per_h, LEAST_Q)
    near, middle, far = maximum(1.0 - q, 0.0), maximum(2.0 - q, 0.0), maximum(3.0 - q, 0.0)
    near2, middle2, far2 = near * near, middle * middle, far * far
    near4, middle4, far4 = near2 * near2, middle2 * middle2, far2 * far2
    return fma(near4, 15.0, fma(middle4, -6.0, far4)) / q


register(Smoothing("cubic", 2.0, {2: 10 / (7 * math.pi), 3: 1 / math.pi}, cubic_w, cubic_f, -0.75, 1.5))
register(Smoothing("wendland2", 2.0, {2: 7 / (4 * math.pi), 3: 21 / (16 * math.pi)}, wendland2_w, wendland2_f, -5.0))
register(
    Smoothing("wendland4", 2.0, {2: 9 / (4 * math.pi), 3: 495 / (256 * math.pi)}, wendland4_w, wendland4_f, -14.0 / 3.0)
)
register(Smoothing("quintic", 3.0, {2: 7 / (478 * math.pi), 3: 1 / (120 * math.pi)}, quintic_w, quintic_f, -5.0, 1.5))
