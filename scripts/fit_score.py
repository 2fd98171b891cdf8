"""Fit the score of the filter: the chance that IoU > ½, from the peak's height and sharpness.

    python scripts/fit_score.py SHARED

Uses the validation clips of `folder:SHARED/data/train` and synthetic sequences with occlusions,
exits and look-alikes; prints what belongs into the presets under [score].
"""

import sys
from pathlib import Path

import numpy as np

import entrack
from entrack.box import iou
from entrack.config import read
from entrack.datasets import open_dataset
from entrack.datasets.sequence import Sequence
from entrack.datasets.synthetic import hard
from entrack.filter import Peak
from entrack.model import load_model
from entrack.tracker import Tracker
from entrack.trunk import load_trunk
from entrack.trunks.train import TrunkTrainConfig


class Witness(Tracker):
    """A tracker that keeps the last peak."""

    def _score(self, peak: Peak) -> float:
        self.peak = peak
        return super()._score(peak)


def observe(tracker: Witness, sequence: Sequence, frames: int) -> list[tuple[float, float, bool]]:
    """(height, log PSR, IoU > ½) of each frame; an absent target overlaps with nothing."""
    tracker.init(sequence.frames[0], sequence.boxes[0])
    rows: list[tuple[float, float, bool]] = []
    for t in range(1, min(frames, len(sequence))):
        box = tracker.update(sequence.frames[t]).box
        hit = not sequence.absent[t] and iou(box, sequence.boxes[t]) > 0.5
        rows.append((tracker.peak.height, np.log(max(tracker.peak.psr, 1e-3)), bool(hit)))
    return rows


def logistic(x: np.ndarray, y: np.ndarray, ridge: float = 1e-2) -> np.ndarray:
    """Weights of a logistic regression, the last one the bias, by Newton's method."""
    x = np.column_stack([x, np.ones(len(x))])
    w = np.zeros(x.shape[1])
    for _ in range(50):
        p = 1 / (1 + np.exp(-x @ w))
        hessian = (x * (p * (1 - p))[:, None]).T @ x + ridge * np.eye(len(w))
        w += np.linalg.solve(hessian, x.T @ (y - p) - ridge * w)
    return w


def main(shared: Path) -> None:
    """Print the weights and how well they are calibrated."""
    model = load_model("cf")
    tracker = Witness(model.config, load_trunk(model.trunk))
    presets = Path(entrack.__file__).parent / "presets"
    names = read(TrunkTrainConfig, presets / "trunk.toml").material.validation
    clips = open_dataset(f"folder:{shared / 'data' / 'train'}")
    rows = [row for name in names for row in observe(tracker, clips.read(name), 200)]
    made = [row for s in hard(24, seed=5000) for row in observe(tracker, s, 150)]
    x = np.array([row[:2] for row in rows + made])
    y = np.array([row[2] for row in rows + made], float)
    peak, psr, bias = logistic(x, y)
    print(f"[score]\nbias = {bias:.2f}\npeak = {peak:.2f}\npsr = {psr:.2f}")
    p = 1 / (1 + np.exp(-(x @ [peak, psr] + bias)))
    bins = np.clip((p * 15).astype(int), 0, 14)
    gaps = [abs(p[bins == b].mean() - y[bins == b].mean()) * (bins == b).mean() for b in set(bins)]
    order = np.argsort(p)
    ranks = np.empty(len(p))
    ranks[order] = np.arange(1, len(p) + 1)
    good = y.sum()
    area = (ranks[y == 1].sum() - good * (good + 1) / 2) / (good * (len(y) - good))
    print(f"# {len(rows)} + {len(made)} frames, share with IoU > .5: {y.mean():.3f}")
    print(f"# expected calibration error {sum(gaps):.3f}, area under the ROC curve {area:.3f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
