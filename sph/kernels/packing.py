"""Generated text of `pack`: what pair sums read besides the state, by vectors of float64; see `columns`.

In single precision also the state in their units.
"""

import math

from sph.kernels.marks import NORMAL, REPULSIVE
from sph.physics.pair_spec import UNIT, PairSpec, columns_of

SCALES = (
    "per_h",
    "per_c",
    "per_rho",
    "per_m",
    "background",
    "viscosity",
    "tensile",
    "of_gradient",
    "of_strain",
    "of_shifting",
    "of_around",
)
"""1 / h, 1 / c0, 1 / rho0, 1 / (rho0 h^d), p / (rho0 c0^2), mu / (rho0 c0 h), Monaghan's coefficient; and what the
other sums of these kinds are multiplied by."""
MOST_GAMMA = 16  # that a polynomial is made for

HEAD = """
import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import (
    Vec, address_of, convert, floor, gather_lines, lanes, load, select, splat, store
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


def _values(spec: PairSpec) -> dict[str, str]:
    values = {"push": "(p + background) * (light * light)", "light": "light", "slope": "slope", "excess": "e"}
    values |= {"tension": "select(p < 0.0, -tensile * p, 0.05 * tensile * p) * (light * light)"}
    mass = "load(F, m, s) * per_m" if spec.single else "load(F, m, s)"
    there = f"select(load(I, flags, s) & {REPULSIVE} == {REPULSIVE}, 0.0, {mass})"  # repulsive particles have no volume
    values |= {"mass": mass, "volume": f"{there} * light"}
    code = f"(load(I, flags, s) >> {NORMAL}) * 8"
    for k, a in enumerate(spec.axes):
        values[f"v{a}"] = f"load(F, v[{k}], s) * per_c"
        values[f"n{a}"] = f"gather_lines(F, 1, address_of(face_normals[{k}], 0), {code})[0]"
    return values


def _lines(spec: PairSpec, gamma: float, columns: list[str]) -> list[str]:
    """For the bodies in the slots from s on."""
    kept, values = columns_of(spec), _values(spec)
    lines = ["e = load(F, drho, s) * per_rho", "rho = e + 1.0", "light = 1.0 / rho", *pressure_lines(gamma)]
    if "slope" in columns:
        lines += _slope_lines(gamma)
    if spec.single:  # fixed point, modulo 256 h
        for k in range(spec.dimensions):
            place = f"convert(I, convert(L, floor(load(F, x[{k}], s) * (per_h * {1 / UNIT!r}))))"
            lines.append(f"store(position[{k}], s, {place})")
    return lines + [f"store(values[{kept.index(name)}], s, convert(R, {values[name]}))" for name in columns]


def source(spec: PairSpec, gamma: float) -> str:
    """The module with `pack`: all columns but those that come from other pair sums."""
    others = {name for column in "glt" for name in spec.components(column)}
    columns = [name for name in columns_of(spec) if name not in others]
    lines = ["def pack(block, blocks, base, scales, flags, x, v, drho, m, face_normals, position, values):"]
    lines += [f"    {name} = scales[{k}]" for k, name in enumerate(SCALES)]
    lines += ["    line = np.zeros(N)"]
    lines += ["    for l in range(blocks[block], blocks[block + 1]):"]
    lines += ["        for s in range(base[l], base[l + 1], N):  # also where nobody is: vectors overrun"]
    lines += [f"            {line}" for line in _lines(spec, gamma, columns)]
    return HEAD.format(real=spec.real) + "\n\n@njit\n" + "\n".join(lines) + "\n"
