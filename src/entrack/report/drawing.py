"""What is drawn of a section: which curves, in which looks."""

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from entrack.report import plots
from entrack.report.metrics import Metric
from entrack.report.runs import Section
from entrack.report.style import Style

Styles = dict[str, Style]
Drawing = tuple[str, str, str, Callable[[], Figure]]
"""Name, title, caption, and what makes the figure."""


def lines_of(section: Section, styles: Styles, curve: str, metric: Metric) -> list[plots.Curve]:
    """Curves in the order of their number, the best first."""
    lines = [
        plots.Curve(r.tracker, styles[r.tracker], r.curves[curve], r.value(metric))
        for r in section.results
        if curve in r.curves
    ]
    sign = -1 if metric.higher else 1
    return sorted(lines, key=lambda line: np.inf if line.value is None else sign * line.value)
