"""A folder of one's own: `<name>.mp4` or `<name>/` of pictures, each with `<name>.txt`."""

from pathlib import Path

from entrack.datasets.frames import PICTURES, ImageFiles, VideoFrames
from entrack.datasets.sequence import Dataset, Sequence
from entrack.datasets.texts import Texts
from entrack.errors import EntrackError

VIDEOS = (".mp4", ".mkv", ".avi", ".mov", ".webm", ".m4v")


def open_folder(root: Path) -> Dataset:
    """Open videos or picture folders, each with a text file of `x,y,w,h` lines.

    Boxes are 0-based pixels; a line of `nan` means that the target is absent.
    """
    texts = Texts(root)
    found = tuple(sorted(p.stem for p in root.glob("*.txt") if _pictures(root, p.stem)))
    if not found:
        looked_for = f"{root}/NAME.txt beside NAME.mp4 or NAME/"
        raise EntrackError(f"no annotated video in {root}: looked for {looked_for}")

    def read(name: str) -> Sequence:
        boxes = texts.table(f"{name}.txt", [4])
        source = _pictures(root, name)
        assert source is not None
        if source.is_dir():
            pictures = (p for p in source.iterdir() if p.suffix.lower() in PICTURES)
            frames = ImageFiles(sorted(pictures)[: len(boxes)])
        else:
            frames = VideoFrames(source, len(boxes))
        return Sequence(name, frames, boxes, absent=(boxes != boxes).any(axis=1))

    return Dataset("folder", root, found, read)


def _pictures(root: Path, name: str) -> Path | None:
    candidates = [root / name, *(root / f"{name}{suffix}" for suffix in VIDEOS)]
    return next((p for p in candidates if p.is_dir() or p.is_file()), None)
