"""Compare trackers on many short runs, paired: the yardstick of this project's choices.

    python benchmarks/variants.py default runs/mine/model --data folder:CLIPS
    python benchmarks/variants.py default mine:tracker --data synthetic:hard,seed=2000 --whole

Whole clips are a lottery: one that is lost early or late moves their mean by .05. So every clip is
started at several frames and followed for a while. What stands beside a tracker's mean overlap is
how far it is from the first tracker's, run by run, with its standard error: what is within two of
these is noise. Trackers are named as for `entrack evaluate`; see its --help.
"""

import argparse
import math
import tomllib
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from entrack import box as boxes
from entrack.datasets import open_dataset
from entrack.datasets.sequence import Sequence
from entrack.errors import EntrackError
from entrack.evaluation import ope
from entrack.evaluation.pool import run_units
from entrack.evaluation.uncertainty import calibration, calibration_error
from entrack.model import assets
from entrack.peers import Contender, parse_all

Place = tuple[str, str, int]
"""Dataset, clip and first frame."""
Found = dict[Place, np.ndarray]
"""What `follow` returned."""


@dataclass(frozen=True)
class Run:
    """One tracker, from one frame of one clip on."""

    contender: Contender
    data: str
    name: str
    start: int
    frames: int

    @property
    def place(self) -> Place:
        """What other trackers run on, too."""
        return self.data, self.name, self.start


@lru_cache(1)
def _kept(contender: Contender):
    return contender.make(threads=1)


def seen(sequence: Sequence) -> np.ndarray:
    """Frames (T,) in which the target is there, with a box; no others count."""
    return ope.valid(sequence.boxes) & ~sequence.absent


def follow(run: Run, report: Callable[[int], None]) -> np.ndarray:
    """Track; return overlap, score, and error of the size's logarithm, frame by frame (T, 3)."""
    sequence = open_dataset(run.data).read(run.name)
    tracker = _kept(run.contender) if run.contender.kind == "model" else run.contender.make(1)
    truths = np.where(seen(sequence)[:, None], sequence.boxes, np.nan)
    tracker.init(sequence.frames[run.start], truths[run.start])
    rows: list[tuple[float, float, float]] = []
    for t in range(run.start + 1, run.start + run.frames):
        answer = tracker.update(sequence.frames[t])
        box = np.asarray(getattr(answer, "box", answer), np.float64)
        overlap = float(ope.overlaps(truths[t : t + 1], box[None])[0])  # −1: no truth
        grown = math.log(boxes.area(box) / boxes.area(truths[t])) / 2 if overlap > 0 else math.nan
        rows.append((overlap, getattr(answer, "score", None), grown))
    return np.array(rows, np.float64)  # without a score, NaN


def validation() -> set[str]:
    """The clips that trunk and policy never saw; read without torch, which workers would load."""
    path = assets().parent / "presets" / "train-default.toml"
    return set(tomllib.loads(path.read_text())["data"]["validation"])


def starts(data: str, names: set[str], every: int, frames: int) -> list[tuple[str, int, int]]:
    """Clip, first frame and number of frames of every run; `every` 0 takes each clip whole."""
    runs: list[tuple[str, int, int]] = []
    dataset = open_dataset(data)
    for name in (n for n in dataset.names if not names or n in names):
        there = seen(dataset.read(name))
        for wanted in range(0, len(there), every or len(there)):
            end = min(wanted + frames, len(there)) if every else len(there)
            first = wanted + int(there[wanted:end].argmax())
            if there[wanted:end].any() and end - first >= (frames // 2 if every else 2):
                runs.append((name, first, end - first))
    return runs


def means(found: Found) -> dict[Place, float]:
    """Mean overlap of every run."""
    overlaps = {place: rows[rows[:, 0] >= 0, 0] for place, rows in found.items()}
    return {place: float(seen.mean()) for place, seen in overlaps.items() if len(seen)}


def line(found: Found) -> str:
    """What a tracker's runs come to."""
    every = np.concatenate(list(found.values()))
    every = every[every[:, 0] >= 0]
    scored = every[np.isfinite(every[:, 1])]
    error = calibration_error(calibration(scored[:, 1], scored[:, 0] > 0.5))
    off = every[np.isfinite(every[:, 2]), 2]
    overlap, none = np.mean(list(means(found).values())), (every[:, 0] == 0).mean()
    return (
        f"overlap {overlap:.4f}  none {none:.3f}"
        f"  size {off.mean():+.3f} rms {(off**2).mean() ** 0.5:.3f}  ece {error:.3f}"
    )


def gained(found: Found, first: Found) -> str:
    """How far it is from the first tracker, run by run, and which runs decide that."""
    mine, theirs = means(found), means(first)
    gain = {place: mine[place] - theirs[place] for place in mine}
    values = np.array(list(gain.values()))
    error = values.std(ddof=1) / len(values) ** 0.5 if len(values) > 1 else math.nan
    most = sorted(gain, key=lambda place: -abs(gain[place]))[:3]
    where = " ".join(f"{place[1]}@{place[2]} {gain[place]:+.2f}" for place in most)
    return f"{values.mean():+.4f} ± {error:.4f}  ({where})"


def main() -> None:
    """Run all, print a line a tracker."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("trackers", nargs="+", metavar="TRACKER")
    parser.add_argument("--data", nargs="+", required=True, metavar="FORMAT:DIR")
    parser.add_argument("--every", type=int, default=70, help="frames from start to start")
    parser.add_argument("--frames", type=int, default=70, help="frames of a run")
    parser.add_argument("--whole", action="store_true", help="each clip once, from end to end")
    parser.add_argument(
        "--validation", action="store_true", help="the clips that no shipped model was trained on"
    )
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    names = validation() if args.validation else set[str]()
    every = 0 if args.whole else args.every
    places = [(data, *run) for data in args.data for run in starts(data, names, every, args.frames)]
    contenders = parse_all(args.trackers)
    runs = [Run(contender, *place) for contender in contenders for place in places]
    found: dict[str, Found] = defaultdict(dict)
    for event in run_units(follow, runs, args.workers):
        run = runs[event.unit]
        if event.kind == "failed":
            why = str(event.value).partition("\n")[0]
            raise SystemExit(f"{run.contender.name} on {run.name}: {why}")
        if event.kind == "done":
            found[run.contender.name][run.place] = event.value
    first = found[contenders[0].name]
    for contender in contenders:
        mine = found[contender.name]
        beside = f"{len(mine)} runs" if mine is first else gained(mine, first)
        print(f"{contender.name:20} {line(mine)}  {beside}", flush=True)


if __name__ == "__main__":
    try:
        main()
    except EntrackError as error:
        raise SystemExit(str(error)) from None
