"""Faces that mirror fluid, in groups of parallel ones."""

import itertools
import math
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from sph.setup.scene import Scene


def most_images(scene: Scene) -> int:
    """How many maps a scene has at most: one or none for parallel faces, either side or none for a period."""
    faces = [face for wall in scene.walls for face in wall.faces]
    layers = [wall.lattice.parts for wall in scene.walls if wall.rule.layer_images]
    groups = Counter(direction(face.normal) for face in itertools.chain(faces, *layers))
    return 3 ** int(scene.periodic.sum()) * math.prod(1 + n for n in groups.values())


def direction(normal: NDArray) -> tuple[float, ...]:
    """A direction that parallel faces share, to whichever side they look."""
    rounded = np.round(normal, 9)
    return tuple(rounded * np.sign(rounded[np.flatnonzero(rounded)[0]]))
