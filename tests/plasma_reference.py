"""A whole run folder made by a plain 1D particle-in-cell loop of a few lines: CIC, 3-point Poisson, leapfrog.

It takes its initial state from the scene of the case and writes with the program's own writers, and so serves
both as data for the figures and as the independent program that the fast one can be compared with.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hpcpic.core.case.config import load
from hpcpic.core.case.schema import dump
from hpcpic.core.files.arrays import FieldArray, ParticleArray
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.series import SeriesWriter
from hpcpic.core.files.snapshot import FieldsWriter, ParticlesWriter
from hpcpic.core.files.together import Alone
from hpcpic.core.space.domain import Domain
from hpcpic.plasma.case.config import PlasmaConfig
from hpcpic.plasma.configure import configure
from hpcpic.plasma.setup.scene import Scene

N_MODES = 8
UNITS = {
    "energy_field": "J",
    "energy_kinetic": "J",
    "energy_total": "J",
    "momentum_x": "kg m/s",
    "charge": "C",
    **{f"mode_{n}": "V/m" for n in range(1, N_MODES + 1)},
}


class Reference:
    """State of all species side by side: x[n] m, v[n] m/s at the same time level only inside `advance`."""

    def __init__(self, config: PlasmaConfig) -> None:
        self.scene = scene = Scene(config)
        every = [(s, np.arange(s.first, s.first + s.n)) for s in scene.species]
        self.x = np.concatenate([s.positions(ids)[:, 0] for s, ids in every])
        self.v = np.concatenate([s.velocities(ids)[:, 0] for s, ids in every])
        self.q = np.concatenate([np.full(s.n, s.q) for s in scene.species])
        self.m = np.concatenate([np.full(s.n, s.m) for s in scene.species])
        self.length, self.n, self.dx, self.dt = (
            scene.lengths[0],
            scene.points[0],
            scene.spacing[0],
            scene.time_step,
        )
        self.solve()
        self.v -= 0.5 * self.dt * self.kick()  # v at -1/2

    def weights(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        s = self.x / self.dx
        i = np.floor(s).astype(int)
        return i % self.n, (i + 1) % self.n, s - i

    def solve(self) -> None:
        """rho[n] C/m, phi[n] V, E[n] V/m at the time of x."""
        i, j, f = self.weights()
        rho = np.bincount(i, self.q * (1 - f), self.n) + np.bincount(j, self.q * f, self.n)
        self.rho = rho / self.dx + self.scene.background
        k = np.arange(self.n // 2 + 1)
        laplace = (2 * np.sin(np.pi * k / self.n) / self.dx) ** 2 * self.scene.permittivity
        laplace[0] = np.inf
        self.phi = np.fft.irfft(np.fft.rfft(self.rho) / laplace, self.n)
        self.E = (np.roll(self.phi, 1) - np.roll(self.phi, -1)) / (2 * self.dx)

    def kick(self) -> np.ndarray:
        i, j, f = self.weights()
        return self.q / self.m * ((1 - f) * self.E[i] + f * self.E[j])

    def advance(self) -> dict[str, float]:
        """One step; the scalars at its beginning, velocities centred."""
        old = self.v
        self.v = old + self.dt * self.kick()
        kinetic = 0.5 * (self.m * (0.5 * (old + self.v)) ** 2).sum()
        field = 0.5 * self.dx * self.rho @ self.phi
        waves = 2 * np.abs(np.fft.rfft(self.E)) / self.n
        scalars = {f"mode_{k}": float(waves[k]) if k < len(waves) else 0.0 for k in range(1, N_MODES + 1)}
        scalars |= {"energy_field": field, "energy_kinetic": kinetic, "energy_total": field + kinetic}
        scalars |= {"momentum_x": float((self.m * 0.5 * (old + self.v)).sum()), "charge": float(self.q.sum())}
        self.x = (self.x + self.dt * self.v) % self.length
        self.solve()
        return scalars


def make_run(case: Path, folder: Path, sets: tuple[str, ...] = ()) -> Path:
    """Run a 1D case without magnetic field and leave a run folder."""
    config = configure(load(case, sets))
    state = Reference(config)
    rundir = RunDir.create(folder, config=dump(config), given={case.name: case.read_text()}, sets=sets)
    world, domain = Alone(), Domain((state.length,), (state.n,), (True,), (0, state.n))
    series, fields = SeriesWriter(rundir, UNITS), FieldsWriter(world, rundir.fields)
    particles = ParticlesWriter(world, rundir.particles)
    periods = config.periods
    for step in range(config.simulation.cycles + 1):
        time = step * state.dt
        if periods["field"] and step % periods["field"] == 0:
            arrays = {
                name: FieldArray(getattr(state, name).copy(), unit)
                for name, unit in (("rho", "C/m"), ("phi", "V"), ("E", "V/m"))
            }
            fields.append(step, time, domain, arrays)
        if periods["particle"] and step % periods["particle"] == 0:
            particles.append(step, time, {s.name: _particles(state, s) for s in state.scene.species})
        scalars = state.advance()
        if periods["series"] and step % periods["series"] == 0:
            series.append(step, time, scalars)
    series.flush()
    rundir.finish("finished", 0, **_facts(config))
    rundir.unlock()
    return folder


def _particles(state: Reference, species) -> ParticleArray:
    own = slice(species.first, species.first + species.n)
    position = np.zeros((species.n, 3))
    position[:, 0] = state.x[own]
    columns, units = {"velocity": state.v[own, None].copy()}, {"velocity": "m/s"}
    return ParticleArray(np.arange(species.first, species.first + species.n), position, columns, units)


def _facts(config: PlasmaConfig) -> dict:
    """What the loop would write at the end; the times are made up."""
    n = sum(s.particles for s in config.species)
    timers = {"push": 1.2, "field": 0.3, "migrate": 0.15, "output": 0.2, "other": 0.05}
    return {
        "case": "configs/plasma/two-stream-cold.conf",
        "reason": "",
        "steps": config.simulation.cycles,
        "time": config.simulation.cycles * config.simulation.time_step,
        "wall_seconds": 1.9,
        "ranks": 2,
        "threads": 1,
        "particles": n,
        "work_unit": "particle",
        "ns_per_particle_step": 2.75,
        "step_ms": 1.25,
        "peak_memory_mib_per_rank": 180.0,
        "estimate": {"memory_mib_per_rank": 170.0, "step_ms": 1.4, "wall_seconds": 2.0},
        "timers": {
            k: {"min": 0.9 * v, "avg": v, "max": 1.1 * v, "share": v / 1.9, "calls": 400}
            for k, v in timers.items()
        },
        "conservation": {
            "charge": {"first": -1.0, "last": -1.0, "change": 0.0, "relative": 0.0},
            "energy_total": {"first": 1.0, "last": 1.001, "change": 1e-3, "relative": 1e-3},
        },
        "derived": [
            {"name": "time step", "value": 0.05, "unit": "", "limit": "< 2", "verdict": "ok"},
            {"name": "cell", "value": 3.1, "unit": "", "limit": "< 1", "verdict": "warn"},
        ],
        "state_digest": "0" * 64,
        "warnings": ["cell dx/lambda_D = 3.1 (limit < 1)"],
    }
