"""Limits beyond which the state of a run is no solution."""

import math
import zlib

import numpy as np

from lbmdem.diagnostics.scalars import Diagnostics, stiffer
from lbmdem.fluid.fluid import Fluid
from lbmdem.grains.dem import Dem
from lbmdem.physics.collision import BRAKES, HOLDS

MAX_SPEED = 0.4  # nodes per step beyond which no collision is a fluid any more
MAX_DENSITY = 2.0  # density of the lattice fluid, likewise; its inverse is the least one
CURE = "a smaller fluid.relaxation_time or fluid.time_step makes steps shorter, a weaker force the fluid slower"
NEAR_HALF = 0.55  # tau below which TRT and BGK hardly damp what solids make: shorter steps take it nearer to 1/2
MAX_DRIFT = 0.01  # change of the mean density of a fluid that cannot leave
FEW = 2000  # numbers, of which another checksum is quicker
MAX_JUMP = 1e-12  # the same between two looks where it stays to rounding: 1e-17 in 50 steps


class GrainBits:
    """A checksum of a rank's grains from one of their steps to the next: while the fluid moves, or a run writes or
    waits, nothing may change them.
    """

    def __init__(self, dem: Dem) -> None:
        self.grains = dem.grains
        self.kept = self._now()
        self.trouble: str | None = None

    def _now(self) -> list[int]:
        """Checksums of rows and of forces: a quick one for few numbers, and one that is quick for many."""
        arrays = self.grains.columns["row"], self.grains.columns["force"]
        return [zlib.crc32(a.data) if a.size < FEW else int(np.add.reduce(a.view(np.int64), None)) for a in arrays]

    def keep(self) -> None:
        """The grains have done a step."""
        self.kept = self._now()

    def compare(self, step: int) -> None:
        """Before a step of the grains."""
        names = "places, velocities or sizes of grains", "forces on grains"
        found = [name for name, now, kept in zip(names, self._now(), self.kept) if now != kept]
        if found:
            self.trouble = f"{' and '.join(found)} changed by themselves before step {step}: damaged memory"


def cure(fluid: Fluid, brakes: str) -> str:
    """What may help a fluid that diverges, and what central moments do to grains: near tau = 1/2 shorter steps only
    make it worse.
    """
    scheme = fluid.collision.scheme
    if fluid.tau >= NEAR_HALF or not math.isfinite(scheme.grid_reynolds):
        return CURE
    return (
        f"with {scheme.name} and tau = {fluid.tau:.4g}, near 1/2, a finer domain.spacing is stable, or "
        f'fluid.collision = "central"{brakes}; shorter steps take tau nearer to it'
    )


def fault(seen: Diagnostics, fluid: Fluid | None, dem: Dem | None, max_overlap: float) -> str | None:
    """Why this rank's state is no solution, or None; max_overlap: allowed overlap over diameter."""
    if fluid and seen.fluid:
        way = cure(fluid, BRAKES if dem else HOLDS if seen.grains_stay else "")
        if seen.fluid.fastest > MAX_SPEED:
            return f"the fluid moves by {seen.fluid.fastest:.3g} nodes in a step (limit {MAX_SPEED}): {way}"
        share = float(fluid.lattice.w[0])  # populations at rest follow the density
        low, high = (1.0 / MAX_DENSITY - 1.0) * 2.0 * share, (MAX_DENSITY - 1.0) * share
        least, most = fluid.rest_bounds()
        if not low <= least <= most <= high:
            return f"the density left {1 / MAX_DENSITY} .. {MAX_DENSITY} times that of rest: {way}"
    if dem and not np.isfinite(dem.grains.x).all():
        return "a grain is nowhere"
    if dem and not all(np.isfinite(dem.grains.columns[name]).all() for name in ("heat", "work")):
        return "the energy of a grain is no number"
    if dem and not dem.grains.are_as_made():
        return "a grain has another mass, inertia or radius than at the start, or leaves the plane: damaged memory"
    if dem and seen.overlap > max_overlap:
        way = stiffer(seen.overlap, dem.law.stiffness)
        return f"grains overlap by {seen.overlap:.1%} of a diameter (limit {max_overlap:.0%}): {way}"
    if seen.fluid and abs(seen.fluid.drift) > MAX_DRIFT:
        way = seen.way_to_keep_mass()
        return f"the mean density of the fluid has changed by {seen.fluid.drift:.2%} (limit {MAX_DRIFT:.0%}){way}"
    if seen.fluid and not abs(seen.fluid.jump) <= MAX_JUMP:
        return f"the mean density of the fluid jumped by {seen.fluid.jump:.1e}, which nothing in it can do"
    return None
