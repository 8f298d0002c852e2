"""A loader of one's own is one class, named by the case."""

import numpy as np
import pytest

from hpcpic.core.case.config import loads
from hpcpic.plasma.configure import configure
from hpcpic.plasma.setup import loaders
from hpcpic.plasma.setup.scene import Scene
from hpcpic.plasma.setup.thermal_spread import thermal_spread

CASE = """
simulation = { cycles = 10; time_step = 0.1; space_length = [8.0]; };
grid = { points = [16]; };
species = ( { name = "e"; particles = 64; charge = -1.0; mass = 1.0; drift_velocity = [2.0]; init_method = "swarm"; } );
"""


class Swarm(loaders.Loader):
    """All at one place; velocities rise evenly to the drift."""

    name = "swarm"
    random_positions = False

    def positions(self, batch):
        return np.full((len(batch.ids), 1), 3.0)

    def mean_velocities(self, batch):
        return batch.drift * batch.index[:, None] / batch.n

    def faults(self, section, dimensions):
        if section.particles > 100:
            yield ("particles",), "a swarm has no more than 100"


def test_a_registered_loader_is_known_to_cases_and_asked_for_its_faults(monkeypatch):
    monkeypatch.setattr(loaders, "LOADERS", dict(loaders.LOADERS))
    loaders.register(Swarm())
    species = Scene(configure(loads(CASE))).species[0]
    ids = np.array(species.ids)
    assert (species.positions(ids) == 3.0).all()
    np.testing.assert_array_equal(species.velocities(ids)[:, 0], 2.0 * ids / 64)
    with pytest.raises(Exception, match="a swarm has no more than 100"):
        configure(loads(CASE, sets=["species[0].particles=101"]))


def test_a_name_belongs_to_one_class_of_loaders(monkeypatch):
    monkeypatch.setattr(loaders, "LOADERS", dict(loaders.LOADERS))
    loaders.register(Swarm())
    loaders.register(Swarm())  # as by a cell of a notebook that is run twice
    monkeypatch.setattr(Swarm, "name", "quiet")
    with pytest.raises(ValueError, match="another loader 'quiet': give yours another name"):
        loaders.register(Swarm())


class Hot(loaders.Loader):
    """Velocities of its own, wider than any drift that the case says."""

    name = "swarm"

    def populations(self, section, axis):
        return loaders.Population(0.5, 1.0, 2.0), loaders.Population(0.5, -3.0, 0.5)


def test_without_fastest_a_loader_is_judged_by_six_deviations_of_its_populations(monkeypatch):
    """The shipped ones by what they say: their drift, beside the thermal deviate, which is told apart."""
    monkeypatch.setattr(loaders, "LOADERS", dict(loaders.LOADERS))
    loaders.register(Hot())
    (species,) = configure(loads(CASE)).species
    assert loaders.loader_of(species).fastest(species).components == (13.0, 13.0, 13.0)
    for word in ("random", "quiet", "opposite beams", "uniform velocities"):
        warm = "0" if word == "uniform velocities" else "3"
        sets = [f'species[0].init_method="{word}"', f"species[0].thermal_velocity={warm}"]
        (species,) = configure(loads(CASE, sets=sets)).species
        assert loaders.loader_of(species).fastest(species) == ((2.0, 0.0, 0.0), 2.0)


def test_a_loader_that_nobody_registered_is_a_fault():
    with pytest.raises(Exception, match="init_method: must be 'random', 'quiet'"):
        configure(loads(CASE))


@pytest.mark.parametrize("d", [1, 2, 3])
def test_the_spread_of_given_velocities_is_that_of_neighbours(d):
    """A wave is no heat, and equal velocities have none; the standard deviation of 0.8 three times is 1e-16."""
    random = np.random.default_rng(1)
    x, v = random.random((4000, d)), random.normal(0.0, 1.0, 4000)
    assert thermal_spread(x, v) == pytest.approx(1.0, rel=0.05)
    wave = 5.0 * np.sin(2 * np.pi * x[:, 0])
    assert thermal_spread(x, wave) < 0.2 * wave.std()
    assert thermal_spread(x, np.full(4000, 0.8)) == 0.0 == thermal_spread(x[:1], v[:1])
    assert thermal_spread(None, v) == v.std()


@pytest.mark.parametrize("places, velocities", [(64, 1024), (1024, 64), (16384, 16)])
def test_the_spread_of_given_velocities_does_not_depend_on_their_order(places, velocities):
    """At each place the same even set: a quiet start by hand, by places, by velocities and in any order."""
    angle = 2 * np.pi * (np.arange(velocities) + 0.5) / velocities
    x, v = (each.ravel() for each in np.meshgrid((np.arange(places) + 0.5) / places, np.cos(angle), indexing="ij"))
    mixed = np.random.default_rng(1).permutation(len(v))
    by_velocity = np.arange(len(v)).reshape(places, velocities).T.ravel()
    for order in (np.arange(len(v)), by_velocity, mixed):
        assert thermal_spread(x[order, None], v[order]) == pytest.approx(np.sqrt(0.5), rel=0.03)


def test_a_cold_beam_whose_velocity_varies_has_no_spread_and_a_warm_one_its_own():
    x = (np.arange(8192) + 0.5)[:, None] / 8192
    wave, heat = np.sin(4 * np.pi * x[:, 0]), np.random.default_rng(1).normal(0.0, 0.1, 8192)
    assert thermal_spread(x, 3.0 + wave) == 0.0
    assert thermal_spread(x, 3.0 + wave + heat) == pytest.approx(0.1, rel=0.05)
