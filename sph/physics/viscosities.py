"""The viscosities that a case may name as numerics.viscosity_form, and how fast each damps a wave."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from numpy.typing import NDArray

from sph.physics import terms
from sph.physics.waves import Waves


@dataclass(frozen=True)
class Viscosity:
    """push or pull: the term of a pair (see `terms`); wall_drag: that with particles of repulsive walls; transposed: of
    mu (grad v)^T beside the pull, which acts at free surfaces.

    decay(waves): of waves, in c0 / h, for nu = c0 h; None where it is none of the fluid. calibrated: by xi of (SC 6).
    artificial: alpha of the artificial viscosity beside it, by default.
    """

    push: Callable | None = None
    pull: Callable | None = None
    wall_drag: Callable | None = None
    transposed: Callable | None = None
    decay: Callable[[Waves], NDArray] | None = None
    calibrated: bool = False
    artificial: float = 0.0

    @property
    def stress(self) -> bool:
        """True if the stress at each body is all there is of the term."""
        return "t" in terms.columns_read(self.pull)

    @property
    def along_velocity(self) -> bool:
        """True if pair forces are along v_ij: their traction on a wall is mu dv/dn, without mu (grad v)^T n."""
        return "dv" in terms.needs(self.pull) and not self.transposed

    @property
    def sees_strain(self) -> bool:
        """True if the velocity gradient at each body is asked for, which a pass of its own finds."""
        return self.stress or self.transposed is not None

    @property
    def laplacian(self) -> bool:
        """True of the sum of Morris et al. 1997, with whatever else."""
        return self.pull is terms.morris_viscosity

    @property
    def physical(self) -> bool:
        """Whether this form stands for the viscosity of the fluid."""
        return self.decay is not None


MORRIS = Viscosity(pull=terms.morris_viscosity, wall_drag=terms.morris_wall_drag, decay=lambda waves: waves.laplacian)
VISCOSITIES = {
    "none": Viscosity(),
    "artificial": Viscosity(artificial=0.02),  # which numerics.artificial_viscosity adds to any form
    "strain-rate": Viscosity(pull=terms.stress, decay=lambda waves: waves.square),
    "morris": MORRIS,
    "full-stress": replace(MORRIS, transposed=terms.transposed_stress),
    "cleary": Viscosity(
        push=terms.cleary_viscosity,
        wall_drag=terms.cleary_wall_drag,
        decay=lambda waves: 2 * waves.xi * waves.pairs,
        calibrated=True,
    ),
}


def viscosity_of(form: str | None) -> Viscosity:
    """That of a form in a case, which is none where it gives none."""
    return VISCOSITIES[form or "none"]
