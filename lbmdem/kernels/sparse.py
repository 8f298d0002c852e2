"""One step of the fluid nodes alone, written as text for a lattice, a collision and a storage type.

Nodes stand one behind the other, in the order (plane, row, x) without the solid ones; every plane begins a vector. The
populations are moved by the "AA pattern" (Bailey et al. 2009), in place, on one array f[q][position]
(`layout.element`):

    even steps   read slot i and write slot j = opposite of i, of the node itself
    odd steps    read f_j and write g_i at one element: slot i of x + e_i when that is fluid, slot j of x else

so that half-way bounce back is no work at all. In odd steps the nodes of a vector have their neighbours in a direction
in few pieces of memory, most often one or two. `words[vector, i - 1]` holds masks of lanes: of the first piece, of the
second one, of those that bounce back, of those with a link whose rule is applied here. `shifts[vector, i - 1, 2]`:
elements from the vector itself to the pieces. What is left over is listed.

Links of the rule CLI (see `links`) are done by the node itself: v = (g_i - kappa g_j) + kappa g_i(y). The first part is
stored; the second one, in which g_i(y) is f_i of the next step, is added then. `modes` of a tile are bits: PARITY of
the steps done, OPENED when populations are such first parts, LEAVE when they shall be so afterwards.
"""

from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from hpcpic.core.simd.generate import module_from_source
from lbmdem.kernels.collide import Collision, source
from lbmdem.lattices import Lattice

PARITY, OPENED, LEAVE = 1, 2, 4
FIRST, SECOND, SHUT, RULED = range(4)  # masks of a word
PLAIN, TWO, MANY = 0, 1, 2  # kinds of vectors: all neighbours in one piece; in two, or solid; in more
AHEAD = 8  # vectors by which populations are fetched before they are needed

_HEAD = '''"""{title}; written by lbmdem.kernels.sparse."""
import numpy as np
from hpcpic.core.simd.jit import njit
from hpcpic.core.simd.masks import expand_at, load_where, mask_of_bits, store_where
from hpcpic.core.simd.vector import (
    Vec, address_of, count_bits, fma, lanes, load_at, prefetch_to_write, select, splat, store_at)

F = Vec(lanes(np.{dtype}), np.{dtype})
N = lanes(np.{dtype})
SIZE = np.dtype(np.{dtype}).itemsize
BYTES = N * SIZE


@njit
def sweep(
    f, stride, first, kinds, words, shifts, more, more_way, more_word, more_shift, kappa, linked, numbers, tiles
):
    """Collide and stream in place, tile after tile: tiles[k] = modes, planes from and to, two numbers more.

    first[plane]: its first vector; more[vector]: start of what is left over, (way, word, shift) each; kappa: of the
    links of a vector in the order of directions and lanes, from linked[vector] on. stride: elements of a slot.
    """
    start, slot = address_of(f, 0), SIZE * stride
    weights = address_of(kappa, 0)
    spill = np.empty({directions} * N + N, np.{dtype})
    room = address_of(spill, 0)
    room += -room & (BYTES - 1)
'''


def sparse_kernel(lattice: Lattice, collision: str, forced: bool, dtype: DTypeLike) -> Any:
    """The compiled kernel `sweep` (see the text above)."""
    text = sparse_source(lattice, source(lattice, collision, forced), dtype)
    return module_from_source(text, f"sparse_{lattice.name.lower()}").sweep


def sparse_source(lattice: Lattice, collision: Collision, dtype: DTypeLike) -> str:
    name = np.dtype(dtype).name
    text = _HEAD.format(title=f"{lattice.name}, {name}", dtype=name, directions=lattice.q - 1)
    lines = [f"{word} = numbers[{k}]" for k, word in enumerate(collision.names)]
    lines += ["for k in range(tiles.shape[0]):", "    modes = tiles[k, 0]"]
    lines += [f"    odd, opened, leave = modes & {PARITY}, modes & {OPENED}, modes & {LEAVE}"]
    lines += ["    for v in range(first[tiles[k, 1]], first[tiles[k, 2]]):"]
    inner = ["here, kind = start + v * BYTES, kinds[v]", "f0 = load_at(F, here, BYTES)"]
    inner += ["if odd:", *_indent(_loads(lattice)), "else:"]
    for i in range(1, lattice.q):
        inner += [f"    f{i} = load_at(F, here + {i} * slot, BYTES)"]
        inner += [f"    prefetch_to_write(here + {i} * slot + {AHEAD} * BYTES)"]
    inner += ["has_links = linked[v + 1] > linked[v]"]
    inner += ["if opened and has_links:", *_indent(_finish(lattice)), *collision.lines]
    inner += ["if leave and has_links:", *_indent(_begin(lattice)), "store_at(here, g0, BYTES)"]
    inner += ["if odd:", *_indent(_stores(lattice)), "else:"]
    inner += [f"    store_at(here + {j} * slot, g{i}, BYTES)" for i, j in _both(lattice)]
    lines += ["        " + line for line in inner]
    return text + "".join(f"    {line}\n" for line in lines) + "    return 0\n"


def _indent(lines: list[str]) -> list[str]:
    return ["    " + line for line in lines]


def _both(lattice: Lattice) -> list[tuple[int, int]]:
    """(i, opposite of i)."""
    return [(i, int(lattice.opposite[i])) for i in range(1, lattice.q)]


def _mask(i: int, part: int) -> str:
    return f"mask_of_bits(F, np.int64(words[v, {i - 1}, {part}]))"


def _piece(i: int, part: int) -> str:
    return f"here + {i} * slot + SIZE * np.int64(shifts[v, {i - 1}, {part}])"


def _loads(lattice: Lattice) -> list[str]:
    """f of an odd step.

    Ahead are fetched: where neighbours would be if no solid came between, and the node's own elements, where lanes
    bounce back; other nodes want these soon anyway.
    """
    lines = [f"if kind == {PLAIN}:"]
    for i, j in _both(lattice):
        lines += [*_ahead(i), f"    f{j} = load_at(F, to{i}, SIZE)"]
    lines += ["else:"]
    for i, j in _both(lattice):
        lines += _ahead(i)
        lines += [f"    f{j} = load_where(here + {j} * slot, {_mask(i, 2)}, splat(F, 0.0), BYTES)"]
        lines += [f"    f{j} = load_where(to{i}, {_mask(i, 0)}, f{j}, SIZE)"]
        lines += [f"    f{j} = load_where({_piece(i, 1)}, {_mask(i, 1)}, f{j}, SIZE)"]
    lines += [f"    if kind == {MANY}:"]
    lines += [f"        store_at(room + {i - 1} * BYTES, f{j}, BYTES)" for i, j in _both(lattice)]
    lines += [f"        {line}" for line in _left_over("place", "at")]
    lines += [f"        f{j} = load_at(F, room + {i - 1} * BYTES, BYTES)" for i, j in _both(lattice)]
    return lines


def _ahead(i: int) -> list[str]:
    places = (f"to{i}", f"here + {i} * slot")
    return [f"    to{i} = {_piece(i, 0)}", *(f"    prefetch_to_write({place} + {AHEAD} * BYTES)" for place in places)]


def _left_over(source: str, target: str) -> list[str]:
    """Copy what is left over between its place and the spilled vectors."""
    return [
        "for m in range(more[v], more[v + 1]):",
        "    way, mask = np.int64(more_way[m]), mask_of_bits(F, np.int64(more_word[m]))",
        "    place, at = here + (way + 1) * slot + SIZE * np.int64(more_shift[m]), room + way * BYTES",
        f"    store_where({target}, load_where({source}, mask, splat(F, 0.0), SIZE), mask, SIZE)",
    ]


def _stores(lattice: Lattice) -> list[str]:
    lines = [f"if kind == {PLAIN}:"]
    lines += [f"    store_at({_piece(i, 0)}, g{i}, SIZE)" for i, _ in _both(lattice)]
    lines += ["else:"]
    for i, j in _both(lattice):
        lines += [f"    store_where(here + {j} * slot, g{i}, {_mask(i, 2)}, BYTES)"]
        lines += [f"    store_where({_piece(i, 0)}, g{i}, {_mask(i, 0)}, SIZE)"]
        lines += [f"    store_where({_piece(i, 1)}, g{i}, {_mask(i, 1)}, SIZE)"]
    lines += [f"    if kind == {MANY}:"]
    lines += [f"        store_at(room + {i - 1} * BYTES, g{i}, BYTES)" for i, _ in _both(lattice)]
    return lines + [f"        {line}" for line in _left_over("at", "place")]


def _weights(lattice: Lattice, line: str) -> list[str]:
    """A line for each direction i with its links: lanes `mask`, `weight` of them; {i}, {j}."""
    lines = ["near = weights + SIZE * linked[v]"]
    for i, j in _both(lattice):
        lines += [f"bits = np.int64(words[v, {i - 1}, 3])", "mask = mask_of_bits(F, bits)"]
        lines += ["weight = expand_at(near, mask, splat(F, 0.0))", "near += SIZE * count_bits(bits)"]
        lines += [line.format(i=i, j=j)]
    return lines


def _finish(lattice: Lattice) -> list[str]:
    return _weights(lattice, "f{j} = select(mask, fma(weight, f{i}, f{j}), f{j})")


def _begin(lattice: Lattice) -> list[str]:
    """All of h before all of g: the two of a pair use each other's."""
    lines = _weights(lattice, "h{i} = select(mask, fma(-weight, g{j}, g{i}), g{i})")
    return lines + [f"g{i} = h{i}" for i in range(1, lattice.q)]
