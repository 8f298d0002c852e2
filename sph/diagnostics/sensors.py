"""Pressure on areas of walls, as a sensor of that size reads it: the force of the fluid on the piece of wall behind the
area, by the pair sums of every step, over the area; the mean since the last reading. Beside gases, which leave no wall
dry, the background is taken off.

Each rank adds the forces as integers (2^-40 of rho0 c0^2 times the area), so that readings have the same bits for any
ranks.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.generate import specialise
from sph.case.config import Gauge
from sph.kernels.groups import Areas
from sph.particles.ghosts import Ghosts
from sph.particles.pair_sums import PairSums
from sph.particles.slabs import Slabs
from sph.particles.walls import Walls
from sph.setup.tanks import ends, frame

FIXED_POINT = 2.0**40


class Sensors:
    """`integrals` of the pressures on the areas since their last readings, Pa s; `lasted`: for how long, s."""

    def __init__(self, walls: Walls, ghosts: Ghosts, sums: PairSums, slabs: Slabs) -> None:
        self.walls, self.ghosts, self.sums, self.slabs = walls, ghosts, sums, slabs
        scene = walls.scene
        self.gauges = scene.config.sensors
        self.integrals, self.lasted = np.zeros((2, len(self.gauges)))
        if not self.gauges:
            return
        self.kernels = specialise("sph.kernels", ["sensors"], DIM=scene.dimensions)
        axes, n = list(scene.axes), len(self.gauges)
        names = [wall.name for wall in scene.walls]
        self.of = np.array([names.index(gauge.wall) if gauge.wall else -1 for gauge in self.gauges])
        self.unit = scene.rho0 * scene.c0**2
        self.untold = scene.untold
        areas = np.array([gauge.area(scene.spacing) for gauge in self.gauges])
        half = np.array([gauge.extents(scene.spacing) for gauge in self.gauges])[:, axes] / 2
        radius = np.array([gauge.radius or 0.0 for gauge in self.gauges])
        along, sign = zip(*(gauge.direction for gauge in self.gauges))
        self.at = np.array([gauge.at for gauge in self.gauges]) - scene.low
        self.arena = sums.tasks.arena
        self.arena.group(areas=Areas)
        self.arena.set(
            area_middle=np.zeros((n, scene.dimensions)),
            area_reach=np.sum((np.maximum(half, radius[:, None]) + 2 * scene.support + scene.spacing) ** 2, axis=1),
            area_frame=np.ascontiguousarray([frame(scene, gauge)[np.ix_(axes, axes)] for gauge in self.gauges]),
            area_half=np.ascontiguousarray(half),
            area_ends=np.ascontiguousarray([ends(scene, gauge)[axes] for gauge in self.gauges]),
            area_radius=radius,
            area_along=np.array([axes.index(k) for k in along]),
            area_wall=self.of,
            area_unit=np.array(sign) * FIXED_POINT / (self.unit * areas),
            lengths=np.array([scene.spacing, scene.support]),
            wall_images=np.array(ghosts.maps.wall),
            slab=np.zeros(2, np.int64),
            pushed=np.zeros((sums.tasks.parts, n), np.int64),
        )

    def now(self) -> NDArray[np.float64]:
        """Pressures on the areas by the last pair sums, Pa. Collective."""
        arena, shown = self.arena, (self.of >= 0)[:, None]
        moved = np.where(shown, self.walls.displacement[self.of], 0.0)
        arena["area_middle"][:] = (self.at + moved)[:, list(self.walls.scene.axes)]
        arena["slab"][:] = self.slabs.low, self.slabs.high
        self.sums.tasks.each(self.kernels.push)
        found = self.slabs.world.sum_int(arena["pushed"].sum(axis=0)) * (self.unit / FIXED_POINT)
        return np.asarray(found) - self.untold

    def add(self, dt: float) -> None:
        """The pressures of now for a step of dt s. Collective."""
        if self.gauges:
            self.integrals += self.now() * dt
            self.lasted += dt

    def read(self, gauge: Gauge) -> float:
        """Mean pressure since the last reading, Pa; now where there was no step since then. Collective."""
        k = self.gauges.index(gauge)
        return float(self.integrals[k] / self.lasted[k] if self.lasted[k] else self.now()[k])

    def begin_anew(self, gauges: Sequence[Gauge]) -> None:
        """These have been read."""
        for gauge in gauges:
            k = self.gauges.index(gauge)
            self.integrals[k] = self.lasted[k] = 0.0
