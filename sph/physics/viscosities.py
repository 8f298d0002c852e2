"""The viscosities that a case may name as numerics.viscosity_form, and how fast each damps a wave."""

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import NDArray

from sph.physics import terms
from sph.physics.waves import Waves


@dataclass(frozen=True)
class Viscosity:
    """push or pull: the term of a pair (see `terms`); wall_drag: that with particles of repulsive walls.

    decay(waves): of waves, in c0 / h, for nu = c0 h; None where it is none of the fluid. calibrated: by xi of (SC 6).
    artificial: alpha of the artificial viscosity beside it, by default.
    """

    push: Callable | None = None
    pull: Callable | None = None
    wall_drag: Callable | None = None
    decay: Callable[[Waves], NDArray] | None = None
    calibrated: bool = False
    artificial: float = 0.0

    @property
    def stress(self) -> bool:
        """True if the term takes the stress at each body, which a pass of its own finds."""
        return "t" in terms.columns_read(self.pull)

    @property
    def along_velocity(self) -> bool:
        """True if pair forces are along v_ij: their traction on a wall is mu dv/dn, without mu (grad v)^T n."""
        return "dv" in terms.needs(self.pull)

    @property
    def physical(self) -> bool:
        """Whether this form stands for the viscosity of the fluid."""
        return self.decay is not None


VISCOSITIES = {
    "none": Viscosity(),
    "artificial": Viscosity(artificial=0.02),  # which numerics.artificial_viscosity adds to any form
    "strain-rate": Viscosity(pull=terms.stress, decay=lambda waves: waves.square),
    "morris": Viscosity(
        pull=terms.morris_viscosity, wall_drag=terms.morris_wall_drag, decay=lambda waves: waves.laplacian
    ),
    "cleary": Viscosity(
        push=terms.cleary_viscosity,
        wall_drag=terms.cleary_wall_drag,
        decay=lambda waves: 2 * waves.xi * waves.pairs,
        calibrated=True,
    ),
}
