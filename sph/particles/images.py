"""Images of particles: in periodic sides, in walls that mirror, and through the particles of a layer (point symmetry).

Image k of a body is at turn x + shift with the velocity spin v + push. Positions are relative to the lower corner of
the domain, axes in storage order.
"""

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import ConfigError
from hpcpic.core.space.products import product
from sph.kernels.groups import Images, Mirrors
from sph.kernels.marks import CODES
from sph.particles.walls import Walls
from sph.setup.mirror_groups import direction
from sph.setup.particle_lattices import whole_steps
from sph.setup.scene import Scene, Wall

FAR = 1e299  # a face as far as this has no edge
Plane = tuple[NDArray[np.float64], float]


class Layer:
    """A flat layer of particles origin + i t_1 (+ j t_2): the centres of point symmetry.

    counts: how many along each tangent; endless: along which it goes through a period.
    """

    def __init__(self, origin: NDArray, tangents: NDArray, counts: tuple[int, ...], endless: NDArray[np.bool_]) -> None:
        self.origin, self.tangents = origin, tangents
        last = np.array(counts) - 1.0
        self.ends = np.stack([np.where(endless, -np.inf, 0.0), np.where(endless, np.inf, last)], axis=1)


class Maps:
    """All images: turn, spin [k, d, d]; shift, push [k, d]; map 0 is the identity.

    planes[k]: a body has image k if x . normal < offset for all of them. wall[k]: number of the wall + 1, 0 for none.
    depth[k]: where the face of a mirror is along its normal. layers[k]: centres, by wall normal: along the normal the
    shift is that of the map, across it twice the nearest centre.
    """

    def __init__(self, d: int) -> None:
        self.turn, self.spin = np.eye(d)[None], np.eye(d)[None]
        self.shift, self.push = np.zeros((1, d)), np.zeros((1, d))
        self.planes: list[list[Plane]] = [[]]
        self.layers: list[list[tuple[NDArray[np.float64], Layer]]] = [[]]
        self.wall, self.depth = [0], [0.0]

    def add(
        self, turn: NDArray, shift: NDArray, spin: NDArray, push: NDArray, planes: list[Plane], wall: int = 0,
        layers: list[tuple[NDArray, Layer]] | None = None, depth: float = 0.0,
    ) -> None:  # fmt: skip
        """Add one map. ConfigError if there are too many."""
        if len(self.planes) == CODES:
            raise ConfigError([f"more than {CODES} images of a particle: too many mirrors"])
        self.turn, self.spin = np.concatenate([self.turn, turn[None]]), np.concatenate([self.spin, spin[None]])
        self.shift, self.push = np.concatenate([self.shift, shift[None]]), np.concatenate([self.push, push[None]])
        self.planes.append(planes)
        self.wall.append(wall)
        self.layers.append(layers or [])
        self.depth.append(depth)

    def combine(self, other: "Maps") -> None:
        """Every map of `other` after every map here too: corners."""
        n = len(self.planes)
        for k in range(1, len(other.planes)):
            for j in range(n):
                turn = product(other.turn[k], self.turn[j])
                shift = product(other.turn[k], self.shift[j]) + other.shift[k]
                spin = product(other.spin[k], self.spin[j])
                push = product(other.spin[k], self.push[j]) + other.push[k]
                planes, layers = [*self.planes[j], *other.planes[k]], [*self.layers[j], *other.layers[k]]
                self.add(turn, shift, spin, push, planes, self.wall[j] or other.wall[k], layers)

    @cached_property
    def images(self) -> Images:
        """All maps as arrays; an image with fewer planes has some that hold all."""
        (n, d), most = self.shift.shape, max(map(len, self.planes))
        normals, offsets = np.zeros((n, most, d)), np.full((n, most), np.inf)
        tangents, ends, squares = np.zeros((n, d - 1, d)), np.zeros((n, d - 1, 2)), np.ones((n, d - 1))
        turn, origin, across = self.turn.copy(), np.zeros((n, d)), np.zeros((n, d, d))
        for k, (planes, layers) in enumerate(zip(self.planes, self.layers)):
            for p, (normal, offset) in enumerate(planes):
                normals[k, p], offsets[k, p] = normal, offset
            if layers:
                layer = layers[0][1]
                origin[k], tangents[k], ends[k] = layer.origin, layer.tangents, layer.ends
                squares[k] = np.sum(layer.tangents**2, axis=1)
                turn[k] = -np.eye(d)  # what lies in the layer is turned too
                across[k] = np.eye(d) - sum(np.outer(normal, normal) for normal, _ in layers)
        mirrored = np.array(self.wall) > 0  # velocities turn and density does not flow
        maps = turn, self.shift, self.spin, self.push, mirrored
        return Images(normals, offsets, *maps, origin, tangents, squares, ends, across)


def periodic_maps(lengths: NDArray, periodic: NDArray, reach: float) -> Maps:
    """Shifts by a period, up and down, along each periodic axis and their combinations."""
    d = len(lengths)
    maps, one, still = Maps(d), np.eye(d), np.zeros(d)
    for axis in np.flatnonzero(periodic):
        step, unit = Maps(d), np.eye(d)[axis]
        step.add(one, unit * lengths[axis], one, still, [(unit, reach)])
        step.add(one, -unit * lengths[axis], one, still, [(-unit, reach - lengths[axis])])
        maps.combine(step)
    return maps


def single_mirrors(groups: list[Maps]) -> Mirrors:
    """The faces of groups of mirrors as kernels.motion.swap takes them. Behind: deeper than the face, not farther than
    its images reach.
    """
    d = groups[0].turn.shape[1] if groups else 1
    maps = [(group, k) for group in groups for k in range(1, len(group.planes))]
    most = max((len(group.planes[k]) for group, k in maps), default=0)
    normals, bounds = np.zeros((len(maps), most, d)), np.full((len(maps), most), np.inf)
    for f, (group, k) in enumerate(maps):
        for p, (normal, offset) in enumerate(group.planes[k]):
            normals[f, p], bounds[f, p] = normal, offset
        normals[f, 0], bounds[f, 0] = group.planes[k][0][0], group.depth[k]

    def stacked(field: str, *shape: int) -> NDArray:
        return np.array([getattr(group, field)[k] for group, k in maps]).reshape(len(maps), *shape)

    return Mirrors(
        normals, bounds, stacked("turn", d, d), stacked("shift", d), stacked("spin", d, d), stacked("push", d)
    )


def images_of(walls: Walls, reach: float) -> tuple[Maps, Mirrors]:
    """All images within `reach` m where walls are now, and the mirrors by themselves."""
    scene, axes = walls.scene, list(walls.scene.axes)
    maps = periodic_maps((scene.high - scene.low)[axes], scene.periodic[axes], reach)
    groups = mirrors(scene, walls, axes, reach)
    for group in groups:
        maps.combine(group)
    return maps, single_mirrors(groups)


def mirrors(scene: Scene, walls: Walls, axes: list[int], reach: float) -> list[Maps]:
    """Maps of the mirror walls (Morris et al. 1997, as (MP) 4.2 uses them) and of point symmetries (Ferrari et al.
    2009, MP 4.1), parallel faces in one group.
    """
    d, groups = scene.dimensions, dict[tuple[float, ...], Maps]()
    for wall in scene.walls:
        way = walls.displacement[wall.index]
        moved = way - whole_steps(wall, way) - scene.low
        push = 2 * walls.velocity[wall.index][axes]
        beyond = 0.0 if wall.section.solid else reach  # the corners of a tank belong to both of its faces
        for point, normal, near, edges, layer in _faces(wall, reach, moved, axes):
            planes = near + [(plane, offset + beyond * np.sqrt(product(plane, plane))) for plane, offset in edges]
            group = groups.setdefault(direction(normal), Maps(d))
            away = np.outer(normal, normal)
            turn, shift = np.eye(d) - 2 * away, 2 * product(point, normal) * normal
            if layer is None:
                group.add(turn, shift, -np.eye(d), push, planes, wall.index + 1, None, product(point, normal))
            else:
                group.add(turn, shift, turn, product(away, push), planes, wall.index + 1, [(normal, layer)],
                          product(point, normal))  # fmt: skip
    return list(groups.values())


def _faces(wall: Wall, reach: float, moved: NDArray, axes: list[int]) -> Iterator[tuple]:
    """Columns that describe the faces of a wall: point, normal, planes of who is near, of the edges, layer of centres
    (None: mirror).
    """
    if wall.rule.face_images:
        for face in wall.faces:
            point, normal = (face.point + moved)[axes], face.normal[axes]
            low, high = (face.low + moved)[axes], (face.high + moved)[axes]
            edges = [(unit, high[k]) for k, unit in enumerate(np.eye(len(axes))) if not normal[k] and high[k] < FAR]
            edges += [(-unit, -low[k]) for k, unit in enumerate(np.eye(len(axes))) if not normal[k] and low[k] > -FAR]
            yield point, normal, _near(point, normal, reach), edges, None
    elif wall.rule.layer_images:
        for sheet in wall.lattice.parts:
            normal, tangents = sheet.normal[axes], sheet.tangents[:, axes]
            endless = np.any(tangents[:, wall.through[axes]] != 0.0, axis=1)
            layer = Layer((sheet.origin + moved)[axes], tangents, sheet.counts, endless)
            edges = []
            for tangent, n in zip(tangents[~endless], np.array(sheet.counts)[~endless]):
                step = product(tangent, tangent)
                first = product(layer.origin, tangent) - step / 2
                edges += [(tangent, first + n * step), (-tangent, -first)]
            yield layer.origin, normal, _near(layer.origin, normal, reach), edges, layer


def _near(point: NDArray, normal: NDArray, reach: float) -> list[Plane]:
    """The planes between which a body is at most `reach` m before a face or behind it."""
    return [(normal, product(point, normal) + reach), (-normal, reach - product(point, normal))]
