"""Sequences to files in the GOT-10k layout."""

import shutil
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from entrack.datasets.sequence import Sequence
from entrack.errors import EntrackError

_JPEG = (cv2.IMWRITE_JPEG_QUALITY, 94)


def write(sequences: Iterable[Sequence], out: Path) -> list[str]:
    """Write sequences below the folder `out` and return their names.

    `NAME/%08d.jpg`, `NAME/groundtruth.txt` (x,y,w,h a line, 1-based as GOT-10k has them, and whole
    where the target is hidden), `NAME/absence.label` (1 where it is), `NAME/meta_info.ini`, and
    `list.txt`. A sequence appears when it is complete; one that is there already is kept, so that
    a stopped run goes on.

    Raises
    ------
    EntrackError
        Where a file cannot be written, or another sequence has the name already; the sequences
        before it are there and in the list.
    """
    names: list[str] = []
    try:
        out.mkdir(parents=True, exist_ok=True)
        for sequence in sequences:
            _write(sequence, out / sequence.name)
            names.append(sequence.name)
            _replace(out / "list.txt", "".join(f"{name}\n" for name in names))
    except OSError as error:
        raise EntrackError(
            f"cannot write to {out}, {len(names)} sequences are there: {error}"
        ) from error
    return names


def _write(sequence: Sequence, folder: Path) -> None:
    rows = [",".join(f"{v:.4f}" for v in box) for box in sequence.boxes + np.array([1, 1, 0, 0])]
    boxes = "".join(f"{row}\n" for row in rows)
    if folder.is_dir():
        if (folder / "groundtruth.txt").read_text() != boxes:
            raise EntrackError(f"{folder} holds another sequence of that name: choose a new folder")
        return
    part = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    width, height = sequence.picture_size() or (0, 0)
    about = f"[METAINFO]\nresolution: ({width}, {height})\nattributes: {sequence.attributes}\n"
    (part / "meta_info.ini").write_text(about)
    for number, frame in enumerate(sequence.frames, 1):
        _, data = cv2.imencode(".jpg", frame, _JPEG)
        (part / f"{number:08d}.jpg").write_bytes(data.tobytes())
    (part / "groundtruth.txt").write_text(boxes)
    np.savetxt(part / "absence.label", sequence.absent, "%d")
    part.rename(folder)


def _replace(path: Path, text: str) -> None:
    part = path.with_name(f"{path.name}.part")
    part.write_text(text)
    part.replace(path)
