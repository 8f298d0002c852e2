"""The plasma at the extremes: accurate (A), warned (B), refused (C) or told to diverge (D); never silently wrong."""

import json

import numpy as np
import pytest
from app_runner import launch, outcome, outcomes, running

from hpcpic.core.case.config import loads
from hpcpic.core.case.derived import enforce
from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError, Diverged
from hpcpic.core.run import checkpoint
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import derived

HOT = """
simulation = { cycles = 400; time_step = 0.2; space_length = [32.0, 16.0]; random_seed = 3; };
grid = { points = [32, 16]; };
species = ( { name = "electrons"; particles = 8192; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
              thermal_velocity = 1.0; init_method = "random position"; } );
"""
SINGLE = 'numerics.precision="single"'


def species(**values):
    return tuple(f"species[0].{key}={value}" for key, value in values.items())


def ended(world, sets, *, force=False, case=HOT, steps=40):
    """(class, warnings, relative change of the energy) of a case on one rank; nothing may get lost."""
    tree = loads(case, sets=sets)
    try:
        config = configure(tree)
        warnings = enforce(derived(config, world.size), tree, force)
    except ConfigError as error:
        return "C", error.messages, 0.0
    with running(world, "hpcpic", config) as app:
        n, first = app.work_items, app.scalars()
        try:
            for _ in range(steps):
                app.step()
        except Diverged as error:
            return "D", [error.message], 0.0
        last = app.scalars()
        assert app.sums.counts().sum() == n and last["charge"] == first["charge"]
        if app.guard():
            return "D", [app.guard()], 0.0
    assert not {name: value for name, value in last.items() if not np.isfinite(value)}
    change = last["energy_total"] / first["energy_total"] - 1 if first["energy_total"] else 0.0
    return "B" if warnings else "A", warnings, change


def fast(cells):
    """A weak plasma whose fastest particle, five thermal velocities above the mean, crosses so many cells."""
    tail = np.sqrt(2 * np.log(8192)) * 0.1 * 0.2
    drift = float(cells - tail) / 0.2
    return species(plasma_frequency=0.2, thermal_velocity=0.1, drift_velocity=[drift, 0.3 * drift])


def turn(angle):
    return (f"field.magnetic=[0.0, 0.0, {angle / 0.2}]",)


def at(*point, n=1, step=(0.0, 0.0), **more):
    """n particles, each `step` from the one before."""
    return species(
        particles=n, init_method='"position delta"', position_init=list(point), position_delta=list(step),
        thermal_velocity=0.0, plasma_frequency=0.05, **more,
    )  # fmt: skip


TABLE = {
    "wp dt": [
        *((f"{x}", "A", (f"simulation.time_step={x}",)) for x in (0.05, 0.2)),
        *((f"{x}", "B", (f"simulation.time_step={x}",)) for x in (0.8, 1.1)),
        *((f"{x}", "CB", (f"simulation.time_step={x}",)) for x in (1.2, 1.5, 1.9)),
        *((f"{x}", "CC", (f"simulation.time_step={x}",)) for x in (2.0, 2.1, 50.0)),
    ],
    "lambda_D/dx": [
        *((f"{x}", "A", species(thermal_velocity=x)) for x in (1.0, 0.5)),
        *((f"{x}", "B", species(thermal_velocity=x)) for x in (0.3, 0.1)),
        ("0.01", "CB", species(thermal_velocity=0.01)),
    ],
    "v dt/dx": [
        *((f"{x}", "A", fast(x)) for x in (0.25, 0.5, 0.99)),
        *((f"{x}", "B", fast(x)) for x in (1.01, 2.0, 100.0)),
    ],
    "wc dt": [
        *((f"{x}", "A", turn(x)) for x in (1e-9, 0.1, 0.349)),
        *((f"{x}", "B", turn(x)) for x in (2.0, 10.0, 1e3)),
        *((f"{x}", "CC", turn(x)) for x in (1e12, 1e30)),
        ("beyond floating point", "CC", turn(1e80)),
    ],
    "particles": [
        ("16 per cell", "A", species(particles=8192)),
        *((f"{n} per cell", "B", species(particles=int(512 * n))) for n in (1, 1 / 8)),  # noise
        ("0", "A", species(particles=0)),
        ("1", "A", at(7.3, 5.1)),
        ("2 at one point", "A", at(7.3, 5.1, n=2)),
        *((f"x = {x!r}", "A", at(x, x / 2)) for x in (0.0, -1e-20, -31.999999999999996, 32.0, 31.999999999999996, 1e6)),
    ],
    "species": [
        ("heavy", "A", species(mass=1e6, charge=-1e6)),
        ("light, charged 1e12", "A", species(mass=1e-12)),
        ("q/m 1e-12", "A", species(mass=1e12)),
        ("no charge", "A", species(charge=0.0, plasma_frequency=0.0)),
        ("no mass", "CC", species(mass=0.0)),
        ("1e80 kg", "CC", species(mass=1e80)),
    ],
    "grid": [
        *((f"{nx}x{ny}", "A" if nx * ny > 1 else "B",  # a single point has no field
           (f"grid.points=[{nx}, {ny}]", f"simulation.space_length=[{nx}.0, {ny}.0]",
            *species(particles=max(8192, 4 * nx * ny))))
          for nx, ny in ((1, 32), (32, 1), (2, 64), (64, 2), (1, 1), (97, 101))),
    ],
    "time": [
        ("dt = 0", "CC", ("simulation.time_step=0.0",)),
        ("dt < 0", "A", ("simulation.time_step=-0.2",)),
        ("one step", "B", ("simulation.cycles=1",)),
    ],
}  # fmt: skip
CROWDS = {
    "on one node": at(7.0, 5.0, n=500),
    "in one cell": at(7.1, 5.1, n=300, step=(0.002, 0.001)),
    "on the seam": at(0.0, 0.0, n=300, step=(0.0, 0.05)),
}
ROWS = [
    pytest.param(expected, sets, id=f"{what} {value}") for what, rows in TABLE.items() for value, expected, sets in rows
]
ACCURATE = 0.02  # relative change of the energy in 8 / wp, where a method of second order is called accurate


@pytest.mark.parametrize("expected, sets", ROWS)
def test_table(world, expected, sets):
    """Two letters: without and with --force."""
    found, messages, change = ended(world, sets)
    assert found == expected[0], messages
    if found == "A":
        assert abs(change) < ACCURATE
    if found == "C":
        assert all("limit" in message or "must" in message for message in messages)
        forced, warnings, _ = ended(world, sets, force=True)
        assert forced == expected[1], warnings
        assert forced == "C" or any("refused without --force" in warning for warning in warnings)


@pytest.mark.parametrize("crowd", CROWDS)
def test_crowds_lose_nobody(world, crowd):
    """All particles so close together fly apart, in a field that a grid cannot resolve."""
    assert ended(world, CROWDS[crowd])[0] == "A"


def test_no_species(world):
    assert ended(world, (), case=HOT.split("species")[0] + "species = ();")[0] == "A"


@pytest.mark.parametrize("beyond", [2.1, 2.5, 5.0])
def test_instability_is_seen_within_100_steps(world, beyond):
    """wp dt >= 2 is always refused; here the refusal is passed by."""
    with running(world, "hpcpic", HOT, [f"simulation.time_step={beyond}"]) as app:
        assert app.guard() is None
        for _ in range(100):  # no series asks for the energy
            app.step()
        assert "the total energy grew from" in app.guard()


def test_not_a_number_is_seen_at_once(world):
    with running(world, "hpcpic", HOT) as app, pytest.raises(Diverged, match="not a number"):
        app.solve()
        app.mesh.e[:] = np.nan
        app.step()


@pytest.mark.parametrize("n", [400_000, 600_000, 1_200_000])
def test_charge_never_wraps(world, n):
    """So many particles on one of many nodes that 64 bits end: 0.4, 0.6 and 1.2 million times 2^44 parts."""
    crowd = (*at(1.0, 1.0, n=n), "grid.points=[512, 512]", "simulation.space_length=[512.0, 512.0]")
    with pytest.raises(Diverged, match="on one node"), running(world, "hpcpic", HOT, crowd):
        pass


def test_crowded_small_grid(world):
    """As many on a grid where that is usual: fewer parts, and nothing overflows."""
    crowd = (*at(1.0, 1.0, n=600_000), "grid.points=[4, 4]", "simulation.space_length=[4.0, 4.0]")
    with running(world, "hpcpic", HOT, crowd) as app:
        app.step()
        most = app.scene.species[0].q * 600_000 / app.scene.cell_volume
        assert abs(app.mesh.rho).max() == pytest.approx(abs(most), rel=1e-12)


@pytest.mark.parametrize("precision", ["double", "single"])
def test_one_particle_stays_at_rest(world, precision):
    """A particle feels no force of its own: centred differences and one shape for gather and deposit."""
    with running(world, "hpcpic", HOT, (*at(7.3, 5.1), f'numerics.precision="{precision}"')) as app:
        for _ in range(100):
            app.step()
        velocity = app.particles()["electrons"].columns["velocity"]
        # rounding of E of one macro-particle (q/m) q / eps0 ~ 1.3 for 20 / wp
        assert np.abs(velocity).max() < {"double": 1e-13, "single": 1e-5}[precision]


def test_no_charge_streams_freely(world):
    """Over every seam and corner, at any speed, to where x + v t is."""
    free = species(charge=0.0, plasma_frequency=0.0, drift_velocity=[-77.7, 33.3])
    with running(world, "hpcpic", HOT, free) as app:
        start = app.particles()["electrons"]
        begin, v = (
            start.position[np.argsort(start.ids), :2],
            start.columns["velocity"][np.argsort(start.ids), :2],
        )
        for _ in range(200):
            app.step()
        end = app.particles()["electrons"]
        box = np.array([32.0, 16.0])
        apart = (end.position[np.argsort(end.ids), :2] - begin - v * app.time) / box
        assert np.abs(apart - np.round(apart)).max() < 1e-12  # of the box, after 200 roundings at 8 cells
        assert (end.position[:, :2] >= 0).all() and (end.position[:, :2] < box).all()


def test_uniform_field_accelerates_without_end(world):
    """p = N q E t exactly, and the guard takes the energy for what it is."""
    with running(world, "hpcpic", HOT, ("field.electric=[50.0, 0.0, 0.0]",)) as app:
        first = app.scalars()["momentum_x"]
        for _ in range(100):
            app.step()
        gained = app.scalars()["momentum_x"] - first
        assert gained == pytest.approx(app.scene.species[0].q * 8192 * 50.0 * app.time, rel=1e-9)
        assert app.guard() is None


class Turned:
    """A checkpoint in which time runs backwards: x^n, and v^(n+1/2) with the sign of the other time step."""

    def __init__(self, now, later):
        self.arrays = {
            name: -later[name].local if name.endswith("velocity") else shard.local.copy() for name, shard in now.items()
        }
        self.step = 0

    def read(self, name, low, high):
        return self.arrays[name][low:high]


@pytest.mark.parametrize("sets", [(), ("field.magnetic=[0.0, 0.0, 1.0]",), ("field.magnetic=[0.5, 0.3, 1.0]",)])
def test_backwards_in_time_to_the_start(world, sets):
    n = 100
    with running(world, "hpcpic", HOT, sets) as app:
        start = app.state()["electrons/position"].local.copy()
        for _ in range(n):
            app.step()
        now = app.state()
        app.step()
        turned = Turned(now, app.state())
    with running(world, "hpcpic", HOT, ("simulation.time_step=-0.2", *sets)) as app:
        app.restore(turned)
        for _ in range(n):
            app.step()
        end = app.state()["electrons/position"].local
        assert app.iteration == n and np.abs(end - start).max() < 1e-9  # 20 / wp of a hot plasma magnify 1e-15


@pytest.mark.parametrize("power", [40, -40])
@pytest.mark.parametrize("sets", [(), (SINGLE,), ("field.magnetic=[0.0, 0.0, 1.0]",)], ids=["", "single", "B"])
def test_units_are_free(world, sets, power):
    """Metre, second, kilogram and coulomb times a power of two: the same bits of the state."""
    digests = set()
    for metre, second, kilogram, farad in [(0, 0, 0, 0), *np.eye(4, dtype=int).tolist(), (1, -1, 1, -1)]:
        m, s, kg, f = (2.0 ** (power * k) for k in (metre, second, kilogram, farad))
        scaled = (
            f"simulation.time_step={0.2 * s!r}",
            f"simulation.space_length=[{32 * m!r}, {16 * m!r}]",
            f"constants.vacuum_permittivity={f!r}",
            *species(
                mass=kg,
                charge=-kg,
                plasma_frequency=1 / s,
                thermal_velocity=m / s,
                drift_velocity=[m / s, 0.0],
            ),
        )
        field = tuple(f"field.magnetic=[0.0, 0.0, {1 / s!r}]" for text in sets if "magnetic" in text)
        with running(world, "hpcpic", HOT, (*sets, *scaled, *field)) as app:
            for _ in range(20):
                app.step()
            digests.add(checkpoint.digest(world, app.state()))
    assert len(digests) == 1


ON_RANKS = {
    "100 cells a step": fast(100.0),
    "everybody on a slab boundary": at(0.0, 8.0, n=320, step=(0.1, 0.0)),
    "one ulp below a slab boundary": at(0.0, 7.999999999999999, n=320, step=(0.1, 0.0)),
    "on the seam": at(0.0, 15.999999999999998, n=320, step=(0.1, 0.0)),
    "below zero": at(-1e-20, -1e-20, n=3),
    "one cell": at(7.1, 5.1, n=300, step=(0.002, 0.001)),
    "nobody": species(particles=0),
    "a row each": ("grid.points=[37, 3]", "simulation.space_length=[37.0, 3.0]"),
    "one column": ("grid.points=[1, 64]", "simulation.space_length=[1.0, 64.0]"),
    "primes": ("grid.points=[97, 101]", "simulation.space_length=[97.0, 101.0]"),
}


def test_extremes_on_ranks(tmp_path):
    """Bits, scalars and numbers are the same on one rank, in this process, and on three."""
    jobs = [{"program": "hpcpic", "case": HOT, "sets": sets, "steps": 20} for sets in ON_RANKS.values()]
    alone, together = [outcome(World.alone(), job) for job in jobs], outcomes(tmp_path, 3, jobs)
    for name, one, three in zip(ON_RANKS, alone, together, strict=True):
        assert one == three, name


def run(folder, ranks, *sets, flags=()):
    (folder / "hot.conf").write_text(HOT)
    words = [word for assignment in sets for word in ("--set", assignment)] + list(flags)
    return launch(
        ranks, "-m", "hpcpic", "run", str(folder / "hot.conf"), "-o", str(folder / "run"), "--threads", "1", *words
    )


def facts(folder):
    return json.loads((folder / "run" / "run.json").read_text())


def test_warned(tmp_path):
    done = run(tmp_path, 2, "simulation.time_step=1.5", "simulation.cycles=20", flags=["--force"])
    assert done.returncode == 0 and facts(tmp_path)["status"] == "finished"
    assert any("wp dt = 1.5" in warning and "without --force" in warning for warning in facts(tmp_path)["warnings"])
    assert done.stderr.count("wp dt = 1.5") == 1


def test_refused(tmp_path):
    done = run(tmp_path, 2, "simulation.time_step=2.1", flags=["--force"])
    assert done.returncode == 2 and not (tmp_path / "run").exists()
    assert done.stderr.count("wp dt = 2.1") == 1 and "time_step = 0.49" in done.stderr


def test_more_ranks_than_rows(tmp_path):
    done = run(tmp_path, 3, "grid.points=[512, 2]")
    assert done.returncode == 2 and not (tmp_path / "run").exists()
    assert done.stderr.count("at most 2 ranks") == 1


def test_diverged(tmp_path):
    """A field in which the rotation is lost in rounding, past its refusal: known after the first steps, in one line."""
    done = run(tmp_path, 2, "field.magnetic=[0.0, 0.0, 5e30]", flags=["--beyond-limits"])
    assert done.returncode == 4 and "Traceback" not in done.stderr
    assert (facts(tmp_path)["status"], facts(tmp_path)["exit_code"]) == ("diverged", 4)
    assert len([line for line in done.stderr.splitlines() if "moved 2^31 cells" in line]) == 1


def test_a_run_of_no_steps_writes_the_initial_state(tmp_path):
    done = run(tmp_path, 1, "simulation.cycles=0")
    assert done.returncode == 0, done.stderr
    assert (facts(tmp_path)["status"], facts(tmp_path)["steps"]) == ("finished", 0) and facts(tmp_path)["state_digest"]
    series = (tmp_path / "run" / "series.csv").read_text().splitlines()
    assert len(series) == 2 and series[1].startswith("0,0.0,")
    done = launch(1, "-m", "hpcpic", "tradeoff", str(tmp_path / "hot.conf"), "--set", "simulation.cycles=0")
    assert done.returncode == 2 and "a run of no steps" in done.stderr
