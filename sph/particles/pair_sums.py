"""The pair sums of a scene: accelerations and rates of density of all bodies of a rank."""

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.generate import specialise
from sph.kernels import passes
from sph.kernels.groups import WallMotion
from sph.particles.ghosts import Ghosts
from sph.particles.tasks import Tasks
from sph.physics.equation_of_state import coefficients
from sph.physics.pair_spec import NUMBERS, PairSpec, columns_of, passes_of, sums_of
from sph.setup.pair_numbers import PairNumbers
from sph.setup.scene import Scene

FIRST_SUMS = {
    "gradient": "momentsxx",
    "matrix": "matrixxx",
    "shifting": "shiftsx",
    "strain": "strainsxx",
    "walls": "weight",
}


LINES = "push", "light", "volume", "excess", "mass", "slope", "c", "tension", "swift", "fluidity", "bulk"


def columns_kernels(spec: PairSpec, gamma: float) -> ModuleType:
    """The module kernels.columns as a case needs it."""
    columns = columns_of(spec)
    first = {"NORMALS": "nx", "V": "vx", "G": "gx", "L": "lxx", "T": "txx", "S": "sxx", "DRIVEN": "ownx"}
    first["TURN"] = spec.components("turn")[0]
    first |= {name.upper(): name for name in LINES}
    constants: dict[str, Any] = {key: columns.index(name) if name in columns else -1 for key, name in first.items()}
    constants |= {
        "DIM": spec.dimensions,
        "KIND": repr(spec.real),
        "SINGLE": spec.single,
        "GAMMA": gamma,
        "DENSITIES": spec.densities,
        "GASES": spec.gases,
        "ACCELERATED": spec.accelerated,
        "TURNING": spec.turning,
    }
    return specialise("sph.kernels", ["columns"], IN_TURN=spec.in_turn, **constants)


class PairSums:
    """Rates of the bodies in slots, left as sums in the arena until the next sums or sort.

    factors: what makes of them a [m/s2] without gravity and body force, with 1 / m, and d rho / dt [kg/m3 s].
    rate: which of the sums is that of rates.
    """

    def __init__(self, scene: Scene, spec: PairSpec, tasks: Tasks, ghosts: Ghosts) -> None:
        self.spec, self.tasks, self.ghosts = spec, tasks, ghosts
        self._sums = {title: sums_of(spec, one) for title, one in passes_of(spec).items()}
        self._held: dict[str, Any] = {} if spec.single else {"position": "x"}
        self.rate = -1
        self.kernels = passes.make(spec)
        self.columns = columns_kernels(spec, scene.eos.gamma)
        known = PairNumbers(scene, spec)
        self._axes, self._of_moments = scene.axes, known.of_moments
        self._half_steps = known.half_steps
        tasks.arena.group(walls=WallMotion)
        tasks.arena.set(
            scales=known.scales, liquids=scene.liquids.table, powers_of_pressure=coefficients(scene.eos.gamma),
            pair_numbers=known.numbers, factors=known.factors,
            face_normals=np.ascontiguousarray(scene.normals[:, scene.axes].T),
        )  # fmt: skip
        sweeps = [getattr(self.kernels, title) for title in self._sums if title != "moments"]
        tasks.foresee(*sweeps, odd=True, blocks="sweeps", numbers="pair_numbers", **self._held)
        tasks.foresee(self.columns.pack, blocks="layers", powers="powers_of_pressure", **self._held)

    def forces_on(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """[d, k] N (2D: N/m) on bodies, of the last sums."""
        a = self.tasks.arena
        return a["sums"][: self.spec.dimensions, rows] * a["factors"][0]

    def _sweep(self, title: str) -> None:
        names = self._sums[title]
        self.rate = names.index("rate") if "rate" in names else -1
        self.tasks.alternate(getattr(self.kernels, title), blocks="sweeps", numbers="pair_numbers", **self._held)

    def _unpack(self, title: str, kind: str) -> None:
        """Sums of the pass `title` into the columns of the bodies."""
        names = self._sums[title]
        kernel = getattr(self.columns, f"unpack_{kind}")
        self.tasks.each(kernel, blocks="inner", at=names.index(FIRST_SUMS[kind]))

    def walls(self, iteration: int) -> None:
        """Densities of walls that follow from the fluid."""
        if not self.spec.extrapolated:
            return
        spec = self.spec
        if spec.driven:
            self.ghosts.refresh(iteration)
            self.tasks.each(self.columns.pack_own, blocks="layers")
        if spec.single or spec.densities or (spec.wetted and spec.viscosities):
            self.pack()  # of places and fluid
        self._sweep("walls")
        self._unpack("walls", "walls")
        if spec.wetted:
            names = self._sums["walls"]
            at = names.index("thick" if spec.viscosities else "weight")
            self.tasks.each(self.columns.unpack_wetted, blocks="inner", at=at, first=names.index("weight"))
        self.ghosts.refresh(iteration)

    def pack(self) -> None:
        """What pair sums read of all bodies besides the state."""
        self.tasks.each(self.columns.pack, blocks="layers", powers="powers_of_pressure", **self._held)
        if self.spec.sticking:
            self.tasks.each(self.columns.pack_turn, blocks="layers")

    def _pack_again(self) -> None:
        if self.spec.changes:
            self.tasks.each(self.columns.pack_again, blocks="layers")

    def forces(self, iteration: int) -> None:
        """Split scheme, first half: a (and the density gradient) from x^n, v^n, rho^n."""
        self.walls(iteration)
        self.pack()
        self.matrices(iteration)
        self.stresses(iteration)
        self._sweep("first")
        if self.spec.needs_gradient:
            self._unpack("first", "gradient")
        if self.spec.shifting:
            self._unpack("first", "shifting")

    def rates(self, iteration: int, time_step: float) -> None:
        """Split scheme, second half: d rho / dt from x half a step later, rho^n and the new v."""
        self.tasks.arena["pair_numbers"][NUMBERS.index("half_step")] = self._half_steps * time_step
        self.ghosts.refresh(iteration)
        self._pack_again()
        self._sweep("second")

    def matrices(self, iteration: int) -> None:
        """Renormalisation of the gradients at all bodies."""
        if self.spec.corrected:
            self._sweep("matrices")
            self._unpack("matrices", "matrix")
            self.ghosts.refresh(iteration)
            self.tasks.each(self.columns.pack_matrix, blocks="layers")

    def add_moments(self) -> None:
        """Sum the moments of the kernel of the state as it is, in a scene that tells them."""
        self.pack()
        self._pack_again()
        self._sweep("moments")

    def moments_at(self, slots: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
        """Moments of W and of its gradient at bodies, of the last sums, in units of h and in physical axes: m0[n]
        without the body's own W, m1[n, d] (MP 12); slope0[n, d], slope1[n, d, d] (MP 13).
        """
        d, values = self.spec.dimensions, self.tasks.arena["sums"][:, slots].astype(np.float64).T
        place = {name: k for k, name in enumerate(self._sums["moments"])}
        axes, (of_m0, of_m1, of_slope0, of_slope1) = self._axes, self._of_moments
        vectors = [[place[f"{name}{'xyz'[axes.index(k)]}"] for k in range(d)] for name in ("moment1", "slope0")]
        pairs = [["xyz"[min(i, j)] + "xyz"[max(i, j)] for j in map(axes.index, range(d))]
                 for i in map(axes.index, range(d))]  # fmt: skip
        matrix = [[place[f"slope1{pair}"] for pair in row] for row in pairs]
        found = {"m0": of_m0 * values[:, place["moment0"]], "m1": of_m1 * values[:, vectors[0]]}
        return found | {"slope0": of_slope0 * values[:, vectors[1]], "slope1": of_slope1 * values[:, matrix]}

    def stresses(self, iteration: int) -> None:
        """(MP 22) at all bodies, for (MP 23)."""
        if not self.spec.needs_stress:
            return
        self._sweep("strain")
        self._unpack("strain", "strain")
        self.ghosts.refresh(iteration)
        self.tasks.each(self.columns.pack_stress, blocks="layers")

    def everything(self, iteration: int) -> None:
        """a and d rho / dt from one state, of which ghosts are too."""
        self.walls(iteration)
        self.pack()
        self.matrices(iteration)
        self.stresses(iteration)
        if self.spec.needs_gradient:
            self._sweep("slopes")
            self._unpack("slopes", "gradient")
            self.ghosts.refresh(iteration)
            self._pack_again()
        self._sweep("both")
        if self.spec.shifting:
            self._unpack("both", "shifting")
