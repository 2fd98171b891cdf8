"""From boxes as the benchmarks' files have them to boxes as the program has them."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def zero_based(rows: Floats, origin: int) -> Floats:
    """Return boxes (T, 4) counted from 0; NaN rows where a side is not positive.

    >>> zero_based(np.array([[1.0, 1, 5, 5], [0, 0, 0, 0]]), origin=1)
    array([[ 0.,  0.,  5.,  5.],
           [nan, nan, nan, nan]])
    """
    boxes = rows - (origin, origin, 0, 0)
    boxes[~(rows[:, 2:] > 0).all(axis=1)] = np.nan
    return boxes


def upright_boxes(corners: ArrayLike) -> Floats:
    """Boxes (…, 4) with the area and the mean corner of quadrilaterals (…, 8).

    The proportions are those of the smallest upright rectangle around the corners.

    >>> upright_boxes([2, 0, 4, 2, 2, 4, 0, 2])
    array([0.586, 0.586, 2.828, 2.828])
    """
    points = np.asarray(corners, np.float64).reshape(*np.shape(corners)[:-1], 4, 2)
    middle = points.mean(axis=-2)
    extent = points.max(axis=-2) - points.min(axis=-2)
    sides = np.linalg.norm(np.diff(points[..., :3, :], axis=-2), axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.sqrt(sides.prod(axis=-1) / extent.prod(axis=-1))
    size = extent * np.where(np.isfinite(scale) | np.isnan(middle[..., 0]), scale, 1)[..., None]
    return np.concatenate([middle - size / 2, size], axis=-1)
