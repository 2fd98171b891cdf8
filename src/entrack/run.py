"""Track through a source: the loop under `entrack.track` and the command line."""

import time
from collections.abc import Generator, Iterable, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, Protocol, Self

from numpy.typing import ArrayLike

import entrack
from entrack import box as boxes_
from entrack.boxfiles import BoxWriter
from entrack.datasets.frames import Image
from entrack.draw import overlay
from entrack.pipeline import Behind, ahead
from entrack.tracker import Estimate
from entrack.video import Frame, VideoWriter, open_source, written_size


class ManyTracker(Protocol):
    """The two methods that tracking several boxes takes; `entrack.Tracker` has them."""

    def init_many(self, image: Any, boxes: Any) -> None:
        """Start on boxes (N, 4)."""
        ...

    def update_many(self, image: Any) -> list[Estimate]:
        """Find all of them in the next frame."""
        ...


def track(
    source: str | Path | int,
    box: ArrayLike,
    model: str | Path = "default",
    start: int = 0,
    stop: int | None = None,
) -> Generator[tuple[Image, Estimate], None, None]:
    """Yield every frame of a video with what the tracker says of it.

    Parameters
    ----------
    source
        A video file, a folder of pictures, a glob, the number of a camera, an address.
    box
        `(x, y, w, h)` of the target in frame `start`, 0-based pixels.
    model
        A shipped model's name, or a model folder.
    start, stop
        Frames `start` ≤ i < `stop`.

    Yields
    ------
    image
        (H, W, 3) uint8 BGR.
    estimate
        In the first frame the given box, with score 1.

    Raises
    ------
    EntrackError
        If the video, the box or the model cannot be used, or the video breaks off.
    """
    given = boxes_.check(box)
    tracker = entrack.load(model)
    with (
        open_source(source, start, stop) as frames,
        closing(follow(tracker, frames, [given])) as steps,
    ):
        for frame, [estimate] in steps:
            yield frame.image, estimate


def follow(
    tracker: ManyTracker, frames: Iterable[Frame], boxes: Sequence[ArrayLike]
) -> Generator[tuple[Frame, list[Estimate]], None, None]:
    """Yield each frame with the estimates of all boxes; a thread decodes ahead.

    In the first frame the estimates are the boxes themselves, as far as they are in the picture.
    Close the generator before the source of its frames.
    """
    begun = False
    with closing(ahead(frames, weigh=_bytes)) as decoded:
        for frame in decoded:
            yield (
                frame,
                tracker.update_many(frame.image) if begun else begin(tracker, frame, boxes),
            )
            begun = True


def begin(tracker: ManyTracker, frame: Frame, boxes: Sequence[ArrayLike]) -> list[Estimate]:
    """Start on boxes; the estimates are the boxes, as far as they are in the picture."""
    height, width = frame.image.shape[:2]
    given = [boxes_.inside(box, width, height) for box in boxes]
    began = time.perf_counter()
    tracker.init_many(frame.image, given)
    ms = 1e3 * (time.perf_counter() - began)
    return [Estimate(box, 1.0, False, None, None, search=box, ms=ms) for box in given]


def _bytes(frame: Frame) -> int:
    return frame.image.nbytes


class Recorder:
    """Write boxes and an annotated video in a thread behind the tracker.

    Leaving the `with` block, by an error, too, finishes the files. See `BoxWriter` and
    `VideoWriter`.
    """

    def __init__(
        self, boxes: Path | None, video: Path | None, objects: int = 1, fps: float = 25.0
    ) -> None:
        with ExitStack() as stack:
            self._boxes = stack.enter_context(BoxWriter(boxes, objects)) if boxes else None
            self._video = stack.enter_context(VideoWriter(video, fps)) if video else None
            self.write = stack.enter_context(  # last in, so emptied first
                Behind(self._write, weigh=lambda frame, estimates: _bytes(frame))
            )
            """Add a frame and its estimates."""
            self._end = stack.pop_all()
        self._ms: float | None = None

    def _write(self, frame: Frame, estimates: list[Estimate]) -> None:
        if self._boxes:
            self._boxes.write(frame, estimates)
        if self._video:
            ms = estimates[0].ms
            self._ms = ms if self._ms is None else 0.9 * self._ms + 0.1 * ms  # readable digits
            size = written_size(frame.image)  # a copy of 8K in its own size takes 100 MB
            drawn = overlay(frame.image, estimates, frame.index, 1e3 / self._ms, size)
            self._video.write(drawn, frame.time)

    @property
    def paths(self) -> list[Path]:
        """The files that are made."""
        return (self._boxes.paths if self._boxes else []) + (
            [self._video.path] if self._video else []
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end.close()
