"""Laws of the whole step: same bits for any ranks, threads, blocks and after a restart; conservation; reversal."""

import json
import re

import numpy as np
import pytest

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run import checkpoint
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from hpcpic.plasma.configure import configure
from hpcpic.plasma.step import Plasma

K_SQ = (2 * np.sin(np.pi / 64)) ** 2  # K^2 of the first mode of 64 points one apart
THERMAL = {
    "2D": {"points": [33, 25], "v": 2.0, "magnetic": [0.0, 0.0, 0.3]},
    "2D, oblique field": {"points": [40, 18], "v": 0.5, "magnetic": [0.1, 0.2, 0.3]},
    "2D single": {"points": [40, 18], "v": 0.5, "precision": "single"},
    "2D cells twice as wide as high": {"points": [24, 16], "lengths": [48.0, 16.0], "v": 20.0},
    "2D parabola, spectral": {"points": [20, 17], "v": 1.0, "shape": "TSC", "gradient": "spectral"},
    "1D": {"points": [300], "v": 5.0},
    "2D clouds, every constant": {
        "points": [20, 17],
        "equation": "a = 2.0; b = 0.1; c = -0.3; d = 0.5; e = -0.2; f = 0.1;",
        "cloud_radius": 1.0,
    },
    "3D, oblique field": {"points": [12, 9, 17], "v": 2.0, "magnetic": [0.1, 0.2, 0.3]},
}


def plasma(*, threads=1, chunks=0, n=3000, points=(32, 32), lengths=None, v=0.5, magnetic=(0.0, 0.0, 0.0),
           equation="", dt=0.2, init="random position", extra="", solver="MFT", ions=True, **numerics):  # fmt: skip
    lengths = lengths or [float(p) for p in points]
    settings = " ".join(f"{key} = {json.dumps(value)};" for key, value in numerics.items())
    ion = f"""{{ name = "ion"; particles = {n // 2}; charge = 1.0; mass = 100.0; plasma_frequency = 0.1;
                 init_method = "random position"; thermal_velocity = {v / 10}; }}"""
    text = f"""
    simulation = {{ dimensions = {len(points)}; cycles = 100; time_step = {dt}; plasma_chunks = {chunks};
                    space_length = {list(lengths)}; solver = "{solver}"; }};
    grid = {{ points = {list(points)}; }};
    field = {{ magnetic = {list(magnetic)}; equation = {{ {equation} }}; }};  numerics = {{ {settings} }};
    species = ( {{ name = "electron"; particles = {n}; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
                   init_method = "{init}"; thermal_velocity = {v}; {extra} }} {"," + ion if ions else ""} );"""
    return Plasma(configure(loads(text)), World.start(), Pool(threads), Timers())


def digest(made):
    return checkpoint.digest(made.world, made.state())


def after(made, steps):
    for _ in range(steps):
        made.step()
    return made


@pytest.mark.parametrize("case", THERMAL)
def test_blocks_and_threads_do_not_show(case):
    found = set()
    for chunks, threads in ((1, 1), (4, 2), (9, 2)):
        made = after(plasma(**THERMAL[case], chunks=chunks, threads=threads), 8)
        found.add((digest(made), *made.scalars().values()))
        made.close()
    assert len(found) == 1


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("case", THERMAL)
def test_ranks_do_not_show(case):
    """Every rank also runs the case alone: COMM_SELF knows nothing of the others."""
    world = World.start()
    from mpi4py import MPI

    made = after(plasma(**THERMAL[case], chunks=2), 8)
    together = (digest(made), *made.scalars().values())
    moved = sum(int(letter.n[0]) for letter in made.cloud.near.outgoing)
    made.close()
    alone = World(MPI.COMM_SELF, MPI.COMM_SELF)
    started, World.start = World.start, lambda: alone
    try:
        single = after(plasma(**THERMAL[case], chunks=1), 8)
        found = (digest(single), *single.scalars().values())
        single.close()
    finally:
        World.start = started
    same = not world.any(found != together)
    assert same
    assert world.max(moved) > 0


class Memory:
    """A checkpoint that is not a file."""

    def __init__(self, made):
        self.step = made.iteration
        self.arrays = {name: whole(shard) for name, shard in made.state().items()}

    def read(self, name, lo, hi):
        return self.arrays[name][lo:hi]


def whole(shard):
    local = shard.local
    return np.array(local() if callable(local) else local)


@pytest.mark.parametrize("case", ["2D", "1D", "2D, oblique field", "2D single", "3D, oblique field"])
def test_a_restart_goes_on_with_the_same_bits(case):
    through = plasma(**THERMAL[case], chunks=2)
    reader = None
    for step in range(10):
        if step == 5:
            reader = Memory(through)
        through.step()
    again = plasma(**THERMAL[case], chunks=5)
    again.restore(reader)
    assert again.iteration == 5
    after(again, 5)
    assert digest(again) == digest(through)
    assert again.scalars() == through.scalars()


@pytest.mark.parametrize("v", [0.1, 200.0])
def test_charge_and_number_are_exact_at_any_speed(v):
    """200 m/s are 40 cells per step."""
    made = plasma(v=v, chunks=3)
    charge = made.mesh.charge.field.inner.sum(axis=(1, 2)).tolist()
    after(made, 20)
    assert made.mesh.charge.field.inner.sum(axis=(1, 2)).tolist() == charge
    assert made.sums.counts().tolist() == [3000, 1500]
    assert made.guard() is None


@pytest.mark.parametrize("given", [{}, {"equation": "a = 0.7; c = -0.02;", "cloud_radius": 1.5}])
def test_momentum_is_kept_to_round_off_without_a_magnetic_field(given):
    made = plasma(v=0.5, **given)
    before = made.scalars()
    after(made, 50)
    now = made.scalars()
    weight = sum(s.m * s.n for s in made.scene.species) * 0.5  # mass times thermal speed
    for name in ("momentum_x", "momentum_y"):
        assert abs(now[name] - before[name]) < 1e-12 * weight


class Pushed:
    """A checkpoint in which one electron has another velocity or position along x."""

    def __init__(self, made, path, factor, name):
        self._factor, self._name, rundir = factor, f"electron/{name}", RunDir(path)
        checkpoint.write(made.world, rundir, made.iteration, made.time, made.state())
        self._reader = checkpoint.newest(rundir, made.world)

    def __getattr__(self, name):
        return getattr(self._reader, name)

    def read(self, name, lo=0, hi=None):
        rows = self._reader.read(name, lo, hi)
        if name == self._name and lo <= 7 < lo + len(rows):
            rows[7 - lo, 0] *= self._factor
        return rows


@pytest.mark.parametrize(
    "factor, name", [(1.0, "velocity"), (1.0 + 1e-4, "velocity"), (-1.0, "velocity"), (0.99, "position")]
)
@pytest.mark.parametrize(
    "case",
    [
        {"solver": "LU", "points": [16, 12]},
        {"shape": "TSC", "gradient": "spectral"},
        {"points": [300], "v": 5.0},
        {"v": 0.0},
        {"magnetic": [0.0, 0.0, 0.3]},
        {"magnetic": [0.1, 0.2, 0.3]},
        {"precision": "single"},
        {"points": [12, 9, 8], "magnetic": [0.1, 0.2, 0.3]},
    ],
    ids=str,
)
def test_one_particle_that_jumps_is_told_by_what_all_keep(tmp_path, case, factor, name):
    """From a change of 1e-4 of a velocity on, and never without one. In single precision all are rounded too coarsely
    for that.
    """
    made = plasma(**case)
    made.scalars()
    after(made, 30).scalars()
    assert made.guard() is None
    kept = made.kept_motion.kept
    made.restore(Pushed(made, tmp_path, factor, name))
    made.kept_motion.kept = kept
    after(made, 30).scalars()
    seen = factor != 1.0 and "precision" not in case
    assert ("damaged memory" in (made.guard() or "")) == seen


def test_a_negative_time_step_is_no_damaged_memory():
    """Of a cold wave, whose bound of what rounding moves was less than 0: each run of it ended at its first step."""
    wave = "perturbation = { mode = [1]; amplitude = 0.01; };"
    made = plasma(n=4096, points=(64,), v=0.0, init="quiet", dt=-0.1, ions=False, extra=wave)
    made.scalars()
    after(made, 30).scalars()
    assert made.guard() is None and made.time == pytest.approx(-3.0)


@pytest.mark.parametrize("magnetic", [(0.0, 0.0, 0.0), (0.0, 0.0, 0.5)])
def test_time_runs_backwards(magnetic):
    """x^n, v^(n-1/2) -> -dt with v^(n+1/2): the leapfrog retraces its way, to the noise of rounding."""
    made = plasma(v=0.3, magnetic=magnetic, points=(16, 16))
    start = positions(made)
    after(made, 20)
    made.solve()
    # one more impulse and turn brings v^(n-1/2) to v^(n+1/2): no drift, then the mover of -dt
    made.cloud.rewind(made.scene.mover(made.field_scale, steps=1.0))
    forwards = made.cloud.arena["mover"]
    forwards[:] = made.scene.mover(made.field_scale, steps=1.0)
    retrace(made)
    after(made, 20)
    box = np.array(made.scene.lengths)
    moved = positions(made) - start
    moved -= box * np.rint(moved / box)
    assert np.abs(moved).max() < 1e-7


def retrace(made):
    """Turn every velocity and the magnetic field round: the map backwards in time."""
    d = made.scene.dimensions
    made.cloud.arena["pool"][: made.cloud.pages.fresh, :, d:, :] *= -1
    made.cloud.arena["mover"][:, 4:] *= -1


def positions(made):
    ordered = made.particles()["electron"]
    return ordered.position[np.argsort(ordered.ids)][:, : made.scene.dimensions]


@pytest.mark.parametrize(
    "given, factor",
    [
        ({}, 1.0),
        ({"equation": "c = -0.03; f = 0.02;"}, K_SQ / (K_SQ + 0.01)),
        ({"equation": "a = 2.0;"}, 0.5),
        ({"cloud_radius": 4.0}, np.exp(-((np.pi / 8) ** 2))),
    ],
)
def test_a_cold_wave_oscillates_at_the_discrete_frequency(given, factor):
    """omega = (2/dt) asin((wp dt/2) cos(k dx/2)): Birdsall & Langdon; 1e-5 for CIC with centred differences.

    wp^2 has a factor: K^2/(a K^2 - c - f) by the field equation, the square of exp(-(k R)^2/2) by clouds of radius R.
    """
    extra = "perturbation = { mode = [1]; amplitude = 1e-3; };"
    made = plasma(points=[64], n=4096, v=0.0, init="quiet", extra=extra, ions=False, **given)
    signal = []
    for _ in range(630):
        signal.append(made.scalars()["mode_1"])
        made.step()
    t = 0.2 * np.arange(len(signal))
    omega = 10 * np.arcsin(0.1 * np.sqrt(factor) * np.cos(np.pi / 64))
    misfit = [np.sum((np.square(signal) - np.square(signal[0] * np.cos(w * t))) ** 2)
              for w in omega * (1 + np.array([-1e-4, 0.0, 1e-4]))]  # fmt: skip
    vertex = (misfit[0] - misfit[2]) / (misfit[0] - 2 * misfit[1] + misfit[2]) / 2 * 1e-4
    assert abs(vertex) < 1e-5


@pytest.mark.parametrize(
    ("points", "precision"),
    [([128], "double"), ([32, 16], "double"), ([32, 16], "single"),
     pytest.param([128], "single", marks=pytest.mark.validation)],  # kernels for this alone
)  # fmt: skip
def test_particles_that_are_rounded_alike_are_no_damage(points, precision):
    """A cold beam on a lattice: what rounds the place of one rounds that of all, in the same direction."""
    drift = [0.3, 0.0][: len(points)]
    made = plasma(n=2048, points=points, v=0.0, dt=0.1, init="quiet", extra=f"drift_velocity = {drift};", ions=False,
                  lengths=[8.0 * np.pi] * len(points), precision=precision)  # fmt: skip
    for _ in range(60):
        made.step()
        made.scalars()
    assert made.guard() is None
    made.close()


def test_a_full_tile_is_no_damage_and_a_particle_that_moves_in_it_is():
    """One tile, and a cold beam whose places have the same last bits: what rounds a sum rounds it always one way."""
    n = 2**17
    made = plasma(n=n, points=[256], v=0.0, dt=0.1, init="quiet", extra="drift_velocity = [0.3];", ions=False)
    for _ in range(20):
        made.step()
        made.scalars()
    assert made.guard() is None
    made.step()
    made.cloud.arena["pool"][made.cloud.arena["head"][0], 0, 0, 0] += 1e-5
    made.scalars()
    told = made.guard() or ""
    jump = float(re.search(r"mean position along .* \(by (\S+) m\), which", told)[1])
    assert jump == pytest.approx(1e-5 / n, rel=0.2)  # cells are of 1 m; a place is seen to 2 x 2^-40 n = 2.4e-7 cells
    made.close()
