"""The arrays of links to moving grains and of the nodes that these uncover. Without numba.

Sizes: "grains" and their "images" near a slab, "parts" of images, "shares" of planes, "uncovered" nodes.
"""

from hpcpic.core.space.declared import Array
from lbmdem.sizes import GAINS

MOVING_LINKS = (
    Array("ids", ("grains",), "int64"),
    Array("centres", ("grains", 3), "float64", "nodes"),
    Array("radii", ("grains",), "float64", "nodes"),
    Array("motion", ("grains", 6), "float64", "nodes/step, 1/step", "velocity and angular velocity"),
    Array("grain", ("images",), "int64", "", "row of the grain that an image is of"),
    Array("offset", ("images", 3), "int64", "nodes", "from nodes of the grain to local ones"),
    Array("image", ("parts",), "int64"),
    Array("first", ("parts",), "int64", "", "plane"),
    Array("after", ("parts",), "int64", "", "plane"),
    Array("gains", ("parts", GAINS), "int64", "1 / scale"),
    Array("ends", ("cuts",), "int64", "", "first plane of each share, in planes of `solid`"),
    Array("cuts", ("cuts",), "int64", "", "first part of each share"),
    Array("counters", ("shares", 3), "int64", "", "links, fallbacks, lost"),
    Array("scale", (GAINS,), "float64"),
)

REFILL = (
    Array("uncovered", ("uncovered",), "int64", "", "flat places of nodes to fill"),
    Array("speed", ("uncovered", 3), "float64", "nodes/step", "of the grain that was there"),
    Array("fill_cuts", ("cuts",), "int64", "", "first node of each share"),
)
