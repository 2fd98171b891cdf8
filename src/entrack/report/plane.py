"""Trackers as points in a plane, each with its name beside it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from entrack.report import plots
from entrack.report.plots import INK, PAPER, QUIET
from entrack.report.style import Style

Floats = NDArray[np.float64]
_NEAR = 9.0  # points from a point to its name


@dataclass(frozen=True)
class Point:
    """A tracker in the plane; one without a style is quoted."""

    label: str
    x: float
    y: float
    style: Style | None = None


def plane(
    points: Sequence[Point], title: str, labels: tuple[str, str], *, log_x: bool = False,
    invert_x: bool = False,
) -> Figure:  # fmt: skip
    """Points with their names beside them; quoted ones are hollow."""
    figure, axes = plots.figure_with_axes(title, labels)
    if log_x:
        axes.set_xscale("log")
        # Whatever the range: 1, 2, 5, 10, … as plain numbers.
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
    axes.margins(0.14)
    axes.plot([p.x for p in points], [p.y for p in points], linestyle="none")  # sets the limits
    if invert_x:
        axes.invert_xaxis()
    figure.draw_without_rendering()
    taken = [_box(axes, p, np.full(2, -6.0), np.full(2, 12.0)) for p in points]
    for point in points:
        if point.style is None:
            axes.plot(point.x, point.y, "o", ms=5, mfc=PAPER, mec=QUIET, mew=1)
        else:
            plots.bullet(axes, point.x, point.y, point.style)
        _name(axes, point, taken)
    return figure


def _name(axes: Axes, point: Point, taken: list[Floats]) -> None:
    """Write a point's name as near as nothing is yet; from afar a line leads to it."""
    quoted = point.style is None
    font = 7 if quoted else 8
    size = np.array([0.58 * font * len(point.label), 1.1 * font])
    frame = np.asarray(axes.bbox.extents) * (72 / axes.figure.dpi)

    def place(distance: float, angle: float) -> tuple[float, Floats, Floats, list[Floats]]:
        """Cost, the line's end, the name's centre, and what name and line would cover."""
        towards = np.array([np.cos(angle), np.sin(angle)])
        end = towards * distance
        # The side of the name that looks at the point is where the line ends.
        centre = end + np.round(towards, 3) * size / 2
        steps = np.linspace(8, distance, round(distance / 4) if distance > _NEAR else 0)
        covered = [_box(axes, point, centre - size / 2, size)]
        covered += [_box(axes, point, towards * step - 2, np.full(2, 4.0)) for step in steps]
        hidden = sum(_common(box, other) for box in covered for other in taken)
        outside = size.prod() - _common(covered[0], frame)
        return 3 * hidden + 4 * outside + distance, end, centre, covered

    around = np.arange(0, 2 * np.pi, np.pi / 6)
    places = [place(*at) for at in product((_NEAR, 20, 34, 50, 68), around)]
    _, end, centre, covered = min(places, key=lambda found: found[0])
    taken += covered
    at, offset = (point.x, point.y), "offset points"
    if len(covered) > 1:
        leader = {"arrowstyle": "-", "color": QUIET, "lw": 0.5, "shrinkA": 0, "shrinkB": 3}
        axes.annotate("", at, tuple(end), textcoords=offset, arrowprops=leader)
    axes.annotate(
        point.label, at, tuple(centre), textcoords=offset, ha="center", va="center", fontsize=font,
        color=QUIET if quoted else INK, fontstyle="italic" if quoted else "normal",
    )  # fmt: skip


def _box(axes: Axes, point: Point, offset: Floats, size: Floats) -> Floats:
    """Left, bottom, right, top in points."""
    scale = 72 / axes.figure.dpi
    corner = np.asarray(axes.transData.transform((point.x, point.y))) * scale + offset
    return np.concatenate([corner, corner + size])


def _common(a: Floats, b: Floats) -> float:
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    return float(np.prod(np.maximum(sides, 0)))
