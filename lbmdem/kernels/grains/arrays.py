"""Groups of arrays that the kernels of grains take; `lbmdem.grains.arrays` says what each holds."""

from typing import NamedTuple

from numpy.typing import NDArray


class GrainArrays(NamedTuple):
    """State of the grains that this rank moves; `row` holds ghosts too, and a last row that touches nothing."""

    row: NDArray
    pull: NDArray
    force: NDArray
    given: NDArray
    heat: NDArray
    work: NDArray
    origin: NDArray


class Pushed(NamedTuple):
    """Forces that are given from outside, and numbers and masses of the grains that get them."""

    given: NDArray
    id: NDArray
    mass: NDArray


class Frame(NamedTuple):
    """A shaken frame: `accelerations[m, d]` of steps of `each` substeps, of which `first` were done before; forces
    constant[number, d] in a frame at rest. One that is not shaken has no accelerations.
    """

    first: int
    each: int
    accelerations: NDArray
    constant: NDArray


class Contacts(NamedTuple):
    """Slots of pairs that may touch."""

    low: NDArray
    high: NDArray
    damping: NDArray
    lines: NDArray
    couples: NDArray
    springs: NDArray
    busy: NDArray


class GrainLists(NamedTuple):
    """entries[begins[k] .. begins[k + 1]] are twice the slots of grain k's contacts, in the order of the partners' ids,
    plus 1 where it is the second of the pair.
    """

    begins: NDArray
    entries: NDArray


class Box(NamedTuple):
    """lengths[3] of the box; inverses[3] of the lengths of its periodic axes, 0 for others."""

    lengths: NDArray
    inverses: NDArray


class Cells(NamedTuple):
    """Grains by cells of a diameter or more. shape[3]: cells along a periodic axis, else 0; place[n, 3]: the cell of a
    grain. Cells share buckets; bucket b holds begins[b] .. begins[b + 1] of grain, line (of cells along x) and ball[4,
    n] (centre, radius), in the order of the rows.
    """

    shape: NDArray
    place: NDArray
    begins: NDArray
    grain: NDArray
    line: NDArray
    ball: NDArray
