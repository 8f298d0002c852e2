"""Every message carries its iteration: it arrives in the same one and never matches another."""

import weakref
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from hpcpic.core.comm.ghosts import Refresh
from hpcpic.core.comm.halo import Fill, Fold
from hpcpic.core.comm.line import LineFFT
from hpcpic.core.comm.messages import Message, Messages
from hpcpic.core.comm.migrate import Migrate
from hpcpic.core.comm.pieces import Parcel, Pieces
from hpcpic.core.comm.tags import CHANNELS, WINDOW, Channel, tag
from hpcpic.core.comm.transpose import SlabFFT, spectrum_range
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain, even_cuts
from hpcpic.core.space.fields import Field
from hpcpic.core.tasks import scheduler
from hpcpic.core.tasks.graph import Graph, Pool, Stuck

CHANNEL = 40


def ring(world):
    """A message to the next rank, one from the previous, as one set; with the two buffers."""
    out, into = np.zeros(1000), np.zeros(1000)
    following, previous = (world.rank + 1) % world.size, (world.rank - 1) % world.size
    sends, receives = [Message(following, CHANNEL, out)], [Message(previous, CHANNEL, into)]
    return Messages(world.comm, sends=sends, receives=receives), out, into


def test_no_messages_are_always_complete(world):
    messages = Messages(world.comm)
    assert len(messages) == 0
    messages.start()
    messages.wait()
    messages.free()


def test_an_array_that_is_no_single_piece_of_memory_is_refused(world):
    with pytest.raises(ValueError, match="C-contiguous"):
        Messages(world.comm, sends=[Message(0, 0, np.zeros((4, 4))[:, 1])])


def test_a_message_of_more_than_mpi_counts_is_refused(world):
    from mpi4py import MPI

    with pytest.raises(ValueError, match="at most 2147483647"):
        Messages(world.comm, sends=[Message(0, 0, (0, 1 << 31, MPI.BYTE))])


def check_replay(world):
    messages, out, into = ring(world)
    for turn, iteration in enumerate((-2, -1, 0, 510, 511, 512, 1024)):
        out[:] = 100 * turn + world.rank
        messages.at(iteration)
        messages.start()
        messages.wait()
        assert np.all(into == 100 * turn + (world.rank - 1) % world.size)


def test_a_rank_can_send_to_itself(world):
    if world.size == 1:
        check_replay(world)


@pytest.mark.mpi(min_size=2)
def test_sets_are_replayed(world):
    check_replay(world)


@pytest.mark.mpi(min_size=2)
def test_a_start_has_the_tag_of_its_iteration_and_the_next_one_that_of_the_next(world):
    """Received by mpi4py itself, which has never seen our table."""
    following, previous = (world.rank + 1) % world.size, (world.rank - 1) % world.size
    out, into = np.arange(3.0), np.zeros(3)
    messages = Messages(world.comm, sends=[Message(following, CHANNEL, out)], stride=2)
    for iteration in (-2, 7, WINDOW, 10**9):
        messages.at(iteration)
        for later in (0, 2):
            into[:] = 0.0
            messages.start()
            world.comm.Recv(into, previous, tag(iteration + later, CHANNEL))
            messages.wait()
            np.testing.assert_array_equal(into, out)


def exchanges(world):
    """Each kind of exchange as a call with the iteration, which ends when its messages have come."""
    n = 4 * world.size
    domain = Domain((1.0, 1.0), (n, 5), (True, True), even_cuts(n, world.size))
    line = even_cuts(n, world.size)
    pool, kinds = Pool(1), {}

    def launched(thing, graph):
        def launch(iteration):
            thing.at(iteration)
            pool.run(graph)

        return launch

    for kind in (Fill, Fold):
        exchange = kind(world, domain, Field(domain, world.rank, ghosts=((1, 1), (1, 1))), Channel.FIELD)
        graph = Graph()
        with world.first_on_node():
            exchange.add_to(graph, "field")
        kinds[kind.__name__] = launched(exchange, graph.freeze())
    migrate, graph = Migrate(world, 16, Channel.PARTICLES, capacity=4), Graph()
    with world.first_on_node():
        migrate.add_to(graph, written=["letters"], arrived="arrived")
    kinds["Migrate"] = launched(migrate, graph.freeze())
    following, previous = (world.rank + 1) % world.size, (world.rank - 1) % world.size
    sends, receives = [Parcel(following, 3, [np.zeros(5), np.zeros(2)])], [Parcel(previous, 3, [np.zeros(7)])]
    pieces, graph = Pieces(world, sends, receives), Graph()
    graph.message(pieces.messages, outs=["pieces"], name="pieces")
    kinds["Pieces"] = launched(pieces.messages, graph.freeze())
    for name, fft in {
        "LineFFT": LineFFT(world, pool, (n,), line, multiplier=np.ones(n // 2 + 1)),
        "SlabFFT in a node": SlabFFT(world, pool, (n, 8), line, multiplier=_ones(world, n)),
        "SlabFFT between nodes": SlabFFT(world, pool, (n, 8), line, multiplier=_ones(world, n), messages=True),
    }.items():
        kinds[name] = partial(_solve, fft)
    return kinds, pool


def _ones(world, n):
    low, high = spectrum_range((n, 8), world.size, world.rank)
    return np.ones((high - low, n))


def _solve(fft, iteration):
    fft.at(iteration)
    fft.solve()


KINDS = ("Fill", "Fold", "Migrate", "Pieces", "LineFFT", "SlabFFT in a node", "SlabFFT between nodes")


AHEAD = 1, 2, -7, WINDOW - 1
APART = [
    pytest.param(kind, ahead, marks=[pytest.mark.validation] * (k > 0 and k % len(AHEAD) != j))
    for k, kind in enumerate(KINDS)
    for j, ahead in enumerate(AHEAD)
]  # by default all of the first kind and one of each other: each waits half a second


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize(("kind", "ahead"), APART)
def test_messages_of_another_iteration_never_match(world, kind, ahead):
    """Where rank 0 is at another iteration it finds no messages, and says which it waits for. A send needs nobody."""
    apart = World(world.comm.Dup(), world.node)  # whose lost messages meet nobody else's
    kinds, pool = exchanges(apart)
    for iteration in (-2, -1, 0, WINDOW):
        kinds[kind](iteration)
    mine = 20 + ahead * (world.rank == 0)
    pool._words[scheduler.LIMIT_NS] = int(0.5e9)  # ranks that compiled are late before that
    world.barrier()
    try:
        kinds[kind](mine)
        stuck = False
    except Stuck as error:
        stuck = bool(error.pending)
    assert stuck or world.rank
    world.barrier()
    pool.close()


def test_arrays_live_as_long_as_the_messages_that_hold_their_addresses(world):
    """Else MPI writes into memory that belongs to somebody else by then."""
    arrays = [np.zeros(5), np.zeros(2), np.zeros(7)]
    living = [weakref.ref(array) for array in arrays]
    sends, receives = [Parcel(world.rank, CHANNEL, arrays[:2])], [Parcel(world.rank, CHANNEL, arrays[2:])]
    messages = Pieces(world, sends, receives).messages
    del arrays, sends, receives
    assert all(array() is not None for array in living)
    messages.start()
    messages.wait()
    del messages
    assert all(array() is None for array in living)


@pytest.mark.mpi(min_size=2)
def test_ghosts_travel_under_the_tag_of_the_iteration(world):
    refresh = Refresh(world, Channel.GHOSTS)
    following = (world.rank + 1) % world.size
    refresh.choose({following: np.arange(3)})
    values = np.arange(6.0).reshape(3, 2)
    labels = []

    class Recorder:
        """The communicator, and the tags that it was given."""

        def __getattr__(self, name):
            def call(buffer, peer, label):
                labels.append(label)
                return getattr(world.comm, name)(buffer, peer, label)

            return call

    refresh._world = SimpleNamespace(comm=Recorder(), rank=world.rank, size=world.size)
    for iteration in (-2, 5, WINDOW + 5):
        refresh.start(iteration, values)
        assert np.array_equal(refresh.finish(), values)
        assert labels == 2 * [tag(iteration, Channel.GHOSTS)]
        labels.clear()


def test_channels_do_not_overlap():
    assert max(Channel) < CHANNELS
