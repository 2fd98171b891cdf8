"""The camera of the browser: its frames, kept as they arrive, so that one can go back in them."""

import time
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from entrack.datasets.frames import Image
from entrack.errors import EntrackError
from entrack.video import Frame

SCRIPT = (Path(__file__).parent / "camera.js").read_text("utf-8")
"""Called with the address that frames are posted to; throws where there is no camera."""


class Recording:
    """Frames of a camera as JPEG files, each as the camera sent it; see `Footage`.

    Parameters
    ----------
    folder
        For the frames.
    first
        A JPEG.
    largest
        Bytes of all frames; then it is full.

    Raises
    ------
    EntrackError
        If `first` is no picture.
    """

    def __init__(self, folder: Path, first: bytes, largest: float) -> None:
        self.name, self.fps = "camera", 25.0
        self._folder, self._largest = folder, largest
        self._times: list[float] = []
        self.restart(first)
        image = self[0].image
        self.size = (image.shape[1], image.shape[0])

    @property
    def full(self) -> bool:
        """Whether there is no room for more."""
        return self._bytes >= self._largest

    def add(self, jpeg: bytes) -> None:
        """Append a frame."""
        self._path(len(self._times)).write_bytes(jpeg)
        self._times.append(time.perf_counter() - self._began)
        self._bytes += len(jpeg)
        if len(self._times) > 1:
            self.fps = (len(self._times) - 1) / self._times[-1]

    def restart(self, jpeg: bytes) -> None:
        """Forget all frames but this one."""
        self._times, self._bytes, self._began = [], 0, time.perf_counter()
        self.add(jpeg)

    def __len__(self) -> int:
        return len(self._times)

    def __getitem__(self, index: int) -> Frame:
        moment = self._times[index]
        data = np.frombuffer(self._path(index).read_bytes(), np.uint8)
        try:
            image = cast(Image | None, cv2.imdecode(data, cv2.IMREAD_COLOR))
        except cv2.error:  # nothing at all, or more pixels than a picture may have
            image = None
        if image is None:
            raise EntrackError("the camera sent something that is no picture")
        return Frame(index, moment, image)

    def close(self) -> None:
        """Nothing is held open."""

    def _path(self, index: int) -> Path:
        return self._folder / f"camera-{index}.jpg"
