"""Clips on disk as they are in memory: any worker reads any frame at once, and nobody holds all."""

from collections.abc import Iterable
from pathlib import Path

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
    good: list[int] = []
    target: np.memmap | None = None  # type: ignore[type-arg]
    pictures = unfinished(path.with_suffix(".npy"))
    for index in range(len(sequence)):
        try:
            frame = sequence.frames[index]
        except EntrackError:
            continue
        if target is None:
            target = np.lib.format.open_memmap(
                pictures, "w+", np.uint8, (len(sequence), *frame.shape)
            )
        if frame.shape != target.shape[1:]:
            continue
        target[len(good)] = frame
        good.append(index)
    if target is None:
        raise EntrackError(f"{sequence.name} has no frame that can be read")
    target.flush()
    bad = len(sequence) - len(good)
    with unfinished(path).open("wb") as file:
        np.savez(file, boxes=sequence.boxes[good], absent=sequence.absent[good], bad=bad)
    pictures.replace(path.with_suffix(".npy"))
    unfinished(path).replace(path)
    return bad


def kept(folder: Path, names: Iterable[str]) -> list[Sequence]:
    """Open what `keep` wrote."""
    return [_open(folder / f"{name}.npz") for name in names]


def _open(path: Path) -> Sequence:
    with np.load(path) as table:
        boxes, absent = table["boxes"], table["absent"]
    return Sequence(path.stem, np.load(path.with_suffix(".npy"), mmap_mode="r"), boxes, absent)
