"""GOT-10k: a folder a sequence, `groundtruth.txt`, `cover.label`, `meta_info.ini`; 1-based."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from entrack.datasets.boxes import zero_based
from entrack.datasets.frames import NumberedImages, numbered_pictures
from entrack.datasets.sequence import Dataset, Sequence
from entrack.datasets.texts import Texts
from entrack.errors import EntrackError

ORIGIN = 1
_SPLITS = ("val", "test", "train", "")


def open_got10k(root: Path) -> Dataset:
    """Open `<root>/<name>/`, or `<root>/val/<name>/`; the split may also be named by the folder.

    Sequences of the test split, whose ground truth is the first box alone, are left out.
    """
    return open_layout("got10k", root)


def open_layout(name: str, root: Path) -> Dataset:
    """Open a folder of this layout as a dataset of the format `name`."""
    if not root.is_dir():
        raise EntrackError(f"there is no folder {root}")
    below = next((s for s in _SPLITS if (root / s / "list.txt").is_file()), "")
    folder = root / below
    texts = Texts(folder)
    listed = texts.text("list.txt").split() if "list.txt" in texts else []
    there = listed or sorted(p.parent.name for p in folder.glob("*/groundtruth.txt"))

    def truth(sequence: str) -> str:
        return f"{sequence}/groundtruth.txt"

    found = tuple(n for n in there if truth(n) in texts)
    if not found:
        raise EntrackError(f"no {name} sequence in {root}: looked for {root}/NAME/groundtruth.txt")

    def read(sequence: str) -> Sequence:
        boxes = zero_based(texts.table(truth(sequence), [4]), ORIGIN)
        if len(boxes) == 1 and len(numbered_pictures(folder / sequence)) > 1:
            raise EntrackError(f"{folder / sequence} has the first box alone: a test sequence")
        frames = NumberedImages(folder / sequence, len(boxes), 1)
        absent = _absent(texts, sequence, len(boxes))
        return Sequence(sequence, frames, boxes, absent, size=_size(texts, sequence))

    return Dataset(name, folder, found, read, tuple(listed), ORIGIN, truth=truth)


def _absent(texts: Texts, name: str, frames: int) -> NDArray[np.bool_]:
    """Frames in which nothing is visible: cover 0, or else the absence flag."""
    for file, gone in (("cover.label", 0), ("absence.label", 1)):
        path = f"{name}/{file}"
        if path in texts:
            flags = texts.table(path, [1])[:, 0]
            if len(flags) != frames:
                where = texts.root / path
                raise EntrackError(f"{where} has {len(flags)} lines, expected {frames}")
            return flags == gone
    return np.zeros(frames, bool)


def _size(texts: Texts, name: str) -> tuple[int, int] | None:
    path = f"{name}/meta_info.ini"
    found = path in texts and re.search(r"resolution: \((\d+), (\d+)\)", texts.text(path))
    return (int(found[1]), int(found[2])) if found else None
