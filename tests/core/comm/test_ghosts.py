import numpy as np
import pytest

from hpcpic.core.comm.ghosts import Refresh
from hpcpic.core.comm.tags import Channel


def check(world):
    """Each rank gives every rank (itself too) its rows of a kind; values tell owner, row and time."""
    refresh = Refresh(world, Channel.GHOSTS)
    for choice in range(3):
        n_rows = 5 + world.rank
        peers = [peer for peer in range(world.size) if (world.rank + peer + choice) % 3]
        members = {peer: np.arange((peer + choice) % 2, n_rows, 1 + peer)[::-1] for peer in peers}
        owners = [owner for owner in range(world.size) if (owner + world.rank + choice) % 3]
        expected = [
            (owner, row)
            for owner in owners
            for row in range((world.rank + choice) % 2, 5 + owner, 1 + world.rank)[::-1]
        ]
        assert refresh.choose(members) == refresh.n == len(expected)
        for iteration in (-2, 0, 510, 512):
            rows = np.arange(n_rows)
            values = np.stack([rows * 0 + world.rank, rows, rows * 0 + iteration], 1).astype(np.float64)
            refresh.start(iteration, values)
            values[:] = -1.0  # free after start
            ghosts = refresh.finish()
            wanted = np.array([(*pair, iteration) for pair in expected], np.float64).reshape(-1, 3)
            np.testing.assert_array_equal(ghosts, wanted)
        assert refresh.messages == len(set(peers) - {world.rank})


def test_a_rank_alone_copies_its_images(world):
    check(world)


@pytest.mark.mpi(min_size=2)
def test_ghosts_are_what_their_owners_have(world):
    check(world)


@pytest.mark.mpi(min_size=2)
def test_only_peers_are_asked(world):
    """Neighbours on a line of ranks: the same ghosts as when all are asked, at once and later, of those too who show
    none; who is no peer gets none.
    """
    peers = [peer for peer in (world.rank - 1, world.rank + 1) if 0 <= peer < world.size]
    members = {peer: np.arange(peer % 2 * (world.rank + 1)) for peer in (*peers, world.rank)}
    values = 10.0 * world.rank + np.arange(world.size)
    asked, all_ranks = Refresh(world, Channel.GHOSTS), Refresh(world, Channel.GHOSTS)
    all_ranks.choose(members)
    found = [asked.choose_and_send(0, members, peers, values)]
    for refresh in (asked, all_ranks):
        refresh.start(1, values)
        found.append(refresh.finish())
    expected = sum(owner + 1 for owner in (*peers, world.rank)) if world.rank % 2 else 0
    assert len(found[0]) == asked.n == expected and all(np.array_equal(found[0], other) for other in found)
    with pytest.raises(ValueError):
        asked.choose_and_send(2, {(world.rank + 1) % world.size: np.arange(1)}, [], values)
