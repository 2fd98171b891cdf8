"""What a report shows of one section, and what a reader should know of it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from entrack.report import comparison, figures, strips, tables
from entrack.report.drawing import Styles
from entrack.report.figures import Plot
from entrack.report.metrics import by_sequence
from entrack.report.runs import Section
from entrack.report.strips import Strip
from entrack.report.table import Table


@dataclass(frozen=True)
class Chapter:
    """A section with all that is shown of it; the first table is that of the results."""

    section: Section
    tables: list[Table]
    plots: list[Plot]
    strips: list[Strip]
    notes: list[str]


def chapter(
    section: Section, styles: Styles, baseline: str | None, sequences: Sequence[str]
) -> Chapter:
    """Draw and count everything.

    Parameters
    ----------
    baseline
        Tracker with which the others are compared; by default the best.
    sequences
        Sequences of the filmstrips; empty for a choice.
    """
    attributes = tables.attributes(section)
    compared = comparison.against(section, baseline or section.results[0].tracker)
    shown = [
        tables.overall(section),
        *(table for table in (compared, attributes) if table is not None),
        *(tables.sequences(section, metric) for metric in by_sequence(section.protocol)),
    ]
    pictures, why_not = strips.filmstrips(section, styles, sequences)
    notes = [*_notes(section, baseline), *([why_not] if why_not else [])]
    plots = figures.draw(section, styles, attributes, strips.chosen(section, sequences))
    return Chapter(section, shown, plots, pictures, notes)


def _notes(section: Section, baseline: str | None) -> Iterator[str]:
    official, here = section.results[0].about.get("official"), len(section.sequences)
    if official and here < official:
        note = f"These are {here} of the benchmark's {official} sequences"
        quoted = ": quoted numbers are of all of them" if tables.quotes(section) else ""
        yield f"{note}{quoted}."
    if len({frozenset(result.sequences) for result in section.results}) > 1:
        yield (
            "Trackers were not scored on the same sequences, so their numbers cannot be compared; "
            "differences are over the sequences that both have."
        )
    for result in section.results:
        failed: dict[str, str] = result.row.get("failed") or {}
        partial: dict[str, str] = result.row.get("partial") or {}
        yield from (f"{result.tracker} failed on {name}: {why}" for name, why in failed.items())
        for name, part in partial.items():
            yield f"{result.tracker} on {name}: {part} frames are scored."
    if baseline and baseline not in {result.tracker for result in section.results}:
        yield f"{baseline} was not scored here, so nothing is compared with it."
