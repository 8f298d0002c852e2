"""What a case makes the program do and hold: kernels, arrays and messages of a step, before anything is allocated.

`check --plan` prints it and `estimate` adds it up, so what a scene does not contain shows as missing lines and bytes.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

from hpcpic.core.app.forecast import array_lines, imports, listed, slabs
from hpcpic.core.comm.shared_memory import FOLDER as SHARED_MEMORY
from hpcpic.core.space.declared import Array
from hpcpic.plasma.case.config import PlasmaConfig, rotation, velocity_components
from hpcpic.plasma.forecast.cuts import first_cuts
from hpcpic.plasma.forecast.scales import particle_count
from hpcpic.plasma.particles.arrays import declared
from hpcpic.plasma.physics.moments import values_of
from hpcpic.plasma.physics.shapes import SHAPES
from hpcpic.plasma.physics.species_fields import asked_for
from hpcpic.plasma.setup.macro_particles import macro_charge
from hpcpic.plasma.sizes import EDGE, PAGE

ROTATION = ("no rotation", "rotation about z", "rotation about any axis", "exact rotation about any axis")


def groups(config: PlasmaConfig) -> int:
    """Species with the same size of charge share one array of integer charge."""
    return max(1, len({abs(macro_charge(config, species)) for species in config.species}))


def kernels(config: PlasmaConfig) -> list[str]:
    """The compiled kernels of a step, with what they are made for."""
    d, shape = config.dimensions, config.numerics.shape
    law = (
        f"{d}D, {shape}, {velocity_components(config)} velocity components, {config.numerics.precision}, "
        f"{ROTATION[rotation(config)]}"
    )
    field = (
        "sparse LU of the gathered grid"
        if config.simulation.solver == "LU"
        else "transposed FFT, Green function on the columns"
    )
    more = ("one more inverse transform", "two more inverse transforms", "three more inverse transforms")
    gradient = more[d - 1] if config.numerics.gradient == "spectral" else "centred differences"
    if not any(species.particles for species in config.species):
        return ["none: nothing changes without particles"]
    return [
        f"push       {law} (vectors)",
        f"deliver    {law}",
        "collect    integer charge of the blocks",
        f"solve      {field}",
        f"gradient   {gradient}",
    ]


def arrays(config: PlasmaConfig, ranks: int, threads: int) -> Iterator[Array]:
    """The arrays of a rank with the most rows, and with as many particles as any if all cost is in them."""
    d, points = config.dimensions, config.points[::-1]
    below, above = SHAPES[config.numerics.shape].ghosts
    ghosts = below + above
    cuts, inner = first_cuts(config, ranks), points[1:]
    rows = max(high - low for low, high in pairwise(cuts))
    real = "float64" if config.numerics.precision == "double" else "float32"
    blocks = config.simulation.plasma_chunks or threads
    n_groups = groups(config)
    yield from particle_arrays(config, ranks, (rows, *inner), blocks, real)
    between = (rows + ghosts, *(n + ghosts for n in inner[:-1]))
    wide = (*between, *(n + ghosts * blocks for n in inner[-1:]))
    slab = (*between, *(inner[-1:] or (1,)))
    yield Array("charge of the blocks", (n_groups, *wide), "int64")
    yield Array("charge of the slab", (n_groups, *slab), "int64")
    yield Array("rho", (rows, *(inner or (1,))), "float64")
    yield Array("phi", tuple(n + ghosts + 2 for n in (rows, *inner)), "float64")
    yield Array("E", (d, *(n + ghosts for n in (rows, *inner))), "float64")
    if asked := asked_for(config):
        moments = dict.fromkeys(moment for field in asked for moment in field.moments)
        n = 1 + max(1, values_of(tuple(moments), velocity_components(config)))
        yield Array("moments of the blocks", (n, *wide), "int64")
        yield Array("moments of the slab", (n, *slab), "int64")
    if config.periods["histogram"]:
        for histogram in config.histogram:
            yield Array(f"histogram {histogram.name}", (blocks, math.prod(histogram.bins) + 2), "int32")
    results = d if config.numerics.gradient == "spectral" else 1
    if config.simulation.solver == "LU":
        yield Array("LU: gathered grid, twice", (2, points[0], *(inner or (1,))), "float64")
        yield Array("LU: factors", (factor_nonzeros(config.points), 3), "int32")  # a float64 and its row
    else:
        across = inner[-1] if inner else 1
        yield Array("transform: rows", (1 + results, rows, *(inner or (1,))), "float64")
        shared = f" (in {SHARED_MEMORY})" if ranks > 1 and d > 1 else ""
        half = across // 2 + 1
        columns = -(-half // ranks) if d < 3 else -(-inner[0] // ranks) * half
        yield Array(f"transform: columns{shared}", (results, columns, points[0]), "complex128")


def factor_nonzeros(points: Sequence[int]) -> int:
    """Nonzeros of L and U together, with m points along the shortest side: six per point in 1D; in 2D 12 sqrt(m), as we
    counted them in SuperLU's for m of 16 to 256, in 3D 3 m^2, for m of 4 to 16, both to within a quarter.
    """
    m = min(points)
    return round(math.prod(points) * (6, 12 * math.sqrt(m), 3 * m * m)[len(points) - 1])


def particle_arrays(config: PlasmaConfig, ranks: int, slab: tuple[int, ...], blocks: int, real: str) -> Iterator[Array]:
    """Pages that are touched; every tile part of a species leaves half a page empty, on average. `slab`: its points."""
    n = particle_count(config)
    if not n:
        return
    edge, d = EDGE[config.dimensions], config.dimensions
    *others, columns = (-(-n // edge) for n in slab)
    parts = math.prod(others) * (max(blocks, columns) if d > 1 else columns)
    slots = parts * len(config.species)
    pages = -(-n // ranks // PAGE) + min(slots, n) // 2
    lanes = 64 // Array("one", (), real).itemsize
    sizes = {"pages": pages, "packs": PAGE // lanes, "components": d + velocity_components(config), "lanes": lanes}
    for array in declared(real):
        if array.name in ("pool", "ids"):
            yield replace(array.sized(sizes), name=array.text)


def messages(config: PlasmaConfig, ranks: int) -> list[str]:
    """What one rank sends in a step."""
    if ranks == 1:
        return ["none: one rank sends no messages"]
    if not any(species.particles for species in config.species):
        return ["none: nothing changes without particles"]
    neighbours = min(2, ranks - 1)
    below, above = SHAPES[config.numerics.shape].ghosts
    inner, ghosts = config.points[:-1], below + above
    charge = 8 * math.prod(inner[:1]) * math.prod(n + ghosts for n in inner[1:]) * groups(config) * ghosts
    wide = math.prod(n + ghosts + 2 for n in inner)
    lines = [
        f"particles  {neighbours}, with the leavers",
        f"wanted     {(ranks - 1).bit_length()} of 8 bytes: does any rank have leavers that are in no letter",
        f"charge     {min(1 + bool(below), neighbours)}, together {charge} bytes",
        f"potential  {neighbours}, together {8 * wide * (below + above + 2)} bytes",
    ]
    if config.simulation.solver == "LU":
        lines.append("solve      the grid gathered on every rank")
    elif config.dimensions == 1:
        lines.append(f"solve      the charge gathered on every rank, {ranks - 1} messages")
    else:
        lines.append(
            f"transform  {2 * (ranks - 1)}: tokens of 8 bytes inside a node, columns of the slab between nodes"
        )
    return lines


def plan(config: PlasmaConfig, ranks: int, threads: int) -> list[str]:
    """Lines for `check --plan`."""
    lines = listed("kernels of a step", kernels(config)) + slabs(first_cuts(config, ranks))
    lines += listed("arrays per rank", array_lines(arrays(config, ranks, threads)))
    lines += listed("messages of a step, per rank", messages(config, ranks))
    solver = "scipy.sparse" if config.simulation.solver == "LU" else "FFTW (the library of pyfftw alone)"
    return lines + imports(solver)
