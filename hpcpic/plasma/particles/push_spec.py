"""What the kernels of a scene are made for, and into how many parts they divide a particle's charge."""

import math
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hpcpic.core.simd.generate import specialise
from hpcpic.plasma.case.config import rotation
from hpcpic.plasma.physics.moments import Moment, integrands_source, values_of
from hpcpic.plasma.physics.shapes import SHAPES, Shape
from hpcpic.plasma.setup.scene import Scene
from hpcpic.plasma.sizes import WHOLE_BITS

PLAIN = ("storage", "weights", "plain", "moments")  # files of kernels that all scenes have


@dataclass(frozen=True, slots=True)
class PushSpec:
    """What the kernels are made for: axes, shape, velocity components, kind of rotation (physics.boris); type of a
    particle's numbers; moments of the series.
    """

    dimensions: int
    shape: Shape
    velocities: int
    rotation: int
    dtype: DTypeLike
    moments: tuple[Moment, ...] = ()

    @property
    def components(self) -> int:
        return self.dimensions + self.velocities

    @property
    def n_moments(self) -> int:
        """Values that a sample sums over each species."""
        return values_of(self.moments, self.velocities)

    @classmethod
    def of(cls, scene: Scene, moments: tuple[Moment, ...]) -> "PushSpec":
        numerics, v = scene.config.numerics, scene.velocity_components
        dtype = np.float64 if numerics.precision == "double" else np.float32
        return cls(scene.dimensions, SHAPES[numerics.shape], v, rotation(scene.config), dtype, moments)

    def kernels(self, plain: bool = False) -> ModuleType:
        """The compiled module of this specification; `plain` for the reference, one particle after the other."""
        dtype = np.dtype(self.dtype)
        vectors = () if plain else ("simd_base", *self.shape.vector_kernels, "push", "moments_simd", "histogram")
        stems = (*PLAIN, *vectors)
        return self._module(stems, dtype, self.moments)

    def node_moments(self, moments: tuple[Moment, ...]) -> Any:
        """The kernel that sums moments of a species on the nodes, in double precision."""
        return self._module(PLAIN, np.dtype(np.float64), moments).node_moments

    def _module(self, stems: tuple[str, ...], real: np.dtype, moments: tuple[Moment, ...]) -> ModuleType:
        """Kernels that calculate in `real`, whatever the precision of the particles."""
        return specialise(
            "hpcpic.plasma.kernels",
            stems,
            {"moments": integrands_source(moments, self.velocities)},
            replaced=("linear",),
            DIM=self.dimensions,
            NODES=self.shape.nodes,
            VELOCITIES=self.velocities,
            COMPONENTS=self.components,
            REAL=f"np.{real.name}",
            LANES=64 // np.dtype(self.dtype).itemsize,
            MOMENTS=values_of(moments, self.velocities),
            ROTATION=self.rotation,
        )


def groups_of_charge(scene: Scene, spec: PushSpec) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """charge[species] = (group of equal |q|, parts of one particle with sign), weight[group] = density of a part.

    A node may hold 2^18 particles of a group, or a group's all, or 4096 times the mean: the parts are chosen so.
    """
    sizes = sorted({abs(species.q) for species in scene.species}, reverse=True)
    mean = scene.n_particles / np.prod(scene.points)
    most = max(1, min(scene.n_particles, max(2**18, 4096 * mean)))
    bits = min(WHOLE_BITS[np.dtype(spec.dtype).itemsize], 62 - math.ceil(math.log2(most)))
    charge = [(sizes.index(abs(species.q)), int(np.sign(species.q)) << bits) for species in scene.species]
    weight = [q / scene.cell_volume / 2.0**bits for q in sizes]
    return np.array(charge, np.int64).reshape(-1, 2), np.array(weight or [0.0])
