"""Arrays by name: declared once, grown while tasks are bound to them, foretold from the same declarations."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from hpcpic.core.simd.compile import njit
from hpcpic.core.space.declared import Array
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Graph

DECLARED = (
    Array("x", ("d", "slots"), "float64", "m", "positions"),
    Array("flags", ("slots",), "int32"),
    Array("sums", (2,), "float64"),
)


class Bodies(NamedTuple):
    x: NDArray[np.float64]
    flags: NDArray[np.int32]


@njit
def add(sums, bodies, factor, n):
    for i in range(n[0]):
        if bodies.flags[i]:
            sums[0] += factor * bodies.x[0, i]
            sums[1] += 1.0


def filled() -> Arena:
    arena = Arena(DECLARED, d=3, slots=4)
    arena.group(bodies=Bodies)
    arena["x"][0] = np.arange(4.0)
    arena["flags"][1:] = 1
    arena.set(n=np.array([4]), factor=2.0)
    return arena


def test_arguments_are_found_by_name_and_tasks_follow_arrays_that_grow(pool):
    arena = filled()
    task = arena.bind(add)
    pool.each([task])
    assert arena["sums"].tolist() == [12.0, 3.0]
    old = arena["x"]
    assert arena.reserve(slots=100) and arena["x"] is not old and not arena.reserve(slots=100)
    assert arena.sizes["slots"] == 112 and np.array_equal(arena["x"][:, :4], old) and not arena["x"][:, 4:].any()
    arena["x"][0, :4] *= 10.0
    arena.set(factor=1.0)
    pool.each([task])
    assert arena["sums"].tolist() == [12.0 + 60.0, 6.0]


def test_what_is_given_where_a_kernel_is_bound_comes_first_and_stays(pool):
    arena = filled()
    mine = np.zeros(2)
    task = arena.bind(add, sums=mine, factor=0.5)
    arena.set(factor=7.0)
    pool.each([task])
    assert mine.tolist() == [3.0, 3.0] and not arena["sums"].any()
    with pytest.raises(TypeError, match="add takes no speed"):
        arena.bind(add, speed=1.0)
    with pytest.raises(KeyError, match="factor"):
        Arena(DECLARED, d=1, slots=1).bind(add, bodies=arena.value("bodies"))


@njit
def mark(part, line, factor):
    line[part] = part * factor


def test_one_binding_serves_every_part_and_a_text_names_what_to_take(pool):
    arena = Arena([Array("here", ("n",), "float64")], n=3)
    arena.set(factor=2.0)
    bound, graph = arena.bind(mark, 3, line="here"), Graph()
    for part in range(3):
        graph.task(bound, part=part)
    graph.freeze()
    arena.reserve(n=8)
    arena.set(factor=5.0)
    pool.run(graph)
    assert arena["here"].tolist() == [0.0, 5.0, 10.0] + [0.0] * 6


@pytest.mark.parametrize("grown", [3, 200])
def test_phases_share_memory_and_arrays_of_one_do_not(grown):
    kinds = {"order": "int32", "gain": "float64"}
    declared = [Array(name, ("n",), kind, phase="sort") for name, kind in kinds.items()]
    arena = Arena([*declared, Array("sums", (2, "n"), "float64", phase="pairs"), Array("x", ("n",), "float64")], n=10)
    for _ in range(2):
        arena["order"][:], arena["gain"][:] = np.arange(len(arena["order"])), 1.0
        assert (arena["order"] == np.arange(len(arena["order"]))).all()
        assert np.shares_memory(arena["order"], arena["sums"]) and not np.shares_memory(arena["x"], arena["sums"])
        assert all(arena[name].ctypes.data % 64 == 0 for name in arena.declared)
        arena.reserve(n=grown)


def test_memory_is_foretold_from_the_declarations():
    arena = filled()
    arena.reserve(slots=1000)
    assert arena.bytes == {array.name: array.sized(arena.sizes).bytes for array in DECLARED}


def test_every_array_begins_on_a_cache_line():
    arena = filled()
    arena.reserve(slots=77)
    assert all(arena[name].ctypes.data % 64 == 0 for name in arena.declared)


def test_tasks_that_are_gone_are_not_kept(pool):
    arena = filled()
    for _ in range(3):
        arena.bind(add)
    arena.reserve(slots=50)
    arena.set(factor=3.0, sums=np.zeros(2), n=np.array([4]))
    assert not any(task() for uses in arena._uses.values() for task, _ in uses)
