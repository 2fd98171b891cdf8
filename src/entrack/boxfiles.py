"""Boxes of every frame, to files that other tools read: CSV, JSON lines, OTB text."""

import json
import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Self

from entrack.errors import EntrackError
from entrack.files import unfinished, writing
from entrack.tracker import Estimate
from entrack.video import Frame

COLUMNS = (
    *("frame", "time", "object", "x", "y", "w", "h", "score", "lost"),
    *("sigma_x0", "sigma_y0", "sigma_x1", "sigma_y1", "entropy", "ms"),
)
"""Of the CSV: `frame` is 0-based in the source, `time` in seconds, `object` counts from 1 in the
order of the boxes given, boxes and sigma are pixels. What a model does not tell is empty."""


class BoxWriter:
    """Write the estimates of each frame; use it in a `with` block or close it.

    The suffix chooses the format: `.csv`, see `COLUMNS`; `.jsonl`, an object a line with the same
    names, and `box`, `sigma` and `search` as lists; `.txt`, OTB's 1-based `x,y,w,h` a line. OTB has
    one target a file: several objects go to `<name>_1.txt`, `<name>_2.txt`, …

    Each frame is on disk when `write` returns. Until it is closed a file is called `<path>.part`;
    it gets its name, with the whole rows that it has, when the block ends by an error, too. Without
    a single row no file is made.

    Raises
    ------
    EntrackError
        For another suffix, or if a file cannot be written: on opening, writing or closing.
    """

    def __init__(self, path: str | Path, objects: int = 1) -> None:
        path = Path(path)
        suffix = path.suffix.lower()
        if suffix not in _FORMATS:
            raise EntrackError(f"boxes are written as {' '.join(_FORMATS)}, found {path.name}")
        self.paths = [path]
        """The files that are made."""
        if suffix == ".txt" and objects > 1:
            self.paths = [path.with_stem(f"{path.stem}_{n + 1}") for n in range(objects)]
        header, self._row = _FORMATS[suffix]
        self._written = False
        self._files: list[IO[str]] = []
        self._end = ExitStack()
        with ExitStack() as undo:
            undo.enter_context(self)
            for path in self.paths:
                with writing(path):
                    file = unfinished(path).open("w", encoding="utf-8", newline="")
                    self._files.append(file)
                    self._end.callback(self._finish, path, file)
                    file.write(header)
            undo.pop_all()

    def write(self, frame: Frame, estimates: Sequence[Estimate | None]) -> None:
        """Add one frame: the estimates of all objects, in the order of the boxes given.

        An object of which nothing is known in this frame, None, has no row.
        """
        self._written = True
        for number, estimate in enumerate(estimates):
            if estimate is None:
                continue
            place = number % len(self._files)  # one file for all, or one each
            with writing(self.paths[place]):
                self._files[place].write(self._row(frame, number + 1, estimate) + "\n")
                self._files[place].flush()

    def close(self) -> None:
        """Finish the files and give them their names."""
        self._end.close()

    def _finish(self, path: Path, file: IO[str]) -> None:
        part = unfinished(path)
        with writing(path):
            try:
                file.close()
            except OSError:
                _drop_torn_row(part)
                raise
            finally:
                part.replace(path) if self._written else part.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _drop_torn_row(path: Path) -> None:
    os.truncate(path, path.read_bytes().rfind(b"\n") + 1)


def _csv(frame: Frame, number: int, e: Estimate) -> str:
    sigma = [""] * 4 if e.sigma is None else [f"{s:.3f}" for s in e.sigma]
    entropy = "" if e.entropy is None else f"{e.entropy:.4f}"
    box = (f"{side:.3f}" for side in e.box)
    cells = (str(frame.index), f"{frame.time:.6f}", str(number), *box, f"{e.score:.4f}")
    return ",".join((*cells, str(int(e.lost)), *sigma, entropy, f"{e.ms:.2f}"))


def _json(frame: Frame, number: int, e: Estimate) -> str:
    row = {
        "frame": frame.index,
        "time": round(frame.time, 6),
        "object": number,
        "box": e.box.round(3).tolist(),
        "score": round(float(e.score), 4),
        "lost": bool(e.lost),
        "sigma": None if e.sigma is None else e.sigma.round(3).tolist(),
        "entropy": None if e.entropy is None else round(e.entropy, 4),
        "search": e.search.round(3).tolist(),
        "ms": round(e.ms, 2),
    }
    return json.dumps(row)


def _otb(frame: Frame, number: int, e: Estimate) -> str:
    x, y, w, h = e.box
    return f"{x + 1:.3f},{y + 1:.3f},{w:.3f},{h:.3f}"


_FORMATS: dict[str, tuple[str, Callable[[Frame, int, Estimate], str]]] = {
    ".csv": (",".join(COLUMNS) + "\n", _csv),
    ".jsonl": ("", _json),
    ".txt": ("", _otb),
}
SUFFIXES = tuple(_FORMATS)
"""Of the files that can be written."""
