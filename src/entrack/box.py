"""Boxes as pure functions on arrays.

A box is `(x, y, w, h)`: 0-based continuous pixels, the left top corner and the size. All functions
take arrays of shape (..., 4) and broadcast; they return float64.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack.errors import EntrackError

Boxes = NDArray[np.float64]


def to_corners(boxes: ArrayLike) -> Boxes:
    """`(x, y, w, h)` → `(x0, y0, x1, y1)`, the paper's d.

    >>> to_corners([10, 20, 30, 40])
    array([10., 20., 40., 60.])
    """
    b = np.asarray(boxes, np.float64)
    return np.concatenate([b[..., :2], b[..., :2] + b[..., 2:]], axis=-1)


def from_corners(corners: ArrayLike) -> Boxes:
    """`(x0, y0, x1, y1)` → `(x, y, w, h)`; corners in the wrong order are put right (row 20).

    >>> from_corners([40, 60, 10, 20])
    array([10., 20., 30., 40.])
    """
    c = np.asarray(corners, np.float64)
    low, high = np.minimum(c[..., :2], c[..., 2:]), np.maximum(c[..., :2], c[..., 2:])
    return np.concatenate([low, high - low], axis=-1)


def centre(boxes: ArrayLike) -> Boxes:
    """Centres `(cx, cy)`, shape (..., 2).

    >>> centre([10, 20, 30, 40])
    array([25., 40.])
    """
    b = np.asarray(boxes, np.float64)
    return b[..., :2] + b[..., 2:] / 2


def from_centre(centres: ArrayLike, sizes: ArrayLike) -> Boxes:
    """Boxes from centres (..., 2) and sizes (..., 2).

    >>> from_centre([25, 40], [30, 40])
    array([10., 20., 30., 40.])
    """
    c, s = np.asarray(centres, np.float64), np.asarray(sizes, np.float64)
    low = c - s / 2
    return np.concatenate([low, np.broadcast_to(s, low.shape)], axis=-1)


def area(boxes: ArrayLike) -> Boxes:
    """Areas, shape (...); 0 where a side is not positive."""
    b = np.asarray(boxes, np.float64)
    return np.maximum(b[..., 2], 0) * np.maximum(b[..., 3], 0)


def intersection(a: ArrayLike, b: ArrayLike) -> Boxes:
    """The boxes that `a` and `b` share; sides are 0 where they do not meet."""
    a, b = to_corners(a), to_corners(b)
    low = np.maximum(a[..., :2], b[..., :2])
    return np.concatenate([low, np.maximum(np.minimum(a[..., 2:], b[..., 2:]) - low, 0)], axis=-1)


def union(a: ArrayLike, b: ArrayLike) -> Boxes:
    """The smallest boxes (…, 4) around two.

    >>> union([0, 0, 10, 10], [5, 5, 10, 20])
    array([ 0.,  0., 15., 25.])
    """
    p, q = to_corners(a), to_corners(b)
    low, high = np.minimum(p, q)[..., :2], np.maximum(p, q)[..., 2:]
    return from_corners(np.concatenate([low, high], axis=-1))


def iou(a: ArrayLike, b: ArrayLike) -> Boxes:
    """Intersection over union in [0, 1], shape (...); NaN where a box has NaN, 0 for empty boxes.

    >>> iou([0, 0, 2, 2], [1, 0, 2, 2])
    np.float64(0.333)
    """
    shared = area(intersection(a, b))
    union = area(a) + area(b) - shared
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(union > 0, shared / union, np.where(np.isnan(union), np.nan, 0.0))[()]


def clip(boxes: ArrayLike, width: float, height: float) -> Boxes:
    """The parts of `boxes` inside a picture of `width` × `height`; sides may become 0.

    >>> clip([-5, 5, 10, 10], 100, 12)
    array([0., 5., 5., 7.])
    """
    return intersection(boxes, [0, 0, width, height])


def moved(box: ArrayLike, action: ArrayLike) -> Boxes:
    """d_t = d_{t−1} + a_t (eq. 7): `action` (4,) moves the left, top, right and bottom side.

    It is in units of the box's own width and height.

    >>> moved([100, 100, 40, 80], [0.1, 0.1, 0.1, 0.2])
    array([104., 108.,  40.,  88.])
    """
    b = np.asarray(box, np.float64)
    return from_corners(to_corners(b) + np.asarray(action) * np.tile(b[2:], 2))


def parse(text: str) -> Boxes:
    """Read `"X,Y,W,H"` as a user types it.

    >>> parse("10, 20, 30.5, 40")
    array([10. , 20. , 30.5, 40. ])

    Raises
    ------
    EntrackError
        Unless there are four finite numbers and a positive width and height.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 4:
        raise EntrackError(f"a box is four numbers X,Y,W,H in pixels, found {text!r}")
    return check(numbers)


def check(box: Any) -> Boxes:
    """Return `box` as a float64 array (4,) if it is four finite numbers with a positive size."""
    try:
        b = np.asarray(box, np.float64)
    except (TypeError, ValueError):
        b = np.empty(0)
    if b.shape != (4,):
        raise EntrackError(f"a box is four numbers (x, y, w, h), found {box!r}")
    if not np.isfinite(b).all():
        raise EntrackError(f"a box needs finite numbers, found {tuple(b.tolist())}")
    if b[2] <= 0 or b[3] <= 0:
        raise EntrackError(f"a box needs a positive width and height, found {tuple(b.tolist())}")
    return b


def inside(box: Any, width: float, height: float) -> Boxes:
    """The part of `box` inside a frame, or one sentence that says why there is none.

    >>> inside([-10, 5, 40, 20], 640, 360)
    array([ 0.,  5., 30., 20.])

    Raises
    ------
    EntrackError
        If it is no box, or less than a pixel of it is in the frame.
    """
    given = check(box)
    clipped = clip(given, width, height)
    if clipped[2] < 1 or clipped[3] < 1:
        raise EntrackError(f"box {tuple(given.tolist())} lies outside the {width}×{height} frame")
    return clipped
