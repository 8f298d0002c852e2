import numpy as np
import pytest

from hpcpic.core.comm.migrate import Migrate, recut_field, recut_particles, send_anywhere
from hpcpic.core.comm.tags import Channel, tag
from hpcpic.core.space.domain import Domain, block_ranges, even_cuts
from hpcpic.core.space.fields import Field
from hpcpic.core.space.particles import Particles

RECORD = 24
TOTAL = 300


def records(ids):
    """A record is the id, its square and a checksum."""
    ids = np.asarray(ids, np.int64)
    return np.stack([ids, ids**2, ~ids], 1).view(np.uint8)


def ids_of(arrivals):
    """Ids of all arrivals, after looking at every byte of them."""
    whole = np.concatenate([np.zeros((0, RECORD), np.uint8), *arrivals])
    ids = whole.view(np.int64)[:, 0].copy()
    np.testing.assert_array_equal(whole, records(ids))
    return ids


class Walk:
    """Ids that jump between ranks by a rule all ranks know, so each rank knows which ids should have come."""

    def __init__(self, world):
        self.world = world
        self.owner = np.arange(TOTAL) % world.size
        self.ids = np.flatnonzero(self.owner == world.rank)

    def step(self, migrate, iteration, destination):
        """destination[TOTAL]: rank of each id. Returns how many ids changed the rank."""
        mine = destination[self.ids]
        outgoing = {int(peer): records(self.ids[mine == peer]) for peer in np.unique(mine)}
        migrate.start(iteration, outgoing)
        self.ids = ids_of(migrate.finish())
        np.testing.assert_array_equal(np.sort(self.ids), np.flatnonzero(destination == self.world.rank))
        moved = np.count_nonzero(destination != self.owner)
        self.owner = destination
        return moved


def check_any_jumps(world, iterations, capacity):
    walk, migrate, moved = Walk(world), Migrate(world, RECORD, Channel.PARTICLES, capacity=capacity), 0
    rng = np.random.default_rng(11)  # the same on all ranks
    for iteration in iterations:
        if iteration % 3:  # few, near and far
            jumps = rng.integers(-world.size, world.size + 1, TOTAL) * (rng.random(TOTAL) < 0.05)
            destination = (walk.owner + jumps) % world.size
        else:
            destination = rng.integers(0, world.size, TOTAL)
        moved += walk.step(migrate, iteration, destination)
    assert world.sum_int(np.array([migrate.moved]))[0] == moved
    return migrate


WRAP = [-2, -1, 0, 1, *range(508, 516), *range(1020, 1028)]


def test_migration_on_one_rank_keeps_all(world):
    migrate = check_any_jumps(world, WRAP, 4)
    assert migrate.messages == migrate.moved == 0


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("capacity", [0, 1, 7, TOTAL])
def test_no_record_is_lost_doubled_or_changed_for_any_jumps(world, capacity):
    migrate = check_any_jumps(world, WRAP, capacity)
    assert migrate.capacity >= capacity


@pytest.mark.mpi(min_size=2)
def test_everybody_on_one_rank_and_back(world):
    walk, migrate = Walk(world), Migrate(world, RECORD, Channel.PARTICLES, capacity=2)
    for iteration in range(6):
        crowd = np.full(TOTAL, iteration % world.size)
        walk.step(migrate, iteration, crowd)
        walk.step(migrate, iteration, np.arange(TOTAL) % world.size)


@pytest.mark.mpi(min_size=2)
def test_near_moves_take_one_round_and_capacity_grows_once(world):
    walk, migrate = Walk(world), Migrate(world, RECORD, Channel.PARTICLES, capacity=8)
    n_near = min(2, world.size - 1)
    first = walk.owner.copy()
    few = (np.arange(TOTAL) < 6) + first
    walk.step(migrate, 0, few % world.size)
    assert migrate.messages == n_near and migrate.capacity == 8
    walk.step(migrate, 1, (walk.owner + 1) % world.size)  # all at once: overflow
    assert migrate.messages == 2 * n_near + 1
    grown = migrate.capacity
    assert grown >= TOTAL // world.size and world.max(grown) == grown
    walk.step(migrate, 2, (walk.owner + 1) % world.size)  # now they fit
    assert migrate.messages == 3 * n_near + 1 and migrate.capacity == grown


@pytest.mark.mpi(min_size=3)
def test_neighbours_skip_empty_slabs(world):
    """Ranks without rows are no neighbours, but they can send and get."""
    cuts = (0, 4, *[4] * (world.size - 2), 8)
    walk, migrate = Walk(world), Migrate(world, RECORD, Channel.PARTICLES, cuts=cuts)
    full = np.array([0, world.size - 1])
    walk.step(migrate, 0, full[np.arange(TOTAL) % 2])  # the empty ranks send all away
    sent = migrate.messages
    walk.step(migrate, 1, full[np.arange(1, TOTAL + 1) % 2])
    assert migrate.messages - sent == (world.rank in full)  # one message each way, and no second round
    walk.step(migrate, 2, np.arange(TOTAL) % world.size)


@pytest.mark.mpi(min_size=2)
def test_two_migrations_under_way_do_not_mix(world):
    channels = (Channel.PARTICLES, Channel.PARTICLES_2)
    electrons, ions = (Migrate(world, RECORD, channel, capacity=3) for channel in channels)
    mine = np.arange(world.rank, TOTAL, world.size)
    following = (world.rank + 1) % world.size
    for iteration in range(4):
        electrons.start(iteration, {following: records(mine)})
        ions.start(iteration, {following: records(mine + 1000)})
        previous = np.arange((world.rank - 1) % world.size, TOTAL, world.size)
        np.testing.assert_array_equal(np.sort(ids_of(electrons.finish())), previous)
        np.testing.assert_array_equal(np.sort(ids_of(ions.finish())), previous + 1000)


def check_send_anywhere(world):
    ids = np.arange(world.rank, TOTAL, world.size)
    destination = (ids * 7919) % world.size
    outgoing = {int(peer): records(ids[destination == peer]) for peer in np.unique(destination)}
    arrived = ids_of(send_anywhere(world, outgoing, RECORD, tag(5, Channel.SHARDS)))
    everything = np.arange(TOTAL)
    np.testing.assert_array_equal(
        np.sort(arrived), everything[(everything * 7919) % world.size == world.rank]
    )
    assert np.all(np.diff(arrived % world.size) >= 0)  # in the order of ranks
    assert send_anywhere(world, {}, RECORD, tag(6, Channel.SHARDS)) == []


def check_recut_field(world, leading, dtype):
    rows = 9
    domain = Domain((1.0, 1.0), (rows, 5), (True, True), even_cuts(rows, world.size))
    full = np.random.default_rng(3).random((*leading, rows, 5)).astype(dtype)
    field = Field(domain, world.rank, leading=leading, dtype=dtype, ghosts=((1, 1), (0, 2)))
    at = (slice(None),) * len(leading)
    field.inner[...] = full[(*at, slice(*field.rows))]
    inner = [0, 9, 4, 4, 1, 7, 0]
    for turn in range(4):
        cuts = (0, *sorted(inner[turn : turn + world.size - 1]), rows)
        field = recut_field(world, field, domain.with_cuts(cuts))
        assert field.rows == (cuts[world.rank], cuts[world.rank + 1])
        np.testing.assert_array_equal(field.inner, full[(*at, slice(*field.rows))])
        assert field.values.sum() == field.inner.sum() or field.values.size != field.inner.size
        assert np.count_nonzero(field.values) == np.count_nonzero(field.inner)  # ghosts are zero


def check_recut_particles(world):
    low, high = block_ranges(TOTAL, world.size)[world.rank]
    particles = Particles({"x": (np.float64, (2,))})
    ids = np.arange(low, high)
    particles.append({"id": ids, "x": np.stack([ids / 3, ids / 7], 1)})
    for rule in (lambda i: i % world.size, lambda i: 0 * i, lambda i: (i * 31 // 7) % world.size):
        recut_particles(world, particles, rule(particles.columns["id"]))
        ids = particles.columns["id"]
        everything = np.arange(TOTAL)
        np.testing.assert_array_equal(np.sort(ids), everything[rule(everything) == world.rank])
        np.testing.assert_array_equal(particles.columns["x"], np.stack([ids / 3, ids / 7], 1))


def test_general_round_and_new_cuts_on_one_rank(world):
    check_send_anywhere(world)
    check_recut_field(world, (2,), np.float64)
    check_recut_particles(world)


@pytest.mark.mpi(min_size=2)
def test_records_go_anywhere(world):
    check_send_anywhere(world)


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("leading, dtype", [((), np.float64), ((2, 3), np.float32), ((), np.int64)])
def test_a_field_is_the_same_on_new_cuts(world, leading, dtype):
    check_recut_field(world, leading, dtype)


@pytest.mark.mpi(min_size=2)
def test_particles_are_the_same_on_new_cuts(world):
    check_recut_particles(world)
