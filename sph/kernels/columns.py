"""Generated text of what stands around the pair sums: bodies to columns of slots, sums to rates of bodies.

Bodies are in SI units: x[d, n] (relative to the lower corner of the domain), v[d, n], drho[n] (density less the
reference), m[n], flags[n] (1 fluid, 2 its sums are used, 4 mirrored), gradient[d, n]. Columns see `pairs`.
"""

import math

from sph.kernels.pairs import UNIT, Law, columns_of

SCALES = ("per_h", "per_c", "per_rho", "per_m", "background", "viscosity", "acceleration", "rate_scale", "tensile", "h")
"""1 / h, 1 / c0, 1 / rho0, 1 / (rho0 h^d), p / (rho0 c0^2), mu / (rho0 c0 h); c0^2 / h, rho0 c0 / h,
Monaghan's coefficient, h."""

ALL_AROUND = {2: 1.5, 3: 2.4}  # of - sum V_j F r^2, d inside the fluid; less near a free surface (Lee et al. 2008)
LEAST_DETERMINANT = 0.1  # of the sum that L inverts, 1 inside the fluid, about 0.25 at a flat free surface in 2D


def pressure_lines(gamma: float) -> list[str]:
    """(MP 14) in units of rho0 c0^2: p = ((1 + e)^gamma - 1) / gamma, without loss for small e."""
    if gamma != int(gamma) or gamma > 16:
        return [f"p = np.expm1({gamma!r} * np.log1p(e)) / {gamma!r}"]
    n = int(gamma)
    inner = repr(1.0 / n * math.comb(n, n))
    for k in range(n - 1, 0, -1):
        inner = f"{math.comb(n, k) / n!r} + e * ({inner})"
    return [f"p = e * ({inner})"]


def _positions(law: Law) -> list[str]:
    lines = []
    for k in range(law.dimensions):
        if law.single:  # fixed point, modulo 256 h
            lines.append(f"position[{k}, s] = np.int32(np.int64(np.floor(x[{k}, b] * (per_h * {1 / UNIT!r}))))")
        else:
            lines.append(f"position[{k}, s] = x[{k}, b] * per_h")
    return lines


def _values(law: Law, gamma: float) -> dict[str, str]:
    here = " if flags[b] & 8 == 0 else 0.0" if law.repulsive else ""  # repulsive particles have neither mass nor volume
    values = {"rho": "rho", "push": "(p + background) / (rho * rho)"}
    values |= {"volume": f"mass / rho{here}", "mass": f"mass{here}"}
    values |= {"tension": "(-tensile * p if p < 0.0 else 0.05 * tensile * p) / (rho * rho)"}
    values |= {"solid": "0.0 if flags[b] & 8 == 0 else mass"}
    values |= {f"n{a}": f"normal[{k}, b]" for k, a in enumerate(law.axes)}
    values |= {f"v{a}": f"v[{k}, b] * per_c" for k, a in enumerate(law.axes)}
    values |= {"excess": "e", "mixes": "1.0 if flags[b] & 5 == 1 else 0.0", "light": "1.0 / rho"}
    values |= {f"g{a}": f"gradient[{k}, b]" for k, a in enumerate(law.axes)}
    values |= {"slope": f"0.5 * rho ** {2.0 - gamma!r}"}
    return values


def _kernel(title: str, arguments: str, setting: list[str], body: list[str]) -> str:
    lines = [f"def {title}(block, blocks, begin, base, body, scales, {arguments}):"]
    lines += [f"    {name} = scales[{k}]" for k, name in enumerate(SCALES)]
    lines += [f"    {line}" for line in setting]
    lines += ["    for l in range(blocks[block], blocks[block + 1]):"]
    lines += ["        for s in range(base[l], base[l] + begin[l + 1] - begin[l]):", "            b = body[s]"]
    lines += [f"            {line}" for line in body]
    return "\n\n@njit\n" + "\n".join(lines) + "\n"


def source(law: Law, gamma: float) -> str:
    """Kernels pack, pack_again (velocity and gradient only), and one to unpack each kind of sum."""
    columns, values = columns_of(law), _values(law, gamma)

    def store(names: list[str]) -> list[str]:
        return [f"values[{columns.index(name)}, s] = {values[name]}" for name in names]

    later = [name for name in columns if name[:-1] in ("v", "g")]
    stress = [name for name in columns if name[0] == "t" and len(name) == 3]
    matrix = [name for name in columns if name[0] == "l" and len(name) == 3]
    first = [name for name in columns if name[:-1] != "g" and name not in stress + matrix]
    head = ["e = drho[b] * per_rho", "rho = 1.0 + e", "mass = m[b] * per_m", *pressure_lines(gamma)]
    state = "x, v, drho, m, flags, position, values" + (", normal" if law.repulsive else "")
    text = _kernel("pack", state, [], head + _positions(law) + store(first))
    text += _kernel("pack_again", "v, gradient, values", [], store(later))
    if stress:
        text += _kernel("pack_stress", "drho, shear, values", [], _stress(law, columns)) + _unpack_strain(law)
    if law.corrected:
        body = [
            f"values[{columns.index(f'l{a}{b}')}, s] = matrix[{i * law.dimensions + j}, b]"
            for i, a in enumerate(law.axes) for j, b in enumerate(law.axes) if i <= j
        ]  # fmt: skip
        text += _kernel("pack_matrix", "matrix, values", [], body) + _unpack_matrix(law)
    if law.shifting:
        text += _unpack_shifting(law)
    text += _unpack_force(law) + _unpack_rate()
    if law.needs_gradient:
        text += _unpack_gradient(law)
    return text


def _sum(k: str) -> str:
    return f"np.float64(sums[{k}, s] + sums[{k}, n_slots + s])"


def _unpack_force(law: Law) -> str:
    body = ["factor = acceleration / (m[b] * per_m)"]
    body += [f"a[{k}, b] = {_sum(str(k))} * factor" for k in range(law.dimensions)]
    return _kernel("unpack_force", "m, sums, a", ["n_slots = sums.shape[1] // 2"], body)


def _unpack_rate() -> str:
    body = [f"rate[b] = {_sum('at')} * rate_scale if flags[b] & 8 == 0 else 0.0"]
    return _kernel("unpack_rate", "at, flags, sums, rate", ["n_slots = sums.shape[1] // 2"], body)


def _unpack_gradient(law: Law) -> str:
    """Half of the renormalised gradient, L b / 2; the plain sum where too few neighbours are there for L."""
    d = law.dimensions
    names, body, k = {}, [], 0
    for i in range(d):
        for j in range(i, d):
            body.append(f"m{i}{j} = {_sum(f'at + {k}')}")
            names[i, j] = names[j, i] = f"m{i}{j}"
            k += 1
        body.append(f"b{i} = {_sum(f'at + {k}')}")
        k += 1
    return _kernel("unpack_gradient", "at, sums, gradient", ["n_slots = sums.shape[1] // 2"], body + _solve(d))


def _solve(d: int) -> list[str]:
    if d == 2:
        lines = ["det = m00 * m11 - m01 * m01", "g0 = m11 * b0 - m01 * b1", "g1 = m00 * b1 - m01 * b0"]
    else:
        lines = [
            "c00, c01, c02 = m11 * m22 - m12 * m12, m02 * m12 - m01 * m22, m01 * m12 - m02 * m11",
            "c11, c12, c22 = m00 * m22 - m02 * m02, m01 * m02 - m00 * m12, m00 * m11 - m01 * m01",
            "det = m00 * c00 + m01 * c01 + m02 * c02",
            "g0 = c00 * b0 + c01 * b1 + c02 * b2",
            "g1 = c01 * b0 + c11 * b1 + c12 * b2",
            "g2 = c02 * b0 + c12 * b1 + c22 * b2",
        ]
    lines += ["factor = 0.5 / det if det > 1e-3 else 0.0"]
    return lines + [f"gradient[{k}, b] = g{k} * factor" for k in range(d)]


def _unpack_strain(law: Law) -> str:
    """The velocity gradient, shear[a, b] = d v_b / d x_a."""
    body = [f"shear[{k}, b] = {_sum(str(k))}" for k in range(law.dimensions**2)]
    return _kernel("unpack_strain", "sums, shear", ["n_slots = sums.shape[1] // 2"], body)


def _stress(law: Law, columns: list[str]) -> list[str]:
    """mu eps / rho^2 (MP 22)."""
    d = law.dimensions
    body = [f"trace = 2.0 / {d}.0 * (" + " + ".join(f"shear[{k * (d + 1)}, b]" for k in range(d)) + ")"]
    body += ["rho = 1.0 + drho[b] * per_rho", "factor = viscosity / (rho * rho)"]
    for i, a in enumerate(law.axes):
        for j, b in enumerate(law.axes[i:], start=i):
            strain = f"shear[{i * d + j}, b] + shear[{j * d + i}, b]{' - trace' if i == j else ''}"
            body.append(f"values[{columns.index(f't{a}{b}')}, s] = ({strain}) * factor")
    return body


def _unpack_shifting(law: Law) -> str:
    """offset[d, n] in h per Courant and Mach number; zero where fluid or walls are not all around."""
    d = law.dimensions
    body = [f"inside = {_sum(f'at + {d}')} > {ALL_AROUND[d]} and flags[b] & 1 == 1"]
    body += [f"offset[{k}, b] = -4.0 * {_sum(f'at + {k}')} if inside else 0.0" for k in range(d)]
    return _kernel("unpack_shifting", "at, flags, sums, offset", ["n_slots = sums.shape[1] // 2"], body)


def _unpack_matrix(law: Law) -> str:
    """Renormalisation L; the identity where too few neighbours are there, and in walls, whose particles do not meet."""
    d = law.dimensions
    body, k = [], 0
    for i in range(d):
        for j in range(i, d):
            body.append(f"m{i}{j} = {_sum(str(k))}")
            k += 1
    if d == 2:
        body += ["det = m00 * m11 - m01 * m01", "c00, c01, c11 = m11, -m01, m00"]
    else:
        body += _solve(3)[:1] + _solve(3)[1:3]
    body += [f"good = det > {LEAST_DETERMINANT!r} and flags[b] & 1 == 1"]
    for i in range(d):
        for j in range(d):
            name = f"c{min(i, j)}{max(i, j)}"
            body.append(f"matrix[{i * d + j}, b] = {name} / det if good else {float(i == j)!r}")
    return _kernel("unpack_matrix", "flags, sums, matrix", ["n_slots = sums.shape[1] // 2"], body)
