"""OTB-100 and UAV123: targets that are ranges of frames in folders; 1-based boxes."""

from collections.abc import Mapping
from pathlib import Path

from entrack.datasets import lists
from entrack.datasets.boxes import zero_based
from entrack.datasets.frames import NumberedImages
from entrack.datasets.sequence import Dataset, Sequence
from entrack.datasets.texts import Texts
from entrack.errors import EntrackError

ORIGIN = 1


def open_otb(root: Path) -> Dataset:
    """Open `<root>/<folder>/groundtruth_rect*.txt` and `<root>/<folder>/img/%04d.jpg`."""
    return _open("otb", root, lists.otb(), "{t.folder}/{t.truth}", "{t.folder}/img")


def open_uav123(root: Path) -> Dataset:
    """Open `<root>/anno/UAV123/<name>.txt` and `<root>/data_seq/UAV123/<folder>/%06d.jpg`.

    A copy of UAV123@10fps (`anno/UAV123_10fps`) is read with its own frame numbers.
    """
    version, targets = "UAV123", lists.uav123()
    if (root / "anno" / "UAV123_10fps").is_dir() and not (root / "anno" / version).is_dir():
        version, targets = "UAV123_10fps", lists.uav123_10fps()
    pictures = f"data_seq/{version}/{{t.folder}}"
    return _open("uav123", root, targets, f"anno/{version}/{{t.truth}}", pictures)


def _open(
    name: str, root: Path, targets: Mapping[str, lists.Target], truth: str, pictures: str
) -> Dataset:
    texts = Texts(root)

    def truth_of(sequence: str) -> str:
        return truth.format(t=targets[sequence])

    def read(sequence: str) -> Sequence:
        t = targets[sequence]
        rows = texts.table(truth_of(sequence), [4])[t.skip : t.skip + t.frames]
        boxes = zero_based(rows, ORIGIN)
        frames = NumberedImages(root / pictures.format(t=t), len(boxes), t.first)
        return Sequence(sequence, frames, boxes)

    found = tuple(name for name in targets if truth_of(name) in texts)
    if not found:
        example = root / truth_of(next(iter(targets)))
        raise EntrackError(f"no {name} sequence in {root}: looked for {example} and so on")
    lengths = {n: t.frames for n, t in targets.items()}
    return Dataset(name, root, found, read, tuple(targets), ORIGIN, lengths, truth_of)
