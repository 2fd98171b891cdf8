"""Reports: what `entrack evaluate` measured, as a page, plots and tables, as papers print them."""

from collections.abc import Sequence
from pathlib import Path

from entrack.errors import EntrackError, require
from entrack.files import write_bytes, writing

__all__ = ["write_report"]


def write_report(
    runs: Sequence[Path],
    out: Path,
    baseline: str | None = None,
    sequences: Sequence[str] = (),
) -> Path:
    """Write a report of one or several runs; return the page, `out`/report.html.

    Parameters
    ----------
    runs
        Folders that `entrack evaluate` wrote. A tracker that two of them have measured on the same
        dataset appears once for each, with the run's name.
    out
        Folder for the page, plots/ (SVG, PNG), tables/ (CSV, Markdown, LaTeX) and strips/ (JPEG).
    baseline
        Tracker with which the others are compared; by default each section's best.
    sequences
        Sequences of the filmstrips; by default the worst, and those that divide trackers most.

    Raises
    ------
    EntrackError
        If a run cannot be read, or there is no such tracker or sequence.
    """
    require("matplotlib", "report")
    require("jinja2", "report")
    # Here, as matplotlib and jinja2 are an extra.
    from entrack.report import formats, page, published
    from entrack.report.chapters import chapter
    from entrack.report.runs import read_sections
    from entrack.report.style import styles

    sections = read_sections(runs)
    trackers = [result.tracker for section in sections for result in section.results]
    names = [name for section in sections for name in section.sequences]
    _check_known("tracker", [baseline] if baseline else [], trackers)
    _check_known("sequence", sequences, names)
    looks = styles(trackers)
    chapters = [chapter(section, looks, baseline, sequences) for section in sections]
    references = published.reference_tables()
    for folder in ("plots", "tables", "strips"):
        with writing(out / folder):
            (out / folder).mkdir(parents=True, exist_ok=True)
    for each in chapters:
        for plot in each.plots:
            plot.write(out / "plots")
        for strip in each.strips:
            write_bytes(out / "strips" / f"{strip.name}.jpg", strip.jpeg)
    for table in [*(table for each in chapters for table in each.tables), *references]:
        for ending, text in formats.texts(table).items():
            write_bytes(out / "tables" / f"{table.name}.{ending}", text.encode())
    path = out / "report.html"
    write_bytes(path, page.render(chapters, references, looks).encode())
    return path


def _check_known(what: str, wanted: Sequence[str], known: Sequence[str]) -> None:
    for name in wanted:
        if name not in known:
            few = list(dict.fromkeys(known))
            listed = ", ".join(few[:10]) + ", …" * (len(few) > 10)
            raise EntrackError(f"no {what} {name} in these runs: they have {listed}")
