"""Plots, readable without colour: a letter on each line, and another dash for each."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from entrack.report.style import LIGHT, Style

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
_WIDTH, _HEIGHT = 4.9, 3.5  # inches; the legend comes on top
INK, QUIET, PAPER = LIGHT["ink"], LIGHT["quiet"], LIGHT["paper"]
RC: Any = {
    "svg.fonttype": "none", "svg.hashsalt": "entrack", "font.size": 9, "axes.titlesize": 10,
    "font.family": "sans-serif", "text.color": INK, "axes.labelcolor": INK,
    "xtick.color": INK, "ytick.color": INK, "axes.edgecolor": LIGHT["quiet"],
    "axes.facecolor": PAPER, "figure.facecolor": PAPER, "axes.grid": True,
    "grid.color": LIGHT["grid"], "grid.linewidth": 0.7, "axes.axisbelow": True,
    "axes.spines.top": False, "axes.spines.right": False, "axes.unicode_minus": True,
    "legend.frameon": False, "text.parse_math": False, "xtick.labelsize": 8, "ytick.labelsize": 8,
}  # fmt: skip
"""Settings under which figures are drawn and saved."""


@dataclass(frozen=True)
class Curve:
    """A line of a plot; `value` stands in brackets in the legend."""

    label: str
    style: Style
    y: Floats
    value: float | None
    x: Floats | None = None
    """Its own, where it has no x in common with others."""


def curves(
    lines: Sequence[Curve], x: Floats, title: str, labels: tuple[str, str], top: float | None = 1.0
) -> Figure:
    """Lines over a common x, the legend in the order of the lines."""
    figure, axes = figure_with_axes(title, labels, legend=len(lines))
    for place, line in enumerate(lines):
        own = x if line.x is None else line.x
        _draw(axes, line, own, (place + 0.5) / len(lines))
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(0, top)
    _legend(figure, len(lines), max(len(line.label) for line in lines))
    return figure


def stacked(
    panels: Sequence[Sequence[Curve]], shaded: Flags, title: str, labels: tuple[str, ...]
) -> Figure:
    """Panels of lines in [0, 1] over the same frames, counted from 1; `labels` of x, then each y.

    `shaded` (T,) marks frames in all of them.
    """
    named = panels[0]
    figure = Figure(figsize=(_WIDTH, 3.9 + _legend_height(len(named))), layout="constrained")
    rows: list[Any] = list(figure.subplots(len(panels), 1, sharex=True))
    x = np.arange(1.0, len(shaded) + 1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], shaded.astype(int), [0]])))
    for axes, lines, label in zip(rows, panels, labels[1:], strict=True):
        for start, stop in edges.reshape(-1, 2).tolist():
            axes.axvspan(start + 0.5, stop + 0.5, color=LIGHT["grid"], linewidth=0, zorder=0)
        for place, line in enumerate(lines):
            _draw(axes, line, x, (place + 0.5) / len(lines))
        axes.set_ylim(-0.02, 1.02)
        axes.set_ylabel(label)
        axes.tick_params(which="both", length=0)
    rows[0].set_title(title)
    rows[-1].set_xlabel(labels[0])
    rows[-1].set_xlim(1, max(len(shaded), 2))
    handles, names = rows[0].get_legend_handles_labels()
    longest = max((len(line.label) for line in named), default=0)
    _legend(figure, len(named), longest, handles=handles, labels=names)
    return figure


def diagonal(figure: Figure) -> None:
    """Draw where x and y are equal."""
    figure.axes[0].plot([0, 1], [0, 1], color=QUIET, linewidth=0.8, zorder=1)


def dots(figure: Figure, line: Curve, share: Floats) -> None:
    """Draw the points of a line, their areas a measure of how much is in each."""
    assert line.x is not None
    colour = line.style.colour
    figure.axes[0].scatter(line.x, line.y, 400 * share, color=colour, alpha=0.35, linewidths=0)


def shade(figure: Figure, low: float, high: float) -> None:
    """Mark the part of a plot over which its number is the mean."""
    figure.axes[0].axvspan(low, high, color=LIGHT["grid"], alpha=0.5, linewidth=0, zorder=0)


def radar(lines: Sequence[Curve], names: Sequence[str], title: str) -> Figure:
    """Numbers by attribute, as a web."""
    extra = _legend_height(len(lines))
    figure = Figure(figsize=(_WIDTH, 4.2 + extra), layout="constrained")
    axes: Any = figure.add_subplot(projection="polar")
    angles = np.linspace(0, 2 * np.pi, len(names), endpoint=False)
    axes.set_theta_offset(np.pi / 2)
    axes.set_theta_direction(-1)
    axes.set_xticks(angles, names)
    closed = np.append(angles, angles[0])
    for place, line in enumerate(lines):
        y = np.append(line.y, line.y[0])
        axes.plot(closed, y, label=_words(line), **_stroke(line.style))
        at = round((place + 0.5) / len(lines) * len(names)) % len(names)
        if np.isfinite(y[at]):
            bullet(axes, closed[at], float(y[at]), line.style)
    axes.set_ylim(0, None)
    axes.set_rlabel_position(180 / len(names))
    axes.tick_params(axis="y", labelsize=7, labelcolor=QUIET)
    axes.tick_params(axis="x", pad=7)
    axes.spines["polar"].set_color(LIGHT["grid"])
    axes.set_title(title)
    _legend(figure, len(lines), max(len(line.label) for line in lines))
    return figure


def figure_with_axes(title: str, labels: tuple[str, str], legend: int = 0) -> tuple[Figure, Axes]:
    """An empty plot, with room for so many lines of a legend."""
    figure = Figure(figsize=(_WIDTH, _HEIGHT + _legend_height(legend)), layout="constrained")
    axes = figure.add_subplot()
    axes.set_title(title)
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    axes.tick_params(which="both", length=0)
    return figure, axes


def _draw(axes: Axes, line: Curve, x: Floats, place: float) -> None:
    axes.plot(x, line.y, label=_words(line), **_stroke(line.style))
    known = np.flatnonzero(np.isfinite(line.y))
    if len(known):
        # Letters stand side by side, away from the ends where lines meet.
        at = known[round((0.06 + 0.8 * place) * (len(known) - 1))]
        bullet(axes, float(x[at]), float(line.y[at]), line.style)


def _stroke(style: Style) -> dict[str, Any]:
    return {"color": style.colour, "linewidth": 1.6, "linestyle": (0, style.dashes or None)}


def bullet(axes: Axes, x: float, y: float, style: Style) -> None:
    """A tracker's letter in a circle of its colour."""
    box = {"boxstyle": "circle,pad=0.22", "fc": PAPER, "ec": style.colour, "lw": 1.1}
    axes.text(
        x, y, style.letter, fontsize=6.5, ha="center", va="center_baseline", bbox=box,
        color=INK, zorder=4, fontweight="bold",
    )  # fmt: skip


def _words(line: Curve) -> str:
    value = "–" if line.value is None else f"{line.value:.3f}"
    return f"{line.style.letter}  {line.label} [{value}]"


def _legend_height(count: int) -> float:
    return 0.19 * count + 0.1 if count else 0


def _legend(figure: Figure, count: int, longest: int, **entries: Any) -> None:
    """List the lines of all axes, or the `handles` and `labels` given."""
    columns = 2 if count > 5 and longest <= 16 else 1
    look: Any = {"ncols": columns, "handlelength": 3.4, "fontsize": 8.5}
    figure.legend(loc="outside lower left", **look, **entries)
