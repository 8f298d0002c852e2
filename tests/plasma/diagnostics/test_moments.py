"""Sums in time: exact, so the same from vectors and from single particles, from any ranks, after any history."""

import math
from functools import partial

import numpy as np
import pytest
from plasma_cases import advanced

from hpcpic.core.comm.world import World
from hpcpic.plasma.diagnostics.series_sums import LEAST, TOP, SeriesSums

CASE = """
simulation = { dimensions = 2; cycles = 3; time_step = 0.2; space_length = [40.0, 24.0]; random_seed = 7; };
grid = { points = [40, 32]; };
species = (
  { name = "e"; particles = 3001; charge = -1.0; mass = 1.0; drift_velocity = [1.0, 0.0];
    thermal_velocity = 1.0; init_method = "random position"; plasma_frequency = 1.0; },
  { name = "i"; particles = 77; charge = 1.0; mass = 100.0; drift_velocity = [0.5, 0.0];
    plasma_frequency = 0.1; init_method = "random position"; }
);
"""
FLAT = (
    "simulation.dimensions=1", "simulation.space_length=[1000.0]", "grid.points=[1000]",
    "species[0].drift_velocity=[1.0]", "species[1].drift_velocity=[0.5]",
)  # fmt: skip
LAWS = {
    "2D": (),
    "2D, B along z": ("field.magnetic=[0.0, 0.0, 0.5]", "field.electric=[0.1, 0.2, 0.0]"),
    "2D, any B": ("field.magnetic=[0.1, 0.2, 0.5]", "field.electric=[0.1, 0.2, 0.3]"),
    "2D, exact": ("field.magnetic=[0.1, 0.2, 5.0]", "field.electric=[0.1, 0.2, 0.3]", "numerics.exact_phase=true"),
    "1D": FLAT,
    "1D, any B": (*FLAT, "field.magnetic=[0.1, 0.2, 0.5]", "field.electric=[0.1, 0.2, 0.3]"),
}


plasma_of = partial(advanced, CASE)


BY_DEFAULT = [("2D", "single"), ("2D, any B", "double"), ("2D, exact", "double"), ("1D", "double")]
BOTH = [
    pytest.param(law, way, marks=[] if (law, way) in BY_DEFAULT else pytest.mark.validation)
    for law in LAWS
    for way in ("double", "single")
]  # by default those of the modules that test_push compiles


@pytest.mark.parametrize(("law", "precision"), BOTH)
def test_vectors_sum_what_single_particles_do(world, law, precision):
    plasma = plasma_of(world, (*LAWS[law], f'numerics.precision="{precision}"'))
    values = plasma.scalars()
    by_vectors, places = plasma.cloud.arena["limbs"].copy(), plasma.sums.places
    assert by_vectors[..., :2].all(axis=(0, 3)).any()
    plasma.cloud.kernels = plasma.cloud.spec.kernels(plain=True)
    plasma.sums = SeriesSums(plasma.scene, world, plasma.mesh, plasma.cloud, plasma.field_scale)
    assert plasma.scalars() == values
    np.testing.assert_array_equal(plasma.cloud.arena["limbs"], by_vectors)
    apart = np.abs(np.array(plasma.sums.places, object) - np.array(places, object)).max(axis=1)
    assert (apart <= plasma.sums.counts()).all()  # each place is rounded to 2^-40 of a cell
    plasma.close()


def test_energies_and_momenta_are_those_of_the_particles(world):
    """Charges so small that v- is v: sums can be made of what the files get."""
    neutral = (f"species[{k}].{what}" for k in (0, 1) for what in ("charge=1e-30", "plasma_frequency=0.0"))
    plasma = plasma_of(world, (*neutral, "species[0].mass=2.0"))
    values, particles = plasma.scalars(), plasma.particles()
    v = particles["e"].columns["velocity"]
    ions = particles["i"].columns["velocity"]
    energy = math.fsum((v**2).ravel()) + 50 * math.fsum((ions**2).ravel())
    momentum = 2 * v.sum(axis=0) + 100 * ions.sum(axis=0)
    # the velocities in m/s and each of the sums are rounded, each to 2^-53
    assert values["energy_kinetic"] == pytest.approx(energy, rel=1e-14)
    found = values["momentum_x"], values["momentum_y"]
    np.testing.assert_allclose(found, momentum[:2], rtol=0, atol=1e-14 * 100 * np.abs(ions).sum())
    nodes = math.fsum(((plasma.mesh.rho + plasma.scene.background) * plasma.mesh.phi.inner).ravel())
    assert values["energy_field"] == pytest.approx(nodes * plasma.scene.cell_volume / 2, rel=1e-15)
    spectrum = np.abs(np.fft.rfft(plasma.mesh.e[0][plasma.mesh.inside].mean(axis=0))) * 2 / 40
    found = [values[f"mode_{n}"] for n in range(1, 9)]
    np.testing.assert_allclose(found, spectrum[1:9], atol=1e-13 * spectrum.max())
    plasma.close()


@pytest.mark.parametrize("levels", [(LEAST, LEAST), (TOP, TOP), (0, 40), (-40, 3)])
def test_a_sample_does_not_depend_on_earlier_ones(world, levels):
    plasma = plasma_of(world)
    values = plasma.scalars()
    plasma.sums.levels = list(levels)
    assert plasma.scalars() == values
    plasma.close()


def test_what_is_not_finite_makes_its_scalars_no_numbers(world):
    plasma = plasma_of(world)
    good = plasma.scalars()
    plasma.mesh.phi.inner[3, 4] = np.nan
    values = plasma.scalars()
    assert {name for name in values if math.isnan(values[name])} == {"energy_field", "energy_total"}
    plasma.mesh.phi.inner[3, 4], plasma.mesh.e[0][5, 5] = 0, np.inf
    assert all(math.isnan(plasma.scalars()[f"mode_{n}"]) for n in range(1, 9))
    plasma.mesh.e[0][5, 5] = 0
    page = plasma.cloud.arena["head"][0]
    plasma.cloud.arena["pool"][page, 0, 2, 0] = np.nan
    values = plasma.scalars()
    assert math.isnan(values["energy_kinetic"]) and math.isnan(values["momentum_x"])
    assert values["charge"] == good["charge"]
    plasma.close()


def test_fast_particles_are_summed_at_a_larger_scale(world):
    plasma = plasma_of(world)
    before = plasma.scalars()["momentum_x"]
    page, speed = plasma.cloud.arena["head"][0], 2.0**20
    plasma.cloud.arena["pool"][page, 0, 2, 0] += speed
    scene = plasma.scene
    more = scene.species[0].m * speed * scene.spacing[0] / scene.time_step
    assert plasma.scalars()["momentum_x"] - before == pytest.approx(more, rel=1e-12)
    plasma.close()


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("law", ["2D", "1D"])
def test_any_ranks_and_threads_give_the_same_bits_with_one_reduction(world, law, monkeypatch):
    from mpi4py import MPI

    plasma = plasma_of(world, LAWS[law], threads=2)
    plasma.scalars()
    reductions = []
    plain = world._reduce
    monkeypatch.setattr(world, "_reduce", lambda *what: reductions.append(1) or plain(*what))
    values = plasma.scalars()
    assert len(reductions) == 1
    alone = plasma_of(World(MPI.COMM_SELF, MPI.COMM_SELF), LAWS[law])
    assert alone.scalars() == values
    alone.close()
    plasma.close()
