"""Frames of a sequence on disk, read when asked for: BGR uint8 (H, W, 3)."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from entrack.errors import EntrackError

Image = NDArray[np.uint8]
PICTURES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff"})


class ImageFiles(Sequence[Image]):
    """Pictures in the order of their paths."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = paths

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: int) -> Image:  # pyright: ignore[reportIncompatibleMethodOverride]
        path = self.paths[index]
        try:
            image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        except cv2.error:  # larger than any picture may be; see `entrack.__init__`
            image = None
        if image is None:
            why = "is not a picture that can be read" if path.exists() else "does not exist"
            raise EntrackError(f"frame {path} {why}")
        return image  # pyright: ignore[reportReturnType]


class NumberedImages(Sequence[Image]):
    """Pictures `first`, `first` + 1, … of a folder, by the number in their name.

    The folder is listed at the first frame asked for, so that a dataset of a million pictures opens
    at once. A number without a picture is an error that names it.
    """

    def __init__(self, folder: Path, length: int, first: int | None = None) -> None:
        self.folder, self.length, self.first = folder, length, first

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: int) -> Image:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self.files[index]

    @cached_property
    def files(self) -> ImageFiles:
        """The pictures' paths in order."""
        found = numbered_pictures(self.folder)
        first = self.first if self.first is not None else min(found, default=1)
        # A missing picture gets the name it would have: the error then says what to look for.
        example = next(iter(found.values()), self.folder / "00000001.jpg")
        width = len(example.stem)
        wanted = range(first, first + self.length)
        return ImageFiles([found.get(n, example.with_stem(f"{n:0{width}}")) for n in wanted])


def numbered_pictures(folder: Path) -> dict[int, Path]:
    """Pictures of a folder by the number in their name; empty where there is no such folder.

    >>> numbered_pictures(Path("no such folder"))
    {}
    """
    if not folder.is_dir():
        return {}
    files = (p for p in folder.iterdir() if p.suffix.lower() in PICTURES)
    return {int(p.stem): p for p in sorted(files) if p.stem.isdecimal()}


class VideoFrames(Sequence[Image]):
    """Frames of a video file.

    Made for reading in order: a step forwards decodes what lies between, a step backwards starts
    again from the beginning.
    """

    def __init__(self, path: Path, length: int) -> None:
        self.path, self.length = path, length
        self._position, self._image = -1, np.empty((0, 0, 3), np.uint8)
        self._frames: Iterator[Callable[[], Image]] = iter(())

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: int) -> Image:  # pyright: ignore[reportIncompatibleMethodOverride]
        if not -self.length <= index < self.length:
            raise IndexError(f"frame {index} of {self.length}")
        index %= self.length
        if index < self._position or self._position < 0:
            self._frames, self._position = self._decode(), -1
        while self._position < index:
            convert = next(self._frames, None)
            if convert is None:
                found = self._position + 1
                self._position = -1
                raise EntrackError(f"{self.path} has {found} frames, expected {self.length}")
            self._position += 1
            if self._position == index:
                self._image = convert()
        return self._image

    def found(self, *, decode: bool) -> int:
        """Count the frames that can be decoded, or those that the file claims to have."""
        if decode:
            return sum(1 for _ in self._decode())
        with _opened(self.path) as video:
            return sum(1 for packet in video.demux(video=0) if packet.size)

    def _decode(self) -> Iterator[Callable[[], Image]]:
        """Yield a function a frame that converts it, as frames in between need no conversion."""
        with _opened(self.path) as video:
            for frame in video.decode(video=0):
                yield lambda frame=frame: frame.to_ndarray(format="bgr24")


def any_alphabet() -> dict[str, Any]:
    """Have PyAV bear tags that are not UTF-8: before version 19 it has to be asked to."""
    import av

    asked = int(av.__version__.split(".")[0]) < 19
    return {"metadata_errors": "replace"} if asked else {}


@contextmanager
def _opened(path: Path) -> Generator[Any]:
    import av  # here, as it takes a tenth of a second to import
    from av.error import FFmpegError

    try:
        with cast(Any, av.open)(str(path), **any_alphabet()) as video:
            yield video
    except (FFmpegError, OSError, IndexError) as error:
        raise EntrackError(f"cannot read the video {path}: {error}") from error
