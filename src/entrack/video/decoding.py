"""Video files and streams through FFmpeg (PyAV): a few frames in memory, however long the video."""

import re
from collections.abc import Generator
from typing import TYPE_CHECKING, Any, cast

import cv2
import numpy as np

from entrack.datasets.frames import Image, any_alphabet
from entrack.errors import EntrackError
from entrack.video.source import Frame, Source

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.packet import Packet
    from av.video.frame import VideoFrame
    from av.video.stream import VideoStream

PIXELS = 8192 * 4320
"""Of the largest video."""
_LARGE = 4096 * 2304
_SLACK = 0.5  # seconds that a whole video may lack of the length in its header
_NETWORK_WAIT = 10.0  # seconds until a silent server is given up


def open_video(name: str, address: str, start: int, stop: int | None) -> Source:
    """Open frames `start` ≤ i < `stop` of a file or an address; see `open_source`."""
    import av
    from av.error import FFmpegError

    timeout = _NETWORK_WAIT if "://" in address else None
    try:
        container = cast(
            "InputContainer",
            av.open(
                address,
                options={"rtsp_transport": "tcp"},
                timeout=timeout,
                **any_alphabet(),
            ),
        )
    except (FFmpegError, OSError) as error:
        raise EntrackError(f"{name} cannot be read as a video: {error.strerror}") from error
    # FFmpeg would play a text file as terminal art.
    if not container.streams.video or container.format.name == "tty":
        container.close()
        raise EntrackError(f"{name} is not a video")
    stream = container.streams.video[0]
    if stream.codec_context is None:  # pyright: ignore[reportUnnecessaryComparison]
        container.close()
        raise EntrackError(f"{name} is a video of a kind that cannot be decoded")
    if stream.width * stream.height > PIXELS:
        container.close()
        raise EntrackError(f"{name} has {stream.width}×{stream.height} pixels, 8K is the most")
    fps, seconds = frame_rate(stream), _promised_seconds(stream)
    length = stream.frames or (round(seconds * fps) if seconds else None)
    return Source(name, _decode(name, container, start), fps, length, start, stop)


def on_threads(stream: "VideoStream") -> None:
    """Decode two pictures at a time, or large ones one by one: each thread holds some of them."""
    large = stream.width * stream.height > _LARGE
    stream.thread_type, stream.codec_context.thread_count = "FRAME", 1 if large else 2


def frame_rate(stream: "VideoStream") -> float:
    """Frames a second, on average; 25 where the file does not say."""
    return float(stream.average_rate or stream.guessed_rate or 25)


def _promised_seconds(stream: "VideoStream") -> float:
    """How long the video is by its header; 0 where it does not say."""
    if stream.duration and stream.time_base:
        return float(stream.duration * stream.time_base)
    clock = re.fullmatch(r"(\d+):(\d+):([\d.]+)", stream.metadata.get("DURATION", ""))  # Matroska
    if not clock:
        return 0.0
    hours, minutes, seconds = map(float, clock.groups())
    # Matroska's is where the video ends, and it may begin late.
    late = float((stream.start_time or 0) * (stream.time_base or 0))
    return max(0.0, hours * 3600 + minutes * 60 + seconds - max(0.0, late))


def _decode(name: str, container: "InputContainer", start: int) -> Generator[Frame, None, None]:
    """Decode on two threads; a damaged packet is left out, a missing end is an error."""
    from av.error import FFmpegError

    stream = container.streams.video[0]
    on_threads(stream)
    fps, promised = frame_rate(stream), _promised_seconds(stream)
    index, zero, end, cut = 0, None, 0.0, False
    with container:
        try:
            for packet in container.demux(stream):
                if packet.size:  # the last, empty one only brings out what the decoder holds back
                    cut = packet.is_corrupt
                for picture in [] if packet.is_corrupt else pictures(packet):
                    clock = index / fps if picture.pts is None else picture.time
                    zero = clock if zero is None else zero
                    if index >= start:
                        yield Frame(index, clock - zero, upright(picture))
                    index, end = index + 1, clock - zero + _seconds_shown(picture, fps)
        except (FFmpegError, OSError) as error:
            raise EntrackError(f"{name} breaks off at frame {index}: {error.strerror}") from error
    if cut or end < promised - _SLACK:
        raise EntrackError(f"{name} breaks off at frame {index}: the file is cut short or damaged")


def pictures(packet: "Packet[VideoStream]") -> list["VideoFrame"]:
    """Decode a packet; a damaged one has no pictures."""
    from av.error import FFmpegError

    try:
        return packet.decode()
    except FFmpegError:
        return []


def _seconds_shown(picture: "VideoFrame", fps: float) -> float:
    if picture.duration and picture.time_base:
        return float(picture.duration * picture.time_base)
    return 1 / fps


def upright(picture: "VideoFrame") -> Image:
    """BGR pixels of a decoded frame, turned as its metadata asks."""
    plane = picture.reformat(format="bgr24").planes[0]
    memory = cast(Any, plane)  # it has the buffer protocol, which its stubs do not say
    rows = np.frombuffer(memory, np.uint8).reshape(plane.height, plane.line_size)
    # Without PyAV's copy, of 100 MB for 8K, unless there are spare bytes behind each row.
    image = np.ascontiguousarray(rows[:, : 3 * plane.width]).reshape(plane.height, plane.width, 3)
    turn = _TURNS.get(round(picture.rotation / 90) % 4)
    return image if turn is None else cast(Image, cv2.rotate(image, turn))


_TURNS = {1: cv2.ROTATE_90_COUNTERCLOCKWISE, 2: cv2.ROTATE_180, 3: cv2.ROTATE_90_CLOCKWISE}
