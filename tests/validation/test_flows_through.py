"""Flows through inlets and outlets, long waves and sloshing, against theory and experiment."""

import numpy as np
import pytest

import sph

pytestmark = [pytest.mark.validation, pytest.mark.timeout(1800)]


def test_plane_poiseuille_flow_through_inlet_and_outlet(tmp_path):
    series = sph.Case("channel").run(tmp_path / "run", threads=1).series
    late = np.asarray(series["time"]) > 3.0
    mean = {name: np.mean(np.asarray(series[name])[late]) for name in ("middle_x", "quarter_x", "through")}
    drop = np.mean((np.asarray(series["upstream"]) - np.asarray(series["downstream"]))[late])
    print(mean, drop)
    assert mean["middle_x"] == pytest.approx(0.015, rel=0.01) and mean["quarter_x"] == pytest.approx(0.01125, rel=0.01)
    assert mean["through"] == pytest.approx(1e-4, rel=0.01)
    assert drop == pytest.approx(0.015 * 12 * 5e-3 * 0.01 / 1e-4, rel=0.02)  # sound of 0.02 Pa in 0.09 Pa
    assert np.ptp(np.asarray(series["mass_total"])) < 1e-14


def test_a_weir_has_the_head_of_rehbock(tmp_path):
    series = sph.Case("weir").run(tmp_path / "run", threads=1).series
    time, level, over = (np.asarray(series[name]) for name in ("time", "level", "outflow"))
    late = time > 4.0
    head = np.mean(level[late]) - 0.2
    flow = np.polyfit(time[late], over[late], 1)[0] / 1000.0
    print(head, flow)
    assert 2 / 3 * (0.602 + 0.083 * head / 0.2) * np.sqrt(2 * 9.81) * head**1.5 == pytest.approx(0.06, rel=0.03)
    assert head == pytest.approx(0.0999, rel=0.02) and flow == pytest.approx(0.06, rel=0.01)


def test_a_reservoir_fills_at_the_rate_of_its_inflow_and_overflows_its_dam_as_much(tmp_path):
    """Over a broad crest the depth is critical: q = (2/3)^(3/2) sqrt(g) H^(3/2), H the total head over it. The mean of
    two gauges at the quarters of the free water does not see the first three ways in which it swings.
    """
    q, length, crest = 0.06, 0.6, 0.25
    series = sph.Case("dam-with-inflow").run(tmp_path / "run", threads=1).series
    names = "time", "near", "far", "over", "inflow", "outflow", "mass", "strays"
    time, near, far, over, came, left, mass, strays = (np.asarray(series[name]) for name in names)
    level, given = (near + far) / 2, q * np.where(time < 1.0, time**2 / 2, time - 0.5)
    below = time < (crest - 0.12) * length / q + 0.5
    steady = below & (time > 1.0)
    rise = np.polyfit(time[steady], level[steady], 1)[0]
    late = time > 7.0
    head, flow = np.mean(level[late]) - crest + (q / np.mean(level[late])) ** 2 / (2 * 9.81), np.mean(over[late])
    critical = 1.5 * (flow**2 / 9.81) ** (1 / 3)
    print(rise, head, flow, critical, time[over > 0.0][0])
    assert np.abs(came - 1000.0 * given).max() < 1000.0 * 0.4 * 0.01  # a particle in every row
    assert np.abs(mass + left - came - mass[0]).max() < 1e-9 and strays[-1] == 0
    assert rise == pytest.approx(q / length, rel=0.03) and np.all(over[below] == 0.0)
    assert flow == pytest.approx(q, rel=0.03) and head == pytest.approx(critical, rel=0.03)


FLUME = """
simulation = { dimensions = 2; end_time = 6.0; };
gravity = [0.0, -9.81];
fluid = ( { shape = { box = { low = [0.0, 0.0]; high = [END, 0.2]; }; }; } );
numerics = { spacing = 0.0125; smoothing = 2.0; };
wall = ( { shape = { box = { low = [0.0, 0.0]; high = [END, 0.4]; open = ["x-", "x+", "y+"]; }; }; } );
inlet = ( { low = [0.0, 0.0]; high = [0.0625, 0.4]; axis = "x+"; table = ( TABLE ); } );
outlet = ( { low = [FROM, 0.0]; high = [END, 0.4]; axis = "x+"; level = 0.2; WAVES } );
gauge = ( { name = "surface"; what = "elevation"; at = [2.5, 0.0]; } );
output = { period = { series = 0.02; }; };
"""


def test_a_solitary_wave_leaves_through_an_outlet(tmp_path):
    """Of 4 cm in 20 cm of water (Boussinesq), in 4 m beside 6 m of flume, from whose end nothing comes back in time:
    what is other 1.5 m before the outlet came back. Measured 4.6 %; 9 % while what is in the box stayed at the height
    at which it came in; from a fixed level most of it, turned round. With h / dp = 1.3 two flumes of 6 and 6.5 m differ
    by 4 to 8 % by themselves: the surface is as rough as their particles are disordered.
    """
    depth, height, t0 = 0.2, 0.04, 1.178
    c = np.sqrt(9.81 * (depth + height))
    rows = []
    for t in np.linspace(0.0, 2 * t0, 41):
        eta = height / np.cosh(np.sqrt(0.75 * height / depth**3) * c * (t - t0)) ** 2
        rows.append(f"{{ time = {t}; velocity = {c * eta / (depth + eta)}; level = {depth + eta}; }}")
    rows.append(f"{{ time = {2 * t0 + 0.05}; velocity = 0.0; level = {depth}; }}")

    def surface(name, end, waves):
        text = FLUME.replace("TABLE", ", ".join(rows)).replace("WAVES", waves)
        (tmp_path / f"{name}.conf").write_text(text.replace("END", f"{end}").replace("FROM", f"{end - 0.0625}"))
        series = sph.Case(tmp_path / f"{name}.conf").run(tmp_path / name, threads=1).series
        return np.interp(times, np.asarray(series["time"]), np.asarray(series["surface"])) - depth

    times = np.arange(0.0, 6.0, 0.02)
    free, leaves = (surface(f"{end}", end, "waves = true;") for end in (6.0, 4.0))
    fixed = surface("fixed", 4.0, "")
    back, thrown = (np.abs(other - free)[times > 3.6].max() / free.max() for other in (leaves, fixed))
    print(free.max(), back, thrown)
    assert free.max() > 0.034 and back < 0.05 and thrown > 0.6


CLOSED = """
simulation = { dimensions = 2; end_time = 2.4; };
gravity = [0.0, -9.81];
fluid = ( { surface = 0.39; start = { file = "FILE"; }; } );
eos = { sound_speed = 24.0; };
numerics = { spacing = 0.015; };
wall = ( { shape = { box = { low = [0.0, 0.0]; high = [8.0, 0.6]; open = ["y+"]; }; }; } );
gauge = ( { name = "before"; what = "elevation"; at = [4.5, 0.0]; },
          { name = "after"; what = "elevation"; at = [6.0, 0.0]; } );
output = { period = { series = 0.01; }; };
"""


@pytest.mark.parametrize(
    ("smoothing", "corrected", "least"), [(2.0, False, 0.086), (1.5, True, 0.084)], ids=["h/dp 2", "corrected"]
)
def test_a_solitary_wave_keeps_its_speed_and_height(smoothing, corrected, least, tmp_path):
    """Of Boussinesq, 9 cm in 30 cm: c^2 = g (depth + height), by when half of its height passes two gauges."""
    depth, height, dp, middle = 0.3, 0.09, 0.015, 2.0
    k, c = np.sqrt(0.75 * height / depth**3), np.sqrt(9.81 * (depth + height))
    x = np.linspace(0.0, 8.0, 80_001)
    rise = height / np.cosh(k * (x - middle)) ** 2
    area = np.concatenate([[0.0], np.cumsum((depth + (rise[1:] + rise[:-1]) / 2) * np.diff(x))])
    columns, rows = int(area[-1] / (depth * dp)), round(depth / dp)
    x = np.interp((np.arange(columns) + 0.5) * area[-1] / columns, area, x)[:, None]
    rise = height / np.cosh(k * (x - middle)) ** 2
    level = (np.arange(rows) + 0.5) / rows  # over the depth there
    u = c * rise / (depth + rise)
    w = level * (u - c) * -2.0 * k * np.tanh(k * (x - middle)) * rise
    places, speeds = [x, level * (depth + rise)], [u, w]
    np.savez(tmp_path / "wave.npz", **{name: np.stack(np.broadcast_arrays(*pair), axis=-1).reshape(-1, 2)
                                       for name, pair in (("position", places), ("velocity", speeds))})  # fmt: skip
    (tmp_path / "flume.conf").write_text(CLOSED.replace("FILE", str(tmp_path / "wave.npz")))
    case = sph.Case(tmp_path / "flume.conf").changed(
        {"numerics.smoothing": smoothing, "numerics.gradient_correction": corrected}
    )
    series = case.run(tmp_path / "run", threads=1).series
    time, tops, passed = np.asarray(series["time"]), [], []
    for name in ("before", "after"):
        found = np.convolve(np.asarray(series[name]) - depth, np.ones(9) / 9, "same")[5:-5]
        top, at = found.max(), np.flatnonzero(found > found.max() / 2)
        tops.append(top)
        passed.append((time[5:-5][at[0]] + time[5:-5][at[-1]]) / 2)
    speed = 1.5 / (passed[1] - passed[0])
    print(f"speed {speed:.3f} m/s, of its height {np.sqrt(9.81 * (depth + np.mean(tops))):.3f}, heights {tops}")
    assert speed == pytest.approx(np.sqrt(9.81 * (depth + np.mean(tops))), rel=0.015)  # a sample is 1.3 %
    assert tops[1] > least


SHAKEN = """
simulation = { dimensions = 2; end_time = 21.0; integrator = "STEP"; };
gravity = [0.0, -9.81];
fluid = ( { shape = { box = { low = [0.0, 0.0]; high = [1.0, 0.3]; }; }; } );
numerics = { spacing = 0.02; };
eos = { max_velocity = 2.5; };
wall = ( { shape = { box = { low = [0.0, 0.0]; high = [1.0, 0.9]; open = ["y+"]; }; };
           motion = { amplitude = [0.02, 0.0]; period = 1.3; stop = 13.0; }; } );
output = { period = { particles = 0.25; }; };
"""


@pytest.mark.parametrize("integrator", ["symplectic", "rk3-tvd"])
def test_shaken_water_keeps_its_volume(integrator, tmp_path):
    """Near resonance, for 13 s, up to twice its depth. The mean height of columns of two spacings while it comes to
    rest; with rates of density where a step begins, not in its middle, "symplectic" has -6 %.
    """
    (tmp_path / "shaken.conf").write_text(SHAKEN.replace("STEP", integrator))
    run = sph.Case(tmp_path / "shaken.conf").run(tmp_path / "shaken", threads=1)
    heights = []
    for t in run.particle_times:
        if t > 17.0:
            x = run.particles("fluid_1", time=t)["position"].values
            column = np.floor((x[:, 0] - x[:, 0].min()) / 0.0501).astype(int)
            heights.append(np.mean([x[column == k, 1].max() + 0.01 for k in range(20) if (column == k).any()]))
    print(f"height at last over that at first {np.mean(heights) / 0.3:.4f}")
    assert np.mean(heights) == pytest.approx(0.3, rel=0.02)
