"""The pair sums of a scene: accelerations and rates of density of all bodies of a rank."""

from typing import TYPE_CHECKING

import numpy as np

from hpcpic.core.simd.generate import module_from_source
from hpcpic.core.space.fields import aligned_zeros
from sph.kernels import columns, packing, passes
from sph.kernels.functions import SMOOTHING
from sph.kernels.pairs import Law, columns_of, sums_of
from sph.kernels.passes import NUMBERS
from sph.laws import terms_of
from sph.limits import cleary_constant
from sph.neighbours import Cells
from sph.particles import Bodies, Tasks

if TYPE_CHECKING:
    from sph.scene import Scene

FIRST = {"rate": "rate", "gradient": "mxx", "shifting": "hx"}  # sums

HEAD = "import numpy as np\n\nfrom hpcpic.core.simd.jit import njit\n"


class PairSums:
    """Rates of the bodies in `cells`: a [m/s2] without gravity and body force, rate = d rho / dt [kg/m3 s]."""

    def __init__(self, scene: "Scene", law: Law, tasks: Tasks, cells: Cells, bodies: Bodies) -> None:
        self.law, self.tasks, self.cells, self.bodies = law, tasks, cells, bodies
        self._terms = terms_of(law)
        self.kernels = passes.make(law, self._terms)
        self.packing = module_from_source(packing.source(law, scene.config.eos.gamma), "sph_packing")
        self.around = module_from_source(HEAD + columns.source(law), "sph_columns")
        self._n_sums = 0  # of the passes that there have been
        tasks.set(scales=self._scales(scene), pair_numbers=self._numbers(scene))
        self._slots = 0

    def _scales(self, scene: "Scene") -> np.ndarray:
        h, c, rho, d = scene.h, scene.c0, scene.rho0, scene.dimensions
        background = scene.config.eos.background_pressure / (rho * c * c)
        viscosity = scene.viscosity / (rho * c * h)
        return np.array(
            [1 / h, 1 / c, 1 / rho, 1 / (rho * h**d), background, viscosity, c * c / h, rho * c / h,
             scene.config.numerics.tensile_correction, h]
        )

    def _numbers(self, scene: "Scene") -> np.ndarray:
        h, c, numerics, d = scene.h, scene.c0, scene.config.numerics, scene.dimensions
        strength = numerics.flux_coefficient * (1.0 if self.law.flux == "rusanov" else 2.0)
        cleary = numerics.viscosity_form == "cleary"
        xi = cleary_constant(scene.kernel, d, numerics.smoothing) if cleary else 1.0
        gravity = np.zeros(3)
        gravity[:d] = scene.gravity * (h / (c * c))
        numbers = {
            "artificial": -0.5 * (numerics.artificial_viscosity or 0.0),
            "viscous": -2.0 * xi * scene.viscosity / (scene.rho0 * c * h),
            "flux_strength": strength,
            "reach": scene.h / scene.spacing,
            "per_w": 1.0 / float(SMOOTHING[scene.kernel].shape(np.float64(scene.spacing / h))),
        } | {f"gravity{axis}": gravity[k] for k, axis in enumerate("xyz")}
        return np.array([numbers[name] for name in NUMBERS])

    def fit(self) -> None:
        """Arrays as large as the slots and bodies now are."""
        if self.cells.slots != self._slots:
            self._slots = n = self.cells.slots
            self.tasks.set(
                position=aligned_zeros((self.law.dimensions, n), np.int32 if self.law.single else np.float64),
                values=aligned_zeros((len(columns_of(self.law)), n), self.law.real),
            )

    def _sweep(self, title: str) -> None:
        kernel = getattr(self.kernels, title)
        self._n_sums = max(self._n_sums, len(sums_of(self.law, self._terms[title])))
        self.tasks.workspace.need("pairs", sums=((self._n_sums, 2 * self._slots), np.dtype(self.law.real).type))
        self.tasks.each(kernel, blocks="sweeps", numbers="pair_numbers", classes="slot_class")

    def _unpack(self, title: str, kind: str) -> None:
        """Sums of the pass `title` into the columns of the bodies."""
        names = sums_of(self.law, self._terms[title])
        kernel = getattr(self.around, f"unpack_{kind}")
        more = {"at": names.index(FIRST[kind])} if kind in ("rate", "gradient", "shifting") else {}
        self.tasks.each(kernel, blocks="inner", **more)

    def pack(self) -> None:
        """The state of all bodies into their slots."""
        self.tasks.each(self.packing.pack, blocks="layers")

    def forces(self, iteration: int) -> None:
        """Split scheme, first half: a (and the density gradient) from x^n, v^n, rho^n."""
        self.pack()
        self.matrices(iteration)
        self.stresses(iteration)
        self._sweep("first")
        self._unpack("first", "force")
        if self.law.needs_gradient:
            self._unpack("first", "gradient")
        if self.law.shifting:
            self._unpack("first", "shifting")

    def rates(self, iteration: int) -> None:
        """Split scheme, second half: d rho / dt from x^n, rho^n and the new v."""
        self.bodies.refresh(iteration)
        self.tasks.each(self.around.pack_again, blocks="layers")
        self._sweep("second")
        self._unpack("second", "rate")

    def matrices(self, iteration: int) -> None:
        """Renormalisation of the gradients at all bodies."""
        if self.law.corrected:
            self._sweep("matrices")
            self._unpack("matrices", "matrix")
            self.bodies.refresh(iteration)
            self.tasks.each(self.around.pack_matrix, blocks="layers")

    def stresses(self, iteration: int) -> None:
        """(MP 22) at all bodies, for (MP 23)."""
        if self.law.viscosity != "strain-rate":
            return
        self._sweep("strain")
        self._unpack("strain", "strain")
        self.bodies.refresh(iteration)
        self.tasks.each(self.around.pack_stress, blocks="layers")

    def everything(self, iteration: int) -> None:
        """a and d rho / dt from one state."""
        self.bodies.refresh(iteration)
        self.pack()
        self.matrices(iteration)
        self.stresses(iteration)
        if self.law.needs_gradient:
            self._sweep("slopes")
            self._unpack("slopes", "gradient")
            self.bodies.refresh(iteration)
            self.tasks.each(self.around.pack_again, blocks="layers")
        self._sweep("both")
        self._unpack("both", "force")
        self._unpack("both", "rate")
        if self.law.shifting:
            self._unpack("both", "shifting")
