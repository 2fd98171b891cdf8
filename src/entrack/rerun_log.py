"""A run as a Rerun recording: frames, boxes, σ, score, response map and features over time.

Extra `rerun`. Scrub through it in the viewer: `rerun FILE.rrd`.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np

from entrack import box as boxes_
from entrack.draw import PALETTE
from entrack.errors import require
from entrack.files import unfinished, writing
from entrack.looks import coloured, heat, principal
from entrack.tracker import Estimate, Look
from entrack.video import Frame

_SIDE = 144  # pixels of the response map's picture


class RerunLog:
    """Log each frame; use it in a `with` block or close it.

    Parameters
    ----------
    target
        A file `.rrd`, which gets its name when it is whole; or "spawn" for the viewer.

    Raises
    ------
    EntrackError
        If Rerun is not installed, or the file cannot be written.
    """

    def __init__(self, target: str) -> None:
        self._rr: Any = require("rerun", "rerun")
        self._stream = self._rr.RecordingStream("entrack")
        self.path = None if target == "spawn" else Path(target)
        """The file that is made."""
        if self.path is None:
            self._stream.spawn()
            return
        with writing(self.path):
            unfinished(self.path).touch()  # a folder that is not there is said now
        self._stream.save(str(unfinished(self.path)))

    def write(
        self, frame: Frame, estimates: Sequence[Estimate], looks: Sequence[Look | None]
    ) -> None:
        """Add one frame: what is said, and what was seen, of all objects."""
        rr = self._rr
        self._stream.set_time("frame", sequence=frame.index)
        self._stream.set_time("time", duration=frame.time)
        self._log("frame", rr.Image(frame.image, color_model="BGR").compress(85))
        for number, estimate in enumerate(estimates):
            self._one(number, estimate)
        for number, look in enumerate(looks):
            if look is not None:
                self._seen(f"object {number + 1}", look)

    def _one(self, number: int, estimate: Estimate) -> None:
        rr, name = self._rr, f"object {number + 1}"
        colour = PALETTE[number % len(PALETTE)][::-1]
        words = f"{number + 1} lost" if estimate.lost else f"{number + 1}: {estimate.score:.2f}"
        self._log(f"frame/{name}/box", self._boxes([estimate.box], colour, [words]))
        self._log(f"frame/{name}/search", self._boxes([estimate.search], colour))
        self._log(f"score/{name}", rr.Scalars(estimate.score))
        self._log(f"lost/{name}", rr.Scalars(float(estimate.lost)))
        if estimate.sigma is not None:
            out = np.asarray(estimate.sigma) * [-1, -1, 1, 1]
            corners = boxes_.to_corners(estimate.box)
            band = [boxes_.from_corners(corners + sign * out) for sign in (-1, 1)]
            self._log(f"frame/{name}/sigma", self._boxes(band, colour))
            self._log(f"sigma/{name}", rr.Scalars(np.asarray(estimate.sigma)))

    def _seen(self, name: str, look: Look) -> None:
        rr = self._rr
        response = coloured(heat(look.response), _SIDE)
        self._log(f"seen/{name}/search window", rr.Image(look.patch, color_model="BGR").compress())
        self._log(f"seen/{name}/response", rr.Image(response, color_model="BGR"))
        self._log(f"seen/{name}/features", rr.Image(principal(look.features)))

    def _boxes(self, boxes: Any, colour: Any, labels: Any = None) -> Any:
        b = np.asarray(boxes, np.float64)
        return self._rr.Boxes2D(
            array=b, array_format=self._rr.Box2DFormat.XYWH, colors=[colour], labels=labels
        )

    def _log(self, name: str, what: Any) -> None:
        self._stream.log(name, what)

    def close(self) -> None:
        """Finish the recording and give it its name."""
        self._stream.flush()
        self._stream.disconnect()
        if self.path:
            with writing(self.path):
                unfinished(self.path).replace(self.path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
