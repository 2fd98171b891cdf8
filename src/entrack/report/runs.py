"""Run folders of `entrack evaluate`, read and put together by dataset and protocol."""

import json
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from entrack.errors import EntrackError
from entrack.files import read_bytes
from entrack.peers import Contender
from entrack.report.metrics import Metric, headline

Row = dict[str, Any]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Result:
    """One tracker on one dataset under one protocol.

    Parameters
    ----------
    tracker
        Its name in the report: unique, with the run's name where two runs have the same tracker.
    row
        Its row of `scores.json`.
    about
        The dataset's `dataset.json` in its run.
    curves
        Each curve over all sequences; NaN where nothing was counted.
    sequences
        Each sequence's numbers.
    run
        The folder that was given.
    raw
        Where its raw results are: a folder or a zip file.
    """

    tracker: str
    row: Row
    about: Row
    curves: dict[str, Floats]
    sequences: dict[str, Row]
    run: Path
    raw: Path

    def value(self, metric: Metric, sequence: str | None = None) -> float | None:
        """Return a number over all sequences or of one; None where there is none."""
        row = self.row if sequence is None else self.sequences.get(sequence, {})
        return row.get(metric.name)


@dataclass(frozen=True)
class Section:
    """What was measured under one protocol on one dataset, the best tracker first."""

    dataset: str
    format: str
    """Benchmark that the dataset is, or is a part of."""
    protocol: str
    results: tuple[Result, ...]

    @property
    def name(self) -> str:
        """Name for files and links, no two of one report the same."""
        parts = dict.fromkeys([self.dataset, self.format])
        return re.sub(r"[^\w.+-]+", "-", "-".join([*parts, self.protocol]))

    @property
    def sequences(self) -> list[str]:
        """Every sequence that a tracker has a score for, in the dataset's order."""
        return list(dict.fromkeys(name for result in self.results for name in result.sequences))


_Key = tuple[str, str, str]  # dataset, format, protocol
_Grouped = dict[_Key, list[Result]]


def read_sections(runs: Sequence[Path]) -> list[Section]:
    """Read run folders.

    Raises
    ------
    EntrackError
        If one of them is not a run, is given twice, or holds a file that cannot be read.
    """
    grouped: _Grouped = defaultdict(list)
    for run, times in Counter(run.resolve() for run in runs).items():
        if times > 1:
            raise EntrackError(f"the run {run} is given {times} times")
    for run in runs:
        for row in _rows(run):
            result = _result(run, row)
            grouped[row["dataset"], result.about["format"], row["protocol"]].append(result)
    return [
        Section(dataset, form, protocol, _ranked(results, protocol))
        for (dataset, form, protocol), results in _label(grouped, runs).items()
    ]


def _rows(run: Path) -> list[Row]:
    path = run / "scores.json"
    if not path.is_file():
        raise EntrackError(
            f"there is no {path}: expected a folder that entrack evaluate --out wrote"
        )
    rows = _json(path)
    names = ("dataset", "protocol", "tracker", "spec")
    if not isinstance(rows, list) or not all(_has(row, names) for row in rows):  # pyright: ignore[reportUnknownVariableType]
        raise EntrackError(f"{path} is not a list of rows with {', '.join(names)}")
    if not rows:
        raise EntrackError(f"{path} is empty: no tracker has a score yet")
    return rows  # pyright: ignore[reportUnknownVariableType]


def _has(content: Any, names: tuple[str, ...]) -> bool:
    return isinstance(content, dict) and all(name in content for name in names)


def _result(run: Path, row: Row) -> Result:
    about = _read(run / row["dataset"] / "dataset.json", ("format", "place"))
    contender = Contender(row["tracker"], row["spec"])
    folder = run / row["dataset"] / contender.folder
    details = _read(folder / "scores" / f"{row['protocol']}.json", ("curves", "per_sequence"))
    curves = {name: np.array(curve, np.float64) for name, curve in details["curves"].items()}
    raw = contender.results if contender.kind == "raw" else folder
    return Result(row["tracker"], row, about, curves, details["per_sequence"], run, raw)


def _read(path: Path, names: tuple[str, ...]) -> Row:
    content = _json(path)
    if not _has(content, names):
        raise EntrackError(f"{path} lacks {' or '.join(names)}: it is no file of entrack evaluate")
    return content


def _json(path: Path) -> Any:
    try:
        return json.loads(read_bytes(path))
    except EntrackError:
        raise
    except (ValueError, RecursionError) as error:
        raise EntrackError(f"{path} is not JSON: {error}") from error


def _label(grouped: _Grouped, runs: Sequence[Path]) -> _Grouped:
    """Add the run's name to trackers that two runs have measured on the same."""
    twice = {
        name
        for results in grouped.values()
        for name, times in Counter(result.tracker for result in results).items()
        if times > 1
    }
    short = {run: run.resolve().name for run in runs}
    names = short if len(set(short.values())) == len(runs) else {run: str(run) for run in runs}

    def label(result: Result) -> Result:
        if result.tracker not in twice:
            return result
        return replace(result, tracker=f"{result.tracker} ({names[result.run]})")

    return {key: [label(result) for result in results] for key, results in grouped.items()}


def _ranked(results: list[Result], protocol: str) -> tuple[Result, ...]:
    metric = headline(protocol)

    def rank(result: Result) -> float:
        value = result.value(metric)
        return np.inf if value is None else -value

    return tuple(sorted(results, key=rank))
