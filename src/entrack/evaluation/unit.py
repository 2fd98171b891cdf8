"""The unit of an evaluation: one tracker on one sequence, written to files when it is complete."""

import random
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from entrack.datasets import Dataset, Sequence, open_dataset
from entrack.errors import EntrackError
from entrack.evaluation import ope, raw, trajectory, vot
from entrack.evaluation.certainty import Certainty
from entrack.evaluation.region import Regions
from entrack.files import write_bytes, writing
from entrack.peers import Contender, Peer

Floats = NDArray[np.float64]
REPETITIONS = 15
"""Supervised runs of one sequence, unless the first three are identical."""
_IDENTICAL = 3
_REPORT_EVERY = 0.5  # seconds


@dataclass(frozen=True)
class Unit:
    """One tracker on one sequence.

    Parameters
    ----------
    data
        The dataset as `open_dataset` takes it.
    folder
        Where the tracker's results for the dataset go.
    supervised
        Whether the tracker is started again after a failure (VOT).
    threads
        Threads that the tracker may use.
    toolkit
        Whether vot-toolkit's overlap says what a failure is, not region.c's.
    """

    data: str
    sequence: str
    contender: Contender
    folder: Path
    supervised: bool
    threads: int = 1
    toolkit: bool = False

    def anywhere(self) -> "Unit":
        """Return it with paths that do not depend on the working folder."""
        form, _, place = self.data.partition(":")
        data = f"{form}:{Path(place).expanduser().resolve()}"
        return replace(self, data=data, folder=self.folder.resolve())

    def with_model(self, places: dict[str, str]) -> "Unit":
        """Return it with its model where it lies on this machine; see `cluster.Payload`."""
        spec = self.contender.spec
        return replace(self, contender=replace(self.contender, spec=places.get(spec, spec)))

    @property
    def failed(self) -> Path:
        """The file that says why the unit failed, if it did."""
        return self.folder / f"{self.sequence}.failed.txt"

    def repetition(self, number: int) -> Path:
        """Result file of a supervised run, as VOT lays it out."""
        return self.folder / "baseline" / self.sequence / f"{self.sequence}_{number:03d}.txt"

    @property
    def results(self) -> Path:
        """Result file of a one-pass run."""
        return self.folder / f"{self.sequence}.txt"

    def done(self, frames: int) -> bool:
        """Whether the results are complete; those of another number of frames are removed."""
        runs: list[bytes] = []
        repetitions = map(self.repetition, range(1, REPETITIONS + 1))
        for path in repetitions if self.supervised else [self.results]:
            if path.is_file():
                run = path.read_bytes()
                if run.count(b"\n") == frames:
                    runs.append(run)
                else:
                    path.unlink()
        return _complete(runs) if self.supervised else bool(runs)

    def work(self, frames: int) -> int:
        """Frames that have to be tracked, if three repetitions turn out to be identical."""
        return frames * (_IDENTICAL if self.supervised else 1)


def _complete(runs: list[bytes]) -> bool:
    return len(runs) >= REPETITIONS or (len(runs) >= _IDENTICAL and len(set(runs)) == 1)


def run_unit(unit: Unit, report: Callable[[int], None]) -> None:
    """Track one sequence and write what came out; `report` gets the frames done so far.

    Raises
    ------
    EntrackError
        Which frame failed and why.
    """
    # OpenCV's MIL, Boosting and TLD draw random numbers: the same ones whatever ran before.
    random.seed(0)
    np.random.seed(0)  # noqa: NPY002
    cv2.setRNGSeed(0)
    cv2.setNumThreads(unit.threads)
    dataset = _dataset(unit.data)
    run = _Run(_peer(unit), dataset.read(unit.sequence), report)
    try:
        if len(run.sequence.frames) < len(run.sequence):
            counts = f"{len(run.sequence.frames)} pictures for {len(run.sequence)} boxes"
            raise EntrackError(f"{unit.sequence} has {counts}")
        if unit.supervised:
            _supervised(unit, run)
        else:
            boxes, times = run.one_pass()
            _write(unit.folder / f"{unit.sequence}.time.txt", _lines(times))
            if run.said:
                _write(unit.folder / f"{unit.sequence}.score.csv", run.said.write())
            _write(unit.results, raw.write_boxes(boxes, dataset.origin))
    except Exception as error:
        where = f"failed at frame {run.frame + 1} of {len(run.sequence)}"
        kind = "" if isinstance(error, EntrackError) else f"{type(error).__name__}: "
        raise EntrackError(f"{where}: {kind}{error}") from error


def _supervised(unit: Unit, run: "_Run") -> None:
    runs: list[bytes] = []
    for number in range(1, REPETITIONS + 1):
        path = unit.repetition(number)
        if not path.is_file():
            result, times = run.supervised(unit.toolkit)
            _write(path.with_name(f"{path.stem}_time.value"), _lines(times))
            _write(path, trajectory.write_text(result))
        runs.append(path.read_bytes())
        if _complete(runs):
            return


class _Run:
    """A tracker on a sequence, with a clock around the tracker alone."""

    def __init__(self, peer: Peer, sequence: Sequence, report: Callable[[int], None]) -> None:
        self.peer, self.sequence, self.report = peer, sequence, report
        self.frame, self._frames, self._reported = 0, 0, time.perf_counter()
        self._times: Floats = np.empty(0)
        self.said = Certainty.silent(len(sequence))

    def one_pass(self) -> tuple[Floats, Floats]:
        """Boxes (T, 4) and seconds (T,); NaN rows before the first frame with ground truth."""
        sequence = self.sequence
        boxes = np.full((len(sequence), 4), np.nan)
        self._times = np.zeros(len(sequence))
        first = np.flatnonzero(ope.valid(sequence.boxes))
        if not len(first):
            raise EntrackError(f"{sequence.name} has no frame with a valid box")
        boxes[first[0]] = self._start(int(first[0]))
        for frame in range(int(first[0]) + 1, len(sequence)):
            boxes[frame] = self._follow(frame, (4,))
        return boxes, self._times

    def supervised(self, toolkit: bool) -> tuple[vot.Trajectory, Floats]:
        """A run that starts anew five frames after the overlap is 0, as VOT does."""
        sequence, length = self.sequence, len(self.sequence)
        truth = Regions.of(sequence.boxes if sequence.polygons is None else sequence.polygons)
        size = sequence.picture_size()
        codes = np.full(length, vot.UNKNOWN)
        regions = Regions(np.full((length, 8), np.nan), np.zeros(length, bool))
        self._times = np.zeros(length)
        frame = 0
        while frame < length:
            self._start(frame)
            codes[frame] = vot.START
            frame += 1
            while frame < length:
                answer = Regions.of([self._follow(frame, (4,), (8,))])
                here = truth[frame : frame + 1]
                overlap = vot.overlaps(answer, here, size, toolkit=toolkit)[0]
                if not overlap > 0:
                    codes[frame] = vot.FAILURE
                    frame += vot.SKIP
                    break
                codes[frame] = vot.REGION
                regions.corners[frame] = answer.corners[0]
                regions.upright[frame] = answer.upright[0]
                frame += 1
        return vot.Trajectory(codes, regions), self._times

    def _start(self, frame: int) -> Floats:
        self.frame = frame
        box = self.sequence.boxes[frame]
        image = self.sequence.frames[frame]
        started = time.perf_counter()
        self.peer.init(image, box.copy())
        self._clock(frame, started)
        return box

    def _follow(self, frame: int, *shapes: tuple[int]) -> Floats:
        self.frame = frame
        image = self.sequence.frames[frame]
        started = time.perf_counter()
        answer = self.peer.update(image)
        self._clock(frame, started)
        try:
            box = np.asarray(getattr(answer, "box", answer), np.float64)
        except (TypeError, ValueError):
            box = np.empty(0)
        if box.shape not in shapes:
            raise EntrackError(f"the tracker returned {answer!r}, expected a box (x, y, w, h)")
        self.said.hear(frame, answer)
        return box

    def _clock(self, frame: int, started: float) -> None:
        now = time.perf_counter()
        self._times[frame] = now - started
        self._frames += 1
        if now - self._reported > _REPORT_EVERY:
            self._reported = now
            self.report(self._frames)


@lru_cache(maxsize=4)
def _dataset(spec: str) -> Dataset:
    return open_dataset(spec)


@lru_cache(maxsize=1)
def _model(contender: Contender, threads: int) -> Peer:
    return contender.make(threads)


def _peer(unit: Unit) -> Peer:
    """The unit's tracker: models are kept, as `init` resets them; others are made anew."""
    if unit.contender.kind == "model":
        return _model(unit.contender, unit.threads)
    return unit.contender.make(unit.threads)


def _lines(seconds: Floats) -> str:
    return "".join(f"{value:.8f}\n" for value in seconds.tolist())


def _write(path: Path, text: str) -> None:
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path, text.encode())
