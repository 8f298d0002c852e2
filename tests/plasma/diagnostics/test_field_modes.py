"""Complex amplitudes of modes: those of numpy's transform of E, and a wave turns them by -w t."""

import numpy as np
import pytest
from plasma_cases import LINE, PLANE, advanced

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError
from hpcpic.core.files.series import Series
from hpcpic.core.study.quantities import parsed
from hpcpic.plasma.analysis.knobs import knobs_of
from hpcpic.plasma.configure import configure

CONVECTED = """
simulation = { cycles = 200; time_step = 0.25; space_length = [10.0]; };
grid = { points = [64]; };
species = ( { particles = 64000; charge = -1.0; mass = 1.0; plasma_frequency = 1e-6; drift_velocity = [0.7];
  init_method = "quiet"; perturbation = { mode = [2]; amplitude = 0.01; }; } );
output = { every = { series = 1; }; modes = [2]; };
"""


def amplitudes(plasma):
    values = plasma.scalars()
    return {name[:-3]: values[name] + 1j * values[f"{name[:-3]}_im"] for name in values if name.endswith("_re")}


def test_all_modes_make_the_field(world):
    """Also the shortest one, which is its own mirror."""
    plasma = advanced(LINE, world, ("grid.points=[12]", "output.modes=[1, 2, 3, 4, 5, 6]"), steps=2)
    found, values, x = amplitudes(plasma), plasma.scalars(), np.arange(12) / 12
    e = plasma.fields()["E"].values[:, 0]
    waves = [(found[f"mode_{n}"] * np.exp(2j * np.pi * n * x)).real for n in range(1, 7)]
    np.testing.assert_allclose(np.sum(waves, axis=0), e - e.mean(), atol=1e-13 * np.abs(e).max())
    for n in range(1, 7):
        assert abs(found[f"mode_{n}"]) == pytest.approx(values[f"mode_{n}"], rel=1e-12)
    plasma.close()


def test_a_mode_of_a_plane_is_the_part_of_e_along_k(world):
    plasma = advanced(PLANE, world, ("output.modes=([0, 1], [2, -3])",), steps=2)
    e = plasma.fields()["E"].values
    ex, ey = (2 * np.fft.fft2(e[..., k]) / e[..., k].size for k in (0, 1))
    kx, ky = 2 / 37.0, -3 / 60.0
    found = amplitudes(plasma)
    assert found["mode_0_1"] == pytest.approx(ey[1, 0], rel=1e-11)
    assert found["mode_2_-3"] == pytest.approx((kx * ex[-3, 2] + ky * ey[-3, 2]) / np.hypot(kx, ky), rel=1e-11)
    plasma.close()


def test_a_wave_that_travels_turns_the_amplitude(world):
    """A density without forces goes with its drift u: w = k u. 1000 particles a cell: 1e-5 of a turn is their grain."""
    plasma = advanced(CONVECTED, world, steps=0)
    began = amplitudes(plasma)["mode_2"]
    for n in range(1, 41):
        plasma.step()
        turned = amplitudes(plasma)["mode_2"] / began
        assert turned == pytest.approx(np.exp(-2j * np.pi * 2 / 10.0 * 0.7 * 0.25 * n), abs=1e-4)
    plasma.close()


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("case, modes", [(LINE, "[1, 3]"), (PLANE, "([1, 2], [0, 3])")], ids=["1D", "2D"])
def test_ranks_do_not_show(world, case, modes):
    from mpi4py import MPI

    alone = World(MPI.COMM_SELF, MPI.COMM_SELF)
    found = []
    for one in (world, alone):
        plasma = advanced(case, one, (f"output.modes={modes}",), steps=3)
        found.append(amplitudes(plasma))
        plasma.close()
    assert found[0] == found[1] and all(found[0].values())


@pytest.mark.parametrize("modes, text", [
    ("([1], [40])", r"output.modes\[1\]: is shorter than two cells: at most 32 wavelengths .* \(got \[40\]\)"),
    ("([1, 2])", r"output.modes\[0\]: needs 1 number\(s\) in 1D \(got 2\)"), ("[0]", "must not be zero"),
    ("[3, 3]", r"output.modes\[1\]: stands there twice"),
])  # fmt: skip
def test_modes_that_the_grid_lacks_are_told(modes, text):
    with pytest.raises(ConfigError, match=text):
        configure(loads(CONVECTED, sets=[f"output.modes={modes}"]))


def test_its_frequency_is_a_quantity_of_a_tradeoff(world):
    config = configure(loads(CONVECTED))
    plasma = advanced(CONVECTED, world, steps=0)
    quantity = parsed("frequency(mode_2_re)", [*plasma.scalar_units], knobs_of(config))
    rows = []
    for _ in range(200):
        rows.append(plasma.scalars()["mode_2_re"])
        plasma.step()
    rows.append(plasma.scalars()["mode_2_re"])
    series = Series({"mode_2_re": np.array(rows)}, {}, np.arange(201), 0.25 * np.arange(201))
    assert quantity.measure(series) == pytest.approx(0.7 * 2 / 10.0, rel=1e-4)  # u / wavelength
    plasma.close()
