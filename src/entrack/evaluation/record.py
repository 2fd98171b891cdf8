"""What a run's folder says of itself: JSON files, each whole or not there."""

import json
import os
import platform
from functools import cache
from pathlib import Path
from typing import Any

from entrack import __version__
from entrack.errors import EntrackError
from entrack.evaluation.request import Entry
from entrack.evaluation.score import Row, Scored, Truth
from entrack.files import read_bytes, write_bytes, writing

_SAME = ("tracker", "checksum", "version")


def describe_dataset(truth: Truth, out: Path) -> list[str]:
    """Write `dataset.json`; return what a person should know about what is scored."""
    dataset = truth.dataset
    here = set(dataset.names)
    short = {
        s.name: f"{len(s)} of {dataset.lengths[s.name]}"
        for s in truth.sequences
        if len(s) < dataset.lengths.get(s.name, 0)
    }
    content = {
        "format": dataset.format,
        "place": dataset.place,
        "official": len(dataset.official) or None,
        "missing": dataset.missing,
        "short": short,
        "left_out": dict(truth.left_out),
        "sequences": {s.name: len(s) for s in truth.sequences},
    }
    write_json(out / truth.name / "dataset.json", content)
    notes: list[str] = []
    if dataset.missing:
        found = len(here & set(dataset.official))
        notes.append(f"{found} of the {len(dataset.official)} official sequences are here")
    notes += [f"{name} has {frames} frames" for name, frames in short.items()]
    notes += [f"{name} is not scored: {why}" for name, why in truth.left_out.items()]
    return [f"{truth.name}: {note}" for note in notes]


def check_same_tracker(entry: Entry, threads: int) -> None:
    """Write `run.json` for a new tracker; refuse to mix its results with another model's.

    Raises
    ------
    EntrackError
        If the folder holds results of a tracker with another checksum, version or name.
    """
    path = entry.folder / "run.json"
    content = {**identity(entry), "machine": machine(), "threads": threads}
    if path.is_file():
        before = _read_json(path)
        for key in _SAME:
            if before.get(key) != content[key]:
                raise EntrackError(
                    f"{entry.folder} holds results of {key} {before.get(key)}, now it is "
                    f"{content[key]}: choose another --out, or another name with NAME=TRACKER"
                )
        return
    write_json(path, content)


def identity(entry: Entry) -> Row:
    """What a row knows of its tracker."""
    contender = entry.contender
    return {
        "tracker": contender.name,
        "spec": contender.spec,
        "checksum": contender.checksum,
        "version": contender.version,
    }


def write_scores(entry: Entry, scored: Scored, failed: dict[str, str]) -> Row:
    """Write an entry's curves and numbers under one protocol; return its row."""
    dataset, protocol = entry.truth.dataset, scored.protocol.name
    row: Row = {
        "dataset": entry.truth.name,
        "protocol": protocol,
        "tracker": entry.contender.name,
        **scored.row(),
        "available": len(entry.truth.sequences),
        "official": len(dataset.official) or None,
        "failed": failed,
        **identity(entry),
        "entrack": __version__,
        **_where_it_ran(entry),
    }
    place = str(entry.results.resolve())
    details = {"row": row, "results": place, **scored.details(entry.truth.sequences)}
    write_json(entry.folder / "scores" / f"{protocol}.json", details)
    return row


def _where_it_ran(entry: Entry) -> Row:
    """Machine and threads of our own runs; nobody knows those of given results."""
    path = entry.folder / "run.json"
    if entry.contender.kind == "raw" or not path.is_file():
        return {"machine": None, "threads": None}
    ran = _read_json(path)
    return {"machine": ran["machine"], "threads": ran["threads"]}


def merge_rows(path: Path, rows: list[Row]) -> None:
    """Put rows into `scores.json`, each in the place of its predecessor."""
    before: list[Row] = _read_json(path) if path.is_file() else []
    merged = {_key(row): row for row in [*before, *rows]}
    write_json(path, list(merged.values()))


def _key(row: Row) -> tuple[str, str, str]:
    return row["dataset"], row["protocol"], row["tracker"]


def write_json(path: Path, content: Any) -> None:
    """Write readable JSON, whole or not at all."""
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path, (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode())


def _read_json(path: Path) -> Any:
    try:
        return json.loads(read_bytes(path))
    except EntrackError:
        raise
    except (ValueError, RecursionError) as error:
        raise EntrackError(f"{path} is not what a run writes: {error}") from error


@cache
def machine() -> str:
    """Processor, cores and system: what a speed depends on."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        name = next((s.split(":", 1)[1].strip() for s in lines if s.startswith("model name")), name)
    except OSError:
        pass
    return f"{name}, {os.cpu_count()} cores, {platform.system()}"
