"""The fluxes of density that a case may name as numerics.density_flux, and how fast each damps a wave."""

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import NDArray

from sph.physics import terms
from sph.physics.waves import Waves


@dataclass(frozen=True)
class Flux:
    """coefficient: by default. correction: of rho_j - rho_i, before `formula` makes the flux of it (see `terms`).

    upwind: by the distance of a pair, else by 2 h. decay(waves): of waves, in c0 / h, for a coefficient of 1.
    """

    coefficient: float
    formula: Callable | None
    decay: Callable[[Waves], NDArray]
    correction: Callable | None = None
    upwind: bool = False

    @property
    def columns(self) -> frozenset[str]:
        """Columns that the flux reads: "g" the renormalised gradient, "slope" that of fluid at rest, "c" sound."""
        return terms.columns_read(self.formula, self.correction)


FLUXES = {
    "none": Flux(0.0, None, lambda waves: 0.0 * waves.laplacian),
    "rusanov": Flux(1.0, terms.rusanov_flux, lambda waves: waves.upwind, upwind=True),
    "molteni": Flux(0.1, terms.molteni_flux, lambda waves: waves.laplacian),
    "fourtakas": Flux(0.1, terms.molteni_flux, lambda waves: waves.laplacian, terms.fourtakas),
    "delta": Flux(0.1, terms.molteni_flux, lambda waves: (waves.laplacian - waves.square).clip(0.0), terms.delta),
}
