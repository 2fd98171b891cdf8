"""The tables of a section: numbers from a run, and what others have published beside them."""

from collections import Counter

import numpy as np

from entrack.datasets import lists
from entrack.evaluation.protocols import default_protocol
from entrack.report import published
from entrack.report.metrics import METRICS, Metric, headline, pooled
from entrack.report.runs import Result, Section
from entrack.report.table import Cell, Column, Line, Table

_OVERALL = "All"


def quotes(section: Section) -> list[published.Quote]:
    """Published numbers that mean the same as a section's: those of its usual protocol."""
    if section.protocol != default_protocol(section.format):
        return []
    return published.quotes(section.format)


def overall(section: Section) -> Table:
    """Every tracker's numbers with 95 % intervals, the best first, and the published ones."""
    metrics = [m for m in METRICS.values() if any(r.value(m) is not None for r in section.results)]
    columns = (
        Column("Tracker", mark="cells"),
        *(Column(m.title, m.digits, m.higher) for m in metrics),
        Column("Sequences"),
        Column("Source"),
    )
    lines: list[Line] = []
    for result in section.results:
        numbers = [Cell(result.value(m), _interval(result, m)) for m in metrics]
        cells = (
            Cell(result.tracker),
            *numbers,
            Cell(_scored(result)),
            Cell(f"run {result.run.name}"),
        )
        lines.append(Line(cells))
    quoted = quotes(section)
    for quote in quoted:
        numbers = [Cell(quote.numbers.get(m.name)) for m in metrics]
        whole = str(published.OFFICIAL[section.format])
        cells = (Cell(quote.tracker), *numbers, Cell(whole), Cell(f"quoted: {quote.source}"))
        lines.append(Line(cells, quoted=True))
    note = "In brackets: 95 % bootstrap intervals over sequences."
    if quoted:
        note += " Quoted lines are copied from their sources, and are of the whole benchmark."
    return Table(f"{section.name}-overall", "Results", columns, tuple(lines), note)


def _interval(result: Result, metric: Metric) -> tuple[float, float] | None:
    bounds = result.row.get(f"{metric.name}_95")
    return None if bounds is None or None in bounds else (bounds[0], bounds[1])


def _scored(result: Result) -> str:
    """How much of the benchmark: "13 of 100, 1 failed"."""
    row = result.row
    words = str(row.get("sequences", len(result.sequences)))
    whole = row.get("official") or row.get("available")
    words += f" of {whole}" if whole and str(whole) != words else ""
    failed = len(row.get("failed") or ())
    return words + f", {failed} failed" * bool(failed) + ", some in part" * bool(row.get("partial"))


def attributes(section: Section) -> Table | None:
    """AUC by attribute; None where no sequence has one, or numbers are not means of sequences."""
    labels = {
        name: tuple(sequence.get("attributes") or ())
        for result in section.results
        for name, sequence in result.sequences.items()
    }
    counts = Counter(label for given in labels.values() for label in given)
    if not counts or pooled(section.protocol):
        return None
    metric = headline(section.protocol)
    quoted = published.attribute_columns() if section.format == "lasot" else {}
    columns = (
        Column("Attribute"),
        Column("Sequences"),
        *(Column(r.tracker, 3, metric.higher, mark="heading", bar=True) for r in section.results),
        *(Column(f"{name} (quoted)", 3, metric.higher, quoted=True) for name in quoted),
    )

    def line(attribute: str, count: int) -> Line:
        cells = [Cell(_mean(r, metric, labels, attribute)) for r in section.results]
        spelt = published.ATTRIBUTES.get(attribute, attribute)
        theirs = [Cell(column.get(spelt)) for column in quoted.values()]
        return Line((Cell(attribute), Cell(count), *cells, *theirs))

    known = {name: place for place, name in enumerate(lists.lasot_attributes())}
    order = sorted(counts, key=lambda name: (known.get(name, len(known)), name))
    lines = (line(_OVERALL, len(labels)), *(line(name, counts[name]) for name in order))
    note = f"Mean {metric.title} of the sequences that have the attribute."
    caption = f"{metric.title} by attribute"
    return Table(f"{section.name}-attributes", caption, columns, lines, note, best="row")


def _mean(
    result: Result, metric: Metric, labels: dict[str, tuple[str, ...]], attribute: str
) -> float | None:
    values = [
        value
        for name, given in labels.items()
        if attribute == _OVERALL or attribute in given
        if (value := result.value(metric, name)) is not None
    ]
    return float(np.mean(values)) if values else None


def sequences(section: Section, metric: Metric) -> Table:
    """Every tracker's number on every sequence, the worst sequence first."""
    columns = (
        Column("Sequence"),
        Column("Frames"),
        *(
            Column(
                r.tracker,
                metric.digits,
                metric.higher,
                mark="heading",
                bar=metric.name != "robustness",
            )
            for r in section.results
        ),
    )
    frames = {n: s.get("frames") for r in section.results for n, s in r.sequences.items()}
    lines = [
        Line(
            (
                Cell(name),
                Cell(frames[name]),
                *(Cell(r.value(metric, name)) for r in section.results),
            )
        )
        for name in worst_first(section, metric)
    ]
    return Table(
        f"{section.name}-sequences-{metric.name}",
        f"{metric.title} by sequence",
        columns,
        tuple(lines),
        "Sorted by the mean over trackers, the worst first.",
        best="row",
    )


def worst_first(section: Section, metric: Metric) -> list[str]:
    """Names of sequences by the mean of all trackers."""

    def badness(name: str) -> float:
        values = [v for r in section.results if (v := r.value(metric, name)) is not None]
        mean = float(np.mean(values)) if values else 0.0
        return mean if metric.higher else -mean

    return sorted(section.sequences, key=badness)
