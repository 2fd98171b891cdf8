"""LaSOT: 280 test videos, flags of occlusion and out of view, 14 attributes; 1-based boxes."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from entrack.datasets import lists
from entrack.datasets.boxes import zero_based
from entrack.datasets.frames import NumberedImages
from entrack.datasets.sequence import Dataset, Sequence
from entrack.datasets.texts import Texts
from entrack.errors import EntrackError

ORIGIN = 1
_FLAGS = ("full_occlusion.txt", "out_of_view.txt")


def open_lasot(root: Path) -> Dataset:
    """Open the benchmark's folder, or the annotations that come with its evaluation toolkit.

    `<root>/<class>/<name>/groundtruth.txt` with `full_occlusion.txt`, `out_of_view.txt` and `img/`,
    or `<root>/annos/<name>.txt` with `annos/absent/` and `annos/att/`; the latter may be in a zip
    file. A folder with training videos alone is opened as such.
    """
    texts = Texts(root)
    toolkit = next((p for p in ("annos/", "") if f"{p}absent/airplane-1.txt" in texts), None)

    def truth(name: str) -> str:
        if toolkit is None:
            return f"{name.rpartition('-')[0]}/{name}/groundtruth.txt"
        return f"{toolkit}{name}.txt"

    official = lists.lasot_test()
    found = tuple(name for name in official if truth(name) in texts)
    if not found:
        official = lists.lasot_train()
        found = tuple(name for name in official if truth(name) in texts)
    if not found:
        looked_for = f"{root}/airplane/airplane-1/groundtruth.txt or {root}/annos/airplane-1.txt"
        raise EntrackError(f"no lasot sequence in {root}: looked for {looked_for} and so on")

    def read(name: str) -> Sequence:
        boxes = zero_based(texts.table(truth(name), [4]), ORIGIN)
        if toolkit is None:
            absent = _absent(texts, Path(truth(name)).parent, len(boxes))
        else:
            absent = texts.table(f"{toolkit}absent/{name}.txt", [1])[:, 0] != 0
        folder = root / Path(truth(name)).parent / "img"
        frames = NumberedImages(folder, len(boxes) if folder.is_dir() else 0, 1)
        labels = _attributes(texts, toolkit or "", name)
        return Sequence(name, frames, boxes, absent[: len(boxes)], attributes=labels)

    return Dataset("lasot", root, found, read, official, ORIGIN, truth=truth)


def _absent(texts: Texts, folder: Path, frames: int) -> NDArray[np.bool_]:
    """Full occlusion or out of view: each file is one line of 0 and 1, or a line a frame."""
    absent = np.zeros(frames, bool)
    for name in _FLAGS:
        path = (folder / name).as_posix()
        flags = np.array(texts.text(path).replace(",", " ").split())
        if len(flags) != frames or not np.isin(flags, ("0", "1")).all():
            where = texts.root / path
            raise EntrackError(f"{where} has {len(flags)} flags, expected {frames} of 0 or 1")
        absent |= flags == "1"
    return absent


def _attributes(texts: Texts, toolkit: str, name: str) -> tuple[str, ...]:
    path = f"{toolkit}att/{name}.txt"
    if path not in texts:
        return ()
    flags = texts.text(path).replace(",", " ").split()
    return tuple(a for a, flag in zip(lists.lasot_attributes(), flags, strict=False) if flag == "1")
