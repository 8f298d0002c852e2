"""Where a plasma is densest at its start: random places are nowhere, and a dense part is judged by itself."""

import math

import numpy as np
import pytest
from app_runner import running
from forecast_numbers import CASE, numbers

from hpcpic.plasma.configure import configure


def placed(tmp_path, lengths, points, *position, sets=()):
    """The numbers of electrons, and ions, of wp = 1 and 0.001 on the mean, at positions [n, d] in parts of the box."""
    species = []
    for k, x in enumerate(position):
        np.savez(tmp_path / f"{k}.npz", position=x * np.array(lengths))
        sign, mass, wp = ((-1, 1.0, 1.0), (1, 1e6, 1e-3))[k]
        species.append(f"""{{ name = "s{k}"; charge = {sign}; mass = {mass}; thermal_velocity = 0.1;
            plasma_frequency = {wp}; start = {{ file = "{tmp_path / f"{k}.npz"}"; }}; }}""")
    text = f"""simulation = {{ cycles = 100; time_step = 0.1; space_length = {list(lengths)}; }};
    grid = {{ points = {list(points)}; }}; species = ( {", ".join(species)} );"""
    return numbers(sets, text)[0]


SHAPES = [((64.0,), (256,)), ((32.0, 16.0), (64, 33)), ((8.0, 8.0, 4.0), (32, 33, 17))]


@pytest.mark.parametrize("lengths, points", SHAPES)
@pytest.mark.parametrize("n", [1, 40, 700, 20000])
def test_random_places_are_nowhere_dense(tmp_path, lengths, points, n):
    for seed in range(5):
        x = np.random.default_rng(seed).random((n, len(points)))
        assert "wp max" not in placed(tmp_path, lengths, points, x, x)


@pytest.mark.parametrize("lengths, points", SHAPES)
@pytest.mark.parametrize("side", [0.5, 0.25])
def test_a_plasma_that_fills_a_part_is_judged_by_its_density_there(tmp_path, lengths, points, side):
    """A slab, square or cube, of a random part of the box: wp and 1/lambda_D as the root of its density, to noise and
    to bins that lie across its faces; as much with ions, and with three particles far away.
    """
    rng, d = np.random.default_rng(4), len(points)
    x = 0.3 + side * rng.random((40000, d))
    x[:3] = rng.random((3, d))
    mean, denser = placed(tmp_path, lengths, points, rng.random((40000, d))), side ** (-d / 2)
    for found in (placed(tmp_path, lengths, points, x), placed(tmp_path, lengths, points, x, x)):
        assert found["wp"].value == pytest.approx(1.0, rel=1e-5)
        assert found["wp max"].value == pytest.approx(denser, rel=0.1)
        assert found["wp dt"].value == pytest.approx(0.1 * denser, rel=0.1)
        assert found["lambda_D/dx"].value == pytest.approx(mean["lambda_D/dx"].value / denser, rel=0.1)
        assert found["wp t/2pi"].value == pytest.approx(mean["wp t/2pi"].value * denser, rel=0.1)
        assert all("where it is densest" in found[row].name for row in ("wp max", "wp dt", "lambda_D/dx", "wp t/2pi"))


def test_a_loader_that_fills_a_part_is_judged_there_too():
    """Positions in equal steps, in a tenth of the box."""
    one = 'init_method="position delta"; position_init=[0.0]; position_delta=[0.0064];'
    text = CASE.replace("[64.0, 32.0]", "[64.0]").replace("[64, 32]", "[128]").replace("32768", "1000")
    found, _ = numbers(text=text.replace('init_method = "random position";', one))
    assert found["wp max"].value == pytest.approx(math.sqrt(10), rel=0.1)


@pytest.mark.parametrize("places", [4, 8])
def test_a_wave_of_many_strata_is_as_dense_as_one_of_few(places):
    """Density 1/(1 + a cos kx), of which the densest two cells of 64 have 1.98. Of a million particles a part is looked
    at; equal steps through them met one place of each beam, in a quarter or an eighth of the box.
    """
    strata = f'init_method = "strata"; places = {places}; perturbation = {{ mode = [1]; amplitude = 0.5; }};'
    text = CASE.replace("[64.0, 32.0]", "[64.0]").replace("[64, 32]", "[64]").replace("32768", "1048576")
    found, _ = numbers(text=text.replace('init_method = "random position";', strata))
    assert found["wp max"].value == pytest.approx(math.sqrt(1.98), rel=0.01)


@pytest.mark.parametrize("step, verdict", [(0.1, "ok"), (0.27, "warn"), (0.65, "fail")])
def test_a_dense_slab_diverges_where_its_own_step_is_refused(world, tmp_path, step, verdict):
    """A sixteenth of the box, where wp is 4: wp dt is 0.4, 1.1 and 2.6 there, and on the mean below 0.7."""
    x = (0.5 + np.arange(8192)[:, None] / 8192) / 16 + 0.4
    np.savez(tmp_path / "e.npz", position=64.0 * x, velocity=0.01 * np.sin(64 * np.pi * x))
    np.savez(tmp_path / "i.npz", position=64.0 * x)
    text = f"""simulation = {{ cycles = 40; time_step = {step}; space_length = [64.0]; }}; grid = {{ points = [256]; }};
    species = ( {{ name = "e"; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
                   start = {{ file = "{tmp_path / "e.npz"}"; }}; }},
                {{ name = "i"; charge = 1.0; mass = 1e6; plasma_frequency = 1e-3;
                   start = {{ file = "{tmp_path / "i.npz"}"; }}; }} );"""
    found, tree = numbers(text=text)
    assert (found["wp dt"].verdict, found["wp dt"].forceable) == (verdict, True)
    with running(world, "hpcpic", configure(tree)) as app:
        first = app.scalars()["energy_total"]
        for _ in range(40):
            app.step()
        grown = app.scalars()["energy_total"] / first
    assert (grown > 100) == (verdict == "fail")
