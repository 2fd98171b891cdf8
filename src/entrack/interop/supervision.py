"""Estimates as `supervision.Detections`, for its annotators, zones and sinks."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from entrack import box as boxes
from entrack.errors import require
from entrack.tracker import Estimate


def detections(
    estimates: Estimate | Sequence[Estimate],
    ids: Sequence[int] | None = None,
    *,
    with_lost: bool = False,
) -> Any:
    """Make `supervision.Detections` of the estimates of one frame.

    Parameters
    ----------
    estimates
        What `Tracker.update` or `update_many` returned.
    ids
        Their `tracker_id`: `Tracker.ids`; by default 0, 1, …
    with_lost
        Keep targets that are lost; `data["lost"]` tells them apart.

    Returns
    -------
    supervision.Detections
        `xyxy` (N, 4) float32, `confidence` (N,) float32, `tracker_id` and `class_id` (N,) int.

    Raises
    ------
    EntrackError
        If supervision is not installed.
    """
    found = [estimates] if isinstance(estimates, Estimate) else list(estimates)
    numbers = range(len(found)) if ids is None else ids
    kept = [(n, e) for n, e in zip(numbers, found, strict=True) if with_lost or not e.lost]
    box = np.array([e.box for _, e in kept]).reshape(-1, 4)
    return require("supervision", "interop").Detections(
        xyxy=boxes.to_corners(box).astype(np.float32),
        confidence=np.array([e.score for _, e in kept], np.float32),
        class_id=np.zeros(len(kept), int),
        tracker_id=np.array([n for n, _ in kept], int),
        data={"lost": np.array([e.lost for _, e in kept], bool)},
    )
