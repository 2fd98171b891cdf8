"""Open whatever a user names: video files, folders, globs, cameras, network streams."""

import glob
import itertools
import os
import re
import time
from collections.abc import Generator
from pathlib import Path
from typing import cast

import cv2

from entrack.datasets.frames import PICTURES, Image, ImageFiles
from entrack.errors import EntrackError
from entrack.quiet import errors_alone
from entrack.video.decoding import open_video
from entrack.video.source import Frame, Source

_DIGITS = 9  # of a camera's number
_PICTURES_PER_SECOND = 25.0  # pictures in a folder carry no time


def open_source(source: str | Path | int, start: int = 0, stop: int | None = None) -> Source:
    """Open frames `start` ≤ i < `stop` of a video.

    Parameters
    ----------
    source
        A video file; a folder of pictures, or a glob in it, `shots/a*.png` (both in natural order:
        2 before 10, as if taken 25 times a second); the number of a camera; an rtsp:// or http://
        address.

    Raises
    ------
    EntrackError
        Now, if there is nothing to read; while frames are read, if a picture cannot be decoded or
        the video breaks off before the end that its header promises.
    """
    if start < 0 or (stop is not None and stop <= start):
        raise EntrackError(f"start must be ≥ 0 and stop later, found {start} and {stop}")
    text, path = str(source), Path(str(source))
    if "://" in text:
        return open_video(text, text, start, stop)
    # os.path answers for names that no file can have, too: too long, or with a zero byte.
    if isinstance(source, int) or (text.isdecimal() and not os.path.exists(text)):
        return _open_camera(text, start, stop)
    if os.path.isdir(text):
        paths = [p for p in path.glob("[!.]*") if p.suffix.lower() in PICTURES]
        if not paths:
            raise EntrackError(f"folder {path} holds no pictures ({' '.join(sorted(PICTURES))})")
        return _open_pictures(path.resolve().name, paths, start, stop)
    if os.path.exists(text):
        return open_video(path.name, text, start, stop)
    if glob.has_magic(text) and "\0" not in text:
        # Folders as they are: `/*/*/*/…` would read the whole disk, and `[2020] trip` is a name.
        folder, pattern = os.path.split(text)
        paths = [Path(p) for p in glob.glob(os.path.join(glob.escape(folder), pattern))]
        if not paths:
            raise EntrackError(f"no file matches {text}")
        return _open_pictures(text, paths, start, stop)
    raise EntrackError(f"there is no video, folder or camera {text}")


def _open_pictures(name: str, paths: list[Path], start: int, stop: int | None) -> Source:
    pictures = ImageFiles(sorted(paths, key=_natural))

    def frames() -> Generator[Frame, None, None]:
        for index in range(start, len(pictures)):
            yield Frame(index, index / _PICTURES_PER_SECOND, pictures[index])

    return Source(name, frames(), _PICTURES_PER_SECOND, len(pictures), start, stop)


def _natural(path: Path) -> list[str | int]:
    """Sort key that puts 2.jpg before 10.jpg."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", str(path))]


def _open_camera(name: str, start: int, stop: int | None) -> Source:
    if len(name) > _DIGITS:
        raise EntrackError(f"there is no camera {name[:20]}…")
    number = int(name)
    with errors_alone():
        camera = cv2.VideoCapture(number)
    if not camera.isOpened():
        raise EntrackError(f"camera {number} cannot be opened")

    def frames() -> Generator[Frame, None, None]:
        try:
            began = time.perf_counter()
            for index in itertools.count():
                there, image = camera.read()
                if not there:
                    raise EntrackError(f"camera {number} stopped at frame {index}")
                if index >= start:
                    yield Frame(index, time.perf_counter() - began, cast(Image, image))
        finally:
            camera.release()

    fps = camera.get(cv2.CAP_PROP_FPS) or 30.0
    return Source(f"camera {number}", frames(), fps, None, start, stop)
