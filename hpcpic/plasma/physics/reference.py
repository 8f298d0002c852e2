"""The whole method in one dimension, in plain numpy: CIC, the 3-point Poisson equation by FFT, leapfrog.

Read this first: the program does the same with tiles, vectors, ranks and other shapes.
"""

import numpy as np
from numpy.typing import NDArray

MODES = 8


class Reference:
    """All particles side by side: x[p] m, v[p] m/s half a step before x, q[p] C, m[p] kg in a periodic box of n cells.

    background: charge density C/m that makes the box neutral. After `solve`: rho[n] C/m, phi[n] V, E[n] V/m.
    """

    def __init__(
        self, x: NDArray, v: NDArray, q: NDArray, m: NDArray, *,
        length: float, n: int, time_step: float, permittivity: float, background: float,
    ) -> None:  # fmt: skip
        self.x, self.q, self.m = x, q, m
        self.length, self.n, self.dx, self.dt = length, n, length / n, time_step
        self.permittivity, self.background = permittivity, background
        self.solve()
        self.v = v - 0.5 * self.dt * self.acceleration()  # from the time of x to v^(-1/2)

    def nodes(self) -> tuple[NDArray, NDArray, NDArray]:
        """The nodes left and right of each particle, and its place f between them: the weights are 1 - f and f."""
        s = self.x / self.dx
        i = np.floor(s).astype(int)
        return i % self.n, (i + 1) % self.n, s - i

    def solve(self) -> None:
        """rho (5.1), phi of (phi_(i-1) - 2 phi_i + phi_(i+1)) / dx^2 = -rho / eps0, E by centred differences (5.13)."""
        left, right, f = self.nodes()
        charge = np.bincount(left, self.q * (1 - f), self.n) + np.bincount(right, self.q * f, self.n)
        self.rho = charge / self.dx + self.background
        k = np.arange(self.n // 2 + 1)
        laplace = (2 * np.sin(np.pi * k / self.n) / self.dx) ** 2 * self.permittivity
        laplace[0] = np.inf  # phi has no mean
        self.phi = np.fft.irfft(np.fft.rfft(self.rho) / laplace, self.n)
        self.E = (np.roll(self.phi, 1) - np.roll(self.phi, -1)) / (2 * self.dx)

    def acceleration(self) -> NDArray:
        """(q/m) E at the particles (5.14), m/s^2."""
        left, right, f = self.nodes()
        return self.q / self.m * ((1 - f) * self.E[left] + f * self.E[right])

    def advance(self) -> dict[str, float]:
        """One step (5.18), (5.19); returns the scalars at its beginning, with velocities centred in time."""
        old = self.v
        self.v = old + self.dt * self.acceleration()
        centred = 0.5 * (old + self.v)
        kinetic, field = 0.5 * (self.m * centred**2).sum(), 0.5 * self.dx * self.rho @ self.phi
        waves = 2 * np.abs(np.fft.rfft(self.E)) / self.n
        scalars = {f"mode_{k}": float(waves[k]) if k < len(waves) else 0.0 for k in range(1, MODES + 1)}
        energies = {"energy_field": field, "energy_kinetic": kinetic, "energy_total": field + kinetic}
        scalars |= {name: float(energy) for name, energy in energies.items()}
        scalars |= {"momentum_x": float((self.m * centred).sum()), "charge": float(self.q.sum())}
        self.x = (self.x + self.dt * self.v) % self.length
        self.solve()
        return scalars
