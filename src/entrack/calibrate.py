"""Fit a model's score to footage: the chance that IoU > ½, by what the tracker saw in a frame."""

import shutil
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from itertools import count, groupby, starmap
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import ArrayLike, NDArray

import entrack
from entrack.box import iou, to_corners
from entrack.config import Config, Weights, read_toml
from entrack.datasets import Dataset, Sequence, open_dataset
from entrack.errors import EntrackError
from entrack.evaluation import ope
from entrack.evaluation import uncertainty as un
from entrack.files import write_bytes, writing
from entrack.model import load_model
from entrack.tracker import Tracker

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
_RIDGE = 1e-2  # in units of one frame: keeps weights finite where signals tell all
_FOLDS = 5
_ONE_SIGMA = 0.683
_LEAST_ERROR = 1e-3  # of a box's size: smaller ones are in the annotation


SIGNALS = tuple(f.name for f in fields(Weights) if f.name != "bias")
"""What score and σ are made of; 0 where a model does not have a signal."""
_FOR = ("peak", "psr", "first", "same", "unrest")
_AGAINST = ("unseen", "rival", "leap", "colour", "swap", "off", "sigma")
"""Which way a signal may count for a score. A weight of the other sign is an accident of the
footage, such as a look-alike that is followed for long, and does harm on any other."""


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
    errors
        (N, 4) distance of the four sides from the true ones in units of the box's own size; NaN
        where the target is absent.
    groups
        (N,) number of the sequence.
    kinds
        (N,) number of the dataset.
    """

    signals: Floats
    scores: Floats
    overlaps: Floats
    errors: Floats
    groups: NDArray[np.int64]
    kinds: NDArray[np.int64]

    def __add__(self, other: "Sightings") -> "Sightings":
        """Both; sequences of the same number are the same."""
        pairs = [(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)]
        return Sightings(*(np.concatenate(pair) for pair in pairs))

    @property
    def hits(self) -> Flags:
        """Whether IoU > ½ (N,)."""
        return self.overlaps > 0.5

    @property
    def weights(self) -> Floats:
        """How much each frame counts (N,): every dataset as much as any other, 1 in the mean."""
        counts = np.bincount(self.kinds)
        return (len(self.kinds) / (counts > 0).sum() / np.maximum(counts, 1))[self.kinds]

    def of(self, frames: NDArray[np.bool_ | np.intp]) -> "Sightings":
        """Only these frames."""
        return Sightings(*(getattr(self, f.name)[frames] for f in fields(self)))


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
        `bias` and a weight for each signal, of the score.
    spread
        The same of σ.
    share
        Share of frames with IoU > ½.
    before
        Of the model's own score.
    after
        Of the new score on sequences that it was not fitted to: each fifth of the sequences is
        scored by weights from the others. None for a single sequence.
    """

    weights: dict[str, float]
    spread: dict[str, float]
    sequences: int
    frames: int
    share: float
    before: Quality
    after: Quality | None


def observe(
    tracker: Tracker, datasets: Iterable[Iterable[Sequence]], most: int | None = None
) -> Sightings:
    """Track the sequences of datasets from their first box on, `most` frames of each."""
    rows: list[tuple[list[float], float, float, Floats, int, int]] = []
    group = count()
    for kind, sequences in enumerate(datasets):
        for sequence in sequences:
            number = next(group)
            rows += [(*row, number, kind) for row in _observe(tracker, sequence, most)]
    if not rows:
        raise EntrackError("there is nothing to track: no sequence has two frames")
    return Sightings(*(np.array(column) for column in zip(*rows, strict=True)))


def _observe(
    tracker: Tracker, sequence: Sequence, most: int | None
) -> Iterator[tuple[list[float], float, float, Floats]]:
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
        signals = [look.evidence.get(name, 0.0) for name in SIGNALS]
        truth = sequence.boxes[t] if seen[t] else np.full(4, np.nan)
        overlap = float(iou(estimate.box, truth)) if seen[t] else 0.0
        away = np.abs(to_corners(truth) - to_corners(estimate.box))
        yield signals, estimate.score, overlap, away / np.tile(estimate.box[2:], 2)


def logistic(
    x: ArrayLike, y: ArrayLike, ridge: float = _RIDGE, counts: ArrayLike = 1.0
) -> tuple[Floats, float]:
    """Weights (K,) and bias of a logistic regression of y (N,) on x (N, K), by Newton's method.

    Columns that are not finite or do not change get the weight 0. `counts` (N,) says how much each
    row counts.
    """
    much = np.broadcast_to(np.asarray(counts, np.float64), len(np.asarray(y)))
    raw, event = np.asarray(x, np.float64), np.asarray(y, np.float64)
    centre, spread = raw.mean(axis=0), raw.std(axis=0)
    used = np.isfinite(spread) & (spread > 1e-12)
    columns = np.column_stack([(raw[:, used] - centre[used]) / spread[used], np.ones(len(raw))])
    penalty = ridge * np.append(np.ones(used.sum()), 0.0)

    def loss(w: Floats) -> float:
        z = columns @ w
        return float((much * (np.logaddexp(0, z) - event * z)).sum() + (penalty * w**2).sum() / 2)

    w = np.zeros(columns.shape[1])
    for _ in range(100):
        p = _chance(columns @ w)
        slope = columns.T @ (much * (p - event)) + penalty * w
        curvature = (columns * (much * p * (1 - p))[:, None]).T @ columns + np.diag(penalty + 1e-9)
        step, before = np.linalg.solve(curvature, slope), loss(w)
        while loss(w - step) > before and np.abs(step).max() > 1e-12:
            step = step / 2
        w = w - step
        if np.abs(step).max() < 1e-9:
            break
    weights = np.zeros(raw.shape[1])
    weights[used] = w[:-1] / spread[used]
    return weights, float(w[-1] - weights[used] @ centre[used])


def quantile(
    x: ArrayLike, y: ArrayLike, share: float, ridge: float = 1.0, counts: ArrayLike = 1.0
) -> Floats:
    """Weights (K + 1,), the last of them a bias, below whose line on x (N, K) a share of y lies.

    Quantile regression, by iterated least squares (Hunter and Lange, 2000). `counts` (N,) says how
    much each row counts.
    """
    much = np.broadcast_to(np.asarray(counts, np.float64), len(np.asarray(y)))
    raw, value = np.asarray(x, np.float64), np.asarray(y, np.float64)
    spread = np.append(raw.std(axis=0), 1.0)
    used = spread > 1e-12
    columns = np.column_stack([raw, np.ones(len(raw))])[:, used] / spread[used]
    penalty = np.diag(np.append(np.full(used.sum() - 1, ridge), 1e-9))
    w = np.linalg.lstsq(columns, value, rcond=None)[0]
    for _ in range(200):
        weight = much / (np.abs(value - columns @ w) + 1e-3)
        left = columns.T @ (columns * weight[:, None]) + penalty
        right = columns.T @ (weight * value + much * (2 * share - 1))
        before, w = w, np.linalg.solve(left, right)
        if np.abs(w - before).max() < 1e-6:
            break
    weights = np.zeros(len(spread))
    weights[used] = w / spread[used]
    return weights


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
    weights, bias = fit_score(seen)
    many = len(np.unique(seen.groups))
    return Calibration(
        _named(np.append(weights, bias)),
        fit_spread(seen),
        many,
        len(hits),
        float(hits.mean()),
        quality(seen.scores, seen.overlaps),
        quality(_left_out(seen), seen.overlaps) if many > 1 else None,
    )


def fit_score(seen: Sightings) -> tuple[Floats, float]:
    """Weights (K,) and bias of the score, without the signals that would count the wrong way."""
    signals = seen.signals
    signs = np.array([(name in _FOR) - (name in _AGAINST) for name in SIGNALS])
    used = np.ones(len(SIGNALS), bool)
    while True:
        known = np.where(used, signals, 0)
        weights, bias = logistic(known, seen.hits, counts=seen.weights)
        wrong = weights * signs * signals.std(axis=0)
        if wrong.min() >= 0:
            return weights, bias
        used[wrong.argmin()] = False


def fit_spread(seen: Sightings) -> dict[str, float]:
    """Weights of log σ, below which lie 68 % of the distances of sides from the true ones."""
    known = seen.of(np.flatnonzero(np.isfinite(seen.errors).all(axis=1)))
    error = np.log(np.maximum(known.errors, _LEAST_ERROR)).ravel()
    signals, counts = (np.repeat(part, 4, axis=0) for part in (known.signals, known.weights))
    return _named(quantile(signals, error, _ONE_SIGMA, counts=counts))


def _named(weights: Floats) -> dict[str, float]:
    """For a model's file: `weights` (K + 1,), the last of them the bias."""
    *rest, bias = (round(value, 4) for value in weights.tolist())
    return {"bias": bias, **dict(zip(SIGNALS, rest, strict=True))}


def _left_out(seen: Sightings) -> Floats:
    """Scores (N,) by weights that were fitted without the frame's sequence."""
    names = np.unique(seen.groups)
    fold = np.random.default_rng(0).permutation(len(names)) % min(_FOLDS, len(names))
    of_frame = fold[np.searchsorted(names, seen.groups)]
    scores = np.zeros(len(of_frame))
    for k in np.unique(fold):
        out = of_frame == k
        weights, bias = fit_score(seen.of(~out))
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

    tracker = entrack.load(model)
    passes = 2 if tracker.config.recovery else 1
    number = count()

    def read(dataset: Dataset, name: str) -> Sequence:
        report(next(number) + 1, passes * len(chosen), name)
        return dataset.read(name)

    def datasets() -> Iterator[Iterable[Sequence]]:
        for _, found in groupby(chosen, key=lambda one: id(one[0])):
            yield starmap(read, found)

    fitted = fit_tracker(tracker, datasets, most)
    write_model(load_model(model).folder, out, fitted.weights, fitted.spread)
    return fitted


def fit_tracker(
    tracker: Tracker,
    datasets: Callable[[], Iterable[Iterable[Sequence]]],
    most: int | None = None,
) -> Calibration:
    """Fit a tracker's score and σ to datasets, which are made twice if it recovers.

    What it sees when lost, as it goes on, tells what the score has to be; but what a recovering
    tracker then does depends on that score. So it is tracked without recovery first.
    """
    config = tracker.config
    seen = observe(configured(tracker, replace(config, recovery=None)), datasets(), most)
    if config.recovery:
        first = fit(seen)
        known = replace(config, score=replace(config.score, **first.weights))
        seen += observe(configured(tracker, known), datasets(), most)
    return fit(seen)


def configured(tracker: Tracker, config: Config) -> Tracker:
    """The same tracker with another configuration."""
    return Tracker(config, tracker.trunk, tracker.policy)


def write_model(
    folder: Path, out: Path, weights: Mapping[str, float], spread: Mapping[str, float]
) -> None:
    """Copy a model with other weights of its score and σ."""
    content: dict[str, Any] = read_toml(folder / "model.toml")
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        for entry in content["files"].values():
            source = folder / entry["path"]
            shutil.copyfile(source, out / source.name)
            entry["path"] = source.name
    content["config"].setdefault("score", {}).update(weights)
    content["config"]["spread"] = dict(spread)
    write_bytes(out / "model.toml", tomli_w.dumps(content).encode())
