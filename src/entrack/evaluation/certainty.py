"""What a tracker says of itself, frame by frame: how sure it is, and where it looked."""

import csv
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from entrack.errors import EntrackError

Floats = NDArray[np.float64]
_WIDTHS = {"score": 1, "lost": 1, "sigma": 4, "entropy": 1, "search": 4}
COLUMNS = (
    *("score", "lost", "sigma_x0", "sigma_y0", "sigma_x1", "sigma_y1", "entropy"),
    *("search_x", "search_y", "search_w", "search_h"),
)
"""Columns of the files: `Estimate`'s fields of these names, in 0-based pixels where they are
lengths. What a tracker does not tell is empty, and so is the frame on which it was started."""


@dataclass(frozen=True)
class Certainty:
    """What was said in each frame of a sequence.

    Parameters
    ----------
    table
        (T, 11) float64, a column for each of `COLUMNS`; NaN where nothing was said.
    """

    table: Floats

    @classmethod
    def silent(cls, frames: int) -> "Certainty":
        """Nothing said yet in any frame."""
        return cls(np.full((frames, len(COLUMNS)), np.nan))

    def __len__(self) -> int:
        return len(self.table)

    def __bool__(self) -> bool:
        """Whether anything was said at all."""
        return bool(np.isfinite(self.table).any())

    def first(self, frames: int) -> "Certainty":
        """What was said in the first frames."""
        return Certainty(self.table[:frames])

    @property
    def score(self) -> Floats:
        """How sure it is (T,), in [0, 1] for trackers that are calibrated."""
        return self.table[:, 0]

    @property
    def lost(self) -> Floats:
        """1 where it says that it does not see its target, else 0: (T,)."""
        return self.table[:, 1]

    @property
    def sigma(self) -> Floats:
        """Standard deviations (T, 4) of the left, upper, right and lower side, pixels."""
        return self.table[:, 2:6]

    @property
    def confidence(self) -> Floats:
        """What frames may be ranked by (T,): the score, or else 0 where it says lost and 1 else.

        A tracker that says nothing at all is equally sure of everything.
        """
        said = np.where(np.isfinite(self.lost), 1 - self.lost, 1.0)
        return self.score if np.isfinite(self.score).any() else said

    def hear(self, frame: int, answer: Any) -> None:
        """Keep what an answer like `Estimate` says in one frame."""
        parts = [getattr(answer, name, None) for name in _WIDTHS]
        self.table[frame] = np.concatenate(
            [
                np.full(width, np.nan) if part is None else np.reshape(part, width).astype(float)
                for part, width in zip(parts, _WIDTHS.values(), strict=True)
            ]
        )

    def write(self) -> str:
        """The file's text: CSV with a heading."""
        rows = (
            ",".join("" if np.isnan(value) else f"{value:.9g}" for value in row)
            for row in self.table.tolist()
        )
        return "".join(f"{line}\n" for line in (",".join(COLUMNS), *rows))

    @classmethod
    def read(cls, text: str, where: str) -> "Certainty":
        r"""Read what `write` wrote, or any of its columns.

        >>> Certainty.read("score\n\n0.5\n", "a.score.csv").score
        array([nan, 0.5])

        Raises
        ------
        EntrackError
            For a column that is not known, a row of another length, or a word that is no number.
        """
        heading, *lines = text.splitlines() or [""]
        names = heading.split(",")
        unknown = [name for name in names if name not in COLUMNS]
        if unknown:
            expected = ", ".join(COLUMNS)
            raise EntrackError(f"{where} has a column {unknown[0]!r}, expected {expected}")
        said = cls.silent(len(lines))
        places = [COLUMNS.index(name) for name in names]
        for frame, row in enumerate(csv.reader(io.StringIO("\n".join(lines)))):
            # A row of one empty cell is an empty line.
            cells = row or [""] * len(names)
            if len(cells) != len(names):
                found = f"{len(cells)} values, expected {len(names)}"
                raise EntrackError(f"{where}, line {frame + 2}: {found}")
            try:
                said.table[frame, places] = [float(cell or "nan") for cell in cells]
            except ValueError as error:
                raise EntrackError(f"{where}, line {frame + 2}: {error}") from error
        return said

    @classmethod
    def of_scores(cls, text: str, where: str) -> "Certainty":
        """Read a score a line, which may be empty: VOT's `_confidence.value`."""
        return cls.read(f"score\n{text}", where)
