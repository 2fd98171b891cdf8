"""Named protocols: how one sequence is scored, and which numbers come of it."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from entrack.datasets.sequence import Sequence
from entrack.errors import EntrackError
from entrack.evaluation import longterm, ope, vot
from entrack.evaluation.protocol import Floats, Protocol, Score, mean, ratio
from entrack.evaluation.region import Regions

_OPE = ("otb", "uav123", "lasot", "got10k", "folder", "synthetic")


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
    average = ratio(np.nansum(counted, axis=0), known.astype(np.float64))
    # pysot bounds EAO's overlaps by one pixel less than accuracy's.
    inner = None if size is None else (size[0] - 1, size[1] - 1)
    cut = [
        (values, padded, weight / len(runs))
        for run in runs
        for values, padded, weight in vot.fragments(run, vot.supervised_overlaps(run, truth, inner))
    ]
    failures = sum(len(run.failures) for run in runs) / len(runs)
    terms = {
        "accuracy": (_point(np.nansum(average)), _point(np.isfinite(average).sum())),
        "robustness": (_point(100 * failures), _point(len(truth))),
        "expected_overlap": vot.expected_overlap_terms(cut, _POINTS),
    }
    return Score(len(truth), terms, reach=len(truth))


def vot_toolkit(sequence: Sequence, runs: list[vot.Trajectory]) -> Score:
    """VOT as vot-toolkit: robustness in failures a video, videos weigh as much as they are long."""
    truth, size = _truth(sequence)
    overlaps = [vot.supervised_overlaps(run, truth, size, toolkit=True) for run in runs]
    means = [mean(o[run.counted()]) for run, o in zip(runs, overlaps, strict=True)]
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
    yield longterm.LongTerm("longterm", _OPE, longterm.NUMBERS, certain=longterm.gather)
    for year, (low, high) in EAO_BOUNDS.items():
        # A run of N frames is the curve's point N − 1; vot-toolkit reads the point N instead.
        yield Protocol(year, (year,), _vot_numbers(low - 1, high - 1), supervised=pysot_vot)
        numbers = _vot_numbers(low, high)
        yield Protocol("vot-toolkit", (year,), numbers, supervised=vot_toolkit, toolkit=True)


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
