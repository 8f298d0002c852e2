"""What a case contains, the same on all ranks: the lattice, its faces and solids, and the grains at the start."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.files.start import arrays
from lbmdem.case.boundaries import Boundary, opening
from lbmdem.case.config import AXES, LbmDemConfig
from lbmdem.physics.units import Units
from lbmdem.physics.velocity_sets import CS2
from lbmdem.setup.flows import FLOWS


@dataclass(slots=True)
class FaceScene:
    """One side of the box in lattice units; rate: change of the density in a step."""

    kind: str  # "wall", "pressure", "velocity", "periodic"
    velocity: tuple[float, ...]
    density: float = 1.0
    rate: float = 0.0
    profile: str = "uniform"


@dataclass(frozen=True, slots=True)
class GrainTable:
    """All grains of the case at the start, in SI units; in 2D per metre of depth. set[n]: index of the set."""

    x: NDArray[np.float64]
    v: NDArray[np.float64]
    omega: NDArray[np.float64]
    radius: NDArray[np.float64]
    mass: NDArray[np.float64]
    inertia: NDArray[np.float64]
    fixed: NDArray[np.bool_]
    set: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.radius)


class Scene:
    """tau, force, faces and speeds in lattice units; sizes, grains and gravity in SI units."""

    def __init__(self, config: LbmDemConfig) -> None:
        self.config = config
        self.dimensions = d = config.dimensions
        self.lattice = config.lattice
        self.points = config.points  # along x, y(, z)
        self.time_step = config.time_step
        self.density = config.liquid.density if config.fluid else 0.0  # of the fluid, kg/m3
        self.units = Units(config.spacing, self.time_step, self.density, d)
        self.periodic = tuple(axis in config.domain.periodic for axis in AXES[:d])
        self.gravity = np.array(config.gravity)
        if config.fluid:
            self.tau = config.tau
            self.faces = self._faces()
            self.acceleration = np.array(config.liquid.body_force) / self.units.acceleration
        self.set_names = [grains.name for grains in config.grains]

    def _faces(self) -> dict[str, FaceScene]:
        given = {boundary.face: boundary for boundary in self.config.boundary}
        faces = {}
        for axis, periodic in zip(AXES[: self.dimensions], self.periodic):
            still = FaceScene("periodic" if periodic else "wall", (0.0,) * self.dimensions)
            for name in (axis + "-", axis + "+"):
                faces[name] = self._face(given[name]) if name in given else still
        return faces

    def _face(self, boundary: Boundary) -> FaceScene:
        units, rho = self.units, self.density
        velocity = tuple(u / units.velocity for u in boundary.velocity)
        density = boundary.density / rho if boundary.density is not None else 1.0
        if boundary.pressure is not None:
            density += boundary.pressure / units.pressure / CS2
        rate = boundary.pressure_rate * units.dt / units.pressure / CS2
        return FaceScene(boundary.type, velocity, density, rate, boundary.profile)

    def inflow(self, name: str, axes: tuple[NDArray, ...]) -> NDArray[np.float64]:
        """Velocity [..., d] through a face at its nodes, lattice units: those of `axes` without its own axis, which has
        one. Between walls it may be a parabola; between two pairs of them a product of two, 0 behind what stands there.
        """
        k, face, size = AXES.index(name[0]), self.faces[name], self.config.domain.size
        at = 0.5 * self.units.dx if name[1] == "-" else size[k] - 0.5 * self.units.dx
        ends, tops = opening(k, at, size, self.config.obstacle)
        across = [axis for j, axis in enumerate(axes) if j != k]
        shape = np.ones(np.broadcast_shapes(*(axis.shape for axis in across)))
        for j in self.config.walled(k) if face.profile == "parabolic" else ():
            share = (axes[j] - ends[j]) / max(tops[j] - ends[j], 1e-300)
            shape = shape * np.maximum(6.0 * share * (1.0 - share), 0.0)
        return shape[..., None] * np.array(face.velocity)

    def body_force(self, step: int) -> NDArray[np.float64]:
        """Acceleration of the fluid at a step, in lattice units: of the case, and of the shaken frame."""
        return self.acceleration - self.frame(step)

    def frame(self, step: int) -> NDArray[np.float64]:
        """Acceleration of the shaken frame at a step, in lattice units."""
        return self.shaken_at(np.array([step * self.time_step]))[0] / self.units.acceleration

    def shaken_at(self, times: NDArray) -> NDArray[np.float64]:
        """Accelerations [m, d] of the frame at times [m], in m/s2."""
        shaking = self.config.shaking
        if shaking is None:
            return np.zeros((len(times), self.dimensions))
        sines = [math.sin(2.0 * math.pi * shaking.frequency * t) for t in times.tolist()]
        return np.array(sines)[:, None] * np.array(shaking.acceleration)

    def shaken_over(self, times: NDArray) -> NDArray[np.float64]:
        """Accelerations [m, d] of the frame over steps from times [m]: the mean of both ends, as the fluid gets it."""
        return 0.5 * (self.shaken_at(times) + self.shaken_at(times + self.time_step))

    def constant_force(self, mass: NDArray, volume: NDArray) -> NDArray[np.float64]:
        """Force [n, d] on grains that links do not give, N: weight less buoyancy, and rho V a of a body force a.

        The pressure of the lattice fluid is what is left beside two given parts: that of its own weight, rho g, and
        that which drives it, -grad p = rho a. A surface in these feels rho V g less and rho V a more.
        """
        displaced = self.density * volume
        force = mass[:, None] * ((1.0 - displaced / mass)[:, None] * self.gravity)
        driving = self.config.liquid.body_force if self.config.fluid else ()
        return force + displaced[:, None] * np.array(driving) if any(driving) else force

    def initial_velocity(self, axes: tuple[NDArray, ...]) -> NDArray[np.float64]:
        """Velocity of the fluid at nodes, lattice units [..., d]; axes: coordinates x, y(, z) that broadcast, in m."""
        shape = np.broadcast_shapes(*(axis.shape for axis in axes))
        u = np.zeros((*shape, self.dimensions))
        given = self.given_rows("velocity", axes)
        if given is not None:
            return given / self.units.velocity
        initial = self.config.liquid.initial
        if initial is None:
            for k in range(self.dimensions):
                u[..., k] = self._through(k, axes)
            return u
        speed = initial.speed / self.units.velocity
        u[..., 0], u[..., 1] = FLOWS[initial.flow].velocity(axes[0], axes[1], self.config.domain.size, speed)
        return u

    def given_rows(self, name: str, axes: tuple[NDArray, ...]) -> NDArray[np.float64] | None:
        """These rows of an array that the fluid starts with, in storage order; None where the case names none."""
        start = self.config.liquid.start
        given = arrays(start).get(name) if start else None
        return None if given is None else given[np.rint(axes[-1].ravel() / self.units.dx - 0.5).astype(int)]

    def _through(self, k: int, axes: tuple[NDArray, ...]) -> NDArray[np.float64] | float:
        """Velocity along axis k between two faces of it that let fluid through, one or both with a given velocity.

        An incompressible fluid follows them at once. From rest this one would answer by sound, which such faces throw
        back and viscosity hardly damps.
        """
        faces = {name: self.faces[name] for name in (AXES[k] + "-", AXES[k] + "+")}
        given = [self.inflow(name, axes)[..., k] for name, face in faces.items() if face.kind == "velocity"]
        if not given or any(face.kind == "wall" for face in faces.values()):
            return 0.0
        return given[0] + (given[-1] - given[0]) * (axes[k] / self.config.domain.size[k])

    def initial_density(self, axes: tuple[NDArray, ...], sample: tuple[float, float] | None) -> NDArray[np.float64]:
        """Density at nodes in lattice units: of rest, or of the initial flow; between two pressure faces it falls
        linearly, along the last axis over the sample of grains where there is one, low to high in m: a jump would leave
        an alternation of the velocity from node to node.
        """
        shape = np.broadcast_shapes(*(axis.shape for axis in axes))
        rho = np.ones(shape)
        given = self.given_rows("pressure", axes)
        if given is not None:
            return rho + given / self.units.pressure / CS2
        initial = self.config.liquid.initial
        if initial is not None and (excess := FLOWS[initial.flow].excess) is not None:
            rho += excess(axes[0], axes[1], self.config.domain.size, initial.speed / self.units.velocity)
        for k, name in enumerate(AXES[: self.dimensions]):
            low, high = self.faces[name + "-"], self.faces[name + "+"]
            if low.kind == high.kind == "pressure":
                along = sample if sample and k == self.dimensions - 1 else self._end_nodes(k)
                share = np.clip((axes[k] - along[0]) / (along[1] - along[0]), 0.0, 1.0)
                rho += (low.density - 1.0) * (1.0 - share) + (high.density - 1.0) * share
        return rho

    def _end_nodes(self, k: int) -> tuple[float, float]:
        """Where the first and the last node of axis k are, m: pressure faces hold there."""
        half = 0.5 * self.units.dx
        return half, self.config.domain.size[k] - half


def grain_table(config: LbmDemConfig, positions: list[NDArray], radii: list[NDArray]) -> GrainTable:
    """Grains of all sets one after the other; positions[k][n, d] and radii[k][n] of set k in m."""
    d = config.dimensions
    sets = [np.full(len(r), k, np.int32) for k, r in enumerate(radii)]
    counts = [len(r) for r in radii]
    x = np.concatenate([p.reshape(-1, d) for p in positions]) if positions else np.zeros((0, d))
    radius = np.concatenate(radii) if radii else np.zeros(0)

    def each(values: list) -> NDArray:
        return np.repeat(np.array(values), counts, axis=0) if values else np.zeros(0)

    def rows(name: str, columns: int) -> NDArray:
        """An array that each set starts with, or the one value that all its grains have; [n, columns]."""
        parts = ((grains.given(name), getattr(grains, name), n) for grains, n in zip(config.grains, counts))
        made = [np.tile(value, (n, 1)) if given is None else given for given, value, n in parts]
        return np.concatenate([np.zeros((0, columns)), *made])

    density = each([grains.density for grains in config.grains])
    volume = volumes(radius, d)
    mass = density * volume
    inertia = (0.5 if d == 2 else 0.4) * mass * radius * radius
    turning = 1 if d == 2 else 3
    return GrainTable(
        x=x,
        v=rows("velocity", d),
        omega=rows("angular_velocity", turning),
        radius=radius,
        mass=mass,
        inertia=inertia,
        fixed=each([not grains.moving for grains in config.grains]).astype(np.bool_),
        set=np.concatenate(sets) if sets else np.zeros(0, np.int32),
    )


def volumes(radius: NDArray, d: int) -> NDArray:
    """m3 of spheres, m2 of discs."""
    return np.pi * radius * radius * (1.0 if d == 2 else 4.0 / 3.0 * radius)
