"""Raw results: boxes and trajectories of trackers, ours or somebody else's, read from files.

Read without being told the layout: OTB text (`<name>.txt`), GOT-10k (`<name>/<name>_001.txt`),
pysot, pytracking (tab-separated integers), VOT text and binary (`baseline/<name>/<name>_001.txt` or
`.bin`). Sequences are found by name however it is spelt (`Human4-2`, `human4_2`, `uav_bike1`).
"""

import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from entrack.datasets import lists
from entrack.datasets.sequence import Dataset, Sequence
from entrack.datasets.texts import Texts, name_key
from entrack.errors import EntrackError
from entrack.evaluation.certainty import Certainty
from entrack.evaluation.trajectory import read_binary, read_text
from entrack.evaluation.vot import Trajectory

Floats = NDArray[np.float64]
_REPETITION = re.compile(r"(.+)_(\d{3})")
_TIMES = re.compile(r"(.+?)(?:_(\d{3}))?[._]time")
_SAID = re.compile(r"(.+)\.score\.csv|(.+?)(?:_(\d{3}))?_confidence\.value")


_Files = dict[str, dict[int, str]]


class Results:
    """One tracker's results in a folder or a zip file."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._texts = Texts(root)

    def files(self, name: str) -> list[str]:
        """Files of a sequence, one a repetition; empty where there are none."""
        for key in _spellings(name):
            if found := self._index[0].get(key):
                return [found[repetition] for repetition in sorted(found)]
        return []

    def boxes(self, sequence: Sequence, dataset: Dataset) -> list[Floats]:
        """Boxes (T', 4) of each repetition, as the program has them, whatever their number."""
        tables = [self._texts.table(file, [4]) for file in self.files(sequence.name)]
        return [table - (dataset.origin, dataset.origin, 0, 0) for table in tables]

    def trajectories(self, name: str) -> list[Trajectory]:
        """Supervised runs of a VOT sequence, one a repetition."""
        return [
            read_binary(self._texts.bytes(file), str(self.root / file))
            if file.endswith(".bin")
            else read_text(self._texts.text(file), str(self.root / file))
            for file in self.files(name)
        ]

    def times(self, name: str) -> Floats:
        """Seconds of each frame but the first; empty where they are not known."""
        for key in _spellings(name):
            if found := self._index[1].get(key):
                lines = self._texts.text(found[min(found)]).splitlines()
                # GOT-10k has a column a repetition; VOT leaves the frames after a failure empty.
                first = [line.split(",")[0].split() for line in lines[1:]]
                try:
                    seconds = np.array([float(words[0]) for words in first if words])
                except ValueError:
                    return np.empty(0)
                return seconds[np.isfinite(seconds) & (seconds > 0)]
        return np.empty(0)

    def certainty(self, name: str, frames: int) -> Certainty:
        """What the tracker said of itself in so many frames; silence where there is no file."""
        for key in _spellings(name):
            if found := self._index[2].get(key):
                file = found[min(found)]
                text, where = self._texts.text(file), str(self.root / file)
                read = Certainty.read if file.endswith(".csv") else Certainty.of_scores
                said = read(text, where)
                if len(said) != frames:
                    raise EntrackError(f"{where} has {len(said)} frames, the boxes {frames}")
                return said
        return Certainty.silent(frames)

    @cached_property
    def _index(self) -> tuple[_Files, _Files, _Files]:
        """Files of results, of times and of scores by sequence and repetition."""
        results: _Files = defaultdict(dict)
        times: _Files = defaultdict(dict)
        said: _Files = defaultdict(dict)
        for file in sorted(self._texts.names):
            path = PurePosixPath(file)
            if scored := _SAID.fullmatch(path.name):
                said[name_key(scored[1] or scored[2])].setdefault(int(scored[3] or 1), file)
                continue
            if path.suffix not in (".txt", ".bin", ".value"):
                continue
            if timed := _TIMES.fullmatch(path.stem):
                times[name_key(timed[1])].setdefault(int(timed[2] or 1), file)
            elif path.suffix != ".value":
                for key, repetition in _keys(path):
                    other = results[key].setdefault(repetition, file)
                    if other != file and PurePosixPath(other).suffix == path.suffix:
                        raise EntrackError(
                            f"{self.root} has two results for one sequence: {other} and {file}"
                        )
        return results, times, said


def _keys(path: PurePosixPath) -> Iterator[tuple[str, int]]:
    """Sequence and repetition that a file may belong to: `bag_001` is bag's first, or bag_001."""
    numbered = _REPETITION.fullmatch(path.stem)
    if numbered and name_key(path.parent.name) == name_key(numbered[1]):
        yield name_key(numbered[1]), int(numbered[2])
    else:
        yield name_key(path.stem), 1


def _spellings(name: str) -> list[str]:
    return [name_key(n) for n in (name, f"uav_{name}", *lists.aliases(name))]


def fit_length(
    boxes: Floats, sequence: Sequence, where: str, *, allow_partial: bool
) -> tuple[Sequence, Floats]:
    """Make results and ground truth of one length, or say why not.

    Raises
    ------
    EntrackError
        If the lengths differ, unless `allow_partial`: then the frames that both have remain.
    """
    expected, found = len(sequence), len(boxes)
    if found > expected and sequence.name in lists.longer_results():
        return sequence, boxes[:expected]
    if found == expected:
        return sequence, boxes
    if not allow_partial:
        raise EntrackError(
            f"{where}: results of {found} frames for {sequence.name} with {expected}; "
            "--allow-partial scores the frames that both have"
        )
    common = min(found, expected)
    return sequence.first(common), boxes[:common]


def write_boxes(boxes: Floats, origin: int) -> str:
    r"""Boxes (T, 4) as lines `x,y,w,h` in a dataset's own convention.

    >>> write_boxes(np.array([[0, 0, 10.5, 20]]), origin=1)
    '1.0000,1.0000,10.5000,20.0000\n'
    """
    rows = boxes + np.array([origin, origin, 0, 0])
    return "".join(f"{x:.4f},{y:.4f},{w:.4f},{h:.4f}\n" for x, y, w, h in rows.tolist())
