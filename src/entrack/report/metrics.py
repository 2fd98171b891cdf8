"""What the numbers are called, which way they get better, and what a protocol means by them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Metric:
    """A number of `scores.json`.

    Parameters
    ----------
    name
        Its key.
    title
        Its name in tables.
    digits
        Decimals in tables.
    higher
        Whether more is better; None where a certain value is.
    """

    name: str
    title: str
    digits: int = 3
    higher: bool | None = True


METRICS = {
    metric.name: metric
    for metric in (
        Metric("auc", "AUC"),
        Metric("precision", "P (20 px)"),
        Metric("norm_precision", "NP (0.2)"),
        Metric("op50", "OP (0.5)"),
        Metric("op75", "OP (0.75)"),
        Metric("ao", "AO"),
        Metric("eao", "EAO"),
        Metric("accuracy", "A"),
        Metric("robustness", "R", higher=False),
        Metric("f_score", "F"),
        Metric("tracking_precision", "Pr"),
        Metric("tracking_recall", "Re"),
        Metric("roc_auc", "ROC AUC"),
        Metric("ece", "ECE", higher=False),
        Metric("coverage", "1σ coverage", higher=None),
        Metric("coverage_held", "1σ coverage, held", higher=None),
        Metric("refound", "Re-found"),
        Metric("refound_frames", "Frames to re-find half", digits=0, higher=False),
        Metric("fps_mean", "Frames/s", digits=1),
    )
}
"""In the order of the tables' columns."""

SUPERVISED = ("vot2016", "vot2018", "vot2019", "vot-toolkit")

MEANINGS = {
    "otb": "One pass. AUC is the mean of the success curve over 21 overlaps and then over "
    "sequences; a perfect tracker scores 0.952. Frames without ground truth are failures.",
    "uav123": "One pass, as OTB, but frames without ground truth fail in success and succeed in "
    "precision.",
    "lasot": "One pass, as OTB, but absent frames cannot succeed and are counted; a perfect "
    "tracker scores 0.927 on the whole test set.",
    "got10k": "One pass. AO is the mean overlap over the frames of all sequences in one pool, "
    "without the first frames and without absent ones.",
    "longterm": "One pass, with how sure the tracker was. F, precision and recall of VOT-LT at the "
    "threshold with the greatest F; ROC AUC of the score as a detector of any overlap; expected "
    "calibration error for overlaps of more than ½; share of sides within one σ; share of targets "
    "found within 30 frames of their return.",
    "vot-toolkit": "Supervised: started again after each failure. The rules of vot-toolkit 0.8 "
    "and later; R is failures a video.",
}
_PYSOT = (
    "Supervised: started again after each failure. The rules of pysot; R is failures per 100 "
    "frames, fewer are better."
)


def headline(protocol: str) -> Metric:
    """Return the number by which trackers are ranked under a protocol.

    >>> headline("lasot").title, headline("got10k").title, headline("vot2018").title
    ('AUC', 'AO', 'EAO')
    """
    if protocol in SUPERVISED:
        return METRICS["eao"]
    return METRICS[{"got10k": "ao", "longterm": "f_score"}.get(protocol, "auc")]


def by_sequence(protocol: str) -> tuple[Metric, ...]:
    """Return the numbers that make sense for one sequence alone, which EAO does not."""
    if protocol in SUPERVISED:
        return METRICS["robustness"], METRICS["accuracy"]
    return (headline(protocol),)


def pooled(protocol: str) -> bool:
    """Whether a number is taken over the frames of all sequences, not as a mean of sequences."""
    return protocol in SUPERVISED or protocol == "got10k"


def meaning(protocol: str) -> str:
    """Return what a protocol counts, in two sentences."""
    return MEANINGS.get(protocol, _PYSOT)
