"""What is wrong with a dataset's folder: which file, what was looked for, whether it is scored."""

from collections.abc import Iterator
from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from entrack import box
from entrack.datasets.frames import ImageFiles, NumberedImages, VideoFrames, numbered_pictures
from entrack.datasets.sequence import Dataset, Sequence
from entrack.errors import EntrackError


@dataclass(frozen=True)
class Finding:
    """Something about one sequence, or about the dataset where that is "".

    Parameters
    ----------
    kind
        "missing": not there, so not scored. "unusable": there, but its ground truth cannot be
        scored. "error": no tracker can run on it; given results are scored. "note": as published,
        or worth a look; it is scored.
    """

    kind: Literal["missing", "unusable", "error", "note"]
    sequence: str
    text: str

    @property
    def scored(self) -> bool:
        """Whether the sequence can be scored in spite of it."""
        return self.kind in ("error", "note")

    def __str__(self) -> str:
        what = "scored" if self.scored else "not scored"
        what = "cannot be tracked" if self.kind == "error" else what
        name = f"{self.sequence}: " if self.sequence else ""
        return f"{self.kind}: {name}{self.text} ({what})"


def check(dataset: Dataset, *, every_frame: bool = False) -> Iterator[Finding]:
    """Look at every sequence; `every_frame` decodes each picture instead of looking at its ends."""
    for name in dataset.missing:
        yield Finding("missing", name, f"there is no {dataset.root / dataset.truth(name)}")
    for name in dataset.names:
        try:
            sequence = dataset.read(name)
        except EntrackError as error:
            yield Finding("unusable", name, str(error))
            continue
        yield from _check_boxes(sequence, dataset)
        yield from _check_frames(sequence, every_frame)


def _check_boxes(sequence: Sequence, dataset: Dataset) -> Iterator[Finding]:
    name, boxes = sequence.name, sequence.boxes
    invalid = ~(np.isfinite(boxes).all(axis=1) & (boxes[:, 2:] > 0).all(axis=1))
    if invalid.all():
        yield Finding("unusable", name, "no frame has a valid box")
        return
    official = dataset.lengths.get(name)
    if official and len(sequence) != official:
        yield Finding("note", name, f"{len(sequence)} boxes, the official list has {official}")
    unexplained = invalid & ~sequence.absent
    if unexplained.any():
        yield Finding("note", name, f"zero or NaN boxes in {spans(unexplained)}")
    size = _size(sequence)
    if size is None:
        return
    shown = boxes[~invalid]
    beyond = (shown[:, :2] + shown[:, 2:] - size).max()
    if shown[:, :2].min() >= 1 and 0 < beyond <= 1:
        counts = f"from {dataset.origin + 1}; {dataset.format} counts from {dataset.origin}"
        yield Finding("note", name, f"boxes look as if they counted pixels {counts}")
    elif shown[:, :2].min() == -1 and dataset.origin == 1:
        counts = f"from 0; {dataset.format} counts from 1"
        yield Finding("note", name, f"boxes look as if they counted pixels {counts}")
    outside = ~invalid & (box.area(box.clip(np.nan_to_num(boxes), *size)) == 0)
    if outside.any():
        where = spans(outside)
        yield Finding("note", name, f"boxes outside the {size[0]}×{size[1]} picture in {where}")


def _size(sequence: Sequence) -> tuple[int, int] | None:
    try:
        return sequence.picture_size()
    except (EntrackError, IndexError):
        return None  # the frames' own check says why


def _check_frames(sequence: Sequence, every_frame: bool) -> Iterator[Finding]:
    name, frames = sequence.name, sequence.frames
    if isinstance(frames, VideoFrames):
        yield from _check_video(name, frames, every_frame)
        return
    if not isinstance(frames, (NumberedImages, ImageFiles)):
        return
    files = frames.files if isinstance(frames, NumberedImages) else frames
    gone = [path for path in files.paths if not path.is_file()]
    if len(files) == 0 or len(gone) == len(files):
        folder = frames.folder if isinstance(frames, NumberedImages) else "the annotations"
        looked_for = f": looked for {gone[0].name} to {gone[-1].name}" if gone else ""
        yield Finding("error", name, f"no pictures in {folder}{looked_for}")
        return
    if gone:
        yield Finding("error", name, f"{len(gone)} of {len(files)} pictures missing: {_some(gone)}")
    if len(files) < len(sequence):
        yield Finding("error", name, f"{len(files)} pictures for {len(sequence)} boxes")
    if isinstance(frames, NumberedImages) and frames.first == 1:
        more = len(numbered_pictures(frames.folder)) + len(gone) - len(sequence)
        if more > 0:
            text = f"{frames.folder} has {more} more pictures than there are boxes"
            yield Finding("note", name, text)
    there = [i for i, path in enumerate(files.paths) if path.is_file()]
    broken = [files.paths[i] for i in there if _broken(files, i, every_frame)]
    if broken:
        yield Finding("error", name, f"unreadable pictures: {_some(broken)}")


def _check_video(name: str, video: VideoFrames, every_frame: bool) -> Iterator[Finding]:
    try:
        found = video.found(decode=every_frame)
    except EntrackError as error:
        yield Finding("error", name, str(error))
        return
    if found != len(video):
        kind = "error" if found < len(video) else "note"
        yield Finding(kind, name, f"{video.path} has {found} frames for {len(video)} boxes")


_ENDS = {".jpg": (b"\xff\xd8", b"\xff\xd9"), ".png": (b"\x89PNG", b"IEND\xaeB`\x82")}


def _broken(files: ImageFiles, index: int, decode: bool) -> bool:
    """Whether a picture is cut off or none; the first and the last are decoded in any case."""
    path = files.paths[index]
    if decode or index in (0, len(files) - 1) or path.suffix.lower() not in _ENDS:
        try:
            files[index]
        except EntrackError:
            return True
        return False
    head, tail = _ENDS[path.suffix.lower()]
    with path.open("rb") as file:
        start = file.read(len(head))
        file.seek(0, 2)
        file.seek(max(file.tell() - 64, 0))  # some writers pad a little after the end
        return start != head or tail not in file.read()


def _some(paths: SequenceOf[Path]) -> str:
    return ", ".join(map(str, paths[:3])) + (" …" if len(paths) > 3 else "")


def spans(flags: ArrayLike) -> str:
    """Frames where `flags` (T,) are true, as a person reads them, counted from 1.

    >>> spans([True, False, True, True, True])
    'frames 1, 3–5'
    """
    padded = np.concatenate([[False], np.asarray(flags, bool), [False]]).astype(int)
    edges = np.flatnonzero(np.diff(padded)).reshape(-1, 2)
    parts = [f"{a + 1}" if b - a == 1 else f"{a + 1}–{b}" for a, b in edges.tolist()]
    return f"frames {', '.join(parts[:5])}" + (" …" if len(parts) > 5 else "")
