"""The pair sums of SPH in plain numpy: all pairs at once, slow and plain to read; tests hold the kernels against it.

Arrays over pairs have the indices [.., i, j]: `dx[:, i, j]` = x_i - x_j, `f[i, j]` = F of the pair, so that the
gradient of W at i is F dx. (MP n) and (SC n) are equations of the papers that `sph` cites.
"""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sph.case.config import SphConfig
from sph.physics.equation_of_state import EquationOfState
from sph.physics.fluxes import FLUXES
from sph.physics.liquids import liquids_of
from sph.physics.smoothing import SMOOTHING
from sph.physics.viscosities import viscosity_of
from sph.physics.waves import cleary_constant

LEAST_DETERMINANT = 0.1  # of a matrix that is inverted


class Reference:
    """a [d, n] without gravity and body force, and d rho / dt [n], of n particles of fluid; SI units, storage axes.

    x[d, n] m, v[d, n] m/s, drho[n] = rho - rho0 kg/m3, m[n] kg; gravity[d] m/s2, with body force; period[d] m, 0: none.
    of[n]: numbers of their liquids, if there are several (physics.liquids); drho and rate are then those of the
    reference liquid, which has the same rho / rho0.
    """

    def __init__(
        self, config: SphConfig, x: NDArray, v: NDArray, drho: NDArray, m: NDArray, gravity: NDArray, period: NDArray,
        of: NDArray | int = 0,
    ) -> None:  # fmt: skip
        self.numerics, self.m, self.gravity = config.numerics, m, gravity
        self.d, self.h, self.c, self.gamma = config.dimensions, config.h, config.sound_speed, config.eos.gamma
        liquids = liquids_of(config)
        self.rho0, table = liquids.density, liquids.table[:, np.broadcast_to(of, m.shape)]
        lightness, self.swift, fluidity, ambient = table
        self.rest = m * lightness  # the mass that the reference liquid would have
        self.mu = liquids.viscosity * (2 / self._both(fluidity) if liquids.several else 1.0)  # of pairs (SC 6)
        self.alike = np.equal.outer(self.swift, self.swift)
        eos = EquationOfState(self.rho0, self.c, self.gamma, config.eos.background_pressure or 0.0)
        self.viscosity, self.sound = viscosity_of(config.numerics.viscosity_form), eos.sound_speed(drho)
        self.smoothing = SMOOTHING[config.numerics.kernel]
        self.rho, self.volume = self.rho0 + drho, self.rest / (self.rho0 + drho)
        self.p = eos.pressure(drho) + eos.background  # (MP 14)
        self.drho, self.bulk = drho, self.rho.copy()  # bulk: what the divergence changes drho by
        if liquids.gases:  # p + p_a = p_a (rho / rho0)^1.4, of which the bulk modulus is 1.4 (p + p_a)
            gas, unit = ambient > 0, self.rho0 * self.c**2
            absolute = eos.pressure(drho[gas]) + ambient[gas] * unit
            self.rho[gas] = self.rho0 * (absolute / (ambient[gas] * unit)) ** (1 / 1.4)
            per_drho = self.c**2 * (1 + drho[gas] / self.rho0) ** (self.gamma - 1)  # dp of (MP 14)
            self.bulk[gas] = 1.4 * absolute / per_drho
            self.volume = self.rest / self.rho
        self.dx, self.dv = x[:, :, None] - x[:, None, :], v[:, :, None] - v[:, None, :]
        for k in np.flatnonzero(period):
            self.dx[k] -= period[k] * np.rint(self.dx[k] / period[k])
        self.r = np.sqrt(np.sum(self.dx**2, axis=0))
        self.f = self.smoothing.gradient(self.r / self.h, self.d) / self.h ** (self.d + 2)
        np.fill_diagonal(self.f, 0.0)
        self.vd = np.sum(self.dx * self.dv, axis=0)  # v_ij . r_ij

    def acceleration(self) -> NDArray[np.float64]:
        """(MP 20), (SC 5): a_i = - sum m_j (p_i / rho_i^2 + p_j / rho_j^2 + Pi) F r_ij, and viscosity; of liquids of
        several densities with the masses and densities of the reference liquid, for the inertia of i.
        """
        pressure = self._both(self.p / self.rho**2)
        push = pressure + self._viscous_pressure() + self._tension()
        inertia = self.rest / self.m
        if not self.numerics.gradient_correction:
            pulls = push * self.dx
            return inertia * (self._viscous_force() - np.einsum("j,ij,kij->ki", self.rest, self.f, pulls))
        at_i = np.einsum("iab,bij->aij", self.renormalisation, self.dx) * (self.p / self.rho**2)[:, None]
        at_j = np.einsum("jab,bij->aij", self.renormalisation, self.dx) * (self.p / self.rho**2)[None, :]
        pulls = at_i + at_j + (push - pressure) * self.dx
        return inertia * (self._viscous_force() - np.einsum("j,ij,kij->ki", self.rest, self.f, pulls))

    def rate(self) -> NDArray[np.float64]:
        """(MP 16): d rho_i / dt = rho_i sum V_j F v_ij . r_ij, or (SC 3) with m_j for rho_i V_j; less the flux."""
        vd = self.vd
        if self.numerics.gradient_correction:
            vd = np.einsum("aij,iab,bij->ij", self.dv, self.renormalisation, self.dx)
        if self.numerics.continuity == "masses":
            return np.einsum("j,ij,ij->i", self.rest, self.f, vd) - self._flux()
        return self.bulk * np.einsum("j,ij,ij->i", self.volume, self.f, vd) - self._flux()

    # ---- terms of the force

    @staticmethod
    def _both(a: NDArray) -> NDArray[np.float64]:
        """a_i + a_j."""
        return a[:, None] + a[None, :]

    def _viscous_pressure(self) -> NDArray[np.float64]:
        """Monaghan's artificial viscosity, and (SC 6)."""
        near = self.vd / (self.r**2 + 0.01 * self.h**2)
        mean = 0.5 * self._both(1 / self.rho) * 2 / self._both(self.swift)  # the latter: harmonic, of rho0 c
        found = -(self.numerics.artificial_viscosity or 0.0) * self.c * self.h * np.minimum(near, 0.0) * mean
        if self.viscosity.calibrated:
            xi = cleary_constant(self.smoothing.name, self.d, self.numerics.smoothing)
            found -= 2 * xi * self.mu / np.outer(self.rho, self.rho) * near
        return found

    def _tension(self) -> NDArray[np.float64] | float:
        """Monaghan 2000: artificial pressure times (W / W(dp))^4."""
        if not self.numerics.tensile_correction:
            return 0.0
        value = self.smoothing.value
        ratio = value(self.r / self.h, self.d) / value(self.numerics.spacing / self.h, self.d)
        tension = self.numerics.tensile_correction * np.where(self.p < 0, -self.p, 0.05 * self.p) / self.rho**2
        return self._both(tension) * ratio**4

    def _viscous_force(self) -> NDArray[np.float64] | float:
        """Morris et al. 1997: a_i = sum m_j 2 mu v_ij F / (rho_i rho_j); or (MP 22-23), the divergence of a stress."""
        mu = self.mu
        if not self.viscosity.pull:
            return 0.0
        if not self.viscosity.stress:
            along = 2 * np.einsum("j,ij,kij->ki", self.volume, self.f * mu, self.dv) / self.rho
            return along + (self._transposed_stress() if self.viscosity.transposed else 0.0)
        gradient = velocity_gradient(self.volume, self.f, self.dx, self.dv)
        trace = 2 / self.d * np.einsum("aai->i", gradient) * np.eye(self.d)[:, :, None]
        stress = mu * (gradient + gradient.transpose(1, 0, 2) - trace) / self.rho**2
        return np.einsum("j,ij,abij,bij->ai", self.rest, self.f, stress[..., :, None] + stress[..., None, :], self.dx)

    def _transposed_stress(self) -> NDArray[np.float64]:
        """The divergence of mu ((grad v)^T - I div v), 0 but at free surfaces."""
        gradient = velocity_gradient(self.volume, self.f, self.dx, self.dv)
        gradient = np.einsum("iac,cbi->abi", self.renormalisation, gradient)
        s = gradient - np.einsum("aai->i", gradient) * np.eye(self.d)[:, :, None]
        both = s[..., :, None] + s[..., None, :]
        return self.mu * np.einsum("j,ij,abij,bij->ai", self.volume, self.f, both, self.dx) / self.rho

    # ---- renormalised gradients

    @cached_property
    def moments(self) -> NDArray[np.float64]:
        """[n, d, d]: - sum V_j F r r^T, the identity inside of a lattice (Randles and Libersky 1996)."""
        return -np.einsum("j,ij,aij,bij->iab", self.volume, self.f, self.dx, self.dx)

    def kernel_moments(self) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """(MP 12) m_0[n] and m_1[d, n], (MP 13) m'_0[d, n] and m'_1[n, d, d], in units of h. W' is that by x_j."""
        w = self.smoothing.value(self.r / self.h, self.d) / self.h**self.d
        first = np.einsum("j,ij,aij->ai", self.volume, w, self.dx) / self.h
        return w @ self.volume, first, -self.h * np.einsum("j,ij,aij->ai", self.volume, self.f, self.dx), self.moments

    @cached_property
    def renormalisation(self) -> NDArray[np.float64]:
        """[n, d, d]: the inverse of the moments, where there are neighbours enough."""
        good = np.linalg.det(self.moments) > LEAST_DETERMINANT
        return np.where(good[:, None, None], np.linalg.inv(self.moments), np.eye(self.d))

    # ---- terms of the rate

    def _flux(self) -> NDArray[np.float64] | float:
        """What leaves i: 2 delta c0 h sum V_j F (rho_j - rho_i - what is left out); (MP 17) with r for 2 h
        and the larger c of the pair (MP 15). Only to particles of the same density at rest.
        """
        flux, f = FLUXES[self.numerics.density_flux], self.f * self.alike
        strength = (self.numerics.flux_coefficient or 0.0) * self.c * self.swift
        step = self.drho[None, :] - self.drho[:, None]
        if not flux.formula:
            return 0.0
        if flux.upwind:
            faster = np.maximum.outer(self.sound, self.sound) / self.c
            return strength * np.einsum("j,ij,ij,ij,ij->i", self.volume, f, self.r, faster, step)
        if "slope" in flux.columns:  # less what rest under gravity would give
            rho = self.rho0 + self.drho
            slope = rho / (self.c * self.swift) ** 2 * (rho / self.rho0) ** (1 - self.gamma)
            step = step + 0.5 * self._both(slope) * np.einsum("k,kij->ij", self.gravity, self.dx)
        if "g" in flux.columns:  # Antuono et al. 2010: less what a linear density would give
            plain = np.einsum("j,ij,ij,aij->ia", self.volume, f, step, self.dx)
            moments = -np.einsum("j,ij,aij,bij->iab", self.volume, f, self.dx, self.dx)
            gradient = np.linalg.solve(moments, plain[:, :, None])[:, :, 0].T
            step = step + 0.5 * np.einsum("aij,aij->ij", gradient[:, :, None] + gradient[:, None, :], self.dx)
        return 2 * strength * self.h * np.einsum("j,ij,ij->i", self.volume, f, step)


def velocity_gradient(volume: NDArray, f: NDArray, dx: NDArray, dv: NDArray) -> NDArray[np.float64]:
    """[a, b, i] = d v_b / d x_a = - sum V_j F r_a (v_ij)_b, of which (MP 22) makes the strain rate."""
    return -np.einsum("j,ij,aij,bij->abi", volume, f, dx, dv)
