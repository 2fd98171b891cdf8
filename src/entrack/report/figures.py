"""The plots of a section."""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from entrack.evaluation.ope import NORM_PRECISION, PRECISION, SUCCESS, SUCCESS_101
from entrack.evaluation.protocols import EAO_BOUNDS
from entrack.files import write_bytes
from entrack.report import certainty, plots, timeline
from entrack.report.drawing import Drawing, Styles, lines_of
from entrack.report.metrics import METRICS, SUPERVISED, Metric, headline
from entrack.report.plane import Point, plane
from entrack.report.runs import Section
from entrack.report.table import Table
from entrack.report.tables import quotes


@dataclass(frozen=True)
class Plot:
    """A drawn plot.

    Parameters
    ----------
    name
        For files and links.
    caption
        What it shows, in one sentence.
    svg, png
        The drawing.
    """

    name: str
    title: str
    caption: str
    svg: str
    png: bytes

    def write(self, folder: Path) -> None:
        """Write `<name>.svg` and `<name>.png`."""
        write_bytes(folder / f"{self.name}.svg", self.svg.encode())
        write_bytes(folder / f"{self.name}.png", self.png)


def draw(
    section: Section, styles: Styles, attributes: Table | None, shown: Sequence[str]
) -> list[Plot]:
    """Draw every plot for which a section has numbers; `shown` are sequences to look at closely."""
    if section.protocol == "longterm":
        drawings = [
            *certainty.drawings(section, styles),
            *timeline.drawings(section, styles, shown),
        ]
    else:
        drawings = [*_curves(section, styles), *_expected_overlap(section, styles)]
    if attributes is not None and len(attributes.lines) > 3:
        drawings.append(_radar(section, styles, attributes))
    drawings += [*_accuracy_robustness(section, styles), *_speed(section, styles)]
    with matplotlib.rc_context(plots.RC):
        return [
            Plot(f"{section.name}-{name}", title, caption, *rendered(make()))
            for name, title, caption, make in drawings
        ]


def rendered(figure: Figure) -> tuple[str, bytes]:
    """A figure as SVG and as PNG."""
    svg, png = io.StringIO(), io.BytesIO()
    figure.savefig(svg, format="svg", metadata={"Date": None})
    figure.savefig(png, format="png", dpi=200)
    return svg.getvalue(), png.getvalue()


_CURVES = (
    ("success", "Success", "auc", "overlap threshold", "Share of frames that overlap the target by "
     "more than the threshold"),
    ("precision", "Precision", "precision", "distance threshold (pixels)", "Share of frames whose "
     "centre is no further away than the threshold"),
    ("norm_precision", "Normalised precision", "norm_precision", "distance threshold (sizes of the "
     "target)", "Share of frames whose centre is no further away, in sizes of the target"),
)  # fmt: skip


def _curves(section: Section, styles: Styles) -> Iterator[Drawing]:
    for curve, title, name, x_label, meaning in _CURVES:
        metric = METRICS[name]
        lines = lines_of(section, styles, curve, metric)
        if not lines:
            continue
        x = {"precision": PRECISION, "norm_precision": NORM_PRECISION}.get(curve)
        if x is None:
            x = SUCCESS if len(lines[0].y) == len(SUCCESS) else SUCCESS_101
        heading = f"{title} on {section.dataset} (protocol {section.protocol})"

        labels = (x_label, "share of frames")
        make = partial(plots.curves, lines, x, heading, labels)
        yield curve, heading, f"{meaning}; {metric.title} in brackets.", make


def _expected_overlap(section: Section, styles: Styles) -> Iterator[Drawing]:
    lines = lines_of(section, styles, "expected_overlap", METRICS["eao"])
    if not lines:
        return
    # The first point is not defined; a run of N frames is point N − 1 with pysot, N else.
    shift = 0 if section.protocol == "vot-toolkit" else 1
    x = np.arange(1.0, len(lines[0].y)) + shift
    cut = [plots.Curve(line.label, line.style, line.y[1:], line.value) for line in lines]
    low, high = EAO_BOUNDS[section.format]
    heading = f"Expected average overlap on {section.dataset} (protocol {section.protocol})"

    def make() -> Figure:
        figure = plots.curves(cut, x, heading, ("frames of a run", "expected overlap"), top=None)
        plots.shade(figure, low, high)
        return figure

    meaning = "Mean overlap of a run of so many frames without a new start; EAO, the mean from "
    yield "expected-overlap", heading, f"{meaning}{low} to {high} (shaded), in brackets.", make


def _radar(section: Section, styles: Styles, table: Table) -> Drawing:
    lines = table.lines[1:]
    names = [f"{line.cells[0].value} ({line.cells[1].value})" for line in lines]
    webs = [
        plots.Curve(
            result.tracker,
            styles[result.tracker],
            np.array([line.cells[2 + i].value for line in lines], np.float64),
            result.value(headline(section.protocol)),
        )
        for i, result in enumerate(section.results)
    ]
    heading = f"{headline(section.protocol).title} by attribute on {section.dataset}"
    caption = "In brackets: sequences with the attribute; behind names, the number over all."
    return "radar", heading, caption, partial(plots.radar, webs, names, heading)


def _accuracy_robustness(section: Section, styles: Styles) -> Iterator[Drawing]:
    if section.protocol not in SUPERVISED:
        return
    points = _points(section, styles, METRICS["robustness"], METRICS["accuracy"])
    unit = "a video" if section.protocol == "vot-toolkit" else "per 100 frames"
    heading = f"Accuracy and robustness on {section.dataset} (protocol {section.protocol})"
    labels = (f"robustness: failures {unit}, fewer to the right", "accuracy: mean overlap")
    caption = "The best are in the upper right corner. Hollow: quoted."
    make = partial(plane, points, heading, labels, invert_x=True)
    yield "accuracy-robustness", heading, caption, make


def _speed(section: Section, styles: Styles) -> Iterator[Drawing]:
    metric = headline(section.protocol)
    points = _points(section, styles, METRICS["fps_mean"], metric)
    if not any(point.style for point in points):
        return
    heading = f"Speed and {metric.title} on {section.dataset} (protocol {section.protocol})"
    labels = ("frames a second, faster to the right", metric.title)
    machines = {str(r.row["machine"]) for r in section.results if r.row.get("machine")}
    caption = f"Ours: on {'; '.join(sorted(machines)) or 'a machine that is not known'}."
    caption += " Hollow: quoted, on other machines."
    make = partial(plane, points, heading, labels, log_x=True)
    yield "speed", heading, caption, make


def _points(section: Section, styles: Styles, x: Metric, y: Metric) -> list[Point]:
    ours = [
        Point(r.tracker, r.row[x.name], r.row[y.name], styles[r.tracker])
        for r in section.results
        if r.value(x) is not None and r.value(y) is not None
    ]
    theirs = [
        Point(q.tracker, q.numbers[x.name], q.numbers[y.name])
        for q in quotes(section)
        if {x.name, y.name} <= q.numbers.keys()
    ]
    return ours + theirs
