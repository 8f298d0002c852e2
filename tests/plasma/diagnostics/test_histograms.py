"""Histograms: integers whose density integrates to the real particles, the same however the work is shared."""

import logging

import numpy as np
import pytest
from app_runner import launch
from figure_texts import unreadable
from plasma_cases import advanced
from scipy.special import ndtr
from seldom import seldom

import hpcpic
from hpcpic.__main__ import load_app
from hpcpic.core.case.config import loads
from hpcpic.core.cli.main import build
from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError
from hpcpic.core.files.histograms import FILE, HistogramsWriter, read_histogram
from hpcpic.core.files.together import ALONE
from hpcpic.plasma.configure import configure

PLANE = """
simulation = { cycles = 8; time_step = 0.2; space_length = [33.0, 50.0]; random_seed = 7; };
grid = { points = [33, 25]; };
field = { magnetic = [0.3, -0.4, 2.0]; };
species = (
  { name = "e"; particles = 30001; charge = -1.0; mass = 2.0; plasma_frequency = 1.0; drift_velocity = [1.0, 0.5, -2.0];
    thermal_velocity = 1.0; },
  { name = "i"; particles = 77; charge = 1.0; mass = 100.0; plasma_frequency = 0.1; } );
histogram = ( { name = "fv"; species = "e"; of = ["vx"]; bins = [40]; }, { name = "fz"; species = "e"; of = ["vz"]; },
  { name = "phase"; species = "e"; of = ["y", "vx"]; bins = [9, 40]; }, { name = "at"; species = "i"; of = ["x", "y"]; }
);
"""
LINE = ("species[0].plasma_frequency=0.1", "species[1].plasma_frequency=0.01",
        "simulation.space_length=[1000.0]", "grid.points=[700]",
        "species[0].drift_velocity=[1.0]", "field.magnetic=[0.0, 0.0, 0.0]", "numerics.precision=single",
        "numerics.shape=NGP",
        'histogram[1].of=["vx"]',
        'histogram[2].of=["x", "vx"]', 'histogram[3].of=["x"]')  # fmt: skip
SCENES = {"2D": (), "1D single": LINE}


def counted(world, *sets, steps=2, threads=1):
    plasma = advanced(PLANE, world, sets, threads, steps)
    found = plasma.histograms()
    plasma.close()
    return found


def bits(found):
    return {name: (one.counts.tobytes(), one.beyond) for name, one in found.items()}


@pytest.mark.parametrize("scene", ["2D", seldom("1D single")])
def test_densities_integrate_to_the_real_particles_and_phase_space_to_f_of_v(world, scene):
    plasma = advanced(PLANE, world, SCENES[scene], steps=2)
    found = plasma.histograms()
    for one, species in ((found["fv"], plasma.scene.species[0]), (found["at"], plasma.scene.species[1])):
        real = species.n * species.m / species.section.mass
        widths = [edges[1] - edges[0] for edges in one.edges.values()]
        assert one.beyond == 0 and (one.counts * one.density).sum() * np.prod(widths) == pytest.approx(real, rel=1e-12)
    assert found["fv"].unit == "s/m" and found["phase"].unit == "s/m2"
    assert np.array_equal(found["phase"].counts.sum(axis=0), found["fv"].counts)
    assert found["phase"].counts.sum() + found["phase"].beyond == 30001
    plasma.close()


@pytest.mark.parametrize("scene", SCENES)
def test_mean_and_variance_are_those_of_the_series(world, scene):
    """At the same time, in a magnetic field too. The middle of a bin is off by at most half its width."""
    more = ("species[1].particles=0", "species[0].plasma_frequency=0.5", "histogram[3].species=e")
    plasma = advanced(PLANE, world, (*SCENES[scene], *more), steps=2)
    values, found, e = plasma.scalars(), plasma.histograms(), plasma.scene.species[0]
    middles = {name: 0.5 * (x[1:] + x[:-1]) for name in ("fv", "fz") for x in found[name].edges.values()}
    means = {name: found[name].counts @ v / e.n for name, v in middles.items()}
    width = np.diff(middles["fv"])[0]
    assert means["fv"] == pytest.approx(values["momentum_x"] / (e.n * e.m), abs=0.5 * width)
    if scene == "1D single":
        variance = found["fv"].counts @ (middles["fv"] - means["fv"]) ** 2 / e.n
        square = 2 * values["energy_kinetic"] / (e.n * e.m)
        assert variance == pytest.approx(square - (values["momentum_x"] / (e.n * e.m)) ** 2, abs=width**2)
    plasma.close()


def test_bins_are_those_of_numpy(world):
    """Without charge the v^(n-1/2) of the particles, turned by half a step, is their drift's direction: a B that turns
    nothing here, as other scenes' kernels do.
    """
    sets = ("field.magnetic=[1e-30, 0.0, 0.0]", "species[0].charge=1e-30", "species[0].plasma_frequency=0.0",
            "species[1].charge=1e-30", "species[1].plasma_frequency=0.0", "histogram[2].low=[10.0, -1.0]",
            "histogram[2].high=[40.0, 2.5]")  # fmt: skip
    plasma = advanced(PLANE, world, sets, steps=2)
    found, e = plasma.histograms()["phase"], plasma.particles()["e"]
    bins = (np.linspace(10, 40, 10), np.linspace(-1, 2.5, 41))
    expected = np.histogram2d(e.position[:, 1], e.columns["velocity"][:, 0], bins=bins)[0]
    assert np.array_equal(found.counts, expected) and found.beyond == 30001 - expected.sum() > 3000
    plasma.close()


@pytest.mark.parametrize("drift, spread", [(0.0, 1.0), (3.0, 0.4)])
def test_strata_are_a_maxwellian(world, drift, spread):
    """100 velocities in each of which as many particles: the count below an edge is right to one of them."""
    text = f"""
    simulation = {{ cycles = 1; time_step = 0.1; space_length = [64.0]; }}; grid = {{ points = [64]; }};
    species = ( {{ particles = 32000; charge = -1.0; mass = 1.0; density = 5.0; thermal_velocity = {spread};
      drift_velocity = [{drift}]; init_method = "strata"; }} );
    histogram = ( {{ of = ["vx"]; bins = [30]; }} );"""
    plasma = advanced(text, world, steps=0)
    (found,) = plasma.histograms().values()
    (edges,) = found.edges.values()
    below = np.concatenate([[0], np.cumsum(found.counts)]) / 32000
    np.testing.assert_allclose(below, ndtr((edges - drift) / spread), atol=1.01 / 1000)
    plasma.close()


@pytest.mark.parametrize("scene", SCENES)
def test_blocks_and_threads_do_not_show(world, scene):
    one, other = (
        counted(world, *SCENES[scene], f"simulation.plasma_chunks={chunks}", threads=threads)
        for chunks, threads in ((1, 1), (5, 2))
    )
    assert bits(one) == bits(other)


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("scene", SCENES)
def test_ranks_do_not_show(world, scene):
    from mpi4py import MPI

    alone = World(MPI.COMM_SELF, MPI.COMM_SELF)
    assert bits(counted(world, *SCENES[scene])) == bits(counted(alone, *SCENES[scene]))


def test_who_lies_in_no_bin_is_told_once(world, caplog):
    plasma = advanced(PLANE, world, ("histogram[0].low=[1.0]", "histogram[0].high=[9.0]"), steps=0)
    with caplog.at_level(logging.WARNING):
        for _ in range(2):
            found = plasma.histograms()["fv"]
    assert found.beyond + found.counts.sum() == 30001 and found.beyond > 10000
    assert [record.getMessage() for record in caplog.records] == [
        f"histogram fv: a share of {found.beyond / 30001:.3g} of e lies beyond its low and high, vx from 1 to 9; "
        "give wider ones in the case"
    ]
    plasma.close()


def test_a_scene_without_has_none(world):
    config = configure(loads(PLANE, sets=["histogram=()"]))
    assert config.periods["histogram"] == 0 and config.output.every.histograms == 0
    plasma = advanced(PLANE, world, ("output.every.histograms=0",), steps=0)
    assert plasma._histograms is None and plasma.histograms() == {}
    plasma.close()


@pytest.mark.parametrize("sets, text", [
    ("histogram[0].species=x", r"histogram\[0\].species: must be one of the species e, i \(got 'x'\)"),
    ('histogram[0].of=["vw"]', r"histogram\[0\].of: 'vw' is no axis of this scene; there are x, y, vx, vy, vz"),
    ("histogram[0].low=[3.0]", r"histogram\[0\].low: give low and high, or neither"),
    ("histogram[2].bins=[2000, 2000]", r"histogram\[2\].bins: at most 1048576 bins in all \(got 4000000\)"),
    ("histogram[2].bins=[20]", r"histogram\[2\].bins: needs 2 number\(s\), one for each of y, vx \(got 1\)"),
    ("histogram[1].name=fv", r"histogram\[1\].name: histogram\[0\] is called 'fv' already"),
    ("histogram[1].name=step", "'step' is no name for a group of a file"),
    ('histogram[0].of=["vx", "vx"]', "needs one axis or two different ones"),
])  # fmt: skip
def test_mistakes_are_told_with_their_key(sets, text):
    with pytest.raises(ConfigError, match=text):
        configure(loads(PLANE, sets=[sets]))
    with pytest.raises(ConfigError, match=r"histogram\[0\].high: must be above low on the axis vx \(got 1, low is 2\)"):
        configure(loads(PLANE, sets=["histogram[0].low=[2.0]", "histogram[0].high=[1.0]"]))


def test_a_run_and_its_restart_hold_the_same(tmp_path):
    """A run in one piece, and one that ends at step 5 and goes on on two ranks."""
    (tmp_path / "case.conf").write_text(PLANE)
    for folder, steps in (("whole", 8), ("parts", 5)):
        case = hpcpic.Case(tmp_path / "case.conf")
        case = case.changed({"output.every.histograms": 2, "simulation.cycles": steps})
        case.run(tmp_path / folder, threads=1, quiet=True)
    done = launch(2, "-m", "hpcpic", "restart", str(tmp_path / "parts"), "--until", "1.6")
    assert done.returncode == 0, done.stderr
    whole, parts = (hpcpic.open_run(tmp_path / folder) for folder in ("whole", "parts"))
    for name in ("fv", "phase", "at"):
        one, other = whole.histogram(name), parts.histogram(name).where(lambda h: h.step != 5, drop=True)
        assert one.step.values.tolist() == [0, 2, 4, 6, 8] == other.step.values.tolist()
        assert np.array_equal(one, other) and np.array_equal(one.beyond, other.beyond)
    assert whole.histogram("fv").vx.attrs["units"] == "m/s" and whole.histogram("phase").attrs["units"] == "s/m2"
    figure = whole.plot("histograms", step=2)
    assert len(figure.axes) == 4 + 2 and not unreadable(figure)  # two maps with their scales
    with pytest.raises(SystemExit) as end:
        build(load_app, "hpcpic", "").main(["plot", str(tmp_path / "whole"), "histograms", "--format", "gif"])
    assert end.value.code == 0 and [*(tmp_path / "whole").rglob("*.gif")]


def test_rows_behind_a_restart_are_written_over(world, tmp_path):
    found = counted(world, "histogram[0].bins=[5]", steps=0)
    writer = HistogramsWriter(ALONE, tmp_path / FILE)
    for step in (0, 1, 2):
        writer.append(step, 0.5 * step, found)
    writer.flush()
    later = counted(world, "histogram[0].bins=[5]", steps=1)
    writer = HistogramsWriter(ALONE, tmp_path / FILE, after=1)
    assert read_histogram(tmp_path, "fv").step.tolist() == [0, 1]
    writer.append(2, 1.0, later)
    writer.flush()
    read = read_histogram(tmp_path, "fv")
    assert read.step.tolist() == [0, 1, 2] and read.time.tolist() == [0.0, 0.5, 1.0]
    for row, one in zip(read.density, (found, found, later)):
        assert np.array_equal(row, one["fv"].counts * one["fv"].density)
