"""Table and plots of an ablation: cells with several seeds, paired over seeds and sequences."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from entrack.files import write_bytes
from entrack.report import formats, plots
from entrack.report.figures import rendered
from entrack.report.style import styles
from entrack.report.table import Cell, Column, Line, Table

Floats = NDArray[np.float64]
DRAWS = 10_000

ByCell = Mapping[str, Mapping[int, Mapping[str, float]]]
"""A number by cell, seed and sequence."""

ByRound = Mapping[str, Mapping[int, Mapping[int, float]]]
"""A number by cell, seed and round."""


@dataclass(frozen=True)
class Summary:
    """A cell's number, over its seeds and sequences."""

    name: str
    mean: float
    interval: tuple[float, float]
    """95 %, bootstrap: seeds and sequences are both drawn with replacement."""
    by_seed: tuple[float, ...]
    difference: float | None = None
    """To the reference cell, over what both have; None for the reference itself."""
    difference_interval: tuple[float, float] | None = None

    @property
    def deviation(self) -> float | None:
        """Standard deviation over seeds, where there are several."""
        return float(np.std(self.by_seed, ddof=1)) if len(self.by_seed) > 1 else None


def bootstrap(values: Floats, seed: int = 0) -> tuple[float, float]:
    """95 % interval of the mean of `values` (seeds, sequences), both drawn with replacement.

    >>> bootstrap(np.full((3, 5), 0.5))
    (0.5, 0.5)
    """
    rng = np.random.default_rng(seed)
    seeds, sequences = values.shape
    of_seeds = rng.multinomial(seeds, np.full(seeds, 1 / seeds), DRAWS)
    of_sequences = rng.multinomial(sequences, np.full(sequences, 1 / sequences), DRAWS)
    means = ((of_seeds @ values) * of_sequences).sum(axis=1) / values.size
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def summarise(numbers: ByCell, names: Sequence[str], reference: str) -> list[Summary]:
    """Each cell that has been measured, in the order of `names`."""
    found: list[Summary] = []
    for name in names:
        if name not in numbers:
            continue
        own = _matrix(numbers[name])
        difference, interval = None, None
        if name != reference and reference in numbers:
            common = sorted(numbers[name].keys() & numbers[reference].keys())
            if common:
                a, b = (_matrix({s: numbers[k][s] for s in common}) for k in (name, reference))
                difference, interval = float((a - b).mean()), bootstrap(a - b)
        seeds = tuple(own.mean(axis=1).tolist())
        found.append(Summary(name, float(own.mean()), bootstrap(own), seeds, difference, interval))
    return found


def _matrix(by_seed: Mapping[int, Mapping[str, float]]) -> Floats:
    """Numbers (seeds, sequences)."""
    rows = [by_seed[seed] for seed in sorted(by_seed)]
    return np.array([[row[name] for name in sorted(rows[0])] for row in rows], np.float64)


def write_ablation(
    title: str, dataset: str, overlap: ByCell, lost: ByCell, names: Sequence[str],
    reference: str, published: Mapping[str, float], path: Path,
) -> Table:  # fmt: skip
    """Write `path`.md, .csv, .tex, .svg and .png; return the table."""
    found = summarise(overlap, names, reference)
    shares = {s.name: s.mean for s in summarise(lost, names, reference)}
    columns = [
        Column("Cell"),
        Column("Overlap", 3, higher=True),
        Column("SD of seeds", 3),
        Column(f"Difference to {reference}", 3),
        Column("Frames lost", 3, higher=False),
        Column("Seeds", 0),
    ]
    if published:
        columns.append(Column("The paper, on OTB100", 3, higher=True, quoted=True))
    lines: list[Line] = []
    for s in found:
        cells = [
            Cell(s.name), Cell(s.mean, s.interval), Cell(s.deviation),
            Cell(s.difference, s.difference_interval), Cell(shares[s.name]), Cell(len(s.by_seed)),
        ]  # fmt: skip
        if published:
            cells.append(Cell(published.get(s.name)))
        lines.append(Line(tuple(cells)))
    note = (
        f"{dataset}. In brackets: 95 % intervals, seeds and sequences drawn with replacement; "
        "differences are paired over both."
    )
    table = Table(path.name, f"{title}.", tuple(columns), tuple(lines), note)
    for ending, text in formats.texts(table).items():
        write_bytes(path.with_name(f"{path.name}.{ending}"), text.encode())
    _write(path, lambda: _plot(f"{title}\n{dataset}", found, published))
    return table


def write_curves(title: str, overlap: ByRound, names: Sequence[str], path: Path) -> None:
    """Write `path`.svg and .png: how each cell's overlap went, as the mean of its seeds."""
    measured = [name for name in names if name in overlap]
    looks = styles(list(names))
    lines: list[plots.Curve] = []
    for name in measured:
        seeds = list(overlap[name].values())
        rounds = sorted(set(seeds[0]).intersection(*seeds[1:]))
        means = np.array([[seed[k] for k in rounds] for seed in seeds]).mean(axis=0)
        lines.append(plots.Curve(name, looks[name], means, means[-1], np.array(rounds, np.float64)))
    last = max((line.x[-1] for line in lines if line.x is not None), default=0)
    if last > 0:
        x, labels = np.array([0.0, last]), ("rounds", "mean IoU, validation clips")
        _write(path, lambda: plots.curves(lines, x, title, labels, top=None))


def _write(path: Path, draw: Callable[[], Figure]) -> None:
    with matplotlib.rc_context(plots.RC):
        svg, png = rendered(draw())
    write_bytes(path.with_name(f"{path.name}.svg"), svg.encode())
    write_bytes(path.with_name(f"{path.name}.png"), png)


def _plot(title: str, found: Sequence[Summary], published: Mapping[str, float]) -> Figure:
    """Means with their intervals, single seeds as small points, and the paper's numbers."""
    figure, axes = plots.figure_with_axes(title, ("", "overlap"))
    x = np.arange(len(found))
    means = np.array([s.mean for s in found])
    bounds = np.array([s.interval for s in found]).T
    gaps = np.abs(bounds - means)
    axes.errorbar(x, means, gaps, fmt="o", color=plots.INK, capsize=3, label="mean, 95 % interval")
    for place, s in enumerate(found):
        spread = place + 0.16 + np.zeros(len(s.by_seed))
        label = "single seeds" if place == 0 else None
        axes.plot(spread, s.by_seed, ".", color=plots.QUIET, label=label)
    if published:
        theirs = [published.get(s.name, np.nan) for s in found]
        axes.plot(x, theirs, "D--", color=plots.QUIET, mfc="none", label="the paper, on OTB100")
    axes.set_xticks(x, [s.name for s in found])
    if max(len(s.name) for s in found) > 8:
        axes.tick_params(axis="x", rotation=20)
    # Outside: intervals are long, and one of them would be hidden.
    figure.legend(fontsize=8, ncols=3, loc="outside lower center", frameon=False)
    return figure
