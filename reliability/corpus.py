"""Good videos of every kind, a few kilobytes each, and what can happen to them on the way.

Nothing of it is kept in the repository: the same seed makes the same files.
"""

import random
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import av
import numpy as np

FRAMES = 24
SIZE = (96, 72)  # width, height


class Good(NamedTuple):
    """A video as an encoder makes it."""

    suffix: str
    codec: str = "libx264"
    pixels: str = "yuv420p"
    size: tuple[int, int] = SIZE
    times: Sequence[float] | None = None
    """Of the frames, in 25ths of a second."""
    frames: int = FRAMES
    rotation: int = 0
    audio: float = 0
    """Seconds of sound."""
    options: dict[str, str] = {}  # noqa: RUF012
    container: dict[str, str] = {}  # noqa: RUF012


_FAST = {"preset": "ultrafast", "g": "8", "bf": "2"}
GOOD: dict[str, Good] = {
    "mp4": Good("mp4", options=_FAST),
    "mp4-faststart": Good("mp4", options=_FAST, container={"movflags": "faststart"}),
    "mp4-fragments": Good("mp4", options=_FAST, container={"movflags": "frag_keyframe+empty_moov"}),
    "mov-rotated": Good("mov", rotation=90, options=_FAST),
    "mkv": Good("mkv", options=_FAST),
    "mkv-late": Good("mkv", options=_FAST, times=[250 + t for t in range(FRAMES)]),
    "mkv-variable": Good("mkv", options=_FAST, times=np.cumsum([1, 3, 1, 7] * 6).tolist()),
    "mp4-variable": Good("mp4", options=_FAST, times=np.cumsum([1, 3, 1, 7] * 6).tolist()),
    "mp4-late": Good("mp4", options=_FAST, times=[250 + t for t in range(FRAMES)]),
    "mp4-sound": Good("mp4", options=_FAST, audio=3.0),
    "mkv-sound": Good("mkv", options=_FAST, audio=0.4),
    "ts": Good("ts", "mpeg2video"),
    "ts-h264": Good("ts", options=_FAST),
    "avi": Good("avi", "mpeg4"),
    "avi-mjpeg": Good("avi", "mjpeg", "yuvj420p"),
    "flv": Good("flv", "flv1"),
    "webm": Good("webm", "libvpx", options={"deadline": "realtime", "cpu-used": "8"}),
    "gif": Good("gif", "gif", "rgb8"),
    "h264": Good("h264", options=_FAST),
    "ten-bit": Good("mkv", "ffv1", "yuv420p10le"),
    "ten-bit-h264": Good("mp4", pixels="yuv420p10le", options=_FAST),
    "grey": Good("mkv", "ffv1", "gray"),
    "grey16": Good("mkv", "ffv1", "gray16le"),
    "alpha": Good("mkv", "ffv1", "bgra"),
    "tiny": Good("mp4", size=(16, 16), options=_FAST),
    "odd": Good("mkv", "ffv1", "yuv444p", size=(33, 17)),
    "one-frame": Good("mp4", frames=1, options=_FAST),
    "8k": Good("mp4", size=(7680, 4320), frames=2, options={**_FAST, "crf": "40"}),
}
"""Every one of them has to be tracked to the end, all of its frames."""


def picture(t: int, size: tuple[int, int]) -> np.ndarray:
    """A bright square on a textured ground, which moves a little each frame."""
    width, height = size
    image = np.empty((height, width, 3), np.uint8)
    image[:] = (np.arange(width) * 3 % 120)[None, :, None].astype(np.uint8)
    side, x = max(4, width // 4), width // 4 + (t * width // 200)
    image[height // 4 : height // 4 + side, x : x + side] = 250
    return image


def write(path: Path, good: Good, change: Callable[[int, Any], Any] = lambda n, packet: packet):
    """Encode a video; `change` may return another packet for packet n, or None to drop it."""
    with av.open(str(path), "w", options=good.container) as file:
        stream: Any = file.add_stream(good.codec, rate=25, options=dict(good.options))
        stream.width, stream.height = good.size
        stream.pix_fmt = good.pixels
        stream.codec_context.time_base = Fraction(1, 25)
        stream.codec_context.thread_count = 1
        if good.rotation:
            stream.set_display_rotation(good.rotation)
        sound: Any = file.add_stream("aac", rate=8000) if good.audio else None
        if sound:
            _beep(file, sound, good.audio)
        count = 0
        for t in [*range(good.frames), None]:
            frame = None
            if t is not None:
                frame = av.VideoFrame.from_ndarray(picture(t, good.size), "bgr24")
                frame.pts = int(good.times[t]) if good.times else t
                frame.time_base = Fraction(1, 25)
            for packet in stream.encode(frame):
                kept = change(count, packet)
                count += 1
                if kept is not None:
                    file.mux(kept)


def _beep(file: Any, stream: Any, seconds: float) -> None:
    wave = (9000 * np.sin(np.arange(int(8000 * seconds)) / 3)).astype(np.int16)
    for start in range(0, len(wave), 1024):
        part = wave[start : start + 1024]
        frame = av.AudioFrame.from_ndarray(part[None], format="s16", layout="mono")
        frame.sample_rate, frame.pts = 8000, start
        frame.time_base = Fraction(1, 8000)
        file.mux(stream.encode(frame))
    file.mux(stream.encode(None))


def _odd_ones(folder: Path) -> Iterator[Path]:
    """Files that are no video, or one with something odd in it."""

    def named(name: str, data: bytes) -> Path:
        (folder / name).write_bytes(data)
        return folder / name

    yield named("empty.mp4", b"")
    yield named("text.mp4", b"this is no video\n" * 50)
    yield named("picture.mp4", _png())
    yield named("zeros.mkv", bytes(5000))
    yield named("noise.avi", random.Random(0).randbytes(5000))
    yield named("playlist.m3u8", b"#EXTM3U\n#EXTINF:1,\n/etc/passwd\n#EXT-X-ENDLIST\n")
    yield named("concat.ffconcat", b"ffconcat version 1.0\nfile /etc/passwd\n")
    for suffix in ("mp4", "mkv"):
        path = folder / f"sound-only.{suffix}"
        with av.open(str(path), "w") as file:
            _beep(file, file.add_stream("aac", rate=8000), 1.0)
        yield path
    parts = []
    for number, size in enumerate([(96, 72), (64, 48), (128, 96)]):  # a stream that changes size
        path = folder / f"part{number}.h264"
        write(path, Good("h264", size=size, options=_FAST))
        parts.append(path.read_bytes())
        path.unlink()
    yield named("mixed-sizes.h264", b"".join(parts))


def _png() -> bytes:
    import cv2

    return cv2.imencode(".png", picture(0, SIZE))[1].tobytes()


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(1, len(data))]


def _flip(rate: float) -> Callable[[bytes, random.Random], bytes]:
    def flip(data: bytes, rng: random.Random) -> bytes:
        out = bytearray(data)
        for _ in range(max(1, int(rate * len(data)))):
            out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
        return bytes(out)

    return flip


def _head(data: bytes, rng: random.Random) -> bytes:
    size = rng.choice([4, 16, 64, 256])
    return rng.randbytes(min(size, len(data))) + data[size:]


def _zeroed(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(data))
    end = min(len(data), start + rng.randrange(1, len(data) // 2 + 2))
    return data[:start] + bytes(end - start) + data[end:]


def _missing(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(data))
    return data[:start] + data[start + rng.randrange(1, 2000) :]


def _repeated(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(data))
    return data[:start] + data[max(0, start - 1000) : start] + data[start:]


def _longer(data: bytes, rng: random.Random) -> bytes:
    return data + rng.randbytes(rng.randrange(1, 3000))


FAULTS: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "cut": _cut,
    "flip-one": _flip(0),
    "flip-some": _flip(0.001),
    "flip-many": _flip(0.02),
    "head": _head,
    "zeroed": _zeroed,
    "missing": _missing,
    "repeated": _repeated,
    "longer": _longer,
}


def corpus(folder: Path, rounds: int) -> Iterator[Path]:
    """Make the files in `folder`, one at a time: good ones, odd ones, `rounds` of each fault."""
    for name, good in GOOD.items():
        path = folder / f"{name}.{good.suffix}"
        write(path, good)
        yield path
        data = path.read_bytes()
        for number in range(rounds):
            rng = random.Random(f"{name} {number}")

            def lose(n: int, packet: Any, rng: random.Random = rng) -> Any:
                return packet if n == 0 or rng.random() > 0.15 else None

            lossy = folder / f"{name}.dropped{number}.{good.suffix}"
            try:
                write(
                    lossy, good, lambda n, p, rng=rng: p if n == 0 or rng.random() > 0.15 else None
                )
            except av.FFmpegError:  # this container cannot bear it
                lossy.unlink(missing_ok=True)
            else:
                yield lossy
            for fault, damage in FAULTS.items():
                path = folder / f"{name}.{fault}{number}.{good.suffix}"
                path.write_bytes(damage(data, rng))
                yield path
        wrong = folder / f"{name}.wrong-name.jpg"
        wrong.write_bytes(data)
        yield wrong
    yield from _odd_ones(folder)
