"""Pictures of particles in space without a display: shaded balls, painted by depth into an image."""

import itertools

import numpy as np
from numpy.typing import NDArray

LIGHT = np.array([-0.35, 0.55, 0.76])  # from where, in the frame of the picture (right, up, towards the eye)


class View:
    """An oblique parallel view of a box[2, 3] in an image `width` pixels wide."""

    def __init__(self, box: NDArray, width: int, azimuth: float = -62.0, elevation: float = 24.0) -> None:
        a, e = np.deg2rad(azimuth), np.deg2rad(elevation)
        eye = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        self.axes = np.stack([right, np.cross(eye, right), eye])
        corners = np.array(list(itertools.product(*box.T))) @ self.axes.T
        low, high = corners.min(axis=0), corners.max(axis=0)
        self.scale = width / (high[0] - low[0])
        self.origin = low
        self.shape = (int(np.ceil((high[1] - low[1]) * self.scale)) + 1, width + 1)

    def project(self, x: NDArray) -> NDArray[np.float64]:
        """Pixels right, pixels up, depth towards the eye in pixels, of points x[n, 3]."""
        return (x @ self.axes.T - self.origin) * self.scale


def paint(view: View, x: NDArray, colours: NDArray, radius: float) -> NDArray[np.float64]:
    """Image[rows, columns, 4] of balls at x[n, 3] of this radius in m, with colours[n, 3] in 0 .. 1."""
    rows, columns = view.shape
    place = view.project(x)
    r = max(1.0, radius * view.scale)
    reach = int(np.ceil(r))
    front = np.full(rows * columns, -np.inf)
    spots = []
    for dy, dx in itertools.product(range(-reach, reach + 1), repeat=2):
        px, py = np.rint(place[:, 0]).astype(int) + dx, np.rint(place[:, 1]).astype(int) + dy
        height = r * r - (px - place[:, 0]) ** 2 - (py - place[:, 1]) ** 2
        seen = np.flatnonzero((height >= 0) & (px >= 0) & (px < columns) & (py >= 0) & (py < rows))
        at = (rows - 1 - py[seen]) * columns + px[seen]
        lift = np.sqrt(height[seen])
        np.maximum.at(front, at, place[seen, 2] + lift)
        spots.append((seen, at, lift, px[seen], py[seen]))
    image = np.zeros((rows * columns, 4))
    for seen, at, lift, px, py in spots:
        top = place[seen, 2] + lift == front[at]
        seen, at, lift = seen[top], at[top], lift[top]
        normal = np.stack([px[top] - place[seen, 0], py[top] - place[seen, 1], lift], axis=1) / r
        shade = 0.45 + 0.55 * np.maximum(0.0, normal @ LIGHT)
        image[at, :3] = colours[seen] * shade[:, None]
        image[at, 3] = 1.0
    return image.reshape(rows, columns, 4)


def box_surface(low: NDArray, high: NDArray, step: float) -> NDArray[np.float64]:
    """Points[n, 3] on the faces of a box, about `step` m apart."""
    found = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        lines = [np.linspace(low[k], high[k], max(2, int(np.ceil((high[k] - low[k]) / step)) + 1)) for k in others]
        face = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
        for end in (low[axis], high[axis]):
            points = np.empty((len(face), 3))
            points[:, others], points[:, axis] = face, end
            found.append(points)
    return np.concatenate(found)


def box_edges(low: NDArray, high: NDArray) -> list[NDArray[np.float64]]:
    """The twelve edges[2, 3] of a box."""
    corners = [np.array(corner) for corner in itertools.product(*zip(low, high))]
    return [np.stack([a, b]) for a, b in itertools.combinations(corners, 2) if np.count_nonzero(a != b) == 1]
