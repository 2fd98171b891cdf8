"""Does a tracker know what it does not know? Pure functions over frames.

`iou` (T,) are overlaps with the ground truth, `present` (T,) says where there is a target to be
seen, `scores` (T,) how sure the tracker was; the greater, the surer.

Tracking precision, recall and F are those of A. Lukežič, L. Čehovin Zajc, T. Vojíř, J. Matas and
M. Kristan, "Now you see me: evaluating performance in long-term visual tracking" (2018), which are
also those of VOT-LT. The calibration error is that of C. Guo, G. Pleiss, Y. Sun and K. Weinberger,
"On calibration of modern neural networks" (2017).
"""

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack import box

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

BINS = 15
"""Bins of the calibration error."""
WITHIN = 30
"""Frames after its return within which a target should be found again."""
_LEAST = 10
"""Frames that a target has to be gone for: a shorter absence is no test."""
_GLIMPSE = 5
"""Frames below which a sight between two absences does not count as a return."""


def thresholds(scores: ArrayLike, most: int = 1000) -> Floats:
    """Every score that was given, descending; where there are more than `most`, evenly by rank.

    >>> thresholds([0.5, 0.9, 0.5])
    array([0.9, 0.5])
    """
    distinct = np.unique(np.asarray(scores, np.float64))[::-1]
    if len(distinct) <= most:
        return distinct
    return distinct[np.linspace(0, len(distinct) - 1, most).round().astype(int)]


def precision_recall(
    iou: ArrayLike, present: ArrayLike, scores: ArrayLike, at: ArrayLike
) -> tuple[Floats, Floats]:
    """Tracking precision and recall at each threshold (K,) of one sequence.

    At a threshold the tracker's answers are those with a score of at least that. Precision is the
    mean overlap over its answers, 1 where it gives none; recall is the sum of their overlaps over
    the frames in which the target is present. Where it is absent, every overlap is 0.

    >>> precision_recall([0.8, 0.6, 0.9], [True, True, False], [0.9, 0.4, 0.7], [0.9, 0.5, 0])
    (array([0.8 , 0.4 , 0.467]), array([0.4, 0.4, 0.7]))
    """
    seen, s = np.asarray(present, bool), np.asarray(scores, np.float64)
    overlap = np.where(seen, np.maximum(np.asarray(iou, np.float64), 0), 0)
    order = np.argsort(-s, kind="stable")
    answers = np.searchsorted(-s[order], -np.asarray(at, np.float64), side="right")
    gained = np.concatenate([[0], np.cumsum(overlap[order])])[answers]
    precision = np.where(answers > 0, gained / np.maximum(answers, 1), 1.0)
    return precision, gained / max(int(seen.sum()), 1)


def f_score(precision: ArrayLike, recall: ArrayLike) -> Floats:
    """2 · Pr · Re / (Pr + Re); 0 where both are.

    >>> f_score([1, 0.5, 0], [0, 0.5, 0])
    array([0. , 0.5, 0. ])
    """
    p, r = np.asarray(precision, np.float64), np.asarray(recall, np.float64)
    return 2 * p * r / np.maximum(p + r, 1e-12)


def roc(
    scores: ArrayLike, positive: ArrayLike, weights: ArrayLike | None = None
) -> tuple[Floats, Floats]:
    """False and true positive rate, from (0, 0) to (1, 1): a point for each score that was given.

    `weights` (T,) says how often each frame counts. NaN where one of the two kinds is missing.
    """
    s, yes = np.asarray(scores, np.float64), np.asarray(positive, bool)
    w = np.ones(len(s)) if weights is None else np.asarray(weights, np.float64)
    order = np.argsort(-s, kind="stable")
    last = np.diff(s[order], append=-np.inf) != 0  # equal scores pass together
    rates = [
        np.concatenate([[0], np.cumsum((w * of_kind)[order])[last]]) for of_kind in (~yes, yes)
    ]
    false, true = (
        rate / rate[-1] if rate[-1] > 0 else np.full(len(rate), np.nan) for rate in rates
    )
    return false, true


def area(false: ArrayLike, true: ArrayLike) -> float:
    """Area under a ROC curve: the chance that a positive frame scores higher than a negative one.

    >>> area(*roc([0.9, 0.8, 0.3], [True, False, True]))
    0.5
    """
    x, y = np.asarray(false, np.float64), np.asarray(true, np.float64)
    return float(np.sum(np.diff(x) * (y[1:] + y[:-1]) / 2))


def calibration(scores: ArrayLike, events: ArrayLike, bins: int = BINS) -> Floats:
    """Frames, sum of scores, and events in each of equally wide bins of [0, 1]: (3, bins).

    >>> calibration([0.1, 0.9, 1.0], [False, True, True], bins=2)
    array([[1. , 2. ],
           [0.1, 1.9],
           [0. , 2. ]])
    """
    s, e = np.asarray(scores, np.float64), np.asarray(events, np.float64)
    place = np.clip((s * bins).astype(int), 0, bins - 1)
    counted = [np.bincount(place, of, bins) for of in (np.ones(len(s)), s, e)]
    return np.array(counted, np.float64)


def calibration_error(counted: ArrayLike) -> float:
    """Expected calibration error of what `calibration` counted.

    Mean over frames of the gap between a bin's mean score and its share of events; NaN without
    frames.

    >>> calibration_error(calibration([0.8, 0.8, 0.8, 0.8], [True, True, True, False]))
    0.05
    """
    frames, scores, events = np.asarray(counted, np.float64)
    total = frames.sum()
    return float(np.abs(scores - events).sum() / total) if total else float("nan")


def covered(truth: ArrayLike, boxes: ArrayLike, sigma: ArrayLike) -> Flags:
    """Whether each true side (T, 4) is no further from the answer's than its σ.

    >>> covered([[0, 0, 10, 10]], [[1, 0, 9, 13]], [[1, 1, 1, 2]])
    array([[ True,  True,  True, False]])
    """
    away = np.abs(box.to_corners(truth) - box.to_corners(boxes))
    return np.asarray(away <= np.asarray(sigma, np.float64))


def returns(present: ArrayLike) -> list[int]:
    """Frames in which a target is back after an absence that puts a tracker to the test.

    That is one of ten frames or more which the target, seen before, is not seen in, glimpses of
    fewer than five frames aside, and after which it is seen for 30 frames.

    >>> returns([True] * 5 + [False] * 12 + [True] * 40)
    [17]
    """
    seen = np.asarray(present, bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~seen, [False]]).astype(int)))
    gaps = [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
    joined: list[tuple[int, int]] = []
    for start, stop in gaps:
        if joined and start - joined[-1][1] < _GLIMPSE:
            start = joined.pop()[0]
        joined.append((start, stop))
    return [
        stop
        for (start, stop), (until, _) in pairwise([*joined, (len(seen), 0)])
        if start > 0 and stop - start >= _LEAST and until - stop >= WITHIN
    ]


def found_again(iou: ArrayLike, present: ArrayLike) -> Floats:
    """How many returns are found within 1, 2, … 30 frames: (30,).

    Found is an overlap of more than ½; within one frame means in the first in which it is back.
    """
    good = np.asarray(iou, np.float64) > 0.5
    found = np.zeros(WITHIN)
    for back in returns(present):
        found += np.maximum.accumulate(good[back : back + WITHIN])
    return found
