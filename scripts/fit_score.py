"""Fit the score that `default` and `longterm` ship with, and print it as TOML; 15 minutes.

python scripts/fit_score.py CLIPS                    # the 48 clips of the training data, a folder
python scripts/fit_score.py CLIPS --sigma longterm   # σ of a model, which has that score already
"""

import argparse
from collections.abc import Callable, Iterator
from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass, replace

import cv2
import numpy as np

import entrack
from entrack.calibrate import SIGNALS, fit_spread, logistic, observe
from entrack.datasets import open_dataset
from entrack.datasets.frames import Image
from entrack.datasets.sequence import Sequence
from entrack.evaluation.ope import valid

NAMED = ("psr", "unseen", "rival", "leap", "swap", "off")
"""The signals that count; others say less of footage that was left out of the fit."""
SIDES = {
    "default": ("peak", "first", "colour", "leap", "sigma"),
    "longterm": ("peak", "first", "colour", "leap", "sigma", "lost", "gone"),
}
"""What σ is made of."""
HELD = -2.3267
"""`bias` + `lost`: what a box that is held while its target is searched begins with."""
MADE = "synthetic:hard,seed=1000,count=96"
AFTER, BROKEN = (2, 15), 5
"""Frames after which a picture breaks, and for how many."""
SHARES = (1.0, 1.0, 0.25, 0.1)
"""How much clips, made sequences, broken pictures, and those in grey count."""


def broken(clips: list[Sequence], rng: np.random.Generator) -> Iterator[Sequence]:
    """Clips that go on with pictures in which no target is to be seen."""

    def black(picture: Image) -> Image:
        return np.zeros_like(picture)

    def noise(picture: Image) -> Image:
        return rng.integers(0, 256, picture.shape, dtype=np.uint8)

    def another(picture: Image) -> Image:
        frames = clips[int(rng.integers(len(clips)))].frames
        return cv2.resize(frames[int(rng.integers(len(frames)))], picture.shape[1::-1])

    def blurred(picture: Image) -> Image:
        return cv2.GaussianBlur(picture, (0, 0), max(picture.shape) / 12)

    kinds: tuple[Callable[[Image], Image], ...] = (black, noise, another, blurred)
    for clip in clips:
        for after in AFTER:
            for kind in kinds:
                start = int((valid(clip.boxes) & ~clip.absent).argmax())
                held = range(start, min(start + after + 1, len(clip), len(clip.frames)))
                frames = [clip.frames[k] for k in held]
                frames += [kind(frames[-1]) for _ in range(BROKEN)]
                boxes = np.vstack([clip.boxes[held], np.full((BROKEN, 4), np.nan)])
                absent = np.append(clip.absent[held], [True] * BROKEN)
                yield Sequence(f"{clip.name}-{after}-{kind.__name__}", frames, boxes, absent)


@dataclass(frozen=True)
class Grey(SequenceOf[Image]):
    """Frames without colours: there a tint says nothing, which the others have to make up for."""

    frames: SequenceOf[Image]

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Image:
        grey = cv2.cvtColor(self.frames[index], cv2.COLOR_BGR2GRAY)
        return cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)


def score(clips: list[Sequence]) -> dict[str, float]:
    """Track all and fit; of `[score]`, all but `gone`."""
    tracker = entrack.load("default", threads=1)
    grey = [replace(clip, frames=Grey(clip.frames)) for clip in clips]
    pictures = [broken(some, np.random.default_rng(0)) for some in (clips, grey)]
    seen = observe(tracker, [clips, open_dataset(MADE), *pictures])
    counts = np.array(SHARES)[seen.kinds] / np.bincount(seen.kinds)[seen.kinds]
    chosen = [SIGNALS.index(name) for name in NAMED]
    weights, bias = logistic(seen.signals[:, chosen], seen.hits, counts=counts / counts.mean())
    return {"bias": bias, **dict(zip(NAMED, weights.tolist(), strict=True)), "lost": HELD - bias}


def sigma(clips: list[Sequence], model: str) -> dict[str, float]:
    """Track with a model and fit: `[spread]`."""
    seen = observe(entrack.load(model, threads=1), [clips, open_dataset(MADE)])
    named = np.isin(SIGNALS, SIDES[model])
    found = fit_spread(replace(seen, signals=np.where(named, seen.signals, 0)))
    return {name: found[name] for name in ("bias", *SIDES[model])}


def main() -> None:
    """Track all, fit, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("clips", metavar="CLIPS")
    parser.add_argument("--sigma", choices=tuple(SIDES), help="fit [spread] instead")
    args = parser.parse_args()
    clips = list(open_dataset(f"folder:{args.clips}"))
    found = sigma(clips, args.sigma) if args.sigma else score(clips)
    for name, weight in found.items():
        print(f"{name} = {weight:.4f}")


if __name__ == "__main__":
    main()
