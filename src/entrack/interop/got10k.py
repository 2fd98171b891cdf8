"""A `Tracker` for the experiments of the got10k toolkit.

>>> from got10k.experiments import ExperimentGOT10k             # doctest: +SKIP
>>> ExperimentGOT10k(root, subset="val").run(Tracker())         # doctest: +SKIP
"""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import entrack
from entrack.box import Boxes
from entrack.datasets.frames import ImageFiles
from entrack.errors import EntrackError

_ORIGIN = np.array([1, 1, 0, 0])
"""The toolkit's boxes count from 1."""


class Tracker:
    """What `got10k.trackers.Tracker` is, without its base class, so that it imports without it."""

    def __init__(
        self, model: str | Path = "default", name: str | None = None, threads: int | None = 1
    ) -> None:
        self._tracker = entrack.load(model, threads=threads)
        self.name = name or f"entrack-{Path(model).name}"
        self.is_deterministic = True

    def init(self, image: Any, box: ArrayLike) -> None:
        """Start on a box `(x, y, w, h)`, 1-based, in an RGB picture of PIL."""
        self._tracker.init(_bgr(image), np.asarray(box, np.float64) - _ORIGIN)

    def update(self, image: Any) -> Boxes:
        """Find the target in the next picture: `(x, y, w, h)`, 1-based."""
        return self._tracker.update(_bgr(image)).box + _ORIGIN

    def track(
        self, img_files: Sequence[str | Path], box: ArrayLike, visualize: bool = False
    ) -> tuple[Boxes, NDArray[np.float64]]:
        """Track through pictures on disk; return boxes (T, 4) and the seconds of each (T,)."""
        if visualize:
            raise EntrackError("this tracker shows nothing: use visualize=False, and `show` after")
        frames = ImageFiles([Path(file) for file in img_files])
        boxes, seconds = np.empty((len(frames), 4)), np.empty(len(frames))
        boxes[0] = np.asarray(box, np.float64)
        for index, image in enumerate(frames):
            began = time.perf_counter()
            if index:
                boxes[index] = self._tracker.update(image).box + _ORIGIN
            else:
                self._tracker.init(image, boxes[0] - _ORIGIN)
            seconds[index] = time.perf_counter() - began
        return boxes, seconds


def _bgr(image: Any) -> NDArray[np.uint8]:
    return np.ascontiguousarray(np.asarray(image.convert("RGB"))[:, :, ::-1])
