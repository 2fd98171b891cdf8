"""Is one tracker better than another? Paired over sequences, seeded.

The interval of the difference is a paired bootstrap's: sequences are drawn with replacement, each
with both trackers' numbers. p is that of a paired randomisation test: were the two trackers alike,
the sign of each sequence's difference could as well be the other one. It stays honest where there
are few sequences, with which a bootstrap is too sure of itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack.report.metrics import Metric, by_sequence, pooled
from entrack.report.runs import Result, Section
from entrack.report.table import Cell, Column, Line, Table

DRAWS = 10_000


@dataclass(frozen=True)
class Difference:
    """What a tracker has more than the baseline, over the sequences that both have.

    Parameters
    ----------
    mean
        Weighted mean of the differences.
    interval
        Its 95 % bootstrap interval.
    p
        Two-sided, before it is corrected for the number of trackers.
    above, below
        Sequences on which the tracker's number is greater and smaller.
    """

    mean: float
    interval: tuple[float, float]
    p: float
    above: int
    below: int


def compare(differences: ArrayLike, weights: ArrayLike, seed: int = 0) -> Difference:
    """Compare two trackers by the differences (N,) of their numbers, N ≥ 1, and weights (N,).

    >>> compare([0.1] * 20, [1] * 20).p < 0.001
    True
    >>> compare([0.1, -0.1, 0.2, -0.2], [1, 1, 1, 1]).p
    1.0
    """
    d, w = np.asarray(differences, np.float64), np.asarray(weights, np.float64)
    random = np.random.default_rng(seed)
    counts = random.multinomial(len(d), np.full(len(d), 1 / len(d)), DRAWS)
    low, high = np.percentile((counts @ (w * d)) / (counts @ w), [2.5, 97.5])
    signs: NDArray[np.int8] = random.choice(np.array([-1, 1], np.int8), (DRAWS, len(d)))
    total = abs(float(w @ d))
    # The difference that was found is one of those that might have been.
    as_far = 1 + int((np.abs(signs @ (w * d)) >= total * (1 - 1e-12)).sum())
    p = as_far / (DRAWS + 1)
    return Difference(
        float(w @ d / w.sum()), (float(low), float(high)), p, int((d > 0).sum()), int((d < 0).sum())
    )


def holm(p: Sequence[float]) -> list[float]:
    """Correct p values for their number, as Holm: all are right with 95 % if each is below .05.

    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    order = sorted(range(len(p)), key=lambda i: p[i])
    corrected, worst = list(p), 0.0
    for rank, i in enumerate(order):
        worst = max(worst, min(1.0, p[i] * (len(p) - rank)))
        corrected[i] = worst
    return corrected


def against(section: Section, baseline: str) -> Table | None:
    """Each tracker against the baseline; None where there is nobody to compare."""
    base = next((r for r in section.results if r.tracker == baseline), None)
    others = [r for r in section.results if r is not base]
    if base is None or not others:
        return None
    columns = (
        Column("Tracker", mark="cells"),
        Column("Number"),
        Column("Difference", 3, None),
        Column("Better / worse on"),
        Column("p (Holm)", 4, None),
        Column("Verdict"),
    )
    lines: list[Line] = []
    for metric in by_sequence(section.protocol):
        pairs = [(r, _paired(r, base, metric, section.protocol)) for r in others]
        found = [(r, compare(*pair), len(pair[0])) for r, pair in pairs if pair[0]]
        for (result, d, common), p in zip(found, holm([d.p for _, d, _ in found]), strict=True):
            better, worse = (d.above, d.below) if metric.higher else (d.below, d.above)
            winner = (d.mean > 0) == metric.higher
            verdict = "undecided" if p >= 0.05 else "better" if winner else "worse"
            cells = (
                Cell(result.tracker), Cell(metric.title), Cell(d.mean, d.interval),
                Cell(f"{better} / {worse} of {common}"), Cell(p), Cell(verdict),
            )  # fmt: skip
            lines.append(Line(cells))
    note = (
        "Differences over the sequences that both have, with 95 % intervals of a paired bootstrap; "
        "p of a two-sided paired randomisation test (signs), corrected by Holm's method; "
        "10 000 draws each, seed 0."
    )
    if pooled(section.protocol):
        note += " Sequences weigh as many frames as they have."
    return Table(
        f"{section.name}-comparison", f"Against {baseline}", columns, tuple(lines), note
    ) if lines else None  # fmt: skip


def _paired(
    result: Result, base: Result, metric: Metric, protocol: str
) -> tuple[list[float], list[float]]:
    """Differences and weights of the sequences that both have."""
    differences: list[float] = []
    weights: list[float] = []
    for name, sequence in base.sequences.items():
        ours, theirs = result.value(metric, name), base.value(metric, name)
        if ours is not None and theirs is not None:
            differences.append(ours - theirs)
            weights.append(float(sequence["frames"]) if pooled(protocol) else 1.0)
    return differences, weights
