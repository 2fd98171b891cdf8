"""A sprite that moves, and the geometry of drawing it.

Three frames of reference, all in continuous pixels (the first pixel's centre is at .5): a sprite's
own (from its centre), the world's (from the background's centre), and the picture's.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from entrack.datasets.frames import Image
from entrack.datasets.synthetic.motion import Track
from entrack.datasets.synthetic.sprite import Sprite

Matrix = NDArray[np.float64]  # (3, 3), affine
Region = tuple[int, int, int, int]  # x, y, w, h in whole pixels


@dataclass(frozen=True)
class Actor:
    """A sprite and how it moves.

    Parameters
    ----------
    sprite
        What is drawn.
    poses
        (T, 5): x, y of its centre in the world, scale, stretch (the width grows by √stretch, the
        height shrinks by it), angle in radians.
    pictures
        (T,) int: which of the sprite's pictures is shown.
    layer
        (T,): the higher, the nearer; an actor hides those on lower layers, and on its own those
        that the scene names before it.
    """

    sprite: Sprite
    poses: Track
    pictures: NDArray[np.int64]
    layer: Track

    def matrix(self, t: float) -> Matrix:
        """From the sprite's frame of reference into the world's at time `t`, in frames."""
        x, y, scale, stretch, angle = at(self.poses, t)
        c, s = np.cos(angle), np.sin(angle)
        sx, sy = scale * np.sqrt(stretch), scale / np.sqrt(stretch)
        return np.array([[c * sx, -s * sy, x], [s * sx, c * sy, y], [0, 0, 1]])

    @property
    def extents(self) -> NDArray[np.float64]:
        """Its boxes in the world, (T, 4)."""
        return np.array([self.box(t, np.eye(3)) for t in range(len(self.poses))])

    def box(self, t: int, view: Matrix) -> NDArray[np.float64]:
        """Its box (4,) in frame `t`, where `view` takes the world to."""
        points = _apply(view @ self.matrix(t), self.sprite.hulls[int(self.pictures[t])])
        return np.concatenate([points.min(axis=0), np.ptp(points, axis=0)])

    def alpha(self, t: int, view: Matrix, region: Region) -> NDArray[np.float32]:
        """Its coverage (h, w) in [0, 1] of a region of what `view` shows."""
        x, y, w, h = region
        level, matrix = self.drawing(t, view)
        shape = self.sprite.shapes[int(self.pictures[t])][level]
        seen = cv2.warpAffine(shape, for_cv(shift(-x, -y) @ matrix), (w, h))
        return seen.astype(np.float32) / np.float32(255)

    def drawing(self, t: float, view: Matrix) -> tuple[int, Matrix]:
        """The level of detail to draw, and the way from its pixels to what `view` shows."""
        matrix = view @ self.matrix(t)
        level = self.sprite.level(float(np.sqrt(abs(np.linalg.det(matrix[:2, :2])))))
        h, w = self.sprite.shapes[0][0].shape
        return level, matrix @ shift(-w / 2, -h / 2) @ np.diag([2.0**level, 2.0**level, 1.0])


def around(box: NDArray[np.float64]) -> Region:
    """Whole pixels that hold the box and a soft edge."""
    x, y = (int(np.floor(v)) - 1 for v in box[:2])
    w, h = (int(np.ceil(v)) + 3 for v in box[2:])
    return x, y, w, h


def draw(canvas: NDArray[Any], picture: Image, matrix: Matrix) -> None:
    """Lay a picture (BGR multiplied by alpha, alpha) over the canvas, in place."""
    h, w = picture.shape[:2]
    corners = _apply(matrix, np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float64))
    limit = canvas.shape[1::-1]
    x0, y0 = (max(int(v), 0) for v in np.floor(corners.min(axis=0)))
    x1, y1 = (min(int(v) + 1, m) for v, m in zip(corners.max(axis=0), limit, strict=True))
    if x0 >= x1 or y0 >= y1:
        return
    layer = cv2.warpAffine(picture, for_cv(shift(-x0, -y0) @ matrix), (x1 - x0, y1 - y0))
    through = cv2.cvtColor(255 - layer[..., 3], cv2.COLOR_GRAY2BGR)
    part = canvas[y0:y1, x0:x1]
    dimmed = cv2.multiply(part, through, scale=1 / 255)
    part[:] = cv2.add(dimmed, cv2.cvtColor(layer, cv2.COLOR_BGRA2BGR))


def at(track: Track, t: float) -> NDArray[np.float64]:
    """A row of the track; between two frames, what lies between them."""
    low = int(t)
    part = t - low
    return track[low] if part == 0 else (1 - part) * track[low] + part * track[low + 1]


def shift(x: float, y: float) -> Matrix:
    """The way of everything by (x, y)."""
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1]], np.float64)


def _apply(matrix: Matrix, points: NDArray[np.float64]) -> NDArray[np.float64]:
    return points @ matrix[:2, :2].T + matrix[:2, 2]


def for_cv(matrix: Matrix) -> Matrix:
    """What cv2.warpAffine needs (2, 3): there, a pixel's centre has whole numbers."""
    return (shift(-0.5, -0.5) @ matrix @ shift(0.5, 0.5))[:2]
