"""Sizes and places of packings."""

import math
import os
import re

import numpy as np
import pytest
from app_runner import running
from scipy.special import betainc

from hpcpic.core.errors import ConfigError
from hpcpic.core.physics.contact_law import ContactLaw
from hpcpic.core.simd.caches import Store
from hpcpic.core.space.domain import Domain, even_cuts
from hpcpic.core.tasks.graph import Pool
from lbmdem.forecast.derived import least_porosity_of_discs
from lbmdem.grains.packing import Sample, beta_diameters, cached, grow, pack, porosity_of, settle, solid_volume


def sample_of(world, n, porosity, d=3, periodic=True, seed=4):
    """A cube of n grains at a porosity, and their diameters from 1 to 2 mm."""
    radius = 0.5 * beta_diameters(n, 1e-3, 2e-3, 1.0, 1.0, seed, d)
    side = (solid_volume(radius, d) / (1.0 - porosity)) ** (1 / d)
    domain = Domain((side,) * d, (12,) * d, (periodic,) + (True,) * (d - 1), even_cuts(12, world.size))
    return domain, Sample(radius, 0.0, side, seed)


def gaps(domain, sample, x):
    """Least gap / diameter of grains, and of grains and rigid ends."""
    d, side, r = domain.ndim, domain.lengths[0], sample.radius
    delta = x[:, None] - x[None]
    periodic = np.array(domain.periodic[::-1])
    delta -= np.where(periodic, side * np.rint(delta / side), 0.0)
    between = np.sqrt(np.square(delta).sum(-1)) - r[:, None] - r[None]
    np.fill_diagonal(between, np.inf)
    ends = np.minimum(x - r[:, None], side - x - r[:, None])[:, ~periodic]
    return min(between.min(), ends.min(initial=np.inf)) / (2 * r.min()), d


@pytest.mark.parametrize(("a", "b", "d"), [(1.0, 1.0, 3), (2.0, 5.0, 3), (0.5, 0.5, 2)])
def test_sizes_follow_the_beta_law_in_volume(a, b, d):
    """The share of volume below a size is the incomplete beta function, to the size of one grain's share."""
    sizes = np.sort(beta_diameters(2000, 1.0, 3.0, a, b, 1, d))
    assert 1.0 <= sizes[0] < sizes[-1] <= 3.0
    volume = np.cumsum(sizes**d)
    shares = (volume - 0.5 * sizes**d) / volume[-1]
    np.testing.assert_allclose(shares, betainc(a, b, (sizes - 1.0) / 2.0), atol=2e-3)


def test_the_seed_only_deals_the_sizes_out():
    one, two = (beta_diameters(100, 1.0, 2.0, 1.0, 2.0, seed) for seed in (1, 2))
    assert np.any(one != two)
    np.testing.assert_array_equal(np.sort(one), np.sort(two))


@pytest.mark.parametrize(("porosity", "periodic", "d"), [(0.5, False, 3), (0.4, True, 3), (0.25, True, 2)])
def test_a_packing_has_the_porosity_asked_for_and_no_overlaps(world, pool, porosity, periodic, d):
    domain, sample = sample_of(world, 40, porosity, d, periodic)
    assert porosity_of(domain, sample) == pytest.approx(porosity)
    x = grow(world, pool, domain, sample)
    least, _ = gaps(domain, sample, x)
    assert least > -2e-3
    assert np.all((x >= 0.0) & (x <= domain.lengths[0]))
    spread = x.std(axis=0) / domain.lengths[0]  # a uniform spread: sqrt(1/12) = 0.289
    assert np.all(np.abs(spread - 0.289) < 0.08)


def test_too_dense_a_packing_is_refused(world, pool):
    with pytest.raises(ConfigError, match="denser than can be"):
        grow(world, pool, *sample_of(world, 40, 0.2))


def test_grains_settle_on_each_other(world, pool):
    """Below a loose state, at rest, none fallen through the floor, the heap's top lower than before."""
    radius = 0.5 * beta_diameters(50, 1e-3, 2e-3, 1.0, 1.0, 3)
    side = 5e-3
    domain = Domain((4 * side, side, side), (8, 2, 2), (False, True, True), even_cuts(8, world.size))
    high = solid_volume(radius, 3) / 0.4 / side**2
    sample = Sample(radius, 0.0, high, 3, 2650.0, 9.81, ContactLaw(300.0, 0.3, 0.5, 1e-3))
    x = settle(world, pool, domain, sample, grow(world, pool, domain, sample))
    assert np.all(x[:, 2] > 0.97 * radius)
    touched = 1.0 - solid_volume(radius, 3) / (side**2 * np.max(x[:, 2] + radius))
    assert 0.36 < touched < 0.55
    assert x[:, 2].mean() < 0.47 * high


@pytest.mark.parametrize("count", [40, 61])
def test_the_floor_bears_grains_that_nothing_brings_to_rest(world, monkeypatch, caplog, count):
    """Without damping and friction: they rang, and the floor bore 1.62 and 0.75 of the weight. Rest is a kinetic energy
    of 1e-5 of what lifts the grains by their radius: 2 % is more than is left in the springs."""
    monkeypatch.setattr("lbmdem.grains.packing.cached", lambda world, facts, made, *rest: made())
    case = f"""
    simulation = {{ end_time = 0.01; }};
    domain = {{ size = [0.01, 0.01, 0.02]; }};
    grains = ({{ density = 2650.0; diameters = {{ min = 1.0e-3; max = 1.2e-3; count = {count}; }}; packing = {{ }}; }});
    contact = {{ normal_stiffness = 1.0e4; damping = 0.0; friction = 0.0; }};
    gravity = [0.0, 0.0, -9.81];
    """
    with caplog.at_level("INFO", "hpcpic.lbmdem"), running(world, "lbmdem", case):
        borne = [float(share) for share in re.findall(r"floor bears (\S+) of its weight", caplog.text)]
    assert len(borne) == 1 and abs(borne[0] - 1.0) <= 0.02


@pytest.mark.parametrize("count", [1, 4, 12])
def test_few_grains_on_a_wide_floor_have_room_to_fall(world, monkeypatch, count):
    """The space that a loose state of so many would fill is lower than a grain, or not much higher."""
    monkeypatch.setattr("lbmdem.grains.packing.cached", lambda world, facts, made, *rest: made())
    case = f"""
    simulation = {{ end_time = 1.0; }};
    domain = {{ size = [4.0e-3, 4.0e-3, 6.0e-3]; periodic = ["x", "y"]; }};
    grains = ({{ diameters = {{ min = 0.8e-3; max = 1.0e-3; count = {count}; }}; packing = {{ }}; }});
    contact = {{ normal_stiffness = 100.0; }};
    gravity = [0.0, 0.0, -9.81];
    """
    with running(world, "lbmdem", case) as app:
        x, radius = app.table.x, app.table.radius
    assert len(x) == count and np.all(x[:, 2] > 0.97 * radius)
    assert x[:, 2].max() < 2.1e-3


@pytest.fixture
def store(tmp_path, monkeypatch):
    """Where packings are kept, for this test alone."""
    monkeypatch.setenv("HPCPIC_CACHE_DIR", str(tmp_path))
    store = Store("packings", "packings")
    monkeypatch.setattr("lbmdem.grains.packing._store", lambda: store)
    return store


def test_a_packing_is_kept_and_a_damaged_one_made_again(world, store, caplog):
    made = []

    def make():
        made.append(1)
        return np.arange(6.0).reshape(2, 3)

    def taken(n, shape=(2, 3), possible=lambda x: x[0, 0] == 0.0):
        return cached(world, {"n": n}, make, shape, possible)

    for expected, n in ((1, 1), (1, 1), (2, 2)):
        np.testing.assert_array_equal(taken(n), np.arange(6.0).reshape(2, 3))
        assert len(made) == expected
    for path in store.folder.path.iterdir():
        content = bytearray(path.read_bytes())
        content[40] ^= 1
        path.write_bytes(content)
    taken(1)
    assert len(made) == 3
    taken(1, shape=(3, 3))
    assert len(made) == 4
    taken(1, possible=lambda x: x[0, 0] == 1.0)
    assert len(made) == 5
    assert len([record for record in caplog.records if "made anew" in record.message]) == 2  # once for each reason


@pytest.mark.parametrize("wrong", [np.nan, 1e300, -1.0])
def test_a_kept_packing_outside_the_box_is_not_taken(world, store, wrong):
    """Whoever wrote it and however it came there."""
    arguments = sample_of(world, 30, 0.5)
    sound = pack(world, Pool(1), *arguments)
    (path,) = store.folder.path.iterdir()
    forged = sound.copy()
    forged[7, 1] = wrong
    store.write(path.name, forged.tobytes())
    np.testing.assert_array_equal(pack(world, Pool(1), *arguments), sound)
    np.testing.assert_array_equal(np.frombuffer(store.read(path.name)).reshape(sound.shape), sound)


def test_a_pipe_or_a_folder_in_the_place_of_a_packing_ends_nothing(world, store):
    def take():
        return cached(world, {"n": 1}, lambda: np.zeros((1, 3)), (1, 3), lambda x: True)

    take()
    (path,) = store.folder.path.iterdir()
    for put in (os.mkfifo, os.mkdir):
        path.unlink()
        put(path)
        assert take().shape == (1, 3)


@pytest.mark.parametrize(
    ("largest", "periodic"),
    [pytest.param(largest, periodic, id=f"{largest}-{'periodic' if periodic else 'closed'}",
                  marks=[] if periodic == (largest != 1.22e-3) else pytest.mark.validation)
     for largest in (1.0e-3, 1.22e-3, 3.0e-3) for periodic in (True, False)],
)  # fmt: skip
def test_check_knows_how_densely_discs_grow(world, pool, largest, periodic):
    """A little below its limit there is no packing, and a little above there is one."""
    n = 100
    radius = 0.5 * beta_diameters(n, 1e-3, largest * (1.0 + 1e-9), 1.0, 1.0, 4, 2)
    solid, d = solid_volume(radius, 2), 2.0 * radius
    grown = {}
    for off in (-0.015, 0.05):
        porosity = 0.15  # the sides that its own limit belongs to
        for _ in range(20):
            side = (solid / (1.0 - porosity)) ** 0.5
            walls = 0.0 if periodic else 2.0 * d.mean() / side
            porosity = least_porosity_of_discs(d.var() / d.mean() ** 2, walls) + off
        domain = Domain((side,) * 2, (8,) * 2, (periodic,) * 2, even_cuts(8, world.size))
        try:
            grow(world, pool, domain, Sample(radius, 0.0, side, 4))
            grown[off] = True
        except ConfigError:
            grown[off] = False
    assert grown == {-0.015: False, 0.05: True}


@pytest.mark.mpi(min_size=2)
def test_a_packing_does_not_depend_on_ranks(world, monkeypatch):
    from hpcpic.core.comm.world import World

    monkeypatch.setattr("lbmdem.grains.packing.cached", lambda world, facts, made, *rest: made())
    found = pack(world, Pool(1), *sample_of(world, 30, 0.5))
    alone = World.alone()
    np.testing.assert_array_equal(found, pack(alone, Pool(1), *sample_of(alone, 30, 0.5)))
    assert math.isfinite(found.sum())
