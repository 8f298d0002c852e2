"""What water does to a wall of particles as it strikes it.

The wall's part is tried where a law says what must come: a wedge that meets a wall keeps its shape, so that its force
grows with time and its pressure stays; a jet brings its momentum; a flat front sounds as in linear theory. What remains
of the peak of a wave is the shape of its front, which the spacing must resolve.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from test_sph_physics import DE_COURCY, TRIXI, Done, sensors_of, told

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from sph.analysis import experiments, theory
from sph.case.config import SphConfig
from sph.configure import configure
from sph.step import Sph

pytestmark = [pytest.mark.validation, pytest.mark.timeout(7200)]

WALL = """
domain = {{ low = [-1.2, -1.5]; high = [0.0, 1.5]; }};
eos = {{ sound_speed = {c}; max_velocity = 1.0; }};
numerics = {{ spacing = {dp}; smoothing = {h}; artificial_viscosity = 0.05; }};
wall = ( {{ name = "wall"; type = "extrapolated-free-slip"; measure_force = true;
    shape = {{ box = {{ low = [-1.2, -1.5]; high = [0.0, 1.5]; open = ["x-", "y-", "y+"]; }}; }}; }} );
gauge = ( {{ name = "foot"; what = "wall-pressure"; at = [0.0, 0.0]; axis = "x+"; size = [0.0, 0.02]; }} );
simulation = {{ dimensions = 2; end_time = {end}; }};
output = {{ period = {{ series = 0.0; }}; }};
"""


def struck(world: World, config: SphConfig, end: float, sensor: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Times after each step in s, and the impulse along x on the wall whose force is measured, N s; or, of the first
    sensor, the integral of its pressure, Pa s.
    """
    pool = Pool(1)
    try:
        app, rows = Sph(config, world, pool, Timers()), [(0.0, 0.0)]
        while app.time < end:
            app.step()
            impulse = app.forces.impulses[app.walls.measured, 1][0] if not sensor else app.sensors.integrals[0]
            rows.append((app.time, float(impulse)))
        app.close()
    finally:
        pool.close()
    t, impulse = np.transpose(rows)
    return t, impulse


def mean_force(t: np.ndarray, impulse: np.ndarray, first: float, last: float) -> float:
    a, b = np.interp((first, last), t, impulse)
    return float((b - a) / (last - first))


def wedge(world, folder, degrees: float, c: float, sensor: bool = False, dp: float = 0.0025) -> list[float]:
    """F/(rho U^3 t tan a), or p/(rho U^2) in the middle, while a wedge of half-angle a that moves with U = 1 m/s goes
    0 to 4, 16 to 32, 32 to 64 spacings into the wall.
    """
    slope = math.tan(math.radians(degrees))
    x, y = np.meshgrid(-(np.arange(200) + 0.5) * dp, (np.arange(-400, 400) + 0.5) * dp)
    inside = np.abs(y) < -x * slope
    place = np.stack([x[inside], y[inside]], axis=1)
    np.savez(folder / "wedge.npz", position=place, velocity=np.broadcast_to((1.0, 0.0), place.shape))
    head = f'fluid = ( {{ name = "water"; initial_pressure = "zero"; start = {{ file = "{folder}/wedge.npz"; }}; }} );'
    end = 64 * dp
    t, sums = struck(world, configure(loads(head + WALL.format(c=c, dp=dp, h=2.0, end=end))), end + 1e-4, sensor)
    found = []
    for first, last in ((0, 4), (16, 32), (32, 64)):
        mean = mean_force(t, sums, first * dp, last * dp) / 1000.0
        found.append(mean if sensor else mean / (slope * (first + last) / 2 * dp))
    return found


def test_the_force_of_a_wedge_grows_with_time_whatever_the_sound_speed(world, tmp_path):
    """After 16 spacings of the way; at first contact, of particles one by one, it is half as large again and more."""
    first, middle, last = wedge(world, tmp_path, 20.0, 20.0)
    told("wedge of 20 degrees: F/(rho U^3 t tan a), 0 to 4 spacings", first, "3.17")
    assert abs(told("... 16 to 32 over 32 to 64 - 1", middle / last - 1, "3 %")) < 0.03
    assert 1.3 < first / last < 2.0
    twice = wedge(world, tmp_path, 20.0, 40.0)[2]
    assert abs(told("... with c0 = 40 U over 20 U - 1", twice / last - 1, "2 %")) < 0.02


def test_the_pressure_of_a_wedge_is_that_of_a_jet_the_thinner_it_is(world, tmp_path):
    """p = rho U^2 (1/2 + k a): Bernoulli's half as a -> 0. Measured: 0.71, 0.82 and 0.94 at 10, 15 and 20 degrees."""
    angles = np.radians((10.0, 15.0, 20.0))
    p = [wedge(world, tmp_path, math.degrees(a), 20.0, sensor=True)[2] for a in angles]
    for a, value in zip(angles, p):
        told(f"wedge of {math.degrees(a):.0f} degrees: p/(rho U^2) in the middle", value, "0.48 + 1.33 a")
    rise, thin = np.polyfit(angles, p, 1)
    told("... rise with the angle", rise, "1.33")
    assert abs(told("... p/(rho U^2) without angle", thin, "0.5") - 0.5) < 0.03


def block(world, c: float, length: float, end: float, n: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Times in s, and impulse on the wall over rho U b^2, of a block of n spacings' width b with a flat front."""
    head = f"""fluid = ( {{ name = "water"; velocity = [1.0, 0.0]; initial_pressure = "zero";
        shape = {{ box = {{ low = [{-length}, -0.1]; high = [0.0, 0.1]; }}; }}; }} );"""
    t, impulse = struck(world, configure(loads(head + WALL.format(c=c, dp=0.2 / n, h=2.0, end=end))), end)
    return t, impulse / (1000 * 0.2**2)


def test_a_flat_front_sounds_as_in_linear_theory_and_then_brings_its_momentum(world):
    """A block whose front is flush: 0.271 rho U b^2 without sound, whose first swing has 0.393 by linear acoustics
    whatever c0 is. Measured 0.429 at c0 = 80 U, 0.465 at 20 U: the equation of state stiffens. The force of the jet
    that follows is rho U^2 b less 3 %.
    """
    for c, within in ((80.0, 0.12), (20.0, 0.22)):
        t, impulse = block(world, c, 0.4, 0.25 / c + 0.001)
        swing = told(f"flat front, c0 = {c:g} U: first swing over that of linear theory", impulse.max() / 0.393, "1")
        assert 0.98 < swing < 1 + within
    t, impulse = block(world, 20.0, 1.2, 0.5)
    assert abs(told("jet: force over rho U^2 b - 1", mean_force(t, impulse, 0.3, 0.5) * 0.2 - 1, "4 %")) < 0.04


PLATE = """
simulation = {{ dimensions = 2; end_time = 1.0; random_seed = {seed}; }};
domain = {{ low = [-1.6, -0.6]; high = [1.2, 0.6]; }};
eos = {{ sound_speed = 10.0; max_velocity = 1.0; }};
fluid = ( {{ name = "jet"; velocity = [1.0, 0.0]; initial_pressure = "zero"; disorder = {disorder};
    shape = {{ box = {{ low = [-1.4, -0.1]; high = [0.0, 0.1]; }}; }}; }} );
numerics = {{ spacing = {dp}; }};
wall = ( {{ name = "plate"; solid = true; shape = {{ box = {{ low = [0.0, -0.1]; high = [0.05, 0.1]; }}; }}; }} );
gauge = ( {sensors} );
output = {{ period = {{ series = 0.0; }}; }};
"""


def on_plate(world, n: int, seed: int, disorder: float = 0.1) -> np.ndarray:
    """Mean pressures over rho U^2 / 2 on the quarters of one half of a plate of 2 n spacings, from its middle on, while
    a jet as wide as the plate stands on it; the last one is that of the outer twentieth.
    """
    ends = (0.0, 0.25, 0.5, 0.75, 1.0)
    parts = [*itertools.pairwise(ends), (0.95, 1.0)]
    sensors = ", ".join(f"""{{ name = "s{k}"; what = "wall-pressure"; at = [0.0, {0.05 * (a + b)}]; axis = "x+";
        size = [0.0, {0.1 * (b - a)}]; }}""" for k, (a, b) in enumerate(parts))  # fmt: skip
    pool, began = Pool(1), None
    try:
        text = PLATE.format(dp=0.1 / n, sensors=sensors, seed=seed, disorder=disorder)
        app = Sph(configure(loads(text)), world, pool, Timers())
        while app.time < app.end_time:
            app.step()
            if began is None and app.time >= 0.4:
                began = app.time, app.sensors.integrals[: len(parts)].copy()
        pressed = (app.sensors.integrals[: len(parts)] - began[1]) / (app.time - began[0])
        app.close()
    finally:
        pool.close()
    return pressed / 500.0


def test_a_jet_on_a_plate_presses_as_free_streamlines_have_it(world):
    """Measured over the whole plate -1.2, -1.0 and 0.0 % with 20, 40 (means of three seeds) and 80 spacings; in the
    outer quarters -9, -9 and -6 %, where edges pull -29, -29 and -26 %. From a perfect lattice -2.8, -5.3 and -2.6 %,
    and 3 % up or down with another sound speed: a flush front slams.
    """
    x, p = theory.jet_on_plate(1.0)
    exact = np.diff(np.interp((0.0, 0.25, 0.5, 0.75, 1.0), x, theory.cumulative(x, p))) * 4
    for n, seeds in ((10, (1, 2, 3)), (20, (1, 2, 3)), (40, (1,))):
        found = np.mean([on_plate(world, n, seed) for seed in seeds], axis=0)
        whole, inner, outer = (found[a:b].mean() / exact[a:b].mean() - 1 for a, b in ((0, 4), (0, 3), (3, 4)))
        told(f"jet on a plate of {2 * n} spacings: pressure over theory - 1", whole, "3 %")
        told("... inner three quarters", inner, "3 %")
        told("... outer quarters", outer, "15 %")
        told("... outer twentieth, rho U^2 / 2", found[4], "0.30, within 0.1")
        assert abs(whole) < 0.03 and abs(inner) < 0.03 and abs(outer) < 0.15 and abs(found[4] - 0.3) < 0.1


@pytest.mark.xfail(strict=True, reason="with 40 spacings inside -4.8 %, whole -5.3 %; 3 % by a sound speed 3 % higher")
def test_a_flush_jet_on_a_plate_presses_as_free_streamlines_have_it(world):
    """From a perfect lattice, whose front slams."""
    x, p = theory.jet_on_plate(1.0)
    exact = np.diff(np.interp((0.0, 0.25, 0.5, 0.75, 1.0), x, theory.cumulative(x, p))) * 4
    less = []
    for n in (10, 20, 40):
        found = on_plate(world, n, 0, disorder=0.0)
        less.append(1 - found[:4].mean() / exact.mean())
        assert abs(found[:3].mean() / exact[:3].mean() - 1) < 0.03
    assert less[2] < less[1] < less[0] < 0.08 and less[1] < 0.05


BORE = """
simulation = {{ dimensions = 2; end_time = 0.36; cfl = 0.9; }};
domain = {{ low = [0.0, 0.0]; high = [1.6, 0.75]; }};
gravity = [0.0, -9.81];
eos = {{ sound_speed_factor = 10.0; max_velocity = 2.43; }};
fluid = (
  {{ name = "reservoir"; shape = {{ box = {{ low = [0.0, 0.0]; high = [0.4, 0.3]; }}; }}; disorder = 0.1;
    dynamic_viscosity = 1.0e-3; }},
  {{ name = "bed"; shape = {{ box = {{ low = [0.4, 0.0]; high = [1.6, 0.01]; }}; }}; disorder = 0.1;
    dynamic_viscosity = 1.0e-3; thin_layer = "one layer"; }}
);
numerics = {{ spacing = {dp}; density_flux = "molteni"; viscosity_form = "cleary"; artificial_viscosity = 0.02; }};
wall = ( {{ name = "tank"; type = "{kind}";
    shape = {{ box = {{ low = [0.0, 0.0]; high = [1.6, 0.75]; open = ["y+"]; }}; }}; }} );
output = {{ period = {{ series = 0.0; }}; }};
"""


def arrivals(world, dp: float, kind: str = "extrapolated-free-slip") -> np.ndarray:
    """Times in ms at which the bore of column-impact, in two dimensions, comes to the place of the column at heights of
    5, 15 .. 75 mm.
    """
    pool, heights = Pool(1), np.arange(0.005, 0.08, 0.01)
    came = np.full(len(heights), np.nan)
    try:
        app = Sph(configure(loads(BORE.format(dp=dp, kind=kind))), world, pool, Timers())
        while app.time < app.end_time:
            app.step()
            x, v = (app.storage.physical(name, app.storage.fluid_slots) for name in ("x", "v"))
            there = (np.abs(x[:, 0] - 0.9) < max(dp, 0.006)) & (v[:, 0] > 0.3)
            near = np.abs(x[there, 1] - heights[:, None]) < 0.006
            came[np.isnan(came) & near.any(axis=1)] = 1e3 * app.time
        app.close()
    finally:
        pool.close()
    told(f"bore, {1e3 * dp:g} mm, {kind}: foot (5 to 25 mm), ms", came[:3].mean(), "")
    told("... crest (65 and 75 mm) after the foot, ms", came[6:].mean() - came[:3].mean(), "")
    return came


def test_the_front_of_a_bore_needs_small_particles(world):
    """The crest of a bore over a wet bed plunges. With 12 and 8 mm it is in the air at the place of the column, a
    cavity below it, or has landed there or before, as viscosity, seed and scheme have it: the crest comes 25 ms before
    to 19 ms after the foot. With 5 and 2.5 mm it has landed, and the front leans back by 17 to 38 ms, as seeds have it:
    the measured force on the column rises in 50.
    """
    foot, crest = slice(0, 3), slice(6, 8)
    leans = {dp: times[crest].mean() - times[foot].mean()
             for dp, times in ((dp, arrivals(world, dp)) for dp in (0.012, 0.008, 0.005, 0.0025))}  # fmt: skip
    assert leans[0.008] < 15.0
    assert 8.0 < leans[0.005] < 45.0 and 8.0 < leans[0.0025] < 45.0
    if not leans[0.012] < -10.0:
        pytest.xfail("with 12 mm the crest came 21 ms before the foot, now 6 ms: nearer to what fine spacings have")


@pytest.mark.parametrize(("dp", "lowest", "highest"), [(0.012, 58.0, 84.0), (0.008, 40.0, 54.0), (0.005, 36.0, 47.0)])
def test_the_peak_on_the_column_falls_with_the_spacing(world, dp, lowest, highest):
    """One seed of those of the table, whose band this is and a tenth more. Measured: 33.3 N, and 3.47 N s in the first
    140 ms. Half an hour at 5 mm.
    """
    walls = [f'wall[{k}].type="extrapolated-free-slip"' for k in (0, 1)]
    fluids = [f"fluid[{k}].disorder=0.1" for k in (0, 1)]
    sets = (*walls, *fluids, "simulation.random_seed=1", "simulation.end_time=0.44", f"numerics.spacing={dp}")
    done = Done(world, "column-impact-a", *sets, period=0.0005)
    t, impulse = done.t + experiments.COLUMN_SHIFT, done.series("impulse_column_x")
    found, measured = experiments.column_figures(done.t, impulse), experiments.COLUMN_FORCE.T
    told(f"column, {1e3 * dp:g} mm: peak, N", found["peak"], "33.3 measured")
    lasts = mean_force(t, impulse, found["arrival"], found["arrival"] + 0.14)
    start = experiments.COLUMN_FIGURES["arrival"]
    early = lasts / mean_force(measured[0], theory.cumulative(*measured), start, start + 0.14) - 1
    told("... impulse of the first 140 ms over measured - 1", early, "10 %")
    assert lowest < found["peak"] < highest and abs(early) < 0.1


def test_peaks_of_first_contact_fall_with_the_spacing_to_those_of_others(world):
    """dam-break-pressure, means of the lattice and two seeds: at 5 mm the tip of the tongue is one particle; at 2.5 mm
    none strikes the highest sensor. At the foot both are too coarse: 4 to 5 rho g H.
    """
    seeds = [(), *(("fluid[0].disorder=0.1", f"simulation.random_seed={seed}") for seed in (1, 2))]
    coarse, fine = (
        np.mean([sensors_of(world, f"numerics.spacing={dp}", *seed)[1][:, 1] for seed in seeds], axis=0)
        for dp in (0.005, 0.0025)
    )
    for k, peaks in enumerate(zip(coarse, fine, DE_COURCY[:, 1], TRIXI[:, 1]), 1):
        told(f"sensor {k}: peak with 5 mm, rho g H", peaks[0], "")
        told("... with 2.5 mm", peaks[1], f"{peaks[2]:g}, {peaks[3]:g} by others")
    assert DE_COURCY[:, 1].sum() < fine.sum() < coarse.sum() and (fine < coarse).all()
    assert max(coarse[0], fine[0]) < 6.0 and fine[3] < 0.4
