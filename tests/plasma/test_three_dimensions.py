"""Laws of a box with a third axis: uniform along z it is the 2D run, no axis is singled out, waves run off axis."""

import numpy as np
import pytest

import hpcpic
from hpcpic.plasma.analysis import theory
from hpcpic.plasma.analysis.series_analysis import fit_oscillation

ROUNDING = 1e-11  # of positions in boxes and of velocities: the sums of a transform and of forces, some ten steps long


def electrons(points, lengths, position, velocity, magnetic=(0.0, 0.0, 0.0), density=1.0, **more):
    """Electrons of a density, wp = 1, that start from arrays."""
    n = len(position)
    charge = density * np.prod(lengths) / n
    return hpcpic.Case(
        simulation={"cycles": 12, "time_step": 0.2, "space_length": list(lengths)},
        grid={"points": list(points)},
        field={"magnetic": list(magnetic)},
        species=[{"name": "electrons", "particles": n, "charge": -charge, "mass": charge,
                  "start": {"position": position, "velocity": velocity}}],
        **more,
    )  # fmt: skip


def end_of(case):
    """Positions and velocities after the run, and its scalars."""
    with case.simulation(threads=1) as simulation:
        simulation.advance()
        particles = simulation.particles()
        return particles["position"].values, particles["velocity"].values, simulation.scalars()


def apart(x, y, lengths):
    """The largest distance between positions in a periodic box, in boxes."""
    moved = (x - y) / lengths
    return np.abs(moved - np.rint(moved)).max()


def test_what_is_uniform_along_z_is_the_run_of_two_dimensions():
    """Particles on each of the planes of nodes, at rest along z: nothing pushes them off their planes."""
    rng = np.random.default_rng(3)
    lengths, points, planes = np.array([6.0, 5.0]), (12, 9), 10
    x, v = rng.random((400, 2)) * lengths, rng.standard_normal((400, 2))
    flat_x, flat_v, flat = end_of(electrons(points, lengths, x, v))
    z = np.repeat(np.arange(planes) * 0.7, len(x))
    deep_x = np.column_stack([np.tile(x, (planes, 1)), z])
    deep_v = np.column_stack([np.tile(v, (planes, 1)), 0 * z])
    deep = end_of(electrons((*points, planes), (*lengths, 0.7 * planes), deep_x, deep_v))
    assert apart(deep[0][:, :2], np.tile(flat_x[:, :2], (planes, 1)), lengths) < ROUNDING
    assert np.abs(deep[1][:, :2] - np.tile(flat_v[:, :2], (planes, 1))).max() < ROUNDING
    assert apart(deep[0][:, 2], z, 0.7 * planes) < ROUNDING
    assert np.abs(deep[1][:, 2]).max() < ROUNDING
    for name in ("energy_field", "energy_kinetic"):
        assert deep[2][name] == pytest.approx(0.7 * planes * flat[name], rel=ROUNDING)
    assert deep[2]["mode_2"] == pytest.approx(flat["mode_2"], rel=1e-9)


@pytest.mark.parametrize("gradient", ["difference", "spectral"])
def test_no_axis_is_singled_out(gradient):
    """Axes, positions, velocities and a magnetic field in any direction go round together: so does the result."""
    rng = np.random.default_rng(4)
    lengths, points, b = np.array([6.0, 5.0, 4.0]), np.array([12, 9, 10]), np.array([0.3, -0.2, 0.5])
    x, v = rng.random((900, 3)) * lengths, rng.standard_normal((900, 3))
    found = []
    for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2]):
        handed = 1.0 if order != [1, 0, 2] else -1.0  # B is an axial vector: it turns round in a mirror
        case = electrons(points[order].tolist(), lengths[order].tolist(), x[:, order], v[:, order],
                         (handed * b[order]).tolist(), numerics={"gradient": gradient})  # fmt: skip
        position, velocity, scalars = end_of(case)
        back = np.argsort(order)
        found.append((position[:, back], velocity[:, back], scalars["energy_field"]))
    for position, velocity, energy in found[1:]:
        assert apart(position, found[0][0], lengths) < ROUNDING
        assert np.abs(velocity - found[0][1]).max() < ROUNDING
        assert energy == pytest.approx(found[0][2], rel=1e-10)


def test_fields_stand_at_their_places():
    """The charge of one particle is that of the eight nodes about it, each as near as its weight says."""
    case = electrons((4, 5, 6), (4.0, 5.0, 6.0), np.array([[1.25, 2.5, 3.75]]), np.zeros((1, 3)))
    with case.simulation(threads=1) as simulation:
        rho = simulation.fields("rho")
        assert rho.dims == ("z", "y", "x")
        for x, wx in ((1, 0.75), (2, 0.25)):
            for y, wy in ((2, 0.5), (3, 0.5)):
                for z, wz in ((3, 0.25), (4, 0.75)):
                    assert float(rho.sel(x=x, y=y, z=z)) == pytest.approx(-120.0 * wx * wy * wz, abs=1e-11)


@pytest.mark.parametrize("shape", ["CIC", *(pytest.param(s, marks=pytest.mark.validation) for s in ("NGP", "TSC"))])
def test_momentum_is_kept_along_every_axis(shape):
    rng = np.random.default_rng(5)
    lengths = np.array([6.0, 5.0, 4.0])
    x, v = rng.random((500, 3)) * lengths, rng.standard_normal((500, 3))
    case = electrons((12, 9, 10), lengths, x, v, numerics={"shape": shape})
    with case.simulation(threads=1) as simulation:
        before = simulation.scalars()
        simulation.advance()
        after = simulation.scalars()
    for name in ("momentum_x", "momentum_y", "momentum_z"):
        assert abs(after[name] - before[name]) < 1e-12 * np.prod(lengths)  # mass times a thermal speed of 1
    assert abs(after["momentum_z"]) > 1.0


def test_a_cold_wave_off_the_axes_has_the_frequency_of_the_scheme():
    """k along (1, 2, 1) in a box of unequal sides. What is left is the finite amplitude and the length of the run."""
    lengths, points, mode = (6.0, 8.0, 5.0), (16, 24, 12), (1, 2, 1)
    case = hpcpic.Case(
        simulation={"cycles": 500, "time_step": 0.2, "space_length": list(lengths)},
        grid={"points": list(points)},
        species=[{"name": "electrons", "particles": 16 * 24 * 12 * 8, "charge": -1.0, "mass": 1.0,
                  "plasma_frequency": 1.0, "init_method": "quiet",
                  "perturbation": {"mode": list(mode), "amplitude": 1e-4}}],
        output={"modes": [list(mode)]},
    )  # fmt: skip
    t, wave = [], []
    with case.simulation(threads=2) as simulation:
        for _ in range(500):
            simulation.step()
            t.append(simulation.time)
            row = simulation.scalars()
            wave.append(row["mode_1_2_1_im"])
    k = 2 * np.pi * np.array(mode) / lengths
    expected = theory.cold_wave_frequency(1.0, 0.2, k, np.array(lengths) / points, per_cell=2)
    fit = fit_oscillation(np.array(t), np.array(wave), frequency=expected, damped=False)
    print(fit.frequency, expected, fit.frequency / expected - 1)
    assert fit.frequency == pytest.approx(expected, rel=2e-6)
