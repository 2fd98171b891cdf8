"""A video file whose frames can be had by number, in any order: for scrubbing and going back."""

from bisect import bisect_left
from collections import OrderedDict
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING, cast

from entrack.datasets.frames import any_alphabet
from entrack.errors import EntrackError
from entrack.video.decoding import PIXELS, frame_rate, on_threads, pictures, upright
from entrack.video.source import Frame

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.video.frame import VideoFrame

_NEAR = 32  # frames: up to here reading on is as fast as a seek
_CACHE = 64e6  # bytes of frames that are kept, so that a step back needs no seek
# Containers that hold their own pictures. Playlists and the like name other files and addresses,
# which a stranger's upload must not have opened.
_SAFE = {
    "format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,flv,asf,ogg,gif",
    "protocol_whitelist": "file",
}


class Clip:
    """Frames of a video file by number; use it in a `with` block or close it.

    >>> with Clip("surfer.mp4") as clip:                          # doctest: +SKIP
    ...     clip[250].image.shape
    (360, 640, 3)

    Frame i is the one that `open_source` counts as i, pixel by pixel. Files that name other files
    (playlists) are refused.

    Attributes
    ----------
    name, size, fps
        As in `Source`.

    Raises
    ------
    EntrackError
        If the file is no video.
    """

    def __init__(self, path: str | Path, name: str | None = None) -> None:
        self._path, self.name = Path(path), name or Path(path).name
        with self._open() as container:
            stream = container.streams.video[0]
            self.fps = frame_rate(stream)
            self._unit = float(stream.time_base or 0)
            stamps = [
                packet.pts
                for packet in container.demux(stream)
                if packet.size and not packet.is_discard and not packet.is_corrupt
            ]
        self._length = len(stamps)
        # Without timestamps frames can only be counted from the beginning.
        self._stamps = [] if None in stamps else sorted(t for t in stamps if t is not None)
        self._kept: OrderedDict[int, Frame] = OrderedDict()
        self._reading: Generator[Frame, None, None] | None = None
        self._next = 0
        try:
            first = self[0].image
        except IndexError as error:
            raise EntrackError(f"{self.name} has no frames") from error
        self.size = (first.shape[1], first.shape[0])

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, index: int) -> Frame:
        """Frame `index` ≥ 0; `IndexError` past the end."""
        if not 0 <= index < self._length:
            raise IndexError(index)
        while index not in self._kept:
            if self._reading is None or not self._next <= index < self._next + _NEAR:
                self._stop()
                self._reading = self._read(index)
            frame = next(self._reading, None)
            if frame is None:  # the index promised more than can be decoded
                self._length = self._next
                raise IndexError(index)
            self._next = frame.index + 1
            self._keep(frame, index)
        return self._kept[index]

    def _keep(self, frame: Frame, wanted: int) -> None:
        if frame.index > wanted:  # a damaged frame was left out: the next one stands for it
            frame = Frame(wanted, frame.time, frame.image)
        self._kept[frame.index] = frame
        while len(self._kept) > max(2, _CACHE // frame.image.nbytes):
            self._kept.popitem(last=False)

    def _read(self, index: int) -> Generator[Frame, None, None]:
        """Decode from the last key frame before `index` on; yield from `index` on."""
        from av.error import FFmpegError

        with self._open() as container:
            stream = container.streams.video[0]
            on_threads(stream)
            if index and self._stamps:
                container.seek(self._stamps[index], stream=stream)
            try:
                for count, picture in enumerate(_decoded(container)):
                    number, time = count, count / self.fps
                    if self._stamps and picture.pts is not None:
                        number = bisect_left(self._stamps, picture.pts)
                        time = (picture.pts - self._stamps[0]) * self._unit
                    if number >= index:
                        yield Frame(number, time, upright(picture))
            except (FFmpegError, OSError) as error:
                where = f"{self.name} breaks off after frame {self._next}"
                raise EntrackError(f"{where}: {error.strerror}") from error

    def _open(self) -> "InputContainer":
        import av
        from av.error import FFmpegError

        refused = EntrackError(f"{self.name} is not a video that can be read")
        try:
            container = cast(
                "InputContainer", av.open(str(self._path), options=_SAFE, **any_alphabet())
            )
        except (FFmpegError, OSError) as error:
            raise refused from error
        video = container.streams.video
        if (
            not video
            or video[0].codec_context is None  # pyright: ignore[reportUnnecessaryComparison]
            or not 0 < video[0].width * video[0].height <= PIXELS
        ):
            container.close()
            raise refused
        return container

    def close(self) -> None:
        """Let go of the file, and of the frames that are kept."""
        self._stop()
        self._kept.clear()

    def _stop(self) -> None:
        if self._reading:
            self._reading.close()
            self._reading = None

    def __enter__(self) -> "Clip":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _decoded(container: "InputContainer") -> Generator["VideoFrame", None, None]:
    for packet in container.demux(container.streams.video[0]):
        yield from [] if packet.is_corrupt else pictures(packet)
