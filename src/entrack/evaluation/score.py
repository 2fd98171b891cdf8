"""From results on disk to a row of numbers, under one protocol."""

from collections.abc import Mapping
from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from entrack.datasets import Dataset, Sequence
from entrack.errors import EntrackError
from entrack.evaluation import ope
from entrack.evaluation.protocol import Protocol, Score
from entrack.evaluation.raw import Results, fit_length

Row = dict[str, Any]


@dataclass(frozen=True)
class Truth:
    """A dataset's ground truth in memory: what can be scored, and what cannot."""

    name: str
    dataset: Dataset
    sequences: tuple[Sequence, ...]
    left_out: Mapping[str, str] = field(default_factory=dict[str, str])
    """Sequences that cannot be scored, and why."""

    @classmethod
    def read(cls, name: str, dataset: Dataset) -> "Truth":
        """Read every sequence's ground truth.

        Raises
        ------
        EntrackError
            If not one sequence can be scored.
        """
        sequences: list[Sequence] = []
        left_out: dict[str, str] = {}
        for sequence_name in dataset.names:
            try:
                sequence = dataset.read(sequence_name)
            except EntrackError as error:
                left_out[sequence_name] = str(error)
                continue
            if ope.valid(sequence.boxes).any():
                sequences.append(sequence)
            else:
                left_out[sequence_name] = f"{sequence_name} has no frame with a valid box"
        if not sequences:
            raise EntrackError(
                f"{name}: no sequence can be scored: {next(iter(left_out.values()))}"
            )
        return cls(name, dataset, tuple(sequences), left_out)


@dataclass(frozen=True)
class Scored:
    """Scores of one tracker on one dataset under one protocol, sequence by sequence."""

    protocol: Protocol
    scores: Mapping[str, Score]
    times: Mapping[str, ope.Floats]
    """Seconds of each frame but the first, empty where they are not known."""
    partial: Mapping[str, str]
    """Sequences with another number of results than frames: "120 results for 196 frames"."""

    def row(self) -> Row:
        """Numbers over all sequences, with a 95 % bootstrap interval beside each mean."""
        scores = list(self.scores.values())
        values, intervals = self.protocol.values(scores), self.protocol.intervals(scores)
        row: Row = {"sequences": len(scores), "frames": sum(s.frames for s in scores)}
        for name, value in values.items():
            row[name] = _number(value)
            bounds = intervals[name] if np.isfinite(value) else (np.nan, np.nan)
            row[f"{name}_95"] = [_number(bound) for bound in bounds]
        rates = 1 / np.concatenate([*self.times.values(), np.empty(0)])
        row["fps_mean"] = _number(rates.mean()) if len(rates) else None
        row["fps_median"] = _number(float(np.median(rates))) if len(rates) else None
        if self.partial:
            row["partial"] = dict(self.partial)
        return row

    def details(self, sequences: SequenceOf[Sequence]) -> dict[str, Any]:
        """Curves over all sequences, and each sequence's numbers and curves."""
        curves = self.protocol.curves(list(self.scores.values()))
        per_sequence: dict[str, Any] = {}
        for sequence in sequences:
            if sequence.name not in self.scores:
                continue
            one = [self.scores[sequence.name]]
            rates = 1 / self.times[sequence.name]
            per_sequence[sequence.name] = {
                "frames": one[0].frames,
                "attributes": list(sequence.attributes),
                "fps": _number(rates.mean()) if len(rates) else None,
                **{name: _number(value) for name, value in self.protocol.values(one).items()},
                "curves": _curves(self.protocol.curves(one)),
            }
        return {"curves": _curves(curves), "per_sequence": per_sequence}


def score(
    truth: Truth, results: Results, protocol: Protocol, *, allow_partial: bool = False
) -> Scored:
    """Score a tracker's results; sequences without a result are not in the answer.

    Raises
    ------
    EntrackError
        If results cannot be read, or are of another length and that is not allowed.
    """
    scores: dict[str, Score] = {}
    times: dict[str, ope.Floats] = {}
    partial: dict[str, str] = {}
    for sequence in truth.sequences:
        if not results.files(sequence.name):
            continue
        scores[sequence.name], cut = _score(sequence, truth, results, protocol, allow_partial)
        if cut:
            partial[sequence.name] = cut
        times[sequence.name] = results.times(sequence.name)
    return Scored(protocol, scores, times, partial)


def _score(
    sequence: Sequence, truth: Truth, results: Results, protocol: Protocol, allow_partial: bool
) -> tuple[Score, str]:
    where = str(results.root)
    if protocol.supervised:
        runs = results.trajectories(sequence.name)
        for run in runs:
            fit_length(run.regions.corners, sequence, where, allow_partial=False)
        return protocol.supervised(sequence, runs), ""
    found = results.boxes(sequence, truth.dataset)
    fitted = [fit_length(b, sequence, where, allow_partial=allow_partial) for b in found]
    odd = [len(b) for b in found if len(b) != len(sequence)]
    cut = f"{odd[0]} results for {len(sequence)} frames" if odd and allow_partial else ""
    shortest = min(fitted, key=lambda pair: len(pair[0]))[0]
    runs = [boxes[: len(shortest)] for _, boxes in fitted]
    if protocol.certain:
        said = results.certainty(sequence.name, len(found[0])).first(len(runs[0]))
        return protocol.certain(shortest, runs[0], said), cut
    assert protocol.ope
    return protocol.ope(shortest, runs), cut


def _curves(curves: Mapping[str, ope.Floats]) -> dict[str, list[float | None]]:
    return {n: [_number(v) for v in c.tolist()] for n, c in curves.items() if len(c) > 1}


def _number(value: float) -> float | None:
    """Six decimals are more than any table shows; JSON has no NaN."""
    return round(float(value), 6) if np.isfinite(value) else None
