"""The passes over all pairs: terms (see `pairs`) put into loops over layers, bodies, rows and vectors of neighbours."""

from collections.abc import Sequence
from types import ModuleType

import numpy as np

from hpcpic.core.simd.generate import module_from_source
from hpcpic.core.simd.vector import lanes
from sph.physics.smoothing import SMOOTHING
from sph.physics.terms import Law, Terms, collect, columns_of, state_of

NUMBERS = (
    "artificial", "viscous", "flux_strength", "gravityx", "gravityy", "gravityz", "reach", "per_w", "per_h", "eta2",
    "density", "hundredth",
)  # fmt: skip

ROWS = {2: 2, 3: 5}  # as kernels.runs has them
FRESH = {2: (1,), 3: (1, 4)}  # of these, which the row before has not met
ARGUMENTS = (
    "block, blocks, odd, begin, base, shape, numbers, run_first, run_length, flags, position, v, drho, m, values, sums"
)

HEAD = """
import numpy as np
from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import (
    Vec, address_of, bitmask, convert, fma, lane_numbers, load, maximum, minimum, prefetch,
    prefetch_to_write, select, splat, sqrt, store, total
)

REAL = np.{real}
F_ = Vec({lanes}, REAL)
I_ = Vec({lanes}, np.int32)
"""


def _distance(law: Law) -> list[str]:
    if law.single:
        lines = [f"    d{a} = convert(F_, {a}_i - load(I_, {a}_, j))" for a in law.axes]
    else:
        lines = [f"    d{a} = {a}_i - load(F_, {a}_, j)" for a in law.axes]
    r2 = f"d{law.axes[-1]} * d{law.axes[-1]}"
    for a in law.axes[-2::-1]:
        r2 = f"fma(d{a}, d{a}, {r2})"
    return [*lines, f"    r2 = {r2}", "    r = sqrt(r2)", *SMOOTHING[law.kernel].source]


def _pair(law: Law, terms: Terms, plain: bool) -> list[str]:
    """One vector of neighbours; plain: all are fluid and near none that is not."""
    lines = [*_distance(law), "    F = select(lane < np.int32(end - j), F, 0.0)"]
    if not plain:
        lines += [
            "    kinds = load(I_, flags, j)",
            "    partners = (kinds | class_i) & 3 == 3",
            "    mixing = kinds & class_i & 8 == 8",
            "    F = select(partners, F, 0.0)",
        ]
    lines += [f"    {name}_j = load(F_, {name}_, j)" for name in sorted(terms.columns)]
    if terms.rare and not plain:  # these have neither mass nor volume
        lines += ["    stands = kinds & 4 == 4", "    solid_j = select(stands, mass_j, 0.0)"]
        lines += ["    mass_j = select(stands, 0.0, mass_j)"]
    lines += [line for line in terms.lines if not (plain and "mixing" in line)]
    for k, (_, to_i, to_j, by_i, by_j) in enumerate(terms.sums):
        lines.append(f"    sum{k} = fma({to_i}, {by_i}, sum{k})")
        lines.append(f"    store(sums{k}, j, fma({to_j}, {by_j}, load(F_, sums{k}, j)))")
    if terms.rare and not plain:
        lines += ["    repels = ((kinds | class_i) & 4 == 4) & (F != 0.0)  # it does not reach as far as the support"]
        lines += ["    if bitmask(repels) != 0:", *(f"        {line}" for line in terms.rare)]
        lines += [f"        e{a} = select(partners, e{a}, 0.0)" for a in law.axes]
        names = [entry[0] for entry in terms.sums]
        for a in law.axes:
            k = names.index(f"f{a}")
            lines.append(f"        sum{k} = sum{k} + e{a}")
            lines.append(f"        store(sums{k}, j, load(F_, sums{k}, j) - e{a})")
    return lines


def _fetch_ahead(law: Law, read: Sequence[str], n: int) -> list[str]:
    """Cache lines that bodies soon after i will want first, and no row has before: there are more streams than the
    processor follows by itself.
    """
    lines = []
    for row in FRESH[law.dimensions]:
        lines.append(f"soon = np.int64(run_first[{row}, i]) + np.int64(run_length[{row}, i]) + 4 * LANES_")
        lines += [f"prefetch(address_of({name}, soon))" for name in read]
        lines += [f"prefetch_to_write(address_of(sums{k}, soon))" for k in range(n)]
    return ["if i & (LANES_ // 4 - 1) == 0:", *(f"    {line}" for line in lines)]  # ends vary by more than a line


def _indent(lines: Sequence[str], depth: int) -> str:
    return "".join(" " * depth + line + "\n" for line in lines)


def _pass_source(law: Law, title: str, names: Sequence[str]) -> str:
    terms = collect(law, names)
    columns = columns_of(law)
    n, read = len(terms.sums), sorted(terms.columns)
    places = {name: f"values[{columns.index(name)}]" for name in columns} | ({} if law.single else state_of(law))
    if law.in_turn:
        places["volume"] = places["light"]
    numbers = [f"{name} = REAL(numbers[{k}])" for k, name in enumerate(NUMBERS)]
    views = [f"{a}_ = position[{k}]" for k, a in enumerate(law.axes)] + [f"{name}_ = {places[name]}" for name in read]
    fetch = [f"{name}_i = {name}_[u]" for name in (*law.axes, *read)]
    fetch += [f"sum{k} = splat(F_, 0.0)" for k in range(n)]
    fetch += _fetch_ahead(law, [view.split(" ")[0] for view in views], n)
    views += [f"sums{k} = sums[{k}]" for k in range(n)]
    if terms.rare:
        views += [f"n{a}_ = {places[f'n{a}']}" for a in law.axes]
    return (
        f"\n\n@njit\ndef {title}({ARGUMENTS}):\n"
        + _indent([*numbers, *views, "lane = lane_numbers(I_)"], 4)
        + _indent(["for l in range(blocks[block], blocks[block + 1]):"], 4)
        + _indent(["if (shape[2] + l) & 1 != odd:", "    continue"], 8)
        + _indent(["first, last = base[l], base[l] + begin[l + 1] - begin[l]"], 8)
        + _indent(["if odd == 0:  # the first that adds to these two"], 8)
        + _indent([f"clear(sums{k}, first, base[l + 2])" for k in range(n)], 12)
        + _indent(["for i in range(first, last):", "    u = np.uint64(i)  # numba looks whether others are below 0"], 8)
        + _indent(fetch, 12)
        + _neighbours(law, terms)
        + _indent([f"sums{k}[u] += total(sum{k})" for k in range(n)], 12)
    )


def _neighbours(law: Law, terms: Terms) -> str:
    """The loops over the runs of a body."""

    def loop(plain: bool, depth: int) -> str:
        head = [
            f"for row in range({ROWS[law.dimensions]}):",
            "    j = np.int64(run_first[np.uint64(row), u])",
            "    end = j + np.int64(run_length[np.uint64(row), u])",
            "    while j < end:",
        ]
        return _indent(head, depth) + _indent([*_pair(law, terms, plain), "    j += LANES_"], depth + 4)

    if law.walls:
        body = _indent(["class_i = flags[u]", "if class_i & 16 == 16:"], 12) + loop(True, 16)
        body += _indent(["else:"], 12)
        if terms.rare:
            body += _indent(["solid_i = mass_i if class_i & 4 == 4 else REAL(0.0)", "mass_i -= solid_i"], 16)
        body += loop(False, 16)
    else:
        body = loop(True, 12)
    return body


CLEAR = """

@njit
def clear(line, first, last):
    for k in range(first, last, LANES_):
        store(line, k, splat(F_, 0.0))
"""


def make(law: Law, passes: dict[str, Sequence[str]]) -> ModuleType:
    """Module with a kernel for each pass: title -> names of its terms."""
    n = lanes(np.dtype(law.real))
    text = HEAD.format(real=law.real, lanes=n) + f"LANES_ = np.int64({n})\n" + CLEAR
    text += "".join(_pass_source(law, title, names) for title, names in passes.items())
    return module_from_source(text, "sph_pairs")
