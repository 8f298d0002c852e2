"""A case run to its end in this process, with what the comparison needs kept in memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hpcpic.core.case.config import load
from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from hpcpic.plasma.app import shipped_cases
from hpcpic.plasma.configure import configure
from hpcpic.plasma.step import Plasma

Look = Callable[[Plasma], Any]


class Simulation:
    """`config`, the `app` after the last step, and what `look(app)` gave before each step and at the end."""

    def __init__(self, world: World, case: str, *sets: str, look: Look | None = None, every: int = 1) -> None:
        self.config = configure(load(shipped_cases().get(case, case), sets))
        self.seen, self.times = [], []
        pool = Pool(1)
        try:
            self.app = Plasma(self.config, world, pool, Timers())
            for n in range(self.config.simulation.cycles + 1):
                if look and n % every == 0:
                    self.times.append(self.app.time)
                    self.seen.append(look(self.app))
                if n < self.config.simulation.cycles:
                    self.app.step()
            self.last = self.app.scalars()
            self.particles = self.app.particles()
            self.state = {name: shard.local.copy() for name, shard in self.app.state().items()}
        finally:
            pool.close()

    @property
    def t(self) -> np.ndarray:
        return np.array(self.times)

    def scalar(self, name: str) -> np.ndarray:
        """A scalar over the samples, when look was `Plasma.scalars`."""
        return np.array([row[name] for row in self.seen])


class Rows:
    """State arrays in the place of a checkpoint: what `Plasma.restore` reads."""

    step = 0

    def __init__(self, rows: dict[str, np.ndarray]) -> None:
        self.rows = rows

    def read(self, name: str, low: int, high: int) -> np.ndarray:
        return self.rows[name][low:high]


def mode_along(axis: int, n: int) -> Look:
    """Complex amplitude of rho with n wavelengths along storage axis `axis`, uniform along the other."""

    def look(app: Plasma) -> complex:
        app.solve()
        rho = app.fields()["rho"].values
        line = rho.mean(axis=1 - axis) if rho.ndim == 2 else rho
        return complex(np.fft.rfft(line)[n] / line.size)

    return look


def velocities(app: Plasma) -> np.ndarray:
    """v[n, 3] in m/s of the first species at n - 1/2, by id."""
    particles = next(iter(app.particles().values()))
    return particles.columns["velocity"][np.argsort(particles.ids)]


def positions(app: Plasma) -> np.ndarray:
    """x[n, 3] in m of the first species, by id."""
    particles = next(iter(app.particles().values()))
    return particles.position[np.argsort(particles.ids)]


def quiet_maxwellians(
    parts: list[tuple[float, float, float]],
    vth_step: float = 0.1,
    particles: int = 541,
    **perturbation: float,
) -> str:
    """Species of a case: Maxwellians (wp, drift, vth) as many cold beams on a velocity grid.

    The trapezoid sum over beams `vth_step` apart converges beyond all orders, so the plasma is a Maxwellian
    until the beams come back into step at 2 pi/(k dv). `particles` of a beam: a prime, about half a cell's
    worth away from a multiple of the grid, so that no even spacing is an alias of a mode that grows.
    """
    seed = " ".join(f"{key} = {value!r};" for key, value in perturbation.items())
    beams = []
    for wp, drift, vth in parts:
        u = np.arange(-60, 61) * vth_step if vth else np.zeros(1)
        share = np.exp(-0.5 * u**2)
        beams += [(wp * np.sqrt(s), drift + vth * x) for s, x in zip(share / share.sum(), u) if abs(x) <= 6.0]
    return ",\n".join(
        f'{{ particles = {particles}; charge = -1.0; mass = 1.0; init_method = "quiet"; '
        f"plasma_frequency = {float(wp)!r}; drift_velocity = [{float(v)!r}]; "
        f"perturbation = {{ mode = [1]; {seed} }}; }}"
        for wp, v in beams
    )


def case_text(species: str, *, k: float, cells: int, dt: float, time: float) -> str:
    """A 1D case of one wavelength."""
    return (
        f"simulation = {{ cycles = {round(time / dt)}; time_step = {dt!r}; "
        f"space_length = [{2 * np.pi / k!r}]; }};\n"
        f"grid = {{ points = [{cells}]; }};\nspecies = (\n{species}\n);\n"
    )
