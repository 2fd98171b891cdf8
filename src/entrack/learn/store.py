"""Clips on disk as they are in memory: any worker reads any frame at once, and nobody holds all."""

from collections.abc import Iterable
from pathlib import Path
from typing import IO

import numpy as np

from entrack.datasets.sequence import Sequence
from entrack.errors import EntrackError
from entrack.files import unfinished


def bad_frames(folder: Path, name: str) -> int | None:
    """How many frames `keep` left out of a sequence; None if it has not been kept."""
    path = folder / f"{name}.npz"
    if not path.exists():
        return None
    with np.load(path) as table:
        return int(table["bad"])


def keep(folder: Path, sequence: Sequence) -> int:
    """Write a sequence's frames, boxes and flags; return how many frames are bad.

    A frame that cannot be read is left out with its box. A sequence without a readable frame is an
    error, and so are frames of several sizes.
    """
    path = folder / f"{sequence.name}.npz"
    folder.mkdir(parents=True, exist_ok=True)
    pictures = unfinished(path.with_suffix(".npy"))
    with pictures.open("wb") as file:
        good = _write_frames(file, sequence)
    bad = len(sequence) - len(good)
    with unfinished(path).open("wb") as file:
        np.savez(file, boxes=sequence.boxes[good], absent=sequence.absent[good], bad=bad)
    pictures.replace(path.with_suffix(".npy"))
    unfinished(path).replace(path)
    return bad


def _write_frames(file: IO[bytes], sequence: Sequence) -> list[int]:
    """Write what `np.load` reads as frames (T, H, W, 3); return which frames they are.

    With plain writes: where the disk is full, they fail, but a mapped file ends the program.
    """
    good: list[int] = []
    shape: tuple[int, ...] = ()
    for index in range(len(sequence)):
        try:
            frame = sequence.frames[index]
        except EntrackError:
            continue
        if not good:
            shape = frame.shape
            _write_header(file, (len(sequence), *shape))
        if frame.shape == shape:
            file.write(frame.tobytes())
            good.append(index)
    if not good:
        raise EntrackError(f"{sequence.name} has no frame that can be read")
    file.seek(0)
    _write_header(file, (len(good), *shape))  # as long as before: numpy leaves room to grow
    return good


def _write_header(file: IO[bytes], shape: tuple[int, ...]) -> None:
    about = {"descr": "|u1", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, about)


def kept(folder: Path, names: Iterable[str]) -> list[Sequence]:
    """Open what `keep` wrote."""
    return [_open(folder / f"{name}.npz") for name in names]


def _open(path: Path) -> Sequence:
    with np.load(path) as table:
        boxes, absent = table["boxes"], table["absent"]
    return Sequence(path.stem, np.load(path.with_suffix(".npy"), mmap_mode="r"), boxes, absent)
