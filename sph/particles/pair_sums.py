"""The pair sums of a scene: accelerations and rates of density of all bodies of a rank."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.generate import module_from_source
from sph.kernels import columns, packing, passes
from sph.kernels.passes import NUMBERS
from sph.particles.ghosts import Ghosts
from sph.particles.tasks import Tasks
from sph.physics.pair_spec import most_sums, terms_of
from sph.physics.smoothing import SMOOTHING
from sph.physics.stability import cleary_constant
from sph.physics.terms import UNIT, Law, sums_of

if TYPE_CHECKING:
    from sph.setup.scene import Scene

FIRST = {"gradient": "mxx", "shifting": "hx"}  # sums

HEAD = "import numpy as np\n\nfrom hpcpic.core.simd.compile import njit\n"


class PairSums:
    """Rates of the bodies in slots, left as sums in the arena until the next sums or sort.

    factors: what makes of them a [m/s2] without gravity and body force, with 1 / m, and d rho / dt [kg/m3 s].
    rate: which of the sums is that of rates.
    """

    def __init__(self, scene: "Scene", law: Law, tasks: Tasks, ghosts: Ghosts) -> None:
        self.law, self.tasks, self.ghosts = law, tasks, ghosts
        terms = terms_of(law)
        self._sums = {title: sums_of(law, names) for title, names in terms.items()}
        self._held = {} if law.single else {"position": "x"}
        self.rate = -1
        self.kernels = passes.make(law, terms)
        self.packing = module_from_source(packing.source(law, scene.config.eos.gamma), "sph_packing")
        self.around = module_from_source(HEAD + columns.source(law), "sph_columns")
        self.n_sums = most_sums(law)
        h, c, rho = scene.h, scene.c0, scene.rho0
        si = 1.0, 1.0, 1.0, 1.0
        self.units = (h * UNIT, c, rho, rho * h**scene.dimensions) if law.single else si  # of pair sums
        tasks.arena.set(
            scales=self._scales(scene), pair_numbers=self._numbers(scene), factors=self._factors(scene),
            face_normals=np.ascontiguousarray(scene.normals[:, scene.axes].T),
        )  # fmt: skip

    def _relative_units(self, scene: "Scene") -> tuple[float, float, float, float]:
        """Units of pair sums in those of h, c0, rho0, rho0 h^d."""
        length, speed, density, mass = self.units
        h, c, rho = scene.h, scene.c0, scene.rho0
        return length / h, speed / c, density / rho, mass / (rho * h**scene.dimensions)

    def _scales(self, scene: "Scene") -> np.ndarray:
        h, c, rho, d = scene.h, scene.c0, scene.rho0, scene.dimensions
        background = scene.config.eos.background_pressure / (rho * c * c)
        viscosity = scene.viscosity / (rho * c * h)
        length, speed, _, mass = self._relative_units(scene)
        sums = SMOOTHING[scene.kernel].factor(d) * mass * length
        return np.array(
            [1 / h, 1 / c, 1 / rho, 1 / (rho * h**d), background, viscosity, scene.config.numerics.tensile_correction,
             sums * length, sums * speed, sums, sums * length]
        )  # fmt: skip

    def _factors(self, scene: "Scene") -> np.ndarray:
        h, c, rho, d = scene.h, scene.c0, scene.rho0, scene.dimensions
        length, speed, density, mass = self._relative_units(scene)
        sums = SMOOTHING[scene.kernel].factor(d) * mass * length
        return np.array([c * c / h * (sums * mass) * (rho * h**d), rho * c / h * (sums * density * speed)])

    def _numbers(self, scene: "Scene") -> np.ndarray:
        h, c, numerics, d = scene.h, scene.c0, scene.config.numerics, scene.dimensions
        length, speed, density, mass = self._relative_units(scene)
        strength = numerics.flux_coefficient * (length if self.law.flux == "rusanov" else 2.0)
        cleary = numerics.viscosity_form == "cleary"
        xi = cleary_constant(scene.kernel, d, numerics.smoothing) if cleary else 1.0
        gravity = np.zeros(3)
        gravity[:d] = scene.gravity * (h / (c * c)) * (length / density)
        numbers = {
            "artificial": -0.5 * (numerics.artificial_viscosity or 0.0) * (speed / length),
            "viscous": -2.0 * xi * scene.viscosity / (scene.rho0 * c * h) * (speed / length),
            "flux_strength": strength / (length * speed),
            "reach": scene.h / scene.spacing,
            "per_w": 1.0 / float(SMOOTHING[scene.kernel].shape(np.float64(scene.spacing / h))),
            "per_h": length,
            "eta2": 0.01 / (length * length),
            "density": 1.0 / density,
            "hundredth": 0.01 / (SMOOTHING[scene.kernel].factor(d) * mass * length),
        } | {f"gravity{axis}": gravity[k] for k, axis in enumerate("xyz")}
        return np.array([numbers[name] for name in NUMBERS])

    def forces_on(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """[d, k] N (2D: N/m) on bodies, of the last sums."""
        a = self.tasks.arena
        return a["sums"][: self.law.dimensions, rows] * a["factors"][0]

    def _sweep(self, title: str) -> None:
        names = self._sums[title]
        assert len(names) <= self.n_sums
        self.rate = names.index("rate") if "rate" in names else -1
        self.tasks.alternate(getattr(self.kernels, title), blocks="sweeps", numbers="pair_numbers", **self._held)

    def _unpack(self, title: str, kind: str) -> None:
        """Sums of the pass `title` into the columns of the bodies."""
        names = self._sums[title]
        kernel = getattr(self.around, f"unpack_{kind}")
        more = {"at": names.index(FIRST[kind])} if kind in FIRST else {}
        self.tasks.each(kernel, blocks="inner", **more)

    def pack(self) -> None:
        """What pair sums read of all bodies besides the state."""
        self.tasks.each(self.packing.pack, blocks="layers", **self._held)

    def _pack_again(self) -> None:
        if hasattr(self.around, "pack_again"):
            self.tasks.each(self.around.pack_again, blocks="layers")

    def forces(self, iteration: int) -> None:
        """Split scheme, first half: a (and the density gradient) from x^n, v^n, rho^n."""
        self.pack()
        self.matrices(iteration)
        self.stresses(iteration)
        self._sweep("first")
        if self.law.needs_gradient:
            self._unpack("first", "gradient")
        if self.law.shifting:
            self._unpack("first", "shifting")

    def rates(self, iteration: int) -> None:
        """Split scheme, second half: d rho / dt from x^n, rho^n and the new v."""
        self.ghosts.refresh(iteration)
        self._pack_again()
        self._sweep("second")

    def matrices(self, iteration: int) -> None:
        """Renormalisation of the gradients at all bodies."""
        if self.law.corrected:
            self._sweep("matrices")
            self._unpack("matrices", "matrix")
            self.ghosts.refresh(iteration)
            self.tasks.each(self.around.pack_matrix, blocks="layers")

    def stresses(self, iteration: int) -> None:
        """(MP 22) at all bodies, for (MP 23)."""
        if self.law.viscosity != "strain-rate":
            return
        self._sweep("strain")
        self._unpack("strain", "strain")
        self.ghosts.refresh(iteration)
        self.tasks.each(self.around.pack_stress, blocks="layers")

    def everything(self, iteration: int) -> None:
        """a and d rho / dt from one state."""
        self.ghosts.refresh(iteration)
        self.pack()
        self.matrices(iteration)
        self.stresses(iteration)
        if self.law.needs_gradient:
            self._sweep("slopes")
            self._unpack("slopes", "gradient")
            self.ghosts.refresh(iteration)
            self._pack_again()
        self._sweep("both")
        if self.law.shifting:
            self._unpack("both", "shifting")
