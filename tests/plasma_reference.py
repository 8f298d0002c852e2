"""A whole run folder made by the plain reference (hpcpic.plasma.physics.reference) and the program's own writers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hpcpic.core.case.config import load
from hpcpic.core.case.dump import dump
from hpcpic.core.files.arrays import FieldArray, ParticleArray
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.series import SeriesWriter
from hpcpic.core.files.snapshot import FieldsWriter, ParticlesWriter
from hpcpic.core.files.together import Alone
from hpcpic.core.space.domain import Domain
from hpcpic.plasma.case.config import PlasmaConfig
from hpcpic.plasma.configure import configure
from hpcpic.plasma.diagnostics.scalars import columns
from hpcpic.plasma.physics.reference import Reference
from hpcpic.plasma.setup.scene import Scene

UNITS = {scalar.name: scalar.unit for scalar in columns(1) if scalar.name != "momentum_y"}


def reference_of(scene: Scene) -> Reference:
    """The initial state of a 1D case without magnetic field."""
    every = [(s, np.arange(s.first, s.first + s.n)) for s in scene.species]
    return Reference(
        np.concatenate([s.positions(ids)[:, 0] for s, ids in every]),
        np.concatenate([s.velocities(ids)[:, 0] for s, ids in every]),
        np.concatenate([np.full(s.n, s.q) for s in scene.species]),
        np.concatenate([np.full(s.n, s.m) for s in scene.species]),
        length=scene.lengths[0],
        n=scene.points[0],
        time_step=scene.time_step,
        permittivity=scene.permittivity,
        background=scene.background,
    )


def make_run(case: Path, folder: Path, sets: tuple[str, ...] = ()) -> Path:
    """Run a 1D case without magnetic field and leave a run folder."""
    config = configure(load(case, sets))
    scene = Scene(config)
    state = reference_of(scene)
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
            particles.append(step, time, {s.name: _particles(state, s) for s in scene.species})
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
            k: {"min": 0.9 * v, "avg": v, "max": 1.1 * v, "share": v / 1.9, "calls": 400} for k, v in timers.items()
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
