"""A tracker with the methods of `cv2.Tracker`, to put in its place."""

from pathlib import Path
from typing import Any, Self

from numpy.typing import ArrayLike

import entrack
from entrack.tracker import Estimate

Rect = tuple[int, int, int, int]


class Tracker:
    """`init`, `update` and `getTrackingScore` as the trackers of OpenCV have them.

    >>> tracker = Tracker.create()                              # doctest: +SKIP
    >>> tracker.init(frame, (310, 120, 48, 90))                 # doctest: +SKIP
    >>> found, (x, y, w, h) = tracker.update(next_frame)        # doctest: +SKIP
    """

    def __init__(self, model: str | Path = "default", *, threads: int | None = None) -> None:
        self._tracker = entrack.load(model, threads=threads)
        self.estimate: Estimate | None = None
        """All that is known of the last frame, with fractions of pixels; None before `update`."""

    @classmethod
    def create(cls, model: str | Path = "default", *, threads: int | None = None) -> Self:
        """Make a tracker, as `cv2.TrackerCSRT.create` does."""
        return cls(model, threads=threads)

    def init(self, image: Any, boundingBox: ArrayLike) -> None:
        """Start on a box `(x, y, w, h)` in the first frame (H, W, 3) uint8 BGR."""
        self._tracker.init(image, boundingBox)
        self.estimate = None

    def update(self, image: Any) -> tuple[bool, Rect]:
        """Find the target: whether it is seen, and its box in whole pixels, as OpenCV has it."""
        self.estimate = self._tracker.update(image)
        x, y, w, h = self.estimate.box.round().astype(int).tolist()
        return not self.estimate.lost, (x, y, w, h)

    def getTrackingScore(self) -> float:
        """Probability that the last box is on the target; 1 before `update`."""
        return 1.0 if self.estimate is None else self.estimate.score
