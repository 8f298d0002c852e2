from contextlib import contextmanager

import numpy as np
import pytest

from hpcpic.core.comm.migrate import Migrate, send_anywhere
from hpcpic.core.comm.tags import WINDOW, Channel, tag
from hpcpic.core.tasks.graph import Graph, Pool

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

    def __init__(self, world, capacity, cuts=None):
        self.world = world
        self.migrate = Migrate(world, RECORD, Channel.PARTICLES, cuts=cuts, capacity=capacity)
        self.pool = Pool(1, spin_limit_s=20.0)
        self.connect()
        self.owner = np.arange(TOTAL) % world.size
        self.ids = np.flatnonzero(self.owner == world.rank)
        self.rounds = 0  # of all ranks with all
        self.iteration = 0

    def connect(self):
        self.graph = Graph()
        self.migrate.add_to(self.graph, written=["letters"], arrived="arrived")
        self.graph.freeze()

    def step(self, destination, way="graph"):
        """destination[TOTAL]: rank of each id."""
        mine = destination[self.ids]
        outgoing = {int(peer): records(self.ids[mine == peer]) for peer in np.unique(mine)}
        stay = outgoing.pop(self.world.rank, records([]))
        before = self.migrate.capacity
        arrived = self.by_graph(outgoing) if way == "graph" else self.migrate.send(self.iteration, outgoing)
        self.rounds += int(self.migrate.wants[0])
        self.ids = ids_of([stay, *arrived])
        if self.migrate.capacity != before:
            self.connect()
        np.testing.assert_array_equal(np.sort(self.ids), np.flatnonzero(destination == self.world.rank))
        self.owner = destination
        self.iteration += 1

    def by_graph(self, outgoing):
        """What `send` does, as tasks would."""
        migrate = self.migrate
        for peer, letter in zip(migrate.peers, migrate.outgoing):
            wanted = outgoing.pop(peer, records([]))
            n = letter.n[0] = min(len(wanted), migrate.capacity)
            letter.records[:n] = wanted[:n]
            if n < len(wanted):
                outgoing[peer] = wanted[n:]
        migrate.wants[0] = bool(outgoing)
        migrate.at(self.iteration)
        self.pool.run(self.graph)
        arrived = [letter.records[: letter.n[0]] for letter in migrate.incoming]
        assert migrate.wants[0] == self.world.any(bool(outgoing))
        return arrived + (migrate.rest(self.iteration, outgoing) if migrate.wants[0] else [])

    def close(self):
        self.migrate.free()
        self.pool.close()


@contextmanager
def walking(world, capacity, cuts=None):
    walk = Walk(world, capacity, cuts)
    yield walk
    walk.close()


WRAP = [-2, -1, 0, 1, *range(WINDOW - 4, WINDOW + 4), *range(2 * WINDOW - 4, 2 * WINDOW + 4)]


def check_any_jumps(world, capacity):
    rng = np.random.default_rng(11)  # the same on all ranks
    with walking(world, capacity) as walk:
        for turn, iteration in enumerate(WRAP):
            walk.iteration, way = iteration, ("graph", "send")[turn // 2 % 2]
            if iteration % 3:  # few, near and far
                jumps = rng.integers(-world.size, world.size + 1, TOTAL) * (rng.random(TOTAL) < 0.05)
                walk.step((walk.owner + jumps) % world.size, way)
            else:
                walk.step(rng.integers(0, world.size, TOTAL), way)
        return walk


def test_migration_on_one_rank_keeps_all(world):
    assert check_any_jumps(world, 4).rounds == 0


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("capacity", [0, 1, 7, TOTAL])
def test_no_record_is_lost_doubled_or_changed_for_any_jumps(world, capacity):
    assert check_any_jumps(world, capacity).migrate.capacity >= capacity


@pytest.mark.mpi(min_size=2)
def test_two_migrations_under_way_do_not_mix(world):
    mine, following = np.arange(world.rank, TOTAL, world.size), (world.rank + 1) % world.size
    previous = np.arange((world.rank - 1) % world.size, TOTAL, world.size)
    both = [Migrate(world, RECORD, channel, capacity=TOTAL) for channel in (Channel.PARTICLES, Channel.SHARDS)]
    graph, pool = Graph(), Pool(1, spin_limit_s=20.0)
    for k, migrate in enumerate(both):
        migrate.add_to(graph, written=[("letters", k)], arrived=("arrived", k))
        for peer, letter in zip(migrate.peers, migrate.outgoing):
            sent = records(mine + 1000 * k) if peer == following else records([])
            letter.n[0], letter.records[: len(sent)] = len(sent), sent
    pool.run(graph.freeze())
    for k, migrate in enumerate(both):
        arrived = ids_of([letter.records[: letter.n[0]] for letter in migrate.incoming])
        np.testing.assert_array_equal(np.sort(arrived), previous + 1000 * k)
        assert not migrate.wants[0]
        migrate.free()
    pool.close()


@pytest.mark.mpi(min_size=2)
def test_everybody_on_one_rank_and_back(world):
    with walking(world, 2) as walk:
        for iteration in range(6):
            walk.step(np.full(TOTAL, iteration % world.size))
            walk.step(np.arange(TOTAL) % world.size)


@pytest.mark.mpi(min_size=2)
def test_near_moves_take_one_round_and_capacity_grows_once(world):
    with walking(world, 8) as walk:
        first = walk.owner.copy()
        few = (np.arange(TOTAL) < 6) + first
        walk.step(few % world.size)
        assert walk.rounds == 0 and walk.migrate.capacity == 8
        walk.step((walk.owner + 1) % world.size)  # all at once: overflow
        grown = walk.migrate.capacity
        assert walk.rounds == 1 and grown >= TOTAL // world.size and world.max(grown) == grown
        walk.step((walk.owner + 1) % world.size)  # now they fit
        assert walk.rounds == 1 and walk.migrate.capacity == grown


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("wanting", range(4))
@pytest.mark.parametrize("way", ["graph", "send"])
def test_all_ranks_learn_that_one_wants_a_second_round_and_forget_it(world, wanting, way):
    """Capacity 0: whoever has a record for a neighbour wants one."""
    with walking(world, 0) as walk:
        jumper = np.flatnonzero(walk.owner == wanting % world.size)[:1]
        walk.step(walk.owner.copy(), way)
        assert walk.rounds == 0
        there = walk.owner.copy()
        there[jumper] = (there[jumper] + 1) % world.size
        walk.step(there, way)
        assert walk.rounds == 1
        walk.step(there.copy(), way)
        assert walk.rounds == 1


@pytest.mark.mpi(min_size=3)
def test_neighbours_skip_empty_slabs(world):
    """Ranks without rows are no neighbours, but they can send and get."""
    cuts = (0, 4, *[4] * (world.size - 2), 8)
    full = np.array([0, world.size - 1])
    with walking(world, TOTAL, cuts) as walk:
        walk.step(full[np.arange(TOTAL) % 2])  # the empty ranks send all away
        assert walk.rounds == 1
        walk.step(full[np.arange(1, TOTAL + 1) % 2])
        assert walk.rounds == 1 and len(walk.migrate.peers) == (world.rank in full)
        walk.step(np.arange(TOTAL) % world.size)
        assert walk.rounds == 2


def check_send_anywhere(world):
    ids = np.arange(world.rank, TOTAL, world.size)
    destination = (ids // world.size) % world.size  # some to every rank, oneself too
    outgoing = {int(peer): records(ids[destination == peer]) for peer in np.unique(destination)}
    arrived = ids_of(send_anywhere(world, outgoing, RECORD, tag(5, Channel.SHARDS)))
    everything = np.arange(TOTAL)
    np.testing.assert_array_equal(np.sort(arrived), everything[(everything // world.size) % world.size == world.rank])
    assert np.all(np.diff(arrived % world.size) >= 0)  # in the order of ranks
    assert send_anywhere(world, {}, RECORD, tag(6, Channel.SHARDS)) == []


def test_a_general_round_on_one_rank(world):
    check_send_anywhere(world)


@pytest.mark.mpi(min_size=2)
def test_records_go_anywhere(world):
    check_send_anywhere(world)
