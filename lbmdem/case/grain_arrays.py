"""Arrays that a set of grains starts with."""

from numpy.typing import NDArray

from hpcpic.core.files.start import Start, arrays

OF_DISCS = {"position": slice(2), "velocity": slice(2), "angular_velocity": slice(2, 3)}  # components of vectors


def given(start: Start | None, shape: str | None, name: str) -> NDArray | None:
    """An array of grains of this shape; None where there is none. Vectors of discs may have three components, as they
    are read, of which those are taken that discs have.
    """
    found = arrays(start).get(name) if start else None
    if found is None or shape != "disc" or found.shape[1:] != (3,):
        return found
    return found[:, OF_DISCS[name]]
