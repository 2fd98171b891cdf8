"""vot-toolkit: a tracker of its protocol "python", and a TraX server for its other releases.

    command = entrack.interop.vot:create_tracker        protocol = python
    command = python -m entrack.interop.vot default     protocol = trax

Nothing here prints: standard output belongs to the protocol.
"""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np

import entrack
from entrack.box import Boxes
from entrack.datasets.boxes import upright_boxes
from entrack.datasets.frames import Image
from entrack.errors import EntrackError, require

Rectangle = tuple[float, float, float, float]
Properties = dict[str, Any]
New = tuple[Any, Properties] | Sequence[tuple[Any, Properties]] | None
"""Regions to start on with their properties: one, as supervised experiments give it, or a list."""


class VotTracker:
    """Tracks all objects of a sequence, those that appear later too."""

    multiobject = True
    """Read by the toolkit: `init` and `update` return a list."""

    def __init__(self, model: str = "default", threads: int | None = 1) -> None:
        self._tracker = entrack.load(model, threads=threads)

    def init(
        self, frame: Any, new: New, properties: Properties | None = None
    ) -> list[tuple[Rectangle, Properties]]:
        """Start on the regions of `new`; whatever was tracked is forgotten.

        Parameters
        ----------
        frame
            Path of a picture, or paths by channel, of which "color" or "visible" is looked at.
        new
            Rectangles (x, y, w, h), polygons [(x, y), …] or masks, each with properties.
        """
        boxes = [as_box(region) for region, _ in _listed(new)]
        self._tracker.init_many(read(frame), boxes)
        return [(_rectangle(box), {}) for box in boxes]

    def update(
        self, frame: Any, new: New = None, properties: Properties | None = None
    ) -> list[tuple[Rectangle, Properties]]:
        """Find every object in the next frame, then start on those of `new`."""
        estimates = self._tracker.update_many(read(frame))
        found = [(_rectangle(e.box), {"confidence": float(e.score)}) for e in estimates]
        for region, _ in _listed(new):
            box = as_box(region)
            self._tracker.add(box)
            found.append((_rectangle(box), {}))
        return found


def create_tracker(model: str = "default", threads: str = "1") -> VotTracker:
    """Make a tracker with the arguments of `trackers.ini` (`arg_model`, `arg_threads`)."""
    return VotTracker(model, int(threads))


def as_box(region: Any) -> Boxes:
    """Box of a rectangle, a polygon or a mask as the toolkit hands them over.

    A quadrilateral becomes the upright box of its area, as in `entrack evaluate`.

    >>> as_box((10, 20, 30, 40))
    array([10., 20., 30., 40.])
    >>> as_box([(0, 0), (4, 0), (4, 2), (0, 2)])
    array([0., 0., 4., 2.])
    """
    values = np.asarray(region, np.float64)
    if values.shape == (4,):
        return _as_written(values)
    if values.shape == (4, 2):
        return upright_boxes(_as_written(values).ravel())
    if values.ndim == 2 and values.shape[1] == 2:
        low, high = values.min(axis=0), values.max(axis=0)
        return np.concatenate([low, high - low])
    if values.ndim != 2 or not values.any():
        raise EntrackError(f"expected a rectangle, polygon or mask, found shape {values.shape}")
    inside = np.argwhere(values)[:, ::-1].astype(np.float64)  # x, y
    low = inside.min(axis=0)
    return np.concatenate([low, inside.max(axis=0) + 1 - low])


def _as_written(values: Boxes) -> Boxes:
    """Undo that the toolkit keeps the decimals of its files in single precision.

    3e-6 pixels at the start are a twentieth of a pixel one frame later, and another run at the end.
    """
    single = values.astype(np.float32)
    if (single != values).any():
        return values
    return np.array([float(str(v)) for v in single.ravel()]).reshape(values.shape)


def read(frame: str | Mapping[str, str]) -> Image:
    """Read the picture of a frame, BGR uint8 (H, W, 3)."""
    if not isinstance(frame, str):
        name = next((n for n in ("color", "visible") if n in frame), next(iter(frame)))
        frame = frame[name]
    image = cv2.imread(frame, cv2.IMREAD_COLOR)
    if image is None:
        raise EntrackError(f"frame {frame} cannot be read")
    return image  # pyright: ignore[reportReturnType]


def serve(model: str = "default") -> None:
    """Answer a TraX client until it ends; needs the package vot-trax."""
    trax = require("trax", "vot")
    tracker = VotTracker(model)
    formats = [["rectangle", "polygon"], ["path"], ["color"]]
    with trax.Server(*formats, tracker_name="entrack", multiobject=True) as server:
        while True:
            request = server.wait()
            if request.type not in ("initialize", "frame"):
                return
            frame = request.image["color"].path()
            objects: list[tuple[Any, Properties]] = request.objects or []
            new: New = [(_from_trax(region), {}) for region, _ in objects]
            call = tracker.init if request.type == "initialize" else tracker.update
            found = call(frame, new)
            server.status([(trax.Rectangle.create(*box), told) for box, told in found])


def _from_trax(region: Any) -> Any:
    return list(region) if region.type == "polygon" else region.bounds()


def _listed(new: New) -> Sequence[tuple[Any, Properties]]:
    """Regions as a list; one alone is a tuple of region and properties."""
    if new is None:
        return []
    return [new] if isinstance(new, tuple) else new  # pyright: ignore[reportReturnType]


def _rectangle(box: Boxes) -> Rectangle:
    x, y, w, h = box.tolist()
    return x, y, w, h


if __name__ == "__main__":
    serve(*sys.argv[1:])
