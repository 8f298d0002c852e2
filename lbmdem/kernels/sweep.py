"""One step of a range of planes and rows, written as text for a lattice, a collision and a storage type.

Vectors of a row are of a kind: SKIP (no fluid), PLAIN (all nodes and all their neighbours are fluid), MIXED. All are
computed by the same lines and only stored differently, so that a node's bits do not depend on its neighbours' kind.
Lanes of a plain vector beyond the end of its row compute and store what nobody reads.
On links to solid nodes the population goes back to where its node reads in the next step (layout): half-way bounce
back without another pass.
"""

from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from hpcpic.core.simd.generate import module_from_source
from lbmdem.kernels.layout import storage_order
from lbmdem.physics.collision import Collision, Source
from lbmdem.physics.velocity_sets import Lattice

SKIP, PLAIN, MIXED = 0, 1, 2
AHEAD = 8  # vectors with fluid by which populations are fetched before they are needed (4 does nearly as well)

_HEAD = '''"""{title}; written by lbmdem.kernels.sweep."""
import numpy as np
from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.masks import mask_of_bits, store_where
from hpcpic.core.simd.vector import Vec, address_of, fma, lanes, load_at, prefetch_to_write, store_at

F = Vec(lanes(np.{dtype}), np.{dtype})
S = Vec(1, np.{dtype})
N = lanes(np.{dtype})
SIZE = np.dtype(np.{dtype}).itemsize
BYTES = N * SIZE
FULL = (1 << N) - 1


@njit
def {name}(f, kinds, hops, wet, inside, numbers, strides, nx, tiles):
    """Collide and stream in place, tile after tile: tiles[k] = parity (of the steps done), planes and rows from, to.

    kinds[plane, row, vector]; hops[plane, row, vector]: vectors without fluid from here on, or of one with fluid the
    bytes to the one that is fetched meanwhile; wet[plane + 2, row + 2, vector]: bit b of a vector is set when its node
    b - 1 is fluid; inside[vector]: bits of the nodes that belong to the row.
    """
    start = address_of(f, 0)
    slot, plane, row = SIZE * strides[0], SIZE * strides[1], SIZE * strides[2]
    first, stored, rows = SIZE * strides[3], strides[4], strides[5]
    vectors, line = kinds.shape[2], kinds.reshape(-1)
    end = SIZE * (nx - 1)
'''


def sweep_kernel(collision: Collision, dtype: DTypeLike) -> Any:
    """The compiled kernel `sweep` (see the text above)."""
    name = collision.lattice.name.lower()
    return module_from_source(sweep_source(collision, dtype), f"lbm_{name}").sweep


def sweep_source(collision: Collision, dtype: DTypeLike) -> str:
    """The text of the module with that kernel."""
    lattice, source = collision.lattice, collision.source
    name = np.dtype(dtype).name
    text = _HEAD.format(title=f"{lattice.name}, {name}", dtype=name, name="sweep")
    lines = [f"{word} = numbers[{k}]" for k, word in enumerate(source.names)]
    lines += ["for k in range(tiles.shape[0]):", "    parity, tile = tiles[k, 0], tiles[k]"]
    lines += ["    swap = slot * (2 * parity - 1)"]
    lines += ["    for z in range(tile[1], tile[2]):", "        up = z + 1 if z + 1 < stored else 0"]
    lines += ["        for y in range(tile[3], tile[4]):"]
    inner = ["above = y + 1 if y + 1 < rows else 0", "below = y - 1 if y > 0 else rows - 1"]
    inner += _addresses(lattice)
    inner += ["v, at = 0, (z * kinds.shape[1] + y) * vectors", "while v < vectors:"]
    inner += ["    " + line for line in _vector(lattice, source)]
    inner += _seam(lattice)
    lines += ["            " + line for line in inner]
    return text + "".join(f"    {line}\n" for line in lines) + "    return 0\n"


def _place(e: tuple[int, int, int]) -> str:
    """Address of x = 0 of the row of slot 0 that e points to."""
    plane = "up" if e[0] else "z"
    row = {0: "y", 1: "above", -1: "below"}[e[1]]
    return f"start + {plane}*plane + {row}*row + first"


def _addresses(lattice: Lattice) -> list[str]:
    """lo: where arrivals of the first of a pair are, hi: those of the second, for x = 0."""
    lines = [f"here = {_place((0, 0, 0))}"]
    for i, j in lattice.pairs:
        e = storage_order(lattice, i)
        step = {0: "", 1: " + SIZE", -1: " - SIZE"}[e[2]]
        lines.append(f"lo{i} = here + slot*({i} + parity)")
        lines.append(f"hi{i} = {_place(e)} + slot*({j} - parity){step}")
    return lines


def _vector(lattice: Lattice, source: Source) -> list[str]:
    """Collide and store one vector. Each kind has the whole text to itself, and a plain one stores a pair as soon as it
    is known: where a block of code ends, a processor with few registers would keep all populations in memory.
    """
    lines = ["kind, hop = kinds[z, y, v], hops[z, y, v]", f"if kind == {SKIP}:", "    v += hop", "    continue"]
    streams = ["here", *(f"{side}{i}" for i, _ in lattice.pairs for side in ("lo", "hi"))]
    lines += ["x = v * BYTES", "there = x + hop", *(f"prefetch_to_write({stream} + there)" for stream in streams)]
    # what is fetched is most often the vector AHEAD of this one in memory, which tells whether it is mixed
    lines += [f"if line[min(at + v + {AHEAD}, line.size - 1)] != {PLAIN}:", *_fetch_mixed(lattice)]
    loads, stores = ["f0 = load_at(F, here + x, BYTES)"], {"g0": ["store_at(here + x, g0, BYTES)"]}
    for i, j in lattice.pairs:
        loads += [f"f{i} = load_at(F, lo{i} + x, BYTES)", f"f{j} = load_at(F, hi{i} + x, SIZE)"]
        stores[f"g{j}"] = [f"store_at(hi{i} + x, g{i}, SIZE)", f"store_at(lo{i} + x, g{j}, BYTES)"]
    plain = [text for line in source.lines for text in (line, *stores.get(line.split()[0], ()))]
    lines += [f"if kind == {PLAIN}:", *("    " + line for line in loads + plain)]
    return [*lines, "else:", *("    " + line for line in [*loads, *source.lines, *_mixed(lattice)]), "v += 1"]


def _fetch_mixed(lattice: Lattice) -> list[str]:
    """What only a mixed vector wants: shifted ones are on two lines, and what goes back is on lines none has read."""
    shifted = [f"hi{i} + there + BYTES" for i, _ in lattice.pairs if storage_order(lattice, i)[2]]
    back = [f"{to}{i} + there {sign} swap" for i, _ in lattice.pairs for to, sign in (("hi", "+"), ("lo", "-"))]
    return [f"    prefetch_to_write({place})" for place in shifted + back]


def _wet(e: tuple[int, int, int], v: str) -> str:
    """The bits of the row that e points to."""
    shift = [f"{c:+d}" if c else "" for c in e]
    return f"wet[z + {1 + e[0]}, y + {1 + e[1]}, {v}]" if any(shift) else f"wet[z + 1, y + 1, {v}]"


def _mixed(lattice: Lattice) -> list[str]:
    """Stores of the fluid lanes, to the neighbour whatever it is, and back from solid ones.

    What goes to a solid node is read by nobody. A lane that has nothing to give back stores nowhere: where instructions
    take masks without a branch, which no machine foresees, and at an address that is in the cache already.
    """
    targets = [(target, i, j, sign) for i, j in lattice.pairs for target, sign in (("hi", 1), ("lo", -1))]
    stores = [("here", 0, "BYTES")]
    stores += [("hi" + str(i), i, "SIZE") if sign > 0 else ("lo" + str(i), j, "BYTES") for _, i, j, sign in targets]
    lines = [f"own = ({_wet((0, 0, 0), 'v')} >> 1) & inside[v]", "if own == FULL:"]
    lines += [f"    store_at({place} + x, g{g}, {align})" for place, g, align in stores]
    lines += ["else:", "    fluid = mask_of_bits(F, own)"]
    lines += [f"    store_where({place} + x, g{g}, fluid, {align})" for place, g, align in stores]
    for target, i, j, sign in targets:
        e = storage_order(lattice, i)
        to = (sign * e[0], sign * e[1], sign * e[2])
        g, align = (i, "SIZE") if sign > 0 else (j, "BYTES")
        lines.append(f"shut = own & ~({_wet(to, 'v')} >> {1 + to[2]})")
        back = f"{target}{i} + x {'+' if sign > 0 else '-'} (swap & -np.int64(shut != 0))"
        lines.append(f"store_where({back}, g{g}, mask_of_bits(F, shut), {align})")
    return lines


def _seam(lattice: Lattice) -> list[str]:
    """Copies of what crossed an end of the row to the other end, where it is read if the row is periodic."""
    copies: list[tuple[int, tuple[int, int, int], str, str]] = []
    for i, _ in lattice.pairs:
        plane, row, x = storage_order(lattice, i)
        if x == 1:  # the last node's to x = 0; and of x = 0, where the last node looks for it
            copies.append((1, (plane, row, 1), f"hi{i} - SIZE", f"hi{i} + end"))
            copies.append((0, (-plane, -row, -1), f"lo{i} + end + SIZE", f"lo{i}"))
        elif x == -1:
            copies.append((0, (plane, row, -1), f"hi{i} + end + SIZE", f"hi{i}"))
            copies.append((1, (-plane, -row, 1), f"lo{i} - SIZE", f"lo{i} + end"))
    plain = [f"store_at({to}, load_at(S, {source}, SIZE), SIZE)" for _, _, to, source in copies]
    lines = [f"if kinds[z, y, 0] == {PLAIN} and kinds[z, y, vectors - 1] == {PLAIN}:"]
    lines += ["    " + line for line in plain]
    lines += ["else:", "    last = (nx - 1) - (vectors - 1) * N"]
    for (at_end, e, _, _), line in zip(copies, plain):
        v, own, to = ("vectors - 1", "last + 1", "last + 2") if at_end else ("0", "1", "0")
        lines.append(f"    if ({_wet((0, 0, 0), v)} >> ({own})) & ({_wet(e, v)} >> ({to})) & 1:")
        lines.append("        " + line)
    return lines
