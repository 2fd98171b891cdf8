"""A source of frames: what every kind of video looks like to the rest of the program."""

import itertools
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import Self

from entrack.datasets.frames import Image
from entrack.errors import EntrackError


@dataclass(frozen=True)
class Frame:
    """One picture of a source."""

    index: int
    """0-based, counted from the beginning of the source, whatever `start` was."""
    time: float
    """Seconds since the source's first frame, from its timestamps."""
    image: Image
    """(H, W, 3) uint8 BGR, upright."""


class Source:
    """Frames of a video, one after the other, once; use it in a `with` block or close it.

    Attributes
    ----------
    name
        As a person would call it: a file's name, `camera 0`, an address.
    first
        The first frame, until iteration begins, which yields it, too.
    size
        (width, height) of the first frame. A later frame may have another size.
    fps
        Frames a second, on average where the rate varies.
    length
        Number of frames that the source promises, between start and stop; None if it cannot know.

    Parameters
    ----------
    frames
        Yields from frame `start` on; closing it lets go of the source.
    length
        Of the whole source.
    """

    def __init__(
        self,
        name: str,
        frames: Generator[Frame, None, None],
        fps: float,
        length: int | None,
        start: int = 0,
        stop: int | None = None,
    ) -> None:
        self.name, self.fps = name, fps
        self.length = None if length is None else min(length, stop or length) - start
        self._opened = frames
        part = itertools.islice(frames, None if stop is None else stop - start)
        first = next(part, None)
        if first is None:
            found = f"ends before frame {start}" if start else "has no frames"
            raise EntrackError(f"{name} {found}")
        self.first = first
        self.size = (first.image.shape[1], first.image.shape[0])
        self._frames = self._all(part)

    def _all(self, rest: Iterator[Frame]) -> Generator[Frame, None, None]:
        first = self.first
        del self.first  # 100 MB of an 8K video are not kept to its end
        yield first
        del first
        yield from rest

    def __iter__(self) -> Iterator[Frame]:
        return self._frames

    def close(self) -> None:
        """Let go of the file, the camera or the connection."""
        self._opened.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
