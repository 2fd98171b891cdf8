"""The protocol `longterm`: boxes together with how sure the tracker was of them.

The frame on which a tracker is started does not count, nor do those before it. The target is absent
where the dataset says so or has no box.
"""

from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass

import numpy as np

from entrack.datasets.sequence import Sequence
from entrack.evaluation import ope
from entrack.evaluation import uncertainty as un
from entrack.evaluation.certainty import Certainty
from entrack.evaluation.protocol import Floats, Protocol, Score, quotient, ratio

THRESHOLDS = np.linspace(0, 1, 101)
"""Scores over which precision, recall and F are drawn."""
FALSE_RATES = np.linspace(0, 1, 101)
"""Where the ROC curve is drawn."""
_POINTS = 100
_LAST = slice(un.WITHIN - 1, un.WITHIN)

NUMBERS = {
    "refound": ("found_again", _LAST),
    "coverage": ("coverage", slice(None)),
    "coverage_held": ("coverage_held", slice(None)),
}
"""Numbers that are quotients of sums over sequences; `LongTerm` has others."""


@dataclass(frozen=True, kw_only=True)
class Evidence(Score):
    """What one sequence adds: `Score`, and its frames after the start (N of them).

    Parameters
    ----------
    iou, present, confidence
        (N,) as in `uncertainty`; all frames are equally sure where the tracker does not tell.
    told
        Whether the tracker tells.
    calibration
        (3, 15) as `uncertainty.calibration` counts; zeros where there is no score in [0, 1].
    """

    iou: Floats
    present: un.Flags
    confidence: Floats
    told: bool
    calibration: Floats


def gather(sequence: Sequence, boxes: Floats, said: Certainty) -> Evidence:
    """Compare boxes (T, 4), and what was said with them, with the ground truth."""
    truth, boxes = sequence.boxes, ope.repair(sequence.boxes, boxes)
    seen = ope.valid(truth) & ~sequence.absent
    iou = np.where(seen, ope.overlaps(truth, boxes), 0.0)
    start = int(ope.valid(truth).argmax())
    back = len(un.returns(seen[start:]))
    found = un.found_again(iou[start:], seen[start:])
    after = slice(start + 1, None)
    confidence = said.confidence[after]
    known = np.isfinite(confidence)
    confidence = np.where(known, confidence, confidence[known].min() if known.any() else 1.0)
    score = said.score[after]
    scored = np.isfinite(score)
    chances = scored.any() and bool(((score[scored] >= 0) & (score[scored] <= 1)).all())
    hit = (iou[after] > 0.5)[scored]
    bins = un.calibration(score[scored], hit) if chances else np.zeros((3, un.BINS))
    inside = un.covered(truth, boxes, said.sigma)[after].mean(axis=1)
    held: un.Flags = (np.isfinite(said.sigma).all(axis=1) & seen)[after]
    terms = {
        "found_again": (found, np.full(un.WITHIN, float(back))),
        "coverage": _over(inside, held),
        "coverage_held": _over(inside, held & (iou[after] > 0)),
    }
    return Evidence(
        len(sequence), terms, iou=iou[after], present=seen[after], confidence=confidence,
        told=bool(said), calibration=bins,
    )  # fmt: skip


def _over(values: Floats, use: un.Flags) -> tuple[Floats, Floats]:
    """Sum and number of the values that are used, as the terms of a mean."""
    return np.array([values[use].sum()]), np.array([float(use.sum())])


@dataclass(frozen=True)
class LongTerm(Protocol):
    """Numbers of `Evidence`.

    `tracking_precision`, `tracking_recall` and `f_score` are of the threshold with the greatest F,
    and means over sequences; `roc_auc` (score as a detector of IoU > 0) and `ece` (of IoU > ½) are
    over the frames of all sequences, `refound` over all returns, and `refound_frames` is within
    how many frames half of the returns are found.
    """

    def drawn(self, scores: SequenceOf[Score], counts: Floats) -> dict[str, Floats]:
        """Numbers (draws,) over sequences that count so often, `counts` (draws, sequences)."""
        evidence = _evidence(scores)
        precision, recall = _precision_recall(evidence, _thresholds(evidence), counts)
        f_scores = un.f_score(precision, recall)
        best = np.arange(len(counts)), f_scores.argmax(axis=1)
        half = quotient(scores, "found_again", counts) >= 0.5
        frames = np.where(half.any(axis=1), half.argmax(axis=1) + 1.0, np.nan)
        return {
            "f_score": f_scores[best],
            "tracking_precision": precision[best],
            "tracking_recall": recall[best],
            "roc_auc": _roc_areas(evidence, counts),
            "ece": _calibration_errors(evidence, counts),
            **super().drawn(scores, counts),
            "refound_frames": frames,
        }

    def curves(self, scores: SequenceOf[Score]) -> dict[str, Floats]:
        """Curves over all sequences, to be drawn over `THRESHOLDS`, `FALSE_RATES` or each other."""
        evidence, once = _evidence(scores), np.ones((1, len(scores)))
        drawn = super().curves(scores)
        precision, recall = _precision_recall(evidence, THRESHOLDS, once)
        drawn |= {
            "tracking_precision": precision[0],
            "tracking_recall": recall[0],
            "f_score": un.f_score(precision, recall)[0],
        }
        precision, recall = _precision_recall(evidence, _thresholds(evidence, _POINTS), once)
        drawn |= {"pr_precision": precision[0], "pr_recall": recall[0]}
        if all(e.told for e in evidence):
            false, true = un.roc(*_pooled(evidence))
            drawn["roc"] = np.interp(FALSE_RATES, false, true)
        frames, chances, events = np.sum([e.calibration for e in evidence], axis=0)
        if frames.any():
            drawn |= {
                "calibration_frames": frames / frames.sum(),
                "calibration_score": ratio(chances, frames),
                "calibration_share": ratio(events, frames),
            }
        return drawn


def _evidence(scores: SequenceOf[Score]) -> list[Evidence]:
    return [score for score in scores if isinstance(score, Evidence)]


def _thresholds(evidence: list[Evidence], most: int = 1000) -> Floats:
    return un.thresholds(np.concatenate([[np.inf], *(e.confidence for e in evidence)]), most)


def _precision_recall(
    evidence: list[Evidence], at: Floats, counts: Floats
) -> tuple[Floats, Floats]:
    """Means over sequences at each threshold: (draws, thresholds) each."""
    each = [un.precision_recall(e.iou, e.present, e.confidence, at) for e in evidence]
    precision, recall = np.stack(each, axis=1)
    share = counts / counts.sum(axis=1, keepdims=True)
    return share @ precision, share @ recall


def _pooled(evidence: list[Evidence]) -> tuple[Floats, un.Flags]:
    """Scores of all frames, and whether the box overlaps the target there."""
    confidence = np.concatenate([e.confidence for e in evidence])
    return confidence, np.concatenate([e.iou for e in evidence]) > 0


def _roc_areas(evidence: list[Evidence], counts: Floats) -> Floats:
    if not all(e.told for e in evidence):
        return np.full(len(counts), np.nan)
    pooled = _pooled(evidence)
    owner = np.repeat(np.arange(len(evidence)), [len(e.iou) for e in evidence])
    return np.array([un.area(*un.roc(*pooled, weights[owner])) for weights in counts])


def _calibration_errors(evidence: list[Evidence], counts: Floats) -> Floats:
    counted = np.tensordot(counts, np.stack([e.calibration for e in evidence]), axes=1)
    return np.array([un.calibration_error(bins) for bins in counted])
