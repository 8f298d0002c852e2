"""Every array of a rank that has a size: name, shape, type, unit. What allocates them and what foretells them read it.

A slot is a place for one particle, ghost or image; sizes of shapes are those of the arena:
slots, layers (of cells that have particles, and one more), rows (of cells in these), cells (fine cells in these),
parts (tasks of a launch), ends (one more: where the parts begin, and where the last one ends), walls.
"""

from hpcpic.core.space.declared import Array
from sph.physics.pair_spec import PairSpec, columns_of, most_sums, unused

HALF_ROWS = {2: 2, 3: 5}  # rows of cells in half a neighbourhood, by dimensions


def arrays_of(spec: PairSpec, staged: bool) -> list[Array]:
    """The arrays of a scene; `staged`: its integrator evaluates more than once a step. Those it does not need have
    no slots.
    """
    unneeded = unused(spec, staged)

    def lines(name: str, shape: tuple[int, ...], unit: str, text: str) -> Array:
        return Array(name, (*shape, 0 if name in unneeded else "slots"), "float64", unit, text)

    d = spec.dimensions
    return [
        Array("state", (2 * d + 3, "slots"), "float64", "", "x[d] m, v[d] m/s, rho - rho0 kg/m3, mass kg, key (int64)"),
        Array("flags", ("slots",), "int32", "", "who is there (kernels.marks), 0: nobody"),
        lines("x_old", (d,), "m", "positions at the start of a step"),
        lines("v_old", (d,), "m/s", "velocities then"),
        lines("drho_old", (), "kg/m3", "rho - rho0 then"),
        lines("gradient", (d,), "", "renormalised gradient of density, in units of the pair sums"),
        lines("shear", (d * d,), "", "velocity gradient d v_b / d x_a, in units of the pair sums"),
        lines("matrix", (d * d,), "", "renormalisation of gradients"),
        lines("wetted", (), "", "mu / mu0 of the fluid before a particle of a wall, 0 where it is dry"),
        lines("own", (d,), "m/s2", "acceleration of the user's own of a particle of fluid"),
        lines("offset", (d,), "", "velocity of its shift over the largest velocity"),
        *_of_pairs(spec),
        *(Array(name, ("slots",), "int32", "", text, phase="sort") for name, text in SORTING.items()),
        Array("moved", ("slots",), "float64", "", "a line of the state, in the order of slots", phase="sort"),
        *_of_cells(d),
    ]


SORTING = {
    "body": "by slot: where its particle was",
    "kind": "by slot: the flags of its particle",
    "layer": "layer of a particle",
    "row": "row of cells of a particle",
    "fine": "fine cell of a particle",
    "bucket": "particles by layers; then by particle: its slot",
}


def _of_pairs(spec: PairSpec) -> list[Array]:
    """What sums over pairs read and leave."""
    n = HALF_ROWS[spec.dimensions]
    arrays = [
        Array("sums", (most_sums(spec), "slots"), spec.real, "", "pair sums of the last pass", phase="pairs"),
        Array("values", (len(columns_of(spec)), "slots"), spec.real, "", "operands of pairs", phase="pairs"),
        Array("run_first", (n, "slots"), "int32", "", "first slot of a run of neighbours", phase="pairs"),
        Array("run_length", (n, "slots"), "uint16", "", "slots of a run of neighbours", phase="pairs"),
    ]
    if spec.single:
        arrays.append(Array("position", (spec.dimensions, "slots"), "int32", "", "x in fixed point", phase="pairs"))
    return arrays


def _of_cells(d: int) -> list[Array]:
    """Tables of the cells, and what parts of a launch find and are given."""
    counts = {
        "count": "particles of a part in a layer",
        "low": "their lowest row",
        "high": "their highest row",
        "start": "where the particles of a part in a layer go",
    }
    ends = {
        "chunks": "first slots of the parts",
        "layers": "first layers of the parts",
        "sweeps": "first layers of the parts of a sweep over pairs",
        "inner": "first layers of the parts, without ghosts'",
    }
    return [
        *(Array(name, ("parts", "layers"), "int64", "", text) for name, text in counts.items()),
        *(Array(name, ("ends",), "int64", "", text) for name, text in ends.items()),
        Array("begin", ("layers",), "int64", "", "particles before a layer"),
        Array("base", ("layers",), "int64", "", "first slot of a layer"),
        Array("rows", ("layers", 3), "int64", "", "first row, number of rows and place in row_table of a layer"),
        Array("fine_total", ("layers",), "int64", "", "fine cells of a layer; then its place in fine_start"),
        Array("row_table", ("rows", 8), "int32", "", "see kernels.cells"),
        Array("fine_start", ("cells",), "int32", "", "first slot of a fine cell"),
        Array("span", ("parts", 2), "int64", "", "lowest and highest layer of the particles of a part"),
        Array("part_extremes", ("parts", 3 + 2 * d), "float64", "SI", "largest v^2, a^2, |rho - rho0|, -x, x"),
        Array("bits_sorted", ("parts", 2 * d + 3), "int64", "", "sums of bits of the state when it was last sorted"),
        Array("bits_found", ("parts", 2 * d + 2), "int64", "", "the same where a step is about to change the state"),
        Array("wall_shift", ("walls", d), "float64", "m", "way of the walls since they were last moved"),
        Array("wall_speed", ("walls", d), "float64", "m/s", "velocities of the walls"),
        Array("wall_acceleration", ("walls", d), "float64", "m/s2", "accelerations of the walls"),
        Array("wall_centre", ("walls", d), "float64", "m", "centres of the walls that turn"),
        Array("wall_twist", ("walls", d, d), "float64", "1/s2", "by which accelerations grow from there"),
        Array("wall_spin", ("walls", d, d), "float64", "1/s", "by which velocities do"),
        Array("shape", (6,), "int64", "", "pads, layers, first layer here, layers here, rows, 0"),
        Array("numbers", (5,), "float64", "", "what kernels.motion is told of a step"),
    ]
