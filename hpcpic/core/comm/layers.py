"""Operations on the layers of an array seen as [before, layer, after].

`compiled` is loops, for task graphs (numba compiles loops in a twentieth of the time it takes for slices); `plain` is
numpy, for calls from Python, of what `Fill` does.
"""

from typing import Any, NamedTuple

from hpcpic.core.simd.compile import njit


class Kernel(NamedTuple):
    compiled: Any
    plain: Any = None


def _pack(layers, out, body):
    for k, layer in enumerate(out):
        body[k] = layers[:, layer]


@njit
def pack(layers, out, body):
    """body[k, before, after] = layer out[k]."""
    for k in range(out.size):
        for b in range(layers.shape[0]):
            source, target = layers[b, out[k]], body[k, b]
            for i in range(target.size):
                target[i] = source[i]


def _unpack(layers, into, body):
    for k, layer in enumerate(into):
        layers[:, layer] = body[k]


@njit
def unpack(layers, into, body):
    """Layer into[k] = body[k, before, after]."""
    for k in range(into.size):
        for b in range(layers.shape[0]):
            source, target = body[k, b], layers[b, into[k]]
            for i in range(target.size):
                target[i] = source[i]


@njit
def unpack_add(layers, into, body):
    """Layer into[k] += body[k, before, after], one after the other: a layer may come twice."""
    for k in range(into.size):
        for b in range(layers.shape[0]):
            source, target = body[k, b], layers[b, into[k]]
            for i in range(target.size):
                target[i] += source[i]


def _copy(layers, sources, ghosts):
    for source, ghost in zip(sources, ghosts):
        layers[:, ghost] = layers[:, source]


@njit
def copy(layers, sources, ghosts):
    """Layer ghosts[k] = layer sources[k]."""
    for b in range(layers.shape[0]):
        for k in range(ghosts.size):
            source, target = layers[b, sources[k]], layers[b, ghosts[k]]
            for i in range(target.size):
                target[i] = source[i]


@njit
def add(layers, sources, ghosts):
    """Layer sources[k] += layer ghosts[k]: with `clear` after it, the adjoint of `copy`."""
    for b in range(layers.shape[0]):
        for k in range(ghosts.size):
            source, target = layers[b, ghosts[k]], layers[b, sources[k]]
            for i in range(target.size):
                target[i] += source[i]


@njit
def clear(layers, below, above):
    """The first `below` and the last `above` layers become zero."""
    n = layers.shape[1]
    for b in range(layers.shape[0]):
        for k in range(below + above):
            target = layers[b, k if k < below else n - 1 - (k - below)]
            for i in range(target.size):
                target[i] = 0


PACK = Kernel(pack, _pack)
UNPACK = Kernel(unpack, _unpack)
UNPACK_ADD = Kernel(unpack_add)
COPY = Kernel(copy, _copy)
ADD = Kernel(add)
CLEAR = Kernel(clear)
