"""The integrators that a case may name: what a step of the state y = (x, v, rho) evaluates when, and what it makes of a
linear system. `choose_step` finds dt after the first evaluation, from its accelerations.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Evolving(Protocol):
    """What integrators ask of a state y. f(y) = (v, a, D) are the rates of x, v, rho."""

    def evaluate(self, start: bool = False) -> None:
        """Find a and D = d rho / dt of the present y; `start`: it is y^n."""

    def evaluate_forces(self) -> None:
        """Find a of y^n."""

    def evaluate_rates(self) -> None:
        """Find D of rho as in `evaluate_forces`, the new v, and x half a step of it later."""

    def keep(self) -> None:
        """Remember y^n."""

    def combine(
        self, old: float, now: float, new: float, *, until: float = 1.0, with_new_velocity: bool = False
    ) -> None:
        """y = old y^n + now y + new dt f(y); the stage stands for t^n + until dt."""

    def kick(self) -> None:
        """v = v + dt a."""

    def drift(self) -> None:
        """x = x + dt v, rho = rho + dt D."""


RK3 = ((0.0, 1.0, 1.0), (0.75, 0.25, 0.25), (1 / 3, 2 / 3, 2 / 3))  # weights of y^n, y, dt f(y); Gottlieb and Shu


def euler(y: Evolving, choose_step: Callable[[], None]) -> None:
    """y = y + dt f(y)."""
    y.evaluate(start=True)
    choose_step()
    y.combine(0.0, 1.0, 1.0)


def predictor_corrector(y: Evolving, choose_step: Callable[[], None]) -> None:
    """(SC 11): y* = y + dt f(y); (SC 12): v = v^n + dt f(y*), x = x^n + dt v, rho = rho^n + dt D(y*)."""
    y.evaluate(start=True)
    choose_step()
    y.keep()
    y.combine(0.0, 1.0, 1.0, until=1.0)
    y.evaluate()
    y.combine(1.0, 0.0, 1.0, with_new_velocity=True)


def rk3_tvd(y: Evolving, choose_step: Callable[[], None]) -> None:
    """Runge-Kutta of third order that diminishes total variation (Gottlieb and Shu 1998)."""
    y.evaluate(start=True)
    choose_step()
    y.keep()
    for stage, (weights, until) in enumerate(zip(RK3, (1.0, 0.5, 1.0))):
        if stage:
            y.evaluate()
        y.combine(*weights, until=until)


def symplectic(y: Evolving, choose_step: Callable[[], None]) -> None:
    """v = v + dt a(x, v, rho), then with the new v rho = rho + dt D(x + dt v / 2, v, rho), x = x + dt v: two half
    evaluations. With D of the old x, water that is stirred loses volume in proportion to the step.
    """
    y.evaluate_forces()
    choose_step()
    y.kick()
    y.evaluate_rates()
    y.drift()


def split_step(m: NDArray) -> NDArray[np.complex128]:
    """One step of `symplectic` for y = (rho, v): velocity first, then density with the new velocity."""
    kick, drift = (np.broadcast_to(np.eye(2), m.shape).astype(complex) for _ in range(2))
    kick[..., 1, :] += m[..., 1, :]
    drift[..., 0, :] += m[..., 0, :]
    return drift @ kick


@dataclass(frozen=True)
class Integrator:
    """step(y, choose_step): one step. linear(m): the matrix of one for y' = m y / dt.

    order of accuracy; decay: the most that a step bears, times dt. evaluations: for how many ghosts are sent anew.
    work: of the pair sums of a step, in evaluations of all of them, and first_work: of the first, which a sample of the
    series needs too (measured). staged: it evaluates away from where neighbours were found. split: forces and rates
    are summed one after the other.
    """

    step: Callable[[Evolving, Callable[[], None]], None]
    linear: Callable[[NDArray], NDArray]
    order: float
    decay: float
    evaluations: int
    work: float
    first_work: float = 1.0
    staged: bool = False
    split: bool = False


INTEGRATORS = {
    "euler": Integrator(euler, lambda m: np.eye(2) + m, 1.0, 2.0, 1, 1.0),
    "predictor-corrector": Integrator(
        predictor_corrector, lambda m: np.eye(2) + m + m @ m, 1.0, 1.0, 2, 2.0, staged=True
    ),
    "symplectic": Integrator(symplectic, split_step, 1.0, 2.0, 1, 1.46, 0.85, split=True),
    "rk3-tvd": Integrator(rk3_tvd, lambda m: np.eye(2) + m + m @ m / 2 + m @ m @ m / 6, 3.0, 2.51, 3, 3.0, staged=True),
}
