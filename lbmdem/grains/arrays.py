"""The arrays of the grains of a rank and of their contacts. Without numba.

Sizes: "grains" that this rank moves, "rows" of these, of ghosts and one that touches nothing, "slots" of pairs that may
touch (whole vectors of LANES), "filmed" as many where there are films, "entries" of pairs in the grains' own lists,
"parts" of a substep, "walls".
"""

from collections.abc import Iterator

from hpcpic.core.space.declared import Array
from lbmdem.sizes import LANES, PAIRS_PER_GRAIN, ROW

GRAINS = (
    Array("id", ("grains",), "int64"),
    Array("row", ("rows", ROW), "float64", "m, m/s, 1/kg, rad/s, 1/(kg m2)", "state, of ghosts too"),
    Array("mass", ("grains",), "float64", "kg"),
    Array("inertia", ("grains",), "float64", "kg m2"),
    Array("fixed", ("grains",), "int64", "", "1 for a grain that keeps its velocities"),
    Array("pull", ("grains",), "float64", "", "share of gravity: 0 fixed, 1, less with added mass"),
    Array("force", ("grains", 8), "float64", "N, W, N m", "of contacts: force, power, torque, 0"),
    Array("given", ("grains", 8), "float64", "N, N m", "of others, through the substeps"),
    Array("heat", ("grains",), "float64", "J", "made in this grain's half of its contacts"),
    Array("work", ("grains",), "float64", "J", "done by walls on this grain, and by it if it is fixed and moves"),
    Array("origin", ("grains", 8), "float64", "m, m/s", "first half of the row when pairs were listed"),
)

DRIVEN = (
    Array("own", ("grains", 4), "float64", "m/s2", "acceleration of the user's own (3), and which one: 0 for none"),
)

CONTACTS = (
    Array("low", ("slots",), "int32", "", "row of the grain with the smaller id"),
    Array("high", ("slots",), "int32", "", "row of the other grain, or number of the wall"),
    Array("damping", ("slots",), "float64", "kg/s"),
    Array("lines", ("slots", LANES), "float64", "N, W, N, m", "force, power, torque per arm, half the overlap"),
    Array("couples", ("filmed", LANES), "float64", "N", "of films: torque per arm that is opposite on the two"),
    Array("springs", (3, "slots"), "float64", "m", "tangential springs"),
    Array("busy", ("slots",), "uint8", "", "1 for a vector of slots whose lines are not zero"),
    Array("begins", ("rows",), "int64", "", "first entry of each grain"),
    Array("entries", ("entries",), "int64", "", "2 x slot, plus 1 where the grain is the second of the pair"),
)

STEP = (
    Array("walls", ("walls", ROW), "float64", "m, m/s", "point 0, velocity 0, inward normal 0, ..."),
    Array("farthest", ("parts", LANES), "float64", "m2", "greatest squared distance from origin, by axis"),
    Array("grain_cuts", ("cuts",), "int64", "", "first grain of each part, and the end"),
    Array("pair_cuts", ("cuts",), "int64", "", "first slot of grains of each part"),
    Array("wall_cuts", ("cuts",), "int64", "", "first slot of walls of each part"),
)


def expected(grains: int, d: int, films: bool) -> Iterator[Array]:
    """The arrays of so many grains on a rank, as large as a dense packing makes them."""
    slots = PAIRS_PER_GRAIN[d] * grains // 2
    sizes = {"grains": grains, "rows": grains + 1, "slots": slots, "entries": 2 * slots, "filmed": films * slots}
    return (array.sized(sizes) for array in (*GRAINS, *CONTACTS))
