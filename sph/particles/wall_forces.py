"""The force of the fluid on walls, and its integral over time. In a corner walls share it (see wall_corners).

Pair forces along v_ij give the traction mu dv/dn, without mu (grad v)^T n. On the surface of a body that turns at w and
to which fluid sticks that part is - mu w x n: all around it no force, and a torque of - 2 mu w V. As they are not along
their line, such a pair takes hold midway between its particles, at the surface, not at the particle of the wall.
"""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.space.exact import LIMBS, add_limbs, power_of_two_above, value
from sph.case import geometry
from sph.kernels import readings
from sph.kernels.marks import CODES, OWN, WALL_BITS
from sph.particles.ghosts import Ghosts
from sph.particles.pair_sums import PairSums
from sph.particles.slabs import Slabs
from sph.particles.storage import Slots, Storage
from sph.particles.wall_corners import WallCorners
from sph.particles.walls import Walls
from sph.setup.rigid.rings import is_round
from sph.setup.scene import Wall
from sph.setup.signed_distance import signed_distance

OUTER = 0.75  # spacings: that deep goes the outer layer of a body

Forces = dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]


class WallForces:
    """`impulses` [walls, 1 + 3]: integrals over time of |F| and F on the measured walls, N s (2D: N s/m)."""

    def __init__(self, walls: Walls, ghosts: Ghosts, sums: PairSums, slabs: Slabs) -> None:
        self.walls, self.ghosts, self.storage, self.sums, self.slabs = walls, ghosts, ghosts.storage, sums, slabs
        self.measured = [wall for wall in walls.scene.walls if wall.measure_force]
        self.impulses = np.zeros((len(walls.scene.walls), 4))
        self._surfaces = {wall.index: surface(wall) for wall in self.measured if wall.rigid and not wall.rule.slips}
        sticks = sums.spec.viscosity.laplacian
        self._levers = {wall.index for wall in self.measured if sticks and not wall.rule.slips and is_smooth(wall)}
        self._corners = WallCorners(walls)

    def largest_impulse(self, time: float) -> float:
        """Impulse of pressures rho0 c0^2 on the sides of all particles from the start to a time in s, N s."""
        scene = self.walls.scene
        area = 2 * scene.dimensions * scene.most_particles(time) * scene.spacing ** (scene.dimensions - 1)
        return area * scene.rho0 * scene.c0 * (scene.c0 * time + scene.h)

    def now(self) -> Forces:
        """Force [d] in N (2D: N/m) and torque [3] about `torque_about` of the fluid on each measured wall, by the
        last pair sums. Collective.
        """
        scene = self.walls.scene
        axes, d = list(scene.axes), scene.dimensions
        slots, of = bodies_of_walls(self.walls, self.ghosts, self.slabs)
        force = np.zeros((3, len(slots)))
        force[axes] = self.sums.forces_on(slots)
        corner, taken, taker, owner = self._in_corners()
        # what is shared comes twice: given to who takes it, and taken from who owns the particle
        slots, of = np.concatenate([slots, corner, corner]), np.concatenate([of, taker, owner])
        force, terms = np.concatenate([force, taken, -taken], axis=1), []
        for wall in self.measured:
            own = of == wall.index
            (x, y, z), (fx, fy, fz) = self._arm(wall, slots[own]), force[:, own]
            torque = [y * fz - z * fy, z * fx - x * fz, x * fy - y * fx]
            terms.append(np.concatenate([force[:, own], torque, [self._wetted(wall, slots[own])]]))
        totals = exact_sums(self.slabs.world, terms) if terms else []
        return {wall.name: (total[:d], self._torque(wall, total)) for wall, total in zip(self.measured, totals)}

    def _arm(self, wall: Wall, slots: Slots) -> NDArray[np.float64]:
        """[3, k] m from where torques on a wall are about, in physical axes."""
        scene, arm = self.walls.scene, np.zeros((3, len(slots)))
        d = scene.dimensions
        about = wall.rigid.centre[:d] if wall.rigid else wall.torque_about
        centre = about + self.walls.displacement[wall.index] - scene.low
        axes = list(scene.axes)
        arm[axes] = self.storage.x[:, slots] - centre[axes, None]
        if wall.rigid:
            length = (scene.high - scene.low)[:, None]
            arm[:d] -= np.where(scene.periodic[:, None], length * np.rint(arm[:d] / length), 0.0)
        if wall.index in self._levers:
            middle = np.zeros(d) if wall.rigid else np.array(geometry.middle(wall.shape)) - about
            way = np.where(wall.through[:, None], 0.0, arm[:d] - middle[:, None])
            arm[:d] += (wall.shape.radius / np.sqrt(np.sum(way * way, axis=0)) - 1.0) * way
        return arm

    def _in_corners(self) -> tuple[Slots, NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
        """Slots of own particles in corners of walls, once for each wall that takes a share of the force on them: that
        share [3, k] N, the wall, and whose the particle is.
        """
        storage, scene, shares = self.storage, self.walls.scene, self._corners.shares()
        if not len(shares.ids):
            none = np.zeros(0, np.int64)
            return none, np.zeros((3, 0)), none, none

        def find() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
            """Slots and numbers of particles that may be shared, by number."""
            slots, _ = _slots_of_walls(storage, np.zeros_like(self.ghosts.maps.wall), self._corners.owns)
            slots = slots[storage.flags[slots] & OWN > 0]
            order = np.argsort(storage.numbers(slots))
            return slots[order], storage.numbers(slots)[order]

        slots, numbers = storage.until_sorted("corners", find)
        at = np.minimum(np.searchsorted(numbers, shares.ids), len(numbers) - 1)
        lines = np.flatnonzero(numbers[at] == shares.ids) if len(numbers) else np.zeros(0, np.int64)
        slots = slots[at[lines]]
        force = np.zeros((3, len(slots)))
        force[list(scene.axes)] = self.sums.forces_on(slots)
        force[: scene.dimensions] = shares.force(lines, force[: scene.dimensions])
        return slots, force, shares.of[lines], (shares.ids[lines] >> WALL_BITS) - 1

    def _torque(self, wall: Wall, total: NDArray[np.float64]) -> NDArray[np.float64]:
        """[3] N m about the middle of a wall. Pressure goes through the centre of a disc or ball along which fluid
        slips; what its particles, which are not quite round, have of a torque would turn it.
        """
        if wall.rigid and wall.shape.sphere and wall.rule.slips:
            return np.zeros(3)
        return total[3:6] + self._torque_of_rotation(wall, total[6])

    def _wetted(self, wall: Wall, slots: Slots) -> NDArray[np.float64]:
        """mu / mu0 of the fluid before particles of the surface of a body in these slots, 0 for all else."""
        if not self.sums.spec.wetted or wall.index not in self._surfaces:
            return np.zeros(len(slots))
        storage = self.storage
        return storage.arena["wetted"][slots] * np.isin(storage.numbers(slots), self._surfaces[wall.index])

    def _torque_of_rotation(self, wall: Wall, wetted: float) -> NDArray[np.float64]:
        """- 2 mu w V [3] N m of a body whose surface is wet as the sum of `_wetted` says."""
        if not wetted:
            return np.zeros(3)
        share = wetted / len(self._surfaces[wall.index])
        return -2 * self.walls.scene.viscosity * share * geometry.volume(wall.shape) * self.walls.spin[wall.index]

    def add_impulses(self, dt: float, found: Forces | None = None) -> None:
        """The forces of now, which may have been found, for a step of dt s. Collective."""
        if self.measured:
            forces = found or self.now()
            for wall in self.measured:
                force = forces[wall.name][0]
                parts = [float(np.sqrt(np.sum(force * force))), *force]
                self.impulses[wall.index, : len(parts)] += np.array(parts) * dt


def is_smooth(wall: Wall) -> bool:
    """True of walls with particles that have no edge: discs, balls, and cylinders through a period. Pressure, which is
    along the normal, has the same lever there at a particle and at the surface before it.
    """
    return wall.rule.layered and is_round(wall) and bool(wall.shape.sphere or wall.through.any())


def surface(wall: Wall) -> NDArray[np.int64]:
    """Numbers of the particles of a body in its outer layer."""
    ids, x, _ = wall.near(*wall.bounds)
    return ids[signed_distance(wall.shape, x) > -OUTER * wall.scene.spacing]


def bodies_of_walls(walls: Walls, ghosts: Ghosts, slabs: Slabs) -> tuple[Slots, NDArray[np.int64]]:
    """Slots of the own particles of measured walls and of images in these in own layers, which hold what they do to
    this slab, and the number of the wall of each.
    """
    storage = ghosts.storage

    def find() -> NDArray[np.int64]:
        """[3, n]: slots, walls, and whether they are images, of own particles and of images."""
        found = _slots_of_walls(storage, np.array(ghosts.maps.wall), walls.measured)
        image = storage.key[found[0]] % CODES > 0
        own = storage.flags[found[0]] & OWN > 0
        return np.compress(image | own, np.vstack([found, image]), axis=1)

    found = storage.until_sorted("walls", find)
    if found[2].any():
        layer = slabs.grid.layer(storage.x[0, found[0]])
        found = np.compress((found[2] == 0) | (layer >= slabs.low) & (layer < slabs.high), found, axis=1)
    return found[0], found[1]


def _slots_of_walls(storage: Storage, images: NDArray, wanted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Slots and walls [2, n] of the bodies of some walls, and of images of the fluid in them."""
    found = np.empty((2, storage.end), np.int64)
    return found[:, : readings.of_walls(storage.end, storage.flags, storage.key, images, wanted, *found)]


def exact_sums(world: World, terms: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """By group, [k]: sums over all ranks of terms[group][k, n]; with the same bits for any ranks. Collective."""
    scale = power_of_two_above(world.max(max(float(np.abs(values).max(initial=0.0)) for values in terms)))
    limbs = np.zeros((len(terms), len(terms[0]), LIMBS), np.int64)
    for own, values in zip(limbs, terms):
        for line, numbers in zip(own, values):
            add_limbs(line, numbers, 1.0 / scale)
    return [np.array([value(line, scale) for line in lines]) for lines in world.sum_int(limbs)]
