"""Numbers that others have published, each with its source: data files beside this module."""

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from entrack.report.table import Cell, Column, Line, Table

OFFICIAL = {"otb": 100, "uav123": 123, "lasot": 280, "vot2016": 60, "vot2018": 60}
"""Sequences behind the quoted numbers of each benchmark."""
ATTRIBUTES = {"POC": "PO", "ROT": "RO", "FOC": "FO"}
"""Attributes of LaSOT's files that the paper's Table 2 spells differently."""


@dataclass(frozen=True)
class Quote:
    """One tracker's published numbers on one benchmark, by the names of `scores.json`."""

    tracker: str
    source: str
    numbers: dict[str, float]


def quotes(benchmark: str) -> list[Quote]:
    """Return what is published for a benchmark, the best first.

    >>> quotes("vot2016")[0]
    Quote(tracker='the paper: Ours', source="the paper's Table 5",
          numbers={'eao': 0.361, 'robustness': 0.242, 'accuracy': 0.623})
    """
    if benchmark in ("vot2016", "vot2018"):
        found = list(_vot(benchmark))
    else:
        speeds = _speeds() if benchmark == "otb" else {}
        found = [
            Quote(name, source["name"], {"auc": auc} | speeds.get(name, {}))
            for source in _load("published.toml")["source"]
            for name, auc in source.get(benchmark, {}).items()
        ]
    return sorted(found, key=lambda quote: -next(iter(quote.numbers.values())))


def _vot(benchmark: str) -> list[Quote]:
    table = _paper()[f"paper-table-5-{benchmark}"]
    names = ("eao", "robustness", "accuracy")
    return [
        Quote(
            "the paper: Ours" if tracker == "Ours" else tracker,
            table["source"],
            {name: v for name, v in zip(names, values, strict=True) if v != ""},
        )
        for tracker, *values in table["rows"]
    ]


def _speeds() -> dict[str, dict[str, float]]:
    rows = _paper()["paper-table-3"]["rows"]
    return {"the paper: MERT" if row[0] == "Ours" else row[0]: {"fps_mean": row[3]} for row in rows}


def attribute_columns() -> dict[str, dict[str, float]]:
    """Return the columns of the paper's own trackers in its Table 2: AUC by LaSOT's attributes."""
    table = _paper()["paper-table-2"]
    return {
        f"the paper: {name}": {row[0]: row[table["columns"].index(name)] for row in table["rows"]}
        for name in ("CF.Baseline", "Ours")
    }


def reference_tables() -> list[Table]:
    """Return the whole of the paper's Tables 2 to 5, and every published AUC."""
    return [_published_table(), *map(_table, _paper().values())]


def _table(content: dict[str, Any]) -> Table:
    columns: list[Column] = []
    for title, value in zip(content["columns"], content["rows"][0], strict=True):
        digits = None if title == "Frames/s" else content["digits"]
        number = isinstance(value, float)
        columns.append(Column(title, digits, title != "R") if number else Column(title))
    lines = [
        Line(tuple(Cell(None if value == "" else value) for value in row), quoted=True)
        for row in content["rows"]
    ]
    return Table(
        content["name"], content["title"], tuple(columns), tuple(lines),
        note=f"Quoted from {content['source']}.", best=content["best"],
    )  # fmt: skip


def _published_table() -> Table:
    benchmarks = {"otb": "OTB100", "uav123": "UAV123", "lasot": "LaSOT"}
    found: dict[tuple[str, str], dict[str, float]] = {}
    for benchmark in benchmarks:
        for quote in quotes(benchmark):
            found.setdefault((quote.tracker, quote.source), {})[benchmark] = quote.numbers["auc"]
    columns = (
        Column("Tracker"),
        *(Column(title, 3, higher=True) for title in benchmarks.values()),
        Column("Source"),
    )
    lines = tuple(
        Line((Cell(name), *(Cell(auc.get(b)) for b in benchmarks), Cell(source)), quoted=True)
        for (name, source), auc in found.items()
    )
    return Table(
        "published-auc", "Published AUC of whole benchmarks", columns, lines, note="Quoted."
    )


def _paper() -> dict[str, dict[str, Any]]:
    return {table["name"]: table for table in _load("paper.toml")["table"]}


@cache
def _load(name: str) -> dict[str, Any]:
    return tomllib.loads((files("entrack.report") / "data" / name).read_text("utf-8"))
