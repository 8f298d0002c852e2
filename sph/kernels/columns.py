"""Generated text of what stands around the pair sums: what changes in the columns of slots (see `packing`), and sums
other than forces and rates to what later ones need.

Bodies are in SI units: v[d, n], drho[n] (density less the reference), flags[n] (see sph.kernels.marks). Columns, and
the units of gradient[d, n], see `pairs`.
"""

from sph.kernels.marks import REPULSIVE
from sph.kernels.packing import SCALES
from sph.physics.pair_spec import PairSpec, columns_of

ALL_AROUND = {2: 1.5, 3: 2.4}  # of - sum V_j F r^2, d inside the fluid; less near a free surface (Lee et al. 2008)
LEAST_DETERMINANT = 0.1  # of the sum that L inverts, 1 inside the fluid, about 0.25 at a flat free surface in 2D


def _kernel(title: str, arguments: str, body: list[str]) -> str:
    """For all slots, also where nobody is: vectors overrun."""
    lines = [f"def {title}(block, blocks, base, scales, {arguments}):"]
    lines += [f"    {name} = scales[{k}]" for k, name in enumerate(SCALES)]
    lines += ["    for l in range(blocks[block], blocks[block + 1]):"]
    lines += ["        for b in range(np.uint64(base[l]), np.uint64(base[l + 1])):"]
    lines += [f"            {line}" for line in body]
    return "\n\n@njit\n" + "\n".join(lines) + "\n"


def source(spec: PairSpec) -> str:
    """Kernels pack_again (velocity, gradient, volume), those for stresses and matrices, and one to unpack each kind of
    sum.
    """
    columns = columns_of(spec)
    changed = {*spec.components("v"), *spec.components("g"), *(["light"] if spec.in_turn else [])}
    later = [name for name in columns if name in changed]
    values = {f"v{a}": f"v[{k}, b] * per_c" for k, a in enumerate(spec.axes)}
    values |= {f"g{a}": f"gradient[{k}, b]" for k, a in enumerate(spec.axes)}
    mass = f"(m[b] * {'per_m' if spec.single else '1.0'} if flags[b] & {REPULSIVE} == 0 else 0.0)"
    values["light"] = f"{mass} / (1.0 + drho[b] * per_rho)"  # the volume from now on
    again = [f"values[{columns.index(name)}, b] = {values[name]}" for name in later]
    text = _kernel("pack_again", "flags, v, drho, m, gradient, values", again) if again else ""
    if spec.needs_stress:
        text += _kernel("pack_stress", "drho, shear, values", _stress(spec, columns)) + _unpack_strain(spec)
    if spec.corrected:
        body = [
            f"values[{columns.index(f'l{a}{b}')}, b] = matrix[{i * spec.dimensions + j}, b]"
            for i, a in enumerate(spec.axes) for j, b in enumerate(spec.axes) if i <= j
        ]  # fmt: skip
        text += _kernel("pack_matrix", "matrix, values", body) + _unpack_matrix(spec)
    if spec.shifting:
        text += _unpack_shifting(spec)
    if spec.needs_gradient:
        text += _unpack_gradient(spec)
    return text


def _sum(k: str) -> str:
    return f"np.float64(sums[{k}, b])"


def _unpack_gradient(spec: PairSpec) -> str:
    """Half of the renormalised gradient, L b / 2, in the units of pair sums; 0 where too few neighbours are there for
    L.
    """
    d = spec.dimensions
    names = [f"m{i}{j}" for i in range(d) for j in range(i, d)] + [f"b{i}" for i in range(d)]
    body = [f"{name} = {_sum(f'at + {k}')} * of_gradient" for k, name in enumerate(names)]
    return _kernel("unpack_gradient", "at, sums, gradient", body + _solve(d))


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


def _unpack_strain(spec: PairSpec) -> str:
    """The velocity gradient, shear[a, b] = d v_b / d x_a."""
    body = [f"shear[{k}, b] = {_sum(str(k))} * of_strain" for k in range(spec.dimensions**2)]
    return _kernel("unpack_strain", "sums, shear", body)


def _stress(spec: PairSpec, columns: list[str]) -> list[str]:
    """mu eps / rho^2 (MP 22)."""
    d = spec.dimensions
    body = [f"trace = 2.0 / {d}.0 * (" + " + ".join(f"shear[{k * (d + 1)}, b]" for k in range(d)) + ")"]
    body += ["rho = 1.0 + drho[b] * per_rho", "factor = viscosity / (rho * rho)"]
    for i, a in enumerate(spec.axes):
        for j, b in enumerate(spec.axes[i:], start=i):
            strain = f"shear[{i * d + j}, b] + shear[{j * d + i}, b]{' - trace' if i == j else ''}"
            body.append(f"values[{columns.index(f't{a}{b}')}, b] = ({strain}) * factor")
    return body


def _unpack_shifting(spec: PairSpec) -> str:
    """offset[d, n] in h per Courant and Mach number; zero where fluid or walls are not all around."""
    d = spec.dimensions
    body = [f"inside = {_sum(f'at + {d}')} * of_around > {ALL_AROUND[d]} and flags[b] & 1 == 1"]
    body += [f"offset[{k}, b] = -4.0 * of_shifting * {_sum(f'at + {k}')} if inside else 0.0" for k in range(d)]
    return _kernel("unpack_shifting", "at, flags, sums, offset", body)


def _unpack_matrix(spec: PairSpec) -> str:
    """Renormalisation L; the identity where too few neighbours are there, and in walls, whose particles do not meet."""
    d = spec.dimensions
    body, k = [], 0
    for i in range(d):
        for j in range(i, d):
            body.append(f"m{i}{j} = {_sum(str(k))} * of_gradient")
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
    return _kernel("unpack_matrix", "flags, sums, matrix", body)
