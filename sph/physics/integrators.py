"""One step in time: what is evaluated when. Each integrator is a function of the engine; dt is known after the first
evaluation, from its accelerations.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sph.step import Sph

RK3 = ((0.0, 1.0, 1.0), (0.75, 0.25, 0.25), (1 / 3, 2 / 3, 2 / 3))  # weights of y^n, y, dt f(y); Gottlieb and Shu


def euler(engine: "Sph") -> None:
    """y = y + dt f(y)."""
    engine.evaluate(start=True)
    engine.choose_step()
    engine.combine(0.0, 1.0, 1.0)


def predictor_corrector(engine: "Sph") -> None:
    """(SC 11): y* = y + dt f(y); (SC 12): v = v^n + dt f(y*), x = x^n + dt v, rho = rho^n + dt D(y*)."""
    engine.evaluate(start=True)
    engine.choose_step()
    engine.keep()
    engine.combine(0.0, 1.0, 1.0, until=1.0)
    engine.evaluate()
    engine.combine(1.0, 0.0, 1.0, with_new_velocity=True)


def rk3_tvd(engine: "Sph") -> None:
    """Runge-Kutta of third order that diminishes total variation (Gottlieb and Shu 1998)."""
    engine.evaluate(start=True)
    engine.choose_step()
    engine.keep()
    for stage, (weights, until) in enumerate(zip(RK3, (1.0, 0.5, 1.0))):
        if stage:
            engine.evaluate()
        engine.combine(*weights, until=until)


def symplectic(engine: "Sph") -> None:
    """v = v + dt a(x, v, rho), then with the new v rho = rho + dt D(x, v, rho), x = x + dt v: two half evaluations."""
    engine.evaluate_forces()
    engine.choose_step()
    engine.kick()
    engine.evaluate_rates()
    engine.drift()


INTEGRATORS: dict[str, Callable[["Sph"], None]] = {
    "euler": euler,
    "predictor-corrector": predictor_corrector,
    "rk3-tvd": rk3_tvd,
    "symplectic": symplectic,
}
STAGED = ("predictor-corrector", "rk3-tvd")  # evaluate away from where neighbours were found
