"""Generated text of `pack`: the state of the bodies into the columns of their slots, by vectors of float64.

Bodies are in SI units, columns in those of `pairs`; see `columns`. Numbers of bodies are below 2^28.
"""

import math

from sph.kernels.pairs import UNIT, Law, columns_of

SCALES = ("per_h", "per_c", "per_rho", "per_m", "background", "viscosity", "acceleration", "rate_scale", "tensile", "h")
"""1 / h, 1 / c0, 1 / rho0, 1 / (rho0 h^d), p / (rho0 c0^2), mu / (rho0 c0 h); c0^2 / h, rho0 c0 / h,
Monaghan's coefficient, h."""
MOST_GAMMA = 16  # that a polynomial is made for

HEAD = """
import numpy as np

from hpcpic.core.simd.jit import njit
from hpcpic.core.simd.vector import (
    Vec, address_of, convert, floor, gather_lines, lane_numbers, lanes, load, select, splat, store
)

N = lanes(np.float64)
F, I, L = Vec(N, np.float64), Vec(N, np.int32), Vec(N, np.int64)
R = Vec(N, np.{real})
"""


def _lane_by_lane(name: str, formula: str) -> list[str]:
    """Lines for a formula of e that has no vector form."""
    return [
        "store(line, 0, e)",
        "for k in range(N):",
        f"    line[k] = {formula.replace('e_', 'line[k]')}",
        f"{name} = load(F, line, 0)",
    ]


def pressure_lines(gamma: float) -> list[str]:
    """(MP 14) in units of rho0 c0^2: p = ((1 + e)^gamma - 1) / gamma, without loss for small e."""
    if gamma != int(gamma) or gamma > MOST_GAMMA:
        return _lane_by_lane("p", f"np.expm1({gamma!r} * np.log1p(e_)) / {gamma!r}")
    n = int(gamma)
    inner = repr(1.0 / n * math.comb(n, n))
    for k in range(n - 1, 0, -1):
        inner = f"{math.comb(n, k) / n!r} + e * ({inner})"
    return [f"p = e * ({inner})"]


def _slope_lines(gamma: float) -> list[str]:
    """rho / (2 c^2) in units of rho0 / c0^2: half of rho^(2 - gamma)."""
    if gamma != int(gamma) or gamma > MOST_GAMMA:
        return _lane_by_lane("slope", f"0.5 * (1.0 + e_) ** {2.0 - gamma!r}")
    factor, n = ("rho", 2 - int(gamma)) if gamma <= 2 else ("light", int(gamma) - 2)
    return ["slope = " + " * ".join(["splat(F, 0.5)", *[factor] * n])]


def _take(name: str) -> str:
    """What the bodies b of a vector have in a line of memory."""
    return f"gather_lines(F, 1, address_of({name}, 0), b)[0]"


def _values(law: Law) -> dict[str, str]:
    values = {"push": "(p + background) * (light * light)", "volume": "mass * light", "mass": "mass"}
    values |= {"tension": "select(p < 0.0, -tensile * p, 0.05 * tensile * p) * (light * light)", "solid": "solid"}
    values |= {f"n{a}": _take(f"normal{k}") for k, a in enumerate(law.axes)}
    values |= {f"v{a}": f"{_take(f'v{k}')} * per_c" for k, a in enumerate(law.axes)}
    return values | {"excess": "e", "light": "light", "slope": "slope"}


def _lines(law: Law, gamma: float, columns: list[str]) -> list[str]:
    """For the bodies in the slots from s on."""
    kept, values = columns_of(law), _values(law)
    lines = [
        "b = select(lane < np.int32(last - s), load(I, body, s), body[s]) * 8",
        f"e = {_take('drho')} * per_rho",
        "rho = e + 1.0",
        "light = 1.0 / rho",
        f"mass = {_take('m')} * per_m",
    ]
    if law.repulsive:  # these have neither mass nor volume
        lines += ["stands = load(I, slot_class, s) & 4 == 4", "solid = select(stands, mass, 0.0)"]
        lines += ["mass = select(stands, 0.0, mass)"]
    lines += pressure_lines(gamma)
    if "slope" in columns:
        lines += _slope_lines(gamma)
    for k in range(law.dimensions):
        if law.single:  # fixed point, modulo 256 h
            place = f"convert(I, convert(L, floor({_take(f'x{k}')} * (per_h * {1 / UNIT!r}))))"
        else:
            place = f"{_take(f'x{k}')} * per_h"
        lines.append(f"store(position{k}, s, {place})")
    return lines + [f"store(values{kept.index(name)}, s, convert(R, {values[name]}))" for name in columns]


def source(law: Law, gamma: float) -> str:
    """The module with `pack`: all columns but those that come from other pair sums."""
    columns = [name for name in columns_of(law) if name[:-1] != "g" and not (name[0] in "tl" and len(name) == 3)]
    arguments = ["x", "v", "drho", "m", "position", "values"] + (["normal"] if law.repulsive else [])
    views = dict.fromkeys(("x", "v", "position"), law.dimensions) | {"values": len(columns_of(law))}
    views |= {"normal": law.dimensions} if law.repulsive else {}
    lines = [f"def pack(block, blocks, begin, base, body, slot_class, scales, {', '.join(arguments)}):"]
    lines += [f"    {name} = scales[{k}]" for k, name in enumerate(SCALES)]
    lines += [f"    {name}{k} = {name}[{k}]" for name, n in views.items() for k in range(n)]
    lines += ["    lane, line = lane_numbers(I), np.zeros(N)"]
    lines += ["    for l in range(blocks[block], blocks[block + 1]):"]
    lines += ["        last = base[l] + begin[l + 1] - begin[l]", "        for s in range(base[l], last, N):"]
    lines += [f"            {line}" for line in _lines(law, gamma, columns)]
    return HEAD.format(real=law.real) + "\n\n@njit\n" + "\n".join(lines) + "\n"
