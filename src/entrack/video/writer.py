"""Frames → an MP4 that plays in every browser: H.264, yuv420p, index in front."""

from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Self, cast

import cv2
import numpy as np

from entrack.datasets.frames import Image
from entrack.errors import EntrackError
from entrack.files import unfinished, writing

if TYPE_CHECKING:
    from av.video.stream import VideoStream

_TICK = Fraction(1, 90_000)  # 25 and 29.97 frames a second both come out whole
# The fastest preset with the two tools that it drops and that pay: as small as "superfast" at half
# its time. It has no B frames, so fragments begin at time 0.
_ENCODER = {"preset": "ultrafast", "crf": "22", "x264-params": "cabac=1:deblock=0,0"}
# Larger than 4K: of such pictures the encoder holds one less (25 MB) if it may ignore how long each
# is shown, which only steers bit rates that nobody asks for; a second thread would hold more, too.
_SPARING = {"x264-params": f"{_ENCODER['x264-params']}:force-cfr=1"}
# While it is written the file is a chain of fragments of a second, each playable: nothing that
# happens to the program or the disk loses more than the last one.
_FRAGMENTS = {
    "movflags": "empty_moov+default_base_moof",
    "frag_duration": "1000000",
    "flush_packets": "1",
}
_LONGEST, _PIXELS = 4096, 4096 * 2304  # of H.264 that browsers play
_INDEXED = {"movflags": "faststart"}


class VideoWriter:
    """Write frames with their times; use it in a `with` block or close it.

    The video has the size of the first frame, made even by repeating its last row or column, and
    of 4096 × 2304 pixels at most. A later frame of another size is fitted into it, with black bars.
    Until it is closed the file is called `<path>.part`. It is closed, whole and playable, when the
    block ends by an error, too, even by a full disk. Without a single frame no file is made.

    Parameters
    ----------
    path
        Ends in `.mp4`.
    fps
        Typical rate: how long the last frame stays. The others stay until the next one's time.

    Raises
    ------
    EntrackError
        If the file cannot be written: on opening, writing or closing.
    """

    def __init__(self, path: str | Path, fps: float = 25.0) -> None:
        import av

        self.path = Path(path)
        if self.path.suffix.lower() != ".mp4":
            raise EntrackError(f"a video is written as .mp4, found {self.path.name}")
        self._part = unfinished(self.path)
        self._fps = fps
        self._stream: VideoStream | None = None
        self._begin, self._last, self._closed = 0.0, -1, False
        self._broken: EntrackError | None = None
        with writing(self.path):
            self._part.touch()
            self._file = av.open(str(self._part), "w", format="mp4", options=_FRAGMENTS)

    def write(self, image: Image, time: float) -> None:
        """Show an image (H, W, 3) uint8 BGR from `time` on, in seconds; the first is the zero."""
        from av.video.frame import VideoFrame

        stream = self._stream
        if stream is None:
            stream = self._stream = self._new_stream(image)
            self._begin = time
        image = _fitted(image, stream.width, stream.height)
        planes = cast(Image, cv2.cvtColor(image, cv2.COLOR_BGR2YUV_I420))
        frame = VideoFrame.from_ndarray(planes, "yuv420p")
        frame.time_base = _TICK
        frame.pts = self._last = max(self._last + 1, round((time - self._begin) / _TICK))
        frame.duration = round(1 / self._fps / _TICK)
        if self._broken:  # FFmpeg would write behind a header that is not there, and crash
            raise self._broken
        try:
            with writing(self.path):
                self._file.mux(stream.encode(frame))
        except EntrackError as error:
            self._broken = error
            raise

    def _new_stream(self, image: Image) -> "VideoStream":
        rate = Fraction(self._fps).limit_denominator(1001)
        width, height = (side + side % 2 for side in written_size(image))
        large = width * height > 3840 * 2160
        options = _ENCODER | (_SPARING if large else {})
        stream = self._file.add_stream("libx264", rate=rate, options=options)
        stream.width, stream.height = width, height
        stream.pix_fmt = "yuv420p"
        context = stream.codec_context
        context.time_base = _TICK
        context.thread_type, context.thread_count = "FRAME", 1 if large else 2
        context.colorspace, context.color_range = 6, 1  # as cvtColor makes it: BT.601, 16–235
        return stream

    def close(self) -> None:
        """Finish the file and give it its name."""
        if self._closed:
            return
        self._closed = True
        if self._stream is None:
            self._file.close()
            self._part.unlink()
            return
        with writing(self.path):
            try:
                if self._broken:
                    raise OSError(*getattr(self._broken.__cause__, "args", ())[:2])
                self._file.mux(self._stream.encode())
                self._file.close()
                _put_index_in_front(self._part)
            except OSError:
                with suppress(OSError):
                    self._file.close()
                _drop_torn_fragment(self._part)
                raise
            finally:
                if self._part.stat().st_size:
                    self._part.replace(self.path)
                else:
                    self._part.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def written_size(image: Image) -> tuple[int, int]:
    """(width, height) in which a picture is written: its own, or the largest that browsers play.

    >>> written_size(np.empty((4320, 7680, 3), np.uint8))
    (4096, 2304)
    """
    height, width = image.shape[:2]
    scale = min(1.0, _LONGEST / max(height, width), (_PIXELS / (height * width)) ** 0.5)
    if scale == 1:
        return width, height
    return max(2, round(scale * width / 2) * 2), max(2, round(scale * height / 2) * 2)


def _fitted(image: Image, width: int, height: int) -> Image:
    """`image` at the video's size: a row or column repeated, or scaled between black bars."""
    h, w = image.shape[:2]
    if (h + h % 2, w + w % 2) != (height, width):
        scale = min(width / w, height / h)
        w, h = max(1, int(w * scale)), max(1, int(h * scale))
        left, top = (width - w) // 2, (height - h) // 2
        canvas = np.zeros((height, width, 3), np.uint8)
        canvas[top : top + h, left : left + w] = cv2.resize(
            image, (w, h), interpolation=cv2.INTER_AREA
        )
        return canvas
    border = (0, height - h, 0, width - w, cv2.BORDER_REPLICATE)
    return image if (h, w) == (height, width) else cast(Image, cv2.copyMakeBorder(image, *border))


def _put_index_in_front(path: Path) -> None:
    """Copy the packets of a fragmented MP4 into one that any player can seek in at once."""
    import av

    whole = path.with_name(path.name + ".index")
    try:
        with (
            av.open(str(path)) as old,
            av.open(str(whole), "w", format="mp4", options=_INDEXED) as new,
        ):
            stream = old.streams.video[0]
            copy = new.add_stream_from_template(stream)
            for packet in old.demux(stream):
                if packet.size:
                    packet.stream = copy
                    new.mux(packet)
        whole.replace(path)
    finally:
        whole.unlink(missing_ok=True)


def _drop_torn_fragment(path: Path) -> None:
    """Cut a fragmented MP4 after its last whole fragment: boxes of 4 bytes length, 4 bytes name."""
    size, position, whole = path.stat().st_size, 0, 0
    with path.open("r+b") as file:
        while position < size:
            file.seek(position)
            length, name = int.from_bytes(file.read(4)), file.read(4)
            position += max(length, 8)
            if name == b"mdat" and position <= size:
                whole = position
        file.truncate(whole)
