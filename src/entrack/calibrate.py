"""Fit a model's score to footage: the chance that IoU > ½, by what the tracker saw in a frame."""

import shutil
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import ArrayLike, NDArray

import entrack
from entrack.box import iou
from entrack.config import read_toml
from entrack.datasets import Sequence, open_dataset
from entrack.errors import EntrackError
from entrack.evaluation import ope
from entrack.evaluation import uncertainty as un
from entrack.files import write_bytes, writing
from entrack.model import load_model
from entrack.tracker import Estimate, Look, Tracker

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
_RIDGE = 1e-2  # in units of one frame: keeps weights finite where signals tell all
_FOLDS = 5


def _signal(name: str) -> Callable[[Look, Estimate], float]:
    return lambda look, _: look.evidence.get(name, 0.0)


SIGNALS: Mapping[str, Callable[[Look, Estimate], float]] = {
    name: _signal(name) for name in ("peak", "psr", "sigma")
}
"""What the score is made of: weights of these names are fields of `ScoreConfig`. 0 where a model
does not have a signal."""


@dataclass(frozen=True)
class Sightings:
    """N frames with a tracker's signals, and whether it was right.

    Parameters
    ----------
    signals
        (N, K), a column for each of `SIGNALS`.
    scores
        (N,) the tracker's own scores.
    overlaps
        (N,) IoU; 0 where the target is absent.
    groups
        (N,) number of the sequence.
    """

    signals: Floats
    scores: Floats
    overlaps: Floats
    groups: NDArray[np.int64]

    @property
    def hits(self) -> Flags:
        """Whether IoU > ½ (N,)."""
        return self.overlaps > 0.5


@dataclass(frozen=True)
class Quality:
    """How good a score is."""

    ece: float
    """Expected calibration error, of IoU > ½."""
    roc_auc: float | None
    """Area under the ROC curve as a detector of IoU > 0; None where every frame has that."""


@dataclass(frozen=True)
class Calibration:
    """What a fit found.

    Parameters
    ----------
    weights
        `bias` and a weight for each signal.
    share
        Share of frames with IoU > ½.
    before
        Of the model's own score.
    after
        Of the new score on sequences that it was not fitted to: each fifth of the sequences is
        scored by weights from the others. None for a single sequence.
    """

    weights: dict[str, float]
    sequences: int
    frames: int
    share: float
    before: Quality
    after: Quality | None


def observe(tracker: Tracker, sequences: Iterable[Sequence], most: int | None = None) -> Sightings:
    """Track sequences from their first box on, `most` frames of each."""
    rows: list[tuple[list[float], float, float, int]] = []
    for group, sequence in enumerate(sequences):
        rows += [(*row, group) for row in _observe(tracker, sequence, most)]
    if not rows:
        raise EntrackError("there is nothing to track: no sequence has two frames")
    signals, scores, overlaps, groups = zip(*rows, strict=True)
    return Sightings(np.array(signals), np.array(scores), np.array(overlaps), np.array(groups))


def _observe(
    tracker: Tracker, sequence: Sequence, most: int | None
) -> Iterator[tuple[list[float], float, float]]:
    seen = ope.valid(sequence.boxes) & ~sequence.absent
    if not seen.any():
        return
    start = int(seen.argmax())
    stop = min(len(sequence), len(sequence.frames), start + (most or len(sequence)))
    tracker.init(sequence.frames[start], sequence.boxes[start])
    for t in range(start + 1, stop):
        estimate = tracker.update(sequence.frames[t])
        (look,) = tracker.looks
        assert look is not None
        signals = [signal(look, estimate) for signal in SIGNALS.values()]
        overlap = float(iou(estimate.box, sequence.boxes[t])) if seen[t] else 0.0
        yield signals, estimate.score, overlap


def logistic(x: ArrayLike, y: ArrayLike, ridge: float = _RIDGE) -> tuple[Floats, float]:
    """Weights (K,) and bias of a logistic regression of y (N,) on x (N, K), by Newton's method.

    Columns that are not finite or do not change get the weight 0.
    """
    raw, event = np.asarray(x, np.float64), np.asarray(y, np.float64)
    centre, spread = raw.mean(axis=0), raw.std(axis=0)
    used = np.isfinite(spread) & (spread > 1e-12)
    columns = np.column_stack([(raw[:, used] - centre[used]) / spread[used], np.ones(len(raw))])
    penalty = ridge * np.append(np.ones(used.sum()), 0.0)

    def loss(w: Floats) -> float:
        z = columns @ w
        return float((np.logaddexp(0, z) - event * z).sum() + (penalty * w**2).sum() / 2)

    w = np.zeros(columns.shape[1])
    for _ in range(100):
        p = _chance(columns @ w)
        slope = columns.T @ (p - event) + penalty * w
        curvature = (columns * (p * (1 - p))[:, None]).T @ columns + np.diag(penalty + 1e-9)
        step, before = np.linalg.solve(curvature, slope), loss(w)
        while loss(w - step) > before and np.abs(step).max() > 1e-12:
            step = step / 2
        w = w - step
        if np.abs(step).max() < 1e-9:
            break
    weights = np.zeros(raw.shape[1])
    weights[used] = w[:-1] / spread[used]
    return weights, float(w[-1] - weights[used] @ centre[used])


def _chance(z: Floats) -> Floats:
    return 1 / (1 + np.exp(-np.clip(z, -500, 500)))


def fit(seen: Sightings) -> Calibration:
    """Fit the score to what was seen.

    Raises
    ------
    EntrackError
        If the tracker was right in all frames or in none, as there is nothing to learn then.
    """
    hits = seen.hits
    if hits.all() or not hits.any():
        what = "every frame" if hits.all() else "no frame"
        raise EntrackError(
            f"{what} of {len(hits)} has IoU > .5: a score is fitted to footage in which the target "
            "is both held and lost"
        )
    weights, bias = logistic(seen.signals, hits)
    named = {"bias": bias, **dict(zip(SIGNALS, weights.tolist(), strict=True))}
    count = len(np.unique(seen.groups))
    return Calibration(
        {name: round(value, 4) for name, value in named.items()},
        count,
        len(hits),
        float(hits.mean()),
        quality(seen.scores, seen.overlaps),
        quality(_left_out(seen), seen.overlaps) if count > 1 else None,
    )


def _left_out(seen: Sightings) -> Floats:
    """Scores (N,) by weights that were fitted without the frame's sequence."""
    names = np.unique(seen.groups)
    fold = np.random.default_rng(0).permutation(len(names)) % min(_FOLDS, len(names))
    of_frame = fold[np.searchsorted(names, seen.groups)]
    scores = np.zeros(len(of_frame))
    for k in np.unique(fold):
        out = of_frame == k
        weights, bias = logistic(seen.signals[~out], seen.hits[~out])
        known = np.where(weights != 0, seen.signals[out], 0)
        scores[out] = _chance(known @ weights + bias)
    return scores


def quality(scores: ArrayLike, overlaps: ArrayLike) -> Quality:
    """Judge scores (N,) by overlaps (N,)."""
    held = np.asarray(overlaps, np.float64)
    error = un.calibration_error(un.calibration(scores, held > 0.5))
    area = un.area(*un.roc(scores, held > 0))
    return Quality(error, area if np.isfinite(area) else None)


def calibrate(
    model: str | Path,
    data: Iterable[str],
    out: Path,
    only: Collection[str] = (),
    most: int | None = None,
    report: Callable[[int, int, str], None] = lambda number, of, name: None,
) -> Calibration:
    """Fit a model's score to footage, and write the model with it.

    Parameters
    ----------
    model
        Name of a shipped model, or a model folder.
    data
        Datasets, each `"FORMAT:DIR"`.
    out
        Folder of the new model, which holds copies of all the files.
    only
        Sequences to use; all by default.
    most
        Frames of each sequence; all by default.
    report
        Hears number and name of each sequence before it is tracked, and how many there are.

    Raises
    ------
    EntrackError
        If something cannot be read, `out` holds a model already, or there is nothing to learn.
    """
    if (out / "model.toml").exists():
        raise EntrackError(f"{out} holds a model already: choose another folder")
    found = [(d, name) for d in map(open_dataset, data) for name in d.names]
    unknown = set(only) - {name for _, name in found}
    if unknown:
        raise EntrackError(f"no sequence {', '.join(sorted(unknown))} in these datasets")
    chosen = [(d, name) for d, name in found if not only or name in only]

    def sequences() -> Iterator[Sequence]:
        for number, (dataset, name) in enumerate(chosen, 1):
            report(number, len(chosen), name)
            yield dataset.read(name)

    fitted = fit(observe(entrack.load(model), sequences(), most))
    write_model(load_model(model).folder, out, fitted.weights)
    return fitted


def write_model(folder: Path, out: Path, weights: Mapping[str, float]) -> None:
    """Copy a model with other weights of its score."""
    content: dict[str, Any] = read_toml(folder / "model.toml")
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        for entry in content["files"].values():
            source = folder / entry["path"]
            shutil.copyfile(source, out / source.name)
            entry["path"] = source.name
    content["config"].setdefault("score", {}).update(weights)
    write_bytes(out / "model.toml", tomli_w.dumps(content).encode())
