"""Solvers of the field equation: MFT by Fourier transforms (thesis 5.2.3), LU by factorisation (5.2.2).

Both solve (5.7), a phi_xx + b phi_x + c phi + d phi_yy + e phi_y + f phi = g, in a periodic box, with g = -rho / eps0
and centred differences; the Poisson equation has a = d = 1, and the rest 0. In 3D phi_zz is added. Two things differ
from the thesis: each axis has its own spacing (the printed (5.3) and (5.11) hold for dx = dy = 1), and where a constant
phi gives g = 0 (c + f = 0), the mean of g is left out and phi has no mean.

Charges may be clouds (the shape altered in Fourier space, end of 5.1): the charge of a particle is spread once more
by a Gaussian of standard deviation R along each axis, exp(-k^2 R^2/2), and so is the field that it feels.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hpcpic.core.errors import ConfigError
from hpcpic.core.space.domain import Domain
from hpcpic.core.space.elementary import cos, expm1, sin
from hpcpic.plasma.case.config import PlasmaConfig

if TYPE_CHECKING:
    from hpcpic.core.comm.world import World
    from hpcpic.core.tasks.graph import Pool

MAX_LU_POINTS = 256 * 256


@dataclass(frozen=True, slots=True)
class Operator:
    """The constants of (5.7); lengths in the unit of the domain."""

    a: float = 1.0
    b: float = 0.0
    c: float = 0.0
    d: float = 1.0
    e: float = 0.0
    f: float = 0.0

    @property
    def singular(self) -> bool:
        """A constant phi gives g = 0."""
        return self.c + self.f == 0.0

    def along(self, axis: str) -> tuple[float, float]:
        """Factors of the second and the first derivative along "x", "y" or "z", of which (5.7) does not know."""
        return {"x": (self.a, self.b), "y": (self.d, self.e), "z": (1.0, 0.0)}[axis]


def operator_of(config: PlasmaConfig) -> Operator:
    """The left side of the field equation of a case."""
    return Operator(**config.field.equation.model_dump())


def _angles(n: int) -> NDArray:
    """2 pi k / n in the order of the transform, k from -n/2: so sines are odd and cosines even to the last bit."""
    return 2 * np.pi / n * (np.fft.fftfreq(n) * n)


def _first(n: int, spacing: float, spectral: bool) -> NDArray[np.float64]:
    """k of d/dx = i k. The shortest wave of an even n has no direction, and so no derivative."""
    if not spectral:
        return np.where(np.arange(n) * 2 == n, 0.0, sin(_angles(n))) / spacing
    return np.where(np.arange(n) * 2 == n, 0.0, _angles(n)) / spacing


def _second(n: int, spacing: float, spectral: bool) -> NDArray[np.float64]:
    """What d2/dx2 multiplies a mode by."""
    k = _angles(n)
    return (-(k**2) if spectral else 2 * (cos(k) - 1)) / spacing**2


def green(
    operator: Operator,
    points: tuple[int, ...],
    spacing: tuple[float, ...],
    columns: slice,
    *,
    spectral: bool,
    cloud_radius: float = 0.0,
) -> NDArray:
    """phi_hat / g_hat (5.11) in transform order: [ky of `columns`, kx, kz] in 3D, [kx of `columns`, ky] in 2D, [kx] in
    1D; real if b = e = 0.

    It is 0 for mode 0 of a singular equation. spectral: -k^2 and i k in place of the differences. cloud_radius: that of
    the Gaussian that spreads charge and field. Raises ConfigError where another mode satisfies the equation without a
    charge.
    """
    symbol = np.zeros((1,) * len(points))
    spread = np.zeros((1,) * len(points))  # k^2
    for storage, axis in zip(range(-1, -1 - len(points), -1), "xyz"):
        n, step = points[storage], spacing[storage]
        second, first = operator.along(axis)
        part = second * _second(n, step, spectral)
        if first:
            part = part + 1j * first * _first(n, step, spectral)
        symbol = symbol + in_spectrum(part, axis, points, columns)
        spread = spread + in_spectrum(-_second(n, step, True), axis, points, columns)
    symbol = symbol + (operator.c + operator.f)
    zero = symbol == 0
    allowed = int(operator.singular and (columns.start or 0) == 0 and symbol.size > 0)
    if np.count_nonzero(zero) > allowed:
        raise ConfigError(f"field.equation: {operator} is resonant: waves of this box satisfy it without a charge")
    response = np.where(zero, 0.0, 1.0 / np.where(zero, 1.0, symbol))
    return response * (1.0 + expm1(-(cloud_radius**2) * spread)) if cloud_radius else response


def response(
    operator: Operator, k: Sequence[float], dx: Sequence[float], *, spectral: bool, cloud_radius: float
) -> tuple[float, float]:
    """How many times the squared plasma frequency a wave has of that by Poisson's equation, where no first derivative
    is along it: without a mesh, and on one. Negative where charges of one sign attract each other.

    k rad/m, dx m of x, y, z, as many as there are. Clouds count as part of the scheme.
    """
    waves = np.array(k)
    on_mesh = waves if spectral else 2.0 / np.array(dx) * np.sin(0.5 * waves * np.array(dx))
    second = np.array([operator.along(axis)[0] for axis in "xyz"[: len(waves)]])
    squares = (waves**2, on_mesh**2)
    continuum, mesh = (float(square.sum() / (second @ square - operator.c - operator.f)) for square in squares)
    return continuum, mesh * math.exp(-float(waves @ waves) * cloud_radius**2)


def strongest_response(operator: Operator, points: tuple[int, ...], lengths: tuple[float, ...]) -> float:
    """The largest such factor of all waves of a mesh of [Nx], [Nx, Ny] or [Nx, Ny, Nz] points; infinite where one
    attracts, or has a field without a charge.

    Of K^2 over a linear form in Kx^2, Ky^2 and Kz^2 the extremes are at the corners of what the mesh has.
    """
    ends = []
    for n, length in zip(points, lengths):
        waves = np.array([1, n // 2]) if n > 1 else np.zeros(1)
        ends.append(np.append(0.0, (2 * n / length * np.sin(np.pi * waves / n)) ** 2))
    squares = np.meshgrid(*ends)
    square = np.sum(squares, axis=0)
    form = np.sum([operator.along(axis)[0] * k for axis, k in zip("xyz", squares)], axis=0) - operator.c - operator.f
    there = square > 0
    if (form[there] <= 0).any():
        return math.inf
    return float((square[there] / form[there]).max(initial=0.0))


def in_spectrum(part: NDArray, axis: str, points: tuple[int, ...], columns: slice) -> NDArray:
    """Values of all modes of an axis, of those that a rank has, in a shape that multiplies `green`."""
    if axis == "x":
        part = part[: points[-1] // 2 + 1]
    order = {1: "x", 2: "xy", 3: "yxz"}[len(points)]  # of the axes of the spectrum; the first is cut
    if axis == order[0]:
        part = part[columns]
    return part.reshape([-1 if axis == one else 1 for one in order])


def _gradient(points: tuple[int, ...], spacing: tuple[float, ...], columns: slice) -> list[NDArray]:
    """-i k_x, -i k_y (and -i k_z) of the modes of `columns`, in shapes that multiply `green`."""
    axes = zip("xyz", points[::-1], spacing[::-1])
    return [in_spectrum(-1j * _first(n, step, True), axis, points, columns) for axis, n, step in axes]


class MFT:
    """phi from rho by (5.10): transform, multiply by the Green function, transform back. All ranks call together.

    rho   real[rows, Nx] (1D: [rows], 3D: [planes, Ny, Nx]), to be written: the charge density of this rank's rows
    phi   like rho: the potential, after solve()
    E     [x, y, z components] like rho each, with gradient = "spectral": E_hat = -i k phi_hat; else empty

    permittivity: eps0. spectral: the exact -k^2 and i k for the differences of the operator. cloud_radius: as of
    `green`, in the unit of the domain.
    """

    def __init__(
        self,
        world: "World",
        pool: "Pool",
        domain: Domain,
        dtype: DTypeLike = np.float64,
        *,
        operator: Operator = Operator(),
        permittivity: float = 1.0,
        spectral: bool = False,
        gradient: str = "difference",
        cloud_radius: float = 0.0,
    ) -> None:
        if gradient not in ("difference", "spectral"):
            raise ValueError(f'gradient must be "difference" or "spectral", not {gradient!r}')
        _require_periodic(domain)
        points, spacing = domain.points, domain.spacing
        transform, columns = _transform(world, points)
        factor = green(operator, points, spacing, columns, spectral=spectral, cloud_radius=cloud_radius) / -permittivity
        factor /= np.prod(points)
        if gradient == "spectral":
            factor = np.stack(np.broadcast_arrays(factor, *(k * factor for k in _gradient(points, spacing, columns))))
        self._fft = transform(world, pool, points, domain.cuts, dtype, factor)
        self.rho: NDArray = self._fft.real
        self.phi, *self.E = self._fft.results

    def solve(self, iteration: int = 0) -> None:
        """rho -> phi (and E); messages carry the iteration."""
        self._fft.at(iteration)
        self._fft.solve()

    def free(self) -> None:
        """Free what MPI holds (all ranks together)."""
        self._fft.free()


def _transform(world: "World", points: tuple[int, ...]) -> tuple[Any, slice]:
    """The transform for that many axes, and the part of its first axis that this rank multiplies."""
    if len(points) == 1:
        from hpcpic.core.comm.line import LineFFT

        return LineFFT, slice(0, None)
    from hpcpic.core.comm.transpose import SlabFFT, spectrum_range

    return SlabFFT, slice(*spectrum_range(points, world.size, world.rank))


def _require_periodic(domain: Domain) -> None:
    if domain.ndim not in (1, 2, 3) or not all(domain.periodic):
        raise ValueError("the field solvers take one to three periodic axes")


class LU:
    """The equation of MFT by factorisation of its matrix, for small grids; phi is the same but for round-off.

    Every rank gathers rho and solves for the whole grid. Raises ValueError beyond 65 536 points.
    """

    def __init__(
        self,
        world: "World",
        pool: "Pool",
        domain: Domain,
        dtype: DTypeLike = np.float64,
        *,
        operator: Operator = Operator(),
        permittivity: float = 1.0,
    ) -> None:
        _require_periodic(domain)
        n = int(np.prod(domain.points))
        if n > MAX_LU_POINTS:
            raise ValueError(
                f'solver "LU" holds a matrix of the whole grid: at most 256 x 256 points, not {n}; use "MFT"'
            )
        from scipy.sparse.linalg import splu

        matrix = _matrix(operator, domain)
        if operator.singular:
            # phi(0, 0) = 0, as by the 3 for 4 of 5.2.2, but the matrix stays definite, and is no zero where n is 1
            matrix[0, 0] = 1.25 * matrix[0, 0] or 1.0
        self._factors = splu(matrix.tocsc())
        self._world, self._operator, self._permittivity = world, operator, permittivity
        self._rows = slice(*domain.row_range(world.rank))
        self.rho: NDArray = np.zeros(domain.shape(world.rank), dtype)
        self.phi: NDArray = np.zeros_like(self.rho)
        self.E: list[NDArray] = []

    def solve(self) -> None:
        """rho -> phi."""
        gathered = self._world.gather_rows(self.rho)
        raw = self._world.bcast(None if gathered is None else gathered.tobytes())
        rho = np.frombuffer(raw, self.rho.dtype).reshape(-1, *self.rho.shape[1:])
        g = rho.astype(np.float64) / -self._permittivity
        if self._operator.singular:
            g = g - g.mean()
        phi = self._factors.solve(g.ravel()).reshape(g.shape)
        if self._operator.singular:
            phi -= phi.mean()
        self.phi[:] = phi[self._rows]

    def free(self) -> None:
        """Nothing is to be freed."""


def _matrix(operator: Operator, domain: Domain) -> Any:
    """Sparse [points, points] of (5.7) with centred differences; points in C order."""
    from scipy.sparse import identity, kron

    total = (operator.c + operator.f) * identity(int(np.prod(domain.points)), format="csr")
    for storage, axis in zip(range(domain.ndim - 1, -1, -1), "xyz"):
        n, step = domain.points[storage], domain.spacing[storage]
        second, first = operator.along(axis)
        up = _shift(n)
        line = second / step**2 * (up + up.T - 2 * identity(n)) + first / (2 * step) * (up - up.T)
        before, after = (
            np.prod(domain.points[:storage], dtype=int),
            np.prod(domain.points[storage + 1 :], dtype=int),
        )
        total = total + kron(kron(identity(before), line), identity(after))
    return total.tolil()


def _shift(n: int) -> Any:
    """(shift v)[i] = v[i + 1], periodic; entries add where n < 3 folds them together."""
    from scipy.sparse import coo_matrix

    i = np.arange(n)
    return coo_matrix((np.ones(n), (i, (i + 1) % n)), shape=(n, n)).tocsr()
