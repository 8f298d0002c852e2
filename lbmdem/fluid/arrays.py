"""The arrays of links that stay, and of solid nodes that move. Without numba.

Sizes: "links" of a slab; "segments" of links that have plane, direction and distances in common, and their "ends";
"bodies" that links end at; "shares" of the segments; "grains" near a slab and their "images" before and after a move;
"blocks" of these, "changes" of nodes that a block lists, and nodes "changed" by all.
"""

from hpcpic.core.space.declared import Array
from lbmdem.physics.wall_rules import WallRule
from lbmdem.sizes import GAINS


def fixed_links(rule: WallRule, real: str, place: str, *, sparse: bool, moved: bool) -> tuple[Array, ...]:
    """What links that stay keep of a rule, with populations of the type `real` at places of the type `place`.

    sparse: fluid nodes alone are held; moved: a wall has a velocity.
    """
    far, behind = ("links" if there else 0 for there in (rule.reach == 2, sparse))
    wall, speed = "links" if moved or far else 0, "links" if moved else 0
    return (
        Array("node", ("links",), place, "", "element of the node in a slot"),
        Array("behind", (behind,), place, "", "element of what came from the node behind it, if held apart"),
        Array("weights", ("links", rule.numbers), real if rule.numbers == 1 else "float64", "", "of the rule"),
        Array("wall", (wall,), "float64", "", "what a wall that moves takes off"),
        Array("body", ("links",), "int32", "", "row of the body"),
        Array("arm", ("links", 3), "float64", "nodes", "from the centre of the body to the crossing"),
        Array("speed", (speed, 3), "float64", "nodes/step", "of the wall there"),
        Array("kept", (2, "links", 2), "float64", "", "what went out and what comes back, by parity"),
        Array("far", (2, far, 2), "int64", "", "elements of the populations from further behind, by parity"),
        Array("far_weights", (far, 2), "float64", "", "of these"),
        Array("wall_now", (far,), "float64", "", "wall less what comes from further behind"),
        Array("start", ("ends",), "int64", "", "first link of each segment"),
        Array("offsets", (2, "segments", 3), "int64", "", "elements to the three that a link reads, by parity"),
        Array("direction", ("segments",), "int64"),
        Array("way", ("segments", 3), "float64", "", "of the direction, (x, row, plane)"),
        Array("sums", ("shares", "bodies", GAINS), "int64", "1 / scale"),
        Array("scale", (GAINS,), "float64"),
    )


MOVED_NODES = (
    Array("ids", ("grains",), "int64"),
    Array("centres", ("grains", 3), "float64", "nodes"),
    Array("radii", ("grains",), "float64", "nodes"),
    Array("motion", ("grains", 6), "float64", "nodes/step, 1/step", "velocity and angular velocity"),
    Array("grain", ("images",), "int64", "", "row of the grain that an image is of"),
    Array("offset", ("images", 3), "int64", "nodes", "from nodes of the grain to local ones"),
    Array("ids_before", ("grains",), "int64", "", "the move"),
    Array("centres_before", ("grains", 3), "float64", "nodes"),
    Array("radii_before", ("grains",), "float64", "nodes"),
    Array("grain_before", ("images",), "int64"),
    Array("offset_before", ("images", 3), "int64", "nodes"),
    Array("places", ("images", 2, 4), "float64", "nodes", "centre and squared radius before and now"),
    Array("shifts", ("images", 2, 3), "int64", "nodes", "to local nodes, before and now"),
    Array("numbers", ("images",), "int32", "", "of the grains"),
    Array("counts", ("block_ends", 3), "int64", "", "first image of a block, nodes that its images leave and take"),
    Array("left", ("blocks", "changes"), "int64", "", "flat places of nodes"),
    Array("left_by", ("blocks", "changes"), "int32", "", "ids of the grains"),
    Array("taken", ("blocks", "changes"), "int64", "", "flat places of nodes"),
    Array("taken_by", ("blocks", "changes"), "int32", "", "ids of the grains"),
    Array("claimants", ("grains",), "int64", "", "ids of grains that want a node of another one"),
    Array("changed", ("changed",), "int64", "", "flat places of nodes"),
    Array("own", (2, "changed"), "int64", "", "flat places of own nodes, uncovered and covered"),
    Array("own_by", (2, "changed"), "int32", "", "ids of the grains"),
    Array("lengths", (8,), "int64", "", "of the lists in use, see kernels.grain_rasters"),
)
