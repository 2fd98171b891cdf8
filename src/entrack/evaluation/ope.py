"""One-pass evaluation: boxes → overlaps and errors → curves → numbers. Pure functions.

Boxes are (T, 4) `(x, y, w, h)`. Where the ground truth of a frame is invalid (NaN, or a side that
is not positive) its overlap is −1, a failure; whether that is a failure in precision too is the
protocol's choice.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack import box

Floats = NDArray[np.float64]

SUCCESS = np.arange(0, 1.05, 0.05)
"""21 overlap thresholds 0, .05, … 1, with the toolkits' own rounding."""
SUCCESS_101 = np.linspace(0, 1, 101)
"""101 overlap thresholds of the GOT-10k toolkit."""
PRECISION = np.arange(51.0)
"""51 distances 0 … 50 pixels; the score is read at 20."""
NORM_PRECISION = np.arange(51) / 100
"""51 normalised distances 0 … .5; the score is read at .2."""


def valid(truth: ArrayLike) -> NDArray[np.bool_]:
    """Frames (T,) whose ground truth is a box with a positive width and height."""
    t = np.asarray(truth, np.float64)
    return np.asarray(np.isfinite(t).all(axis=-1) & (t[..., 2:] > 0).all(axis=-1))


def overlaps(truth: ArrayLike, boxes: ArrayLike) -> Floats:
    """IoU (T,) in [0, 1]; −1 where the ground truth is invalid, 0 where the prediction is.

    >>> overlaps([[0, 0, 2, 2], [0, 0, 0, 2]], [[1, 0, 2, 2], [0, 0, 2, 2]])
    array([ 0.333, -1. ])
    """
    # Rounding may take an IoU above 1, and then even the last threshold would be passed.
    iou = np.minimum(np.nan_to_num(box.iou(truth, boxes)), 1)
    return np.where(valid(truth), iou, -1.0)


def clipped_overlaps(
    truth: ArrayLike, boxes: ArrayLike, size: tuple[int, int] | None = None
) -> Floats:
    """IoU (T,) of the GOT-10k toolkit, both boxes clipped to a picture of width × height.

    The toolkit clips the corner and then the size, so that a box that sticks out on the left keeps
    its full width. It repairs nothing: a box with a NaN overlaps with nothing.

    >>> clipped_overlaps([[0, 0, 10, 10]], [[-5, 0, 10, 10]], (100, 100))
    array([1.])
    """
    t, b = (np.array(x, np.float64) for x in (truth, boxes))
    if size is not None:
        for x in (t, b):
            x[..., :2] = np.clip(x[..., :2], 0, size)
            x[..., 2:] = np.clip(x[..., 2:], 0, size - x[..., :2])
    return np.minimum(np.nan_to_num(box.iou(t, b)), 1)


def centre_errors(truth: ArrayLike, boxes: ArrayLike, invalid: float = np.inf) -> Floats:
    """Distances (T,) between the centres in pixels, centre = x + (w − 1)/2.

    `invalid` is the error where the ground truth is invalid: ∞ is a failure, −1 a success.

    >>> centre_errors([[0, 0, 3, 3]], [[3, 4, 3, 3]])
    array([5.])
    """
    return _distances(truth, boxes, np.ones(2), invalid)


def norm_errors(truth: ArrayLike, boxes: ArrayLike, invalid: float = np.inf) -> Floats:
    """Distances (T,) between the centres, divided by the ground truth's width and height.

    >>> norm_errors([[0, 0, 10, 20]], [[1, 0, 10, 20]])
    array([0.1])
    """
    sizes = np.asarray(truth, np.float64)[..., 2:]
    return _distances(truth, boxes, np.where(sizes > 0, sizes, 1), invalid)


def _distances(truth: ArrayLike, boxes: ArrayLike, unit: Floats, invalid: float) -> Floats:
    t, b = np.asarray(truth, np.float64), np.asarray(boxes, np.float64)
    offset = (b[..., :2] + (b[..., 2:] - 1) / 2) - (t[..., :2] + (t[..., 2:] - 1) / 2)
    distance = np.sqrt(((offset / unit) ** 2).sum(axis=-1))
    return np.where(valid(t), np.nan_to_num(distance, nan=np.inf, posinf=np.inf), invalid)


def repair(truth: ArrayLike, boxes: ArrayLike) -> Floats:
    """Predictions as the toolkits score them: an invalid row repeats the row before.

    An invalid first row becomes the ground truth, on which every tracker starts.

    >>> truth = [[1, 1, 2, 2], [1, 1, 2, 2], [1, 1, 2, 2]]
    >>> repair(truth, [[0, 0, 0, 0], [3, 3, 0, 2], [5, 5, 5, 5]])
    array([[1., 1., 2., 2.], [1., 1., 2., 2.], [5., 5., 5., 5.]])
    """
    repaired = np.array(boxes, np.float64)
    good = valid(repaired)
    if not good[0]:
        repaired[0], good[0] = np.asarray(truth, np.float64)[0], True
    return repaired[np.maximum.accumulate(np.where(good, np.arange(len(good)), 0))]


def success_curve(
    iou: ArrayLike, thresholds: ArrayLike = SUCCESS, frames: int | None = None
) -> Floats:
    """Share of frames with `iou > threshold` for each threshold.

    `frames` is the denominator where that is not the number of overlaps.

    >>> success_curve([0.0, 0.5, 1.0], [0.0, 0.5, 1.0])
    array([0.667, 0.333, 0. ])
    """
    i, t = np.asarray(iou, np.float64), np.asarray(thresholds, np.float64)
    passed = len(i) - np.searchsorted(np.sort(i), t, side="right")
    return passed / max(len(i) if frames is None else frames, 1)


def precision_curve(
    errors: ArrayLike, thresholds: ArrayLike = PRECISION, frames: int | None = None
) -> Floats:
    """Share of frames with `error ≤ threshold` for each threshold.

    >>> precision_curve([0.0, 20.0, 21.0], [0, 20])
    array([0.333, 0.667])
    """
    e, t = np.asarray(errors, np.float64), np.asarray(thresholds, np.float64)
    passed = np.searchsorted(np.sort(e), t, side="right")
    return passed / max(len(e) if frames is None else frames, 1)


def norm_precision_curve(
    errors: ArrayLike, thresholds: ArrayLike = NORM_PRECISION, frames: int | None = None
) -> Floats:
    """`precision_curve` over normalised errors."""
    return precision_curve(errors, thresholds, frames)


def auc(curve: ArrayLike) -> float:
    """Area under a success curve: the mean of its values. A perfect tracker scores 20/21.

    >>> auc(success_curve([1.0]))
    0.952
    """
    return float(np.mean(np.asarray(curve, np.float64)))
