"""One step of the fluid nodes alone, written as text for a lattice, a collision and a storage type.

Nodes stand one behind the other, in the order (plane, row, x) without the solid ones; every plane begins a vector. The
populations are moved by the "AA pattern" (Bailey et al. 2009), in place, on one array f[q][position]
(`layout.element`):

    even steps   read slot i and write slot j = opposite of i, of the node itself
    odd steps    read f_j and write g_i at one element: slot i of x + e_i when that is fluid, slot j of x else

so that half-way bounce back is no work at all. In odd steps the nodes of a vector have their neighbours in a direction
in few pieces of memory, most often one or two. `masks[vector, i - 1]` holds lanes: of the first piece, of those that
bounce back; `shifts[vector, i - 1]`: elements from the vector itself to the first piece. Other pieces are listed by
blocks of so many vectors of a plane (sizes.SPARSE_BLOCK), `rest[block]` being the first of a block: `where[k]`, the
element for lane 0, and `code[k]`, the lanes, and times 2^16 the place in a buffer of the vectors of a block.

A processor waits for a masked write to be done before it reads beside it. So a block is read and collided first, its
vectors stay in the buffer, and are written then; vectors whose neighbours are in one piece each (WHOLE) go by it.

Links of the rule CLI are done by the node itself in two parts, `wall_rules.begun` and `finished`: the first one is
stored; the second one, in which g_i(y) is f_i of the next step, is added then. `modes` of a tile are bits: PARITY of
the steps done, OPENED when populations are such first parts, LEAVE when they shall be so afterwards.
"""

from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from hpcpic.core.simd.generate import module_from_source
from lbmdem.physics.collision import Collision, Source
from lbmdem.physics.velocity_sets import Lattice
from lbmdem.sizes import SPARSE_BLOCK as BLOCK

PARITY, OPENED, LEAVE = 1, 2, 4
BROKEN, WHOLE = 0, 1  # kinds of vectors
FIRST, SHUT = range(2)  # masks
AHEAD = 8  # vectors by which populations are fetched before they are needed
FETCHED = 64  # the same of other pieces

_HEAD = '''"""{title}; written by lbmdem.kernels.sparse."""
import numpy as np
from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.masks import expand_at, load_where, mask_of_bits, store_where
from hpcpic.core.simd.scratch import empty
from hpcpic.core.simd.vector import (
    Vec, address_of, count_bits, fma, lanes, load_at, prefetch_to_write, select, splat, store_at)
from lbmdem.physics.wall_rules import begun, finished

F = Vec(lanes(np.{dtype}), np.{dtype})
N = lanes(np.{dtype})
SIZE = np.dtype(np.{dtype}).itemsize
BYTES = N * SIZE


@njit
def take_rest(start, room, where, code, low, high):
    """Other pieces of memory into the buffer."""
    for k in range(np.uint64(low), np.uint64(high)):
        word = np.int64(code[k])
        own, piece = mask_of_bits(F, word), start + SIZE * np.int64(where[k])
        store_where(room + BYTES * (word >> 16), load_where(piece, own, splat(F, 0.0), SIZE), own, BYTES)
        later = start + SIZE * np.int64(where[k + np.uint64({fetched})])
        prefetch_to_write(later)
        prefetch_to_write(later + BYTES - SIZE)  # most often the line of these lanes, which are the last ones


@njit
def put_rest(start, room, where, code, low, high):
    """The inverse."""
    for k in range(np.uint64(low), np.uint64(high)):
        word = np.int64(code[k])
        value = load_at(F, room + BYTES * (word >> 16), BYTES)
        store_where(start + SIZE * np.int64(where[k]), value, mask_of_bits(F, word), SIZE)


@njit
def sweep(f, stride, first, blocks, kinds, masks, shifts, rest, where, code, ruled, kappa, linked, numbers, tiles):
    """Collide and stream in place, tile after tile: tiles[k] = modes, planes from and to, two numbers more.

    first[plane]: its first vector; blocks[plane]: its first block; ruled[vector, i - 1]: lanes with a link; kappa: of
    the links of a vector in the order of directions and lanes, from linked[vector] on. stride: elements of a slot.
    """
    start, slot = address_of(f, 0), SIZE * stride
    weights = address_of(kappa, 0)
    spill = empty({room} * N + N, np.{dtype})
    room = address_of(spill, 0)
    room += -room & (BYTES - 1)
'''


def sparse_kernel(collision: Collision, dtype: DTypeLike) -> Any:
    """The compiled kernel `sweep` (see the text above)."""
    name = collision.lattice.name.lower()
    return module_from_source(sparse_source(collision, dtype), f"sparse_{name}").sweep


def sparse_source(collision: Collision, dtype: DTypeLike) -> str:
    """The text of the module with that kernel."""
    lattice, source = collision.lattice, collision.source
    name = np.dtype(dtype).name
    text = _HEAD.format(title=f"{lattice.name}, {name}", dtype=name, room=BLOCK * (lattice.q - 1), fetched=FETCHED)
    lines = [f"{word} = numbers[{k}]" for k, word in enumerate(source.names)]
    lines += ["for k in range(tiles.shape[0]):", "    modes = tiles[k, 0]"]
    lines += [f"    odd, opened, leave = modes & {PARITY}, modes & {OPENED}, modes & {LEAVE}"]
    lines += ["    for z in range(tiles[k, 1], tiles[k, 2]):", "        for b in range(blocks[z], blocks[z + 1]):"]
    inner = [f"low = first[z] + (b - blocks[z]) * {BLOCK}", f"high = min(low + {BLOCK}, first[z + 1])", "if odd:"]
    inner += ["    take_rest(start, room, where, code, rest[b], rest[b + 1])"]
    inner += ["for v in range(low, high):", *_indent(_vector(lattice, source)), "if odd:"]
    inner += ["    for v in range(low, high):", f"        if kinds[v] == {BROKEN}:"]
    inner += ["            " + line for line in _put(lattice)]
    inner += ["    put_rest(start, room, where, code, rest[b], rest[b + 1])"]
    lines += ["            " + line for line in inner]
    return text + "".join(f"    {line}\n" for line in lines) + "    return 0\n"


def _indent(lines: list[str]) -> list[str]:
    return ["    " + line for line in lines]


def _both(lattice: Lattice) -> list[tuple[int, int]]:
    """(i, opposite of i)."""
    return [(i, int(lattice.opposite[i])) for i in range(1, lattice.q)]


def _mask(i: int, part: int) -> str:
    return f"mask_of_bits(F, np.int64(masks[v, {i - 1}, {part}]))"


def _piece(i: int) -> str:
    return f"here + {i} * slot + SIZE * np.int64(shifts[v, {i - 1}])"


def _kept(i: int) -> str:
    """Where the buffer has g_i, and before it f_j."""
    return f"kept + {i - 1} * BYTES"


def _vector(lattice: Lattice, source: Source) -> list[str]:
    """Read, collide, and write unless others have to be read first."""
    keep = f"kept = room + (v - low) * {lattice.q - 1} * BYTES"
    lines = ["here, kind = start + v * BYTES, kinds[v]", "f0 = load_at(F, here, BYTES)", keep]
    lines += ["if odd:", *_indent(_loads(lattice)), "else:"]
    for i in range(1, lattice.q):
        lines += [f"    f{i} = load_at(F, here + {i} * slot, BYTES)"]
        lines += [f"    prefetch_to_write(here + {i} * slot + {AHEAD} * BYTES)"]
    lines += ["has_links = linked[v + 1] > linked[v]"]
    lines += ["if opened and has_links:", *_indent(_finish(lattice)), *source.lines]
    lines += ["if leave and has_links:", *_indent(_begin(lattice)), "store_at(here, g0, BYTES)"]
    lines += ["if not odd:", *(f"    store_at(here + {j} * slot, g{i}, BYTES)" for i, j in _both(lattice))]
    lines += [f"elif kind == {WHOLE}:", *(f"    store_at({_piece(i)}, g{i}, SIZE)" for i, _ in _both(lattice))]
    return [*lines, "else:", *(f"    store_at({_kept(i)}, g{i}, BYTES)" for i, _ in _both(lattice))]


def _loads(lattice: Lattice) -> list[str]:
    """f of an odd step.

    Ahead are fetched: where neighbours would be if no solid came between, and the node's own elements, where lanes
    bounce back; other nodes want these soon anyway.
    """
    lines = [f"if kind == {WHOLE}:"]
    for i, j in _both(lattice):
        lines += [*_ahead(i), f"    f{j} = load_at(F, to{i}, SIZE)"]
    lines += ["else:"]
    for i, j in _both(lattice):
        lines += _ahead(i)
        lines += [f"    f{j} = load_where(to{i}, {_mask(i, FIRST)}, load_at(F, {_kept(i)}, BYTES), SIZE)"]
        lines += [f"    f{j} = load_where(here + {j} * slot, {_mask(i, SHUT)}, f{j}, BYTES)"]
    return lines


def _ahead(i: int) -> list[str]:
    places = (f"to{i}", f"here + {i} * slot")
    return [f"    to{i} = {_piece(i)}", *(f"    prefetch_to_write({place} + {AHEAD} * BYTES)" for place in places)]


def _put(lattice: Lattice) -> list[str]:
    lines = [f"here, kept = start + v * BYTES, room + (v - low) * {lattice.q - 1} * BYTES"]
    for i, j in _both(lattice):
        lines += [f"g{i} = load_at(F, {_kept(i)}, BYTES)"]
        lines += [f"store_where(here + {j} * slot, g{i}, {_mask(i, SHUT)}, BYTES)"]
        lines += [f"store_where({_piece(i)}, g{i}, {_mask(i, FIRST)}, SIZE)"]
    return lines


def _weights(lattice: Lattice, line: str) -> list[str]:
    """A line for each direction i with its links: lanes `mask`, `weight` of them; {i}, {j}."""
    lines = ["near = weights + SIZE * linked[v]"]
    for i, j in _both(lattice):
        lines += [f"bits = np.int64(ruled[v, {i - 1}])", "mask = mask_of_bits(F, bits)"]
        lines += ["weight = expand_at(near, mask, splat(F, 0.0))", "near += SIZE * count_bits(bits)"]
        lines += [line.format(i=i, j=j)]
    return lines


def _finish(lattice: Lattice) -> list[str]:
    return _weights(lattice, "f{j} = select(mask, finished(weight, f{i}, f{j}), f{j})")


def _begin(lattice: Lattice) -> list[str]:
    """All of h before all of g: the two of a pair use each other's."""
    lines = _weights(lattice, "h{i} = select(mask, begun(weight, g{i}, g{j}), g{i})")
    return lines + [f"g{i} = h{i}" for i in range(1, lattice.q)]
