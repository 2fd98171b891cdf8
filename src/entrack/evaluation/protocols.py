"""Named protocols: how one sequence is scored, and how the sequences make one number.

Every number of every protocol is a quotient of two sums over sequences, possibly for each point of
a curve. A sequence therefore adds a numerator and a denominator a curve, and totals, curves and
bootstrap intervals come from the same few lines.
"""

from collections.abc import Callable, Iterator, Mapping
from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from entrack.datasets.sequence import Sequence
from entrack.errors import EntrackError
from entrack.evaluation import ope, vot
from entrack.evaluation.region import Regions

Floats = NDArray[np.float64]
Terms = dict[str, tuple[Floats, Floats]]
"""Numerator and denominator of each curve; a plain number is a curve of one point."""

_OPE = ("otb", "uav123", "lasot", "got10k", "folder", "synthetic")


@dataclass(frozen=True)
class Score:
    """What one sequence adds to the numbers of a protocol.

    Parameters
    ----------
    frames
        Length of the sequence.
    terms
        Its numerators and denominators.
    reach
        The point at which its curves end; over all sequences the longest counts.
    """

    frames: int
    terms: Terms
    reach: int | None = None


@dataclass(frozen=True)
class Protocol:
    """A way of scoring that equals one toolkit's.

    Parameters
    ----------
    formats
        Datasets that it fits.
    numbers
        Each number's curve, and the part of the curve whose mean it is.
    ope
        Scores predicted boxes, one array (T, 4) a repetition; None for a supervised protocol.
    supervised
        Scores trajectories, one a repetition; None for a one-pass protocol.
    """

    name: str
    formats: tuple[str, ...]
    numbers: Mapping[str, tuple[str, slice]]
    ope: Callable[[Sequence, list[Floats]], Score] | None = None
    supervised: Callable[[Sequence, list[vot.Trajectory]], Score] | None = None

    def curves(self, scores: SequenceOf[Score]) -> dict[str, Floats]:
        """Curves over all sequences; NaN where nothing was counted."""
        names = dict.fromkeys(curve for curve, _ in self.numbers.values())
        return {name: _quotient(scores, name, np.ones((1, len(scores))))[0] for name in names}

    def values(self, scores: SequenceOf[Score]) -> dict[str, float]:
        """Numbers over all sequences; NaN where nothing was counted."""
        curves = self.curves(scores)
        return {name: _mean(curves[curve][part]) for name, (curve, part) in self.numbers.items()}

    def intervals(
        self, scores: SequenceOf[Score], seed: int = 0, draws: int = 1000
    ) -> dict[str, tuple[float, float]]:
        """95 % bootstrap interval of each number: sequences are drawn with replacement."""
        random = np.random.default_rng(seed)
        share = np.full(len(scores), 1 / len(scores))
        counts = random.multinomial(len(scores), share, draws).astype(np.float64)
        result: dict[str, tuple[float, float]] = {}
        for name, (curve, part) in self.numbers.items():
            drawn = [_mean(row[part]) for row in _quotient(scores, curve, counts)]
            finite = [value for value in drawn if np.isfinite(value)] or [np.nan]
            low, high = np.percentile(finite, [2.5, 97.5])
            result[name] = (float(low), float(high))
        return result


def _quotient(scores: SequenceOf[Score], curve: str, counts: Floats) -> Floats:
    """Curves (draws, points) in which each sequence counts so often."""
    above, below = (np.stack([s.terms[curve][i] for s in scores]) for i in (0, 1))
    result = _ratio(counts @ above, counts @ below)
    reaches = [s.reach for s in scores if s.reach is not None]
    if reaches:
        result[:, max(reaches) :] = np.nan
    return result


def _mean(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")


def _ratio(above: Floats, below: Floats) -> Floats:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(below > 0, above / below, np.nan)


def _one_pass(
    truth: Floats, boxes: Floats, invalid: float, counted: NDArray[np.bool_] | None = None
) -> Score:
    """OTB's curves; only `counted` frames can succeed, but all are in the denominator."""
    frames = len(truth)
    boxes = ope.repair(truth, boxes)
    use = np.ones(frames, bool) if counted is None else counted
    iou = ope.overlaps(truth, boxes)[use]
    errors = ope.centre_errors(truth, boxes, invalid)[use]
    norm = ope.norm_errors(truth, boxes, invalid)[use]
    curves = {
        "success": ope.success_curve(iou, frames=frames),
        "precision": ope.precision_curve(errors, frames=frames),
        "norm_precision": ope.norm_precision_curve(norm, frames=frames),
        "overlap": np.array([np.maximum(iou, 0).sum() / frames]),
    }
    return Score(frames, {name: (curve, np.ones(len(curve))) for name, curve in curves.items()})


def otb(sequence: Sequence, runs: list[Floats]) -> Score:
    """OTB: a frame with invalid ground truth is a failure everywhere."""
    return _one_pass(sequence.boxes, runs[0], np.inf)


def uav123(sequence: Sequence, runs: list[Floats]) -> Score:
    """UAV123: frames without ground truth fail in success and succeed in precision."""
    return _one_pass(sequence.boxes, runs[0], -1.0)


def lasot(sequence: Sequence, runs: list[Floats]) -> Score:
    """LaSOT: absent frames cannot succeed but are counted, so a perfect tracker scores .927."""
    return _one_pass(sequence.boxes, runs[0], -1.0, ~sequence.absent)


def got10k(sequence: Sequence, runs: list[Floats]) -> Score:
    """GOT-10k: frames of all sequences in one pool, without the first and without absent ones."""
    use = ~sequence.absent[1:] & np.isfinite(sequence.boxes[1:]).all(axis=1)
    truth, size = sequence.boxes[1:][use], sequence.picture_size()
    iou = np.concatenate([ope.clipped_overlaps(truth, boxes[1:][use], size) for boxes in runs])
    counted = np.array([len(iou)], np.float64)
    success = ope.success_curve(iou, ope.SUCCESS_101) * counted
    terms = {
        "success": (success, np.repeat(counted, len(success))),
        "overlap": (np.array([iou.sum()]), counted),
    }
    return Score(len(sequence), terms)


def pysot_vot(sequence: Sequence, runs: list[vot.Trajectory]) -> Score:
    """VOT as pysot: accuracy pooled over frames, robustness in failures a hundred frames."""
    truth, size = _truth(sequence)
    overlaps = [vot.supervised_overlaps(run, truth, size) for run in runs]
    counted = np.stack(
        [np.where(r.counted(), o, np.nan) for r, o in zip(runs, overlaps, strict=True)]
    )
    known = np.isfinite(counted).sum(axis=0)
    mean = _ratio(np.nansum(counted, axis=0), known.astype(np.float64))
    # pysot bounds EAO's overlaps by one pixel less than accuracy's.
    inner = None if size is None else (size[0] - 1, size[1] - 1)
    cut = [
        (values, padded, weight / len(runs))
        for run in runs
        for values, padded, weight in vot.fragments(run, vot.supervised_overlaps(run, truth, inner))
    ]
    failures = sum(len(run.failures) for run in runs) / len(runs)
    terms = {
        "accuracy": (_point(np.nansum(mean)), _point(np.isfinite(mean).sum())),
        "robustness": (_point(100 * failures), _point(len(truth))),
        "expected_overlap": vot.expected_overlap_terms(cut, _POINTS),
    }
    return Score(len(truth), terms, reach=len(truth))


def vot_toolkit(sequence: Sequence, runs: list[vot.Trajectory]) -> Score:
    """VOT as vot-toolkit: robustness in failures a video, videos weigh as much as they are long."""
    truth, size = _truth(sequence)
    overlaps = [vot.supervised_overlaps(run, truth, size, toolkit=True) for run in runs]
    means = [_mean(o[run.counted()]) for run, o in zip(runs, overlaps, strict=True)]
    cut = [f for r, o in zip(runs, overlaps, strict=True) for f in vot.toolkit_fragments(r, o)]
    length, failures = len(truth), sum(len(run.failures) for run in runs) / len(runs)
    terms = {
        "accuracy": (_point(np.nan_to_num(means).mean() * length), _point(length)),
        "robustness": (_point(failures * length), _point(length)),
        "expected_overlap": vot.expected_overlap_terms(cut, _POINTS),
    }
    return Score(length, terms, reach=max(len(values) for values, _, _ in cut))


_POINTS = 400
"""Points of the expected overlap that are kept: more than any year's upper bound."""


def _point(value: float) -> Floats:
    return np.array([value], np.float64)


def _truth(sequence: Sequence) -> tuple[Regions, tuple[int, int] | None]:
    numbers = sequence.boxes if sequence.polygons is None else sequence.polygons
    return Regions.of(numbers), sequence.picture_size()


_OTB_NUMBERS = {
    "auc": ("success", slice(None)),
    "precision": ("precision", slice(20, 21)),
    "norm_precision": ("norm_precision", slice(20, 21)),
    "op50": ("success", slice(10, 11)),
    "ao": ("overlap", slice(None)),
}
_GOT10K_NUMBERS = {
    "auc": ("success", slice(None)),
    "op50": ("success", slice(50, 51)),
    "op75": ("success", slice(75, 76)),
    "ao": ("overlap", slice(None)),
}


EAO_BOUNDS = {"vot2016": (108, 371), "vot2018": (100, 356), "vot2019": (46, 291)}
"""Shortest and longest run over which EAO is the mean."""


def _vot_numbers(low: int, high: int) -> dict[str, tuple[str, slice]]:
    every = slice(None)
    eao = ("expected_overlap", slice(low, high + 1))
    return {"accuracy": ("accuracy", every), "robustness": ("robustness", every), "eao": eao}


def _protocols() -> Iterator[Protocol]:
    yield Protocol("otb", _OPE, _OTB_NUMBERS, ope=otb)
    yield Protocol("uav123", ("uav123",), _OTB_NUMBERS, ope=uav123)
    yield Protocol("lasot", ("lasot",), _OTB_NUMBERS, ope=lasot)
    yield Protocol("got10k", _OPE, _GOT10K_NUMBERS, ope=got10k)
    for year, (low, high) in EAO_BOUNDS.items():
        # A run of N frames is the curve's point N − 1; vot-toolkit reads the point N instead.
        yield Protocol(year, (year,), _vot_numbers(low - 1, high - 1), supervised=pysot_vot)
        yield Protocol("vot-toolkit", (year,), _vot_numbers(low, high), supervised=vot_toolkit)


PROTOCOLS = tuple(_protocols())


def find_protocol(name: str, dataset_format: str) -> Protocol:
    """Return the protocol of that name for a dataset's format.

    >>> find_protocol("otb", "vot2016")
    Traceback (most recent call last):
    entrack.errors.EntrackError: protocol otb does not fit vot2016: vot2016, vot-toolkit do
    """
    fitting = {p.name: p for p in PROTOCOLS if dataset_format in p.formats}
    if name in fitting:
        return fitting[name]
    known = dict.fromkeys(p.name for p in PROTOCOLS)
    if name not in known:
        raise EntrackError(f"no protocol {name}: expected one of {', '.join(known)}")
    fit = ", ".join(fitting)
    raise EntrackError(f"protocol {name} does not fit {dataset_format}: {fit} do")


def default_protocol(dataset_format: str) -> str:
    """Return the protocol under which a dataset's numbers are usually printed."""
    names = [p.name for p in PROTOCOLS if dataset_format in p.formats]
    return dataset_format if dataset_format in names else names[0]
