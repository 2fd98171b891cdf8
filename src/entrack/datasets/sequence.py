"""A video with ground truth, whatever benchmark it came from."""

from collections.abc import Callable, Mapping
from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from entrack.datasets.frames import PICTURES, Image, ImageFiles
from entrack.errors import EntrackError

__all__ = ["PICTURES", "Dataset", "Image", "ImageFiles", "Sequence"]


def _no_flags() -> NDArray[np.bool_]:
    return np.zeros(0, bool)


@dataclass(frozen=True)
class Sequence:
    """One target in one video.

    Parameters
    ----------
    name
        Unique inside its dataset.
    frames
        T pictures, BGR uint8 (H, W, 3), read lazily by index.
    boxes
        (T, 4) float64, 0-based continuous `(x, y, w, h)`; NaN rows where the target has no box.
    absent
        (T,) bool, where the target is fully occluded or out of view by the dataset's own flags.
    polygons
        (T, 8) float64 corners for datasets of rotated boxes, else None.
    attributes
        The dataset's labels, such as "SV" or "occlusion".
    size
        Width and height of the pictures where the dataset says so; see `picture_size`.
    """

    name: str
    frames: SequenceOf[Image]
    boxes: NDArray[np.float64]
    absent: NDArray[np.bool_] = field(default_factory=_no_flags)
    polygons: NDArray[np.float64] | None = None
    attributes: tuple[str, ...] = ()
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        if self.absent.size == 0:
            object.__setattr__(self, "absent", np.zeros(len(self.boxes), bool))
        if len(self.absent) != len(self.boxes):
            raise EntrackError(
                f"{self.name}: {len(self.absent)} absence flags for {len(self.boxes)} boxes"
            )

    def __len__(self) -> int:
        return len(self.boxes)

    def first(self, count: int) -> "Sequence":
        """Return the sequence without the frames after the first `count`."""
        corners = None if self.polygons is None else self.polygons[:count]
        return replace(self, boxes=self.boxes[:count], absent=self.absent[:count], polygons=corners)

    def picture_size(self) -> tuple[int, int] | None:
        """Width and height, read from the first picture if need be; None without pictures."""
        if self.size is not None or not len(self.frames):
            return self.size
        height, width = self.frames[0].shape[:2]
        return width, height


def _no_lengths() -> dict[str, int]:
    return {}


@dataclass(frozen=True)
class Dataset(SequenceOf[Sequence]):
    """The sequences of one benchmark that are on this machine, read when asked for.

    Parameters
    ----------
    format
        "otb", "lasot", …
    root
        Where it is.
    names
        Sequences found there, in the benchmark's order.
    read
        Reads one of them.
    official
        Every sequence of the benchmark; empty where there is no such list.
    origin
        The number by which the benchmark's files call the first pixel: 1 or 0.
    lengths
        Frames of each sequence by the official list, where it says so.
    truth
        Where a sequence's ground truth is, or would be.
    made
        For sequences that are made when asked for: what opens them again, in place of a folder.
    """

    format: str
    root: Path
    names: tuple[str, ...]
    read: Callable[[str], Sequence]
    official: tuple[str, ...] = ()
    origin: int = 0
    lengths: Mapping[str, int] = field(default_factory=_no_lengths)
    truth: Callable[[str], str] = str
    made: str = ""

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, index: int) -> Sequence:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self.read(self.names[index])

    @property
    def place(self) -> str:
        """What opens it again after `FORMAT:`, from any folder."""
        return self.made or str(self.root.resolve())

    @property
    def missing(self) -> tuple[str, ...]:
        """Sequences of the official list that are not here."""
        here = set(self.names)
        return tuple(name for name in self.official if name not in here)
