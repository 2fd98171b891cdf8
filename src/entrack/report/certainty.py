"""The plots of protocol `longterm`, which show whether a tracker knows when it is lost."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from entrack.evaluation.longterm import FALSE_RATES, THRESHOLDS
from entrack.evaluation.uncertainty import WITHIN
from entrack.report import plots
from entrack.report.drawing import Drawing, Styles, lines_of
from entrack.report.metrics import METRICS
from entrack.report.plots import Floats
from entrack.report.runs import Section

_SHARE = np.array([0.0, 1.0])
_OVER_THRESHOLD = (
    ("f_score", "F", "Harmonic mean of precision and recall at each threshold"),
    ("tracking_precision", "Precision", "Mean overlap of the answers whose score is high enough"),
    ("tracking_recall", "Recall", "Overlap of those answers, over the frames with a target"),
)


def drawings(section: Section, styles: Styles) -> Iterator[Drawing]:
    """Every plot for which there are curves."""
    yield from _reliability(section, styles)
    yield from _over(
        section, styles, "roc", "Detecting that the target is held", FALSE_RATES,
        ("share of frames without overlap above the threshold", "share of frames with overlap"),
        "ROC curve of the score as a detector of IoU > 0; area in brackets.", "roc_auc",
    )  # fmt: skip
    for curve, title, meaning in _OVER_THRESHOLD:
        labels = ("threshold on the score", title)
        caption = f"{meaning}; in brackets at the threshold with the greatest F."
        yield from _over(section, styles, curve, title, THRESHOLDS, labels, caption, curve)
    yield from _precision_recall(section, styles)
    yield from _over(
        section, styles, "found_again", "Finding the target again", np.arange(1.0, WITHIN + 1),
        ("frames since its return", "share of returns found"),
        "Share of absences of ten frames or more after which the box overlaps by more than ½ "
        f"within so many frames; after {WITHIN} in brackets.", "refound",
    )  # fmt: skip


def _heading(section: Section, title: str) -> str:
    return f"{title} on {section.dataset} (protocol {section.protocol})"


def _over(
    section: Section, styles: Styles, curve: str, title: str, x: Floats, labels: tuple[str, str],
    caption: str, number: str,
) -> Iterator[Drawing]:  # fmt: skip
    """Draw one curve over a common x; where it is not known of any tracker there is no plot."""
    lines = [
        line
        for line in lines_of(section, styles, curve, METRICS[number])
        if np.isfinite(line.y).any()
    ]
    if lines:
        heading = _heading(section, title)
        name = curve.replace("_", "-")
        yield name, heading, caption, partial(plots.curves, lines, x, heading, labels)


def _reliability(section: Section, styles: Styles) -> Iterator[Drawing]:
    lines = _against(section, styles, "calibration_share", "calibration_score", "ece")
    if not lines:
        return
    shares = {r.tracker: r.curves.get("calibration_frames") for r in section.results}
    heading = _heading(section, "Reliability of the score")

    def make() -> Figure:
        labels = ("mean score", "share of frames with IoU > ½")
        figure = plots.curves(lines, _SHARE, heading, labels)
        plots.diagonal(figure)
        for line in lines:
            share = shares[line.label]
            if share is not None:
                plots.dots(figure, line, share)
        return figure

    caption = (
        "Fifteen bins of the score; a dot's area is its share of frames, and a calibrated score "
        "lies on the diagonal. Expected calibration error in brackets."
    )
    yield "reliability", heading, caption, make


def _precision_recall(section: Section, styles: Styles) -> Iterator[Drawing]:
    lines = _against(section, styles, "pr_precision", "pr_recall", "f_score")
    if lines:
        heading = _heading(section, "Precision and recall")
        labels = ("tracking recall", "tracking precision")
        make = partial(plots.curves, lines, _SHARE, heading, labels)
        yield (
            "precision-recall",
            heading,
            "A point for each threshold; greatest F in brackets.",
            make,
        )


def _against(section: Section, styles: Styles, y: str, x: str, number: str) -> list[plots.Curve]:
    """Lines of one curve over another."""
    over = {r.tracker: r.curves.get(x) for r in section.results}
    lines = lines_of(section, styles, y, METRICS[number])
    return [replace(line, x=over[line.label]) for line in lines if over[line.label] is not None]
