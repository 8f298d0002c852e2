"""The plasma's scalars in time: energies, momentum, charge and field modes, all at one time level."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space import exact
from hpcpic.core.tasks import TaskError
from hpcpic.plasma.mover import part_of_turn
from hpcpic.plasma.scene import Scene, cross_matrix

if TYPE_CHECKING:
    from hpcpic.plasma.step import Plasma

MODES = 8
FAST = 4.0  # first guess of the largest speed, in the fastest initial one


def units(scene: Scene) -> dict[str, str]:
    """Units per unit of what a 1D or 2D box lacks of a volume are those of the macro-particles themselves."""
    energies = dict.fromkeys(("energy_field", "energy_kinetic", "energy_total"), "J")
    momenta = dict.fromkeys(("momentum_x", "momentum_y"), "kg m/s")
    return energies | momenta | {"charge": "C"} | {f"mode_{n}": "V/m" for n in range(1, MODES + 1)}


class Moments:
    """Sums over particles and nodes whose bits depend on neither ranks nor threads (core.space.exact)."""

    def __init__(self, plasma: "Plasma") -> None:
        self.plasma = plasma
        scene, cloud = plasma.scene, plasma.cloud
        n_species, v = len(scene.species), scene.velocity_components
        kick = np.zeros((n_species, 3))
        for row, species in zip(kick, scene.species):
            row[:v] = species.half_kick
        kick[:, : scene.dimensions] /= plasma.field_scale
        kick[:, scene.dimensions :] *= np.array(scene.config.field.electric)[scene.dimensions :]
        self.speed = 1.0  # power of two above |v| in cells per step
        self.inv_scale = np.ones(2)
        self.limbs = np.zeros((cloud.blocks, max(n_species, 1), 1 + v, exact.LIMBS), np.int64)
        ratio = np.ones(3)
        ratio[: scene.dimensions] = np.array(scene.spacing) / scene.spacing[0]
        self.bounds = cloud.bind_moments(
            half_kick=kick.astype(cloud.law.dtype), ratio_sq=ratio**2, inv_scale=self.inv_scale, limbs=self.limbs
        )
        self.side = np.array((*scene.spacing, scene.spacing[0], scene.spacing[0])[:v])
        self.ratio_most = float((ratio**2).sum())

    def sums(self) -> NDArray[np.float64]:
        """sums[species, k]: of |v-|^2 in (side of x per step)^2, and of the components of v- in cells per step."""
        world = self.plasma.world
        while True:
            self.inv_scale[:] = 1 / exact.power_of_two_above(self.speed**2 * self.ratio_most), 1 / self.speed
            self.limbs[:] = 0
            try:
                self.plasma.cloud.each(self.bounds)
                small = False
            except TaskError as error:
                if error.code != exact.NOT_BOUNDED:
                    raise
                small = True
            if not world.any(small):
                break
            self.speed *= 16
            if self.speed > 2.0**40:
                return np.full(self.limbs.shape[1:3], np.nan)
        total = world.sum_int(self.limbs.sum(axis=0))
        return np.array(
            [[exact.value(limbs, 1 / self.inv_scale[min(k, 1)]) for k, limbs in enumerate(row)] for row in total]
        )

    def scalars(self) -> dict[str, float]:
        """energy_field = sum over nodes of (rho + rho_0) phi dV / 2; energy_kinetic and momentum of v^n."""
        scene, dt = self.plasma.scene, self.plasma.scene.time_step
        sums = self.sums()
        kinetic, momentum = 0.0, np.zeros(3)
        for species, row in zip(scene.species, sums):
            kinetic += 0.5 * species.m * float(row[0]) * (scene.spacing[0] / dt) ** 2
            v = np.zeros(3)
            v[: len(self.side)] = row[1:] * self.side / dt
            t, s = part_of_turn(species.boris[0], 0.5)
            kt, ks = cross_matrix(t), cross_matrix(s)
            momentum += species.m * (v + (ks + ks @ kt) @ v)  # v^n is v- turned by half the angle
        field = self.field_energy()
        charge = sum(species.q * int(n) for species, n in zip(scene.species, self.counts()))
        return {
            "energy_field": field, "energy_kinetic": kinetic, "energy_total": field + kinetic,
            "momentum_x": float(momentum[0]), "momentum_y": float(momentum[1]), "charge": float(charge),
            **{f"mode_{n}": amplitude for n, amplitude in enumerate(self.modes(), start=1)},
        }  # fmt: skip

    def counts(self) -> NDArray[np.int64]:
        """Particles of each species, counted."""
        cloud = self.plasma.cloud
        n_species = len(self.plasma.scene.species)
        return self.plasma.world.sum_int(cloud.pages.count.reshape(-1, max(n_species, 1)).sum(axis=0))

    def field_energy(self) -> float:
        """1/2 sum (rho + rho_0) phi dV."""
        mesh, scene, world = self.plasma.mesh, self.plasma.scene, self.plasma.world
        terms = (mesh.rho + scene.background) * mesh.phi.inner
        most = world.max(float(np.abs(terms).max(initial=0.0)))
        if not most < 2.0**1000:
            return float("nan")
        scale = exact.power_of_two_above(most)
        limbs = world.sum_int(exact.exact_limbs(terms, scale))
        return 0.5 * scene.cell_volume * exact.value(limbs, scale)

    def modes(self) -> list[float]:
        """Amplitudes |E_k| of cos, sin (2 pi n x / Lx) in E_x averaged over y, n = 1 .. MODES."""
        mesh, world, domain = self.plasma.mesh, self.plasma.world, self.plasma.domain
        e = mesh.e[0][mesh.inside]
        most = world.max(float(np.abs(e).max(initial=0.0)))
        if not most < 2.0**900:
            return [float("nan")] * MODES
        rows, columns = (1, domain.points[0]) if domain.ndim == 1 else domain.points
        scale = exact.power_of_two_above(most) / 2.0 ** (61 - int(rows).bit_length())
        sums = np.zeros(columns, np.int64)
        own = slice(*domain.row_range(world.rank)) if domain.ndim == 1 else slice(None)
        sums[own] = np.rint(e / scale).astype(np.int64).reshape(-1, len(sums[own])).sum(axis=0)
        mean = world.sum_int(sums) * (scale / rows)
        amplitudes = np.abs(np.fft.rfft(mean)) / columns
        amplitudes[1 : (columns + 1) // 2] *= 2
        return [float(a) for a in np.pad(amplitudes[1 : MODES + 1], (0, MODES))[:MODES]]

    def trouble(self) -> str | None:
        """Why the state is no solution, or None: what fails in the steps raises by itself, so only rho is looked at."""
        rho = self.plasma.mesh.rho
        if not np.isfinite(rho).all() or not np.isfinite(self.plasma.mesh.phi.inner).all():
            return "the field is not finite"
        return None
