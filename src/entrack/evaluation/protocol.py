"""What a protocol is: sums over sequences, and the numbers that are made of them.

Every number of nearly every protocol is a quotient of two sums over sequences, possibly for each
point of a curve. A sequence therefore adds a numerator and a denominator a curve, and totals,
curves and bootstrap intervals come from the same few lines.
"""

from collections.abc import Callable, Mapping
from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from entrack.datasets.sequence import Sequence
from entrack.evaluation import vot
from entrack.evaluation.certainty import Certainty

Floats = NDArray[np.float64]
Terms = dict[str, tuple[Floats, Floats]]
"""Numerator and denominator of each curve; a plain number is a curve of one point."""


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
        Scores predicted boxes, one array (T, 4) a repetition.
    supervised
        Scores trajectories, one a repetition.
    toolkit
        Failures are found by vot-toolkit's overlap while the tracker runs, not by region.c's.
    certain
        Scores the boxes (T, 4) of one run together with what the tracker said of itself. A protocol
        has one of the three.
    """

    name: str
    formats: tuple[str, ...]
    numbers: Mapping[str, tuple[str, slice]]
    ope: Callable[[Sequence, list[Floats]], Score] | None = None
    supervised: Callable[[Sequence, list[vot.Trajectory]], Score] | None = None
    certain: Callable[[Sequence, Floats, Certainty], Score] | None = None
    toolkit: bool = False

    def curves(self, scores: SequenceOf[Score]) -> dict[str, Floats]:
        """Curves over all sequences; NaN where nothing was counted."""
        names = dict.fromkeys(curve for curve, _ in self.numbers.values())
        return {name: quotient(scores, name, np.ones((1, len(scores))))[0] for name in names}

    def values(self, scores: SequenceOf[Score]) -> dict[str, float]:
        """Numbers over all sequences; NaN where nothing was counted."""
        once = self.drawn(scores, np.ones((1, len(scores))))
        return {name: float(values[0]) for name, values in once.items()}

    def intervals(
        self, scores: SequenceOf[Score], seed: int = 0, draws: int = 1000
    ) -> dict[str, tuple[float, float]]:
        """95 % bootstrap interval of each number: sequences are drawn with replacement."""
        random = np.random.default_rng(seed)
        share = np.full(len(scores), 1 / len(scores))
        counts = random.multinomial(len(scores), share, draws).astype(np.float64)
        result: dict[str, tuple[float, float]] = {}
        for name, drawn in self.drawn(scores, counts).items():
            finite = drawn[np.isfinite(drawn)]
            low, high = np.percentile(finite if len(finite) else [np.nan], [2.5, 97.5])
            result[name] = (float(low), float(high))
        return result

    def drawn(self, scores: SequenceOf[Score], counts: Floats) -> dict[str, Floats]:
        """Numbers (draws,) over sequences that count so often, `counts` (draws, sequences)."""
        return {
            name: np.array([mean(row[part]) for row in quotient(scores, curve, counts)])
            for name, (curve, part) in self.numbers.items()
        }


def quotient(scores: SequenceOf[Score], curve: str, counts: Floats) -> Floats:
    """Curves (draws, points) in which each sequence counts so often."""
    above, below = (np.stack([s.terms[curve][i] for s in scores]) for i in (0, 1))
    result = ratio(counts @ above, counts @ below)
    reaches = [s.reach for s in scores if s.reach is not None]
    if reaches:
        result[:, max(reaches) :] = np.nan
    return result


def mean(values: Floats) -> float:
    """Mean of the finite ones; NaN where there are none."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")


def ratio(above: Floats, below: Floats) -> Floats:
    """Quotients; NaN where nothing was counted."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(below > 0, above / below, np.nan)
