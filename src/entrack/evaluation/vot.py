"""Supervised evaluation of VOT: accuracy, failures and expected average overlap. Pure functions.

A tracker that loses its target is started again five frames later, so that a result is a trajectory
of regions and codes. Two sets of rules are in use: pysot's (VOT2016, VOT2018 and VOT2019 as papers
print them) and vot-toolkit's.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack.errors import EntrackError
from entrack.evaluation.region import Regions, overlaps

Floats = NDArray[np.float64]

REGION, UNKNOWN, START, FAILURE = -1, 0, 1, 2
"""Codes of a frame: a region, nothing, the start on the ground truth, the loss of the target."""
SKIP = 5
"""Frames from a failure to the next start."""
BURN_IN = 10
"""Frames from a start on that do not count in accuracy."""


@dataclass(frozen=True)
class Trajectory:
    """One supervised run over a video: a code (T,) and, where that is `REGION`, a region."""

    codes: NDArray[np.int64]
    regions: Regions

    def __len__(self) -> int:
        return len(self.codes)

    @property
    def failures(self) -> NDArray[np.intp]:
        """Frames at which the target was lost."""
        return np.flatnonzero(self.codes == FAILURE)

    @property
    def starts(self) -> NDArray[np.intp]:
        """Frames at which the tracker was given the ground truth."""
        return np.flatnonzero(self.codes == START)

    def counted(self) -> NDArray[np.bool_]:
        """Frames (T,) that count in accuracy."""
        counted = self.codes == REGION
        for start in self.starts:
            counted[start : start + BURN_IN] = False
        return counted


def supervised_overlaps(
    run: Trajectory, truth: Regions, size: tuple[int, int] | None, *, toolkit: bool = False
) -> Floats:
    """Overlap (T,) with the ground truth; NaN where the frame holds a code."""
    if len(run) != len(truth):
        raise EntrackError(f"{len(run)} frames of results for {len(truth)} of ground truth")
    return overlaps(run.regions, truth, size, toolkit=toolkit)


def fragments(run: Trajectory, iou: ArrayLike) -> list[tuple[Floats, bool, float]]:
    """Cut a run at its failures, as pysot: overlaps, whether zeros follow, and the weight.

    A fragment reaches to the frame of the next start; the last one is as long as it is.
    """
    values = np.nan_to_num(np.asarray(iou, np.float64))
    length = len(values)
    points = [0, *(int(f) + SKIP for f in run.failures if f + SKIP <= length)]
    cut = list[tuple[Floats, bool, float]]()
    for begin, end in pairwise(points):
        part = values[begin : end + 1]
        cut.append((part, True, len(part) / (end - begin + 1)))
    if points[-1] < length:
        cut.append((values[points[-1] :], False, 1.0))
    return cut


def toolkit_fragments(run: Trajectory, iou: ArrayLike) -> list[tuple[Floats, bool, float]]:
    """Cut a run at its failures, as vot-toolkit: a fragment ends at the failure, weights are 1."""
    values = np.nan_to_num(np.asarray(iou, np.float64))
    ends = [*run.failures, *([len(values)] if len(run.starts) > len(run.failures) else [])]
    return [
        (values[start:end], end in run.failures, 1.0)
        for start, end in zip(run.starts, ends, strict=False)
    ]


def expected_overlap_terms(
    cut: list[tuple[Floats, bool, float]], length: int
) -> tuple[Floats, Floats]:
    """What one video adds to the expected overlap: numerator and denominator (length,).

    Element N of their quotient over all videos is the mean overlap of frames 1 … N of a run of
    N + 1 frames, start included; element 0 is not defined by it.

    >>> expected_overlap_terms([(np.array([0, 0.5, 0.7]), False, 1.0)], 4)
    (array([0. , 0.5, 0.6, 0. ]), array([1., 1., 1., 0.]))
    """
    numerator, denominator = np.zeros((2, length))
    for values, padded, weight in cut:
        part = np.zeros(length)
        part[: len(values)] = values[:length]
        known = length if padded else min(len(values), length)
        part[0] = 0
        means = np.cumsum(part) / np.maximum(np.arange(length), 1)
        numerator[:known] += weight * means[:known]
        denominator[:known] += weight
    return numerator, denominator
