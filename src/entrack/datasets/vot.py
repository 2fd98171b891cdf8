"""VOT short-term datasets: rotated boxes, 0-based."""

from pathlib import Path

from entrack.datasets import lists
from entrack.datasets.boxes import upright_boxes
from entrack.datasets.frames import NumberedImages, numbered_pictures
from entrack.datasets.sequence import Dataset, Sequence
from entrack.datasets.texts import Texts
from entrack.errors import EntrackError


def open_vot2016(root: Path) -> Dataset:
    """Open `<root>/[sequences/]<name>/groundtruth.txt` with `color/%08d.jpg` or `%08d.jpg`."""
    return _open("vot2016", root)


def open_vot2018(root: Path) -> Dataset:
    """Open VOT2018 (the same sequences as VOT2017); see `open_vot2016`."""
    return _open("vot2018", root)


def open_vot2019(root: Path) -> Dataset:
    """Open VOT2019; see `open_vot2016`."""
    return _open("vot2019", root)


def _open(year: str, root: Path) -> Dataset:
    folder = root / "sequences" if (root / "sequences").is_dir() else root
    texts, official = Texts(folder), lists.vot(year)
    listed = texts.text("list.txt").split() if "list.txt" in texts else []
    names = dict.fromkeys([*official, *listed])

    def truth(name: str) -> str:
        return f"{name}/groundtruth.txt"

    found = tuple(name for name in names if truth(name) in texts)
    if not found:
        raise EntrackError(f"no VOT sequence in {root}: looked for {folder}/bag/groundtruth.txt")

    def read(name: str) -> Sequence:
        rows = texts.table(truth(name), [4, 8])
        corners = rows if rows.shape[1] == 8 else None
        boxes = rows if corners is None else upright_boxes(rows)
        colour = folder / name / "color"
        pictures = colour if colour.is_dir() else folder / name
        frames = NumberedImages(pictures, len(rows) if numbered_pictures(pictures) else 0)
        return Sequence(name, frames, boxes, polygons=corners, size=_size(texts, name))

    return Dataset(year, folder, found, read, official, truth=truth)


def _size(texts: Texts, name: str) -> tuple[int, int] | None:
    """Width and height as the toolkit's `sequence` file states them."""
    path = f"{name}/sequence"
    lines = texts.text(path).split() if path in texts else []
    stated = dict(line.split("=", 1) for line in lines if "=" in line)
    try:
        return int(stated["width"]), int(stated["height"])
    except (KeyError, ValueError):
        return None
