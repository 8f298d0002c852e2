"""The arrays of links to moving grains. Without numba.

Sizes: "grains"; "parts" of their images, "shares" of planes.
"""

from hpcpic.core.space.declared import Array
from lbmdem.sizes import GAINS

MOVING_LINKS = (
    Array("image", ("parts",), "int64"),
    Array("first", ("parts",), "int64", "", "plane"),
    Array("after", ("parts",), "int64", "", "plane"),
    Array("gains", ("parts", GAINS), "int64", "1 / scale"),
    Array("ends", ("cuts",), "int64", "", "first plane of each share, in planes of `solid`"),
    Array("cuts", ("cuts",), "int64", "", "first part of each share"),
    Array("counters", ("shares", 3), "int64", "", "links, fallbacks, lost"),
    Array("sums", ("grains", GAINS), "int64", "1 / scale"),
    Array("scale", (GAINS,), "float64"),
)
