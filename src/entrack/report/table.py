"""A table before it is HTML, CSV, Markdown or LaTeX."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Column:
    """A column.

    Parameters
    ----------
    title
        Its heading.
    digits
        Decimals of its numbers; None for words and counts.
    higher
        Whether more is better; None where nothing is.
    mark
        Whether its heading ("heading") or the words in it ("cells") are trackers of this report.
    bar
        Whether its numbers are shares in [0, 1] that a page may show as bars.
    quoted
        Whether its numbers are somebody else's.
    """

    title: str
    digits: int | None = None
    higher: bool | None = None
    mark: Literal["", "heading", "cells"] = ""
    bar: bool = False
    quoted: bool = False

    @property
    def numeric(self) -> bool:
        """Whether it holds numbers, which stand to the right."""
        return self.digits is not None or self.higher is not None


@dataclass(frozen=True)
class Cell:
    """A word or a number, with its 95 % interval where it has one."""

    value: str | float | None
    interval: tuple[float, float] | None = None


@dataclass(frozen=True)
class Line:
    """A row; `quoted` if its numbers are somebody else's."""

    cells: tuple[Cell, ...]
    quoted: bool = False


@dataclass(frozen=True)
class Table:
    """Columns and lines, with a name for files and a caption for people.

    Parameters
    ----------
    best
        Whether the best number is that of its column or of its row.
    """

    name: str
    caption: str
    columns: tuple[Column, ...]
    lines: tuple[Line, ...]
    note: str = ""
    best: Literal["column", "row"] = "column"

    def text(self, line: Line, at: int) -> str:
        """A cell as people read it: "0.667", "–" for nothing."""
        return _text(line.cells[at].value, self.columns[at].digits)

    def interval(self, line: Line, at: int) -> str:
        """A cell's interval, or an empty text."""
        bounds = line.cells[at].interval
        return "" if bounds is None else _bounds(bounds, self.columns[at].digits)

    def is_best(self, line: Line, at: int) -> bool:
        """Whether a number is the best of those that it competes with, as printed.

        Quoted lines beside ours are out of competition: they were measured elsewhere.
        """
        column = self.columns[at]
        beside_ours = line.quoted and not all(other.quoted for other in self.lines)
        if beside_ours or column.higher is None or line.cells[at].value is None:
            return False
        if self.best == "column":
            cells = [other.cells[at] for other in self.lines if other.quoted == line.quoted]
        else:
            rivals = [(c.higher, c.quoted) == (column.higher, column.quoted) for c in self.columns]
            cells = [cell for cell, rival in zip(line.cells, rivals, strict=True) if rival]
        numbers = [cell.value for cell in cells if isinstance(cell.value, int | float)]
        best = max(numbers) if column.higher else min(numbers)
        return len(numbers) > 1 and self.text(line, at) == _text(best, column.digits)


def _text(value: str | float | None, digits: int | None) -> str:
    if value is None or value == "":
        return "–"
    if isinstance(value, str) or digits is None:
        return str(value)
    return f"{value:.{digits}f}".replace("-", "−")


def _bounds(bounds: tuple[float, float], digits: int | None) -> str:
    return f"[{_text(bounds[0], digits)}, {_text(bounds[1], digits)}]"
