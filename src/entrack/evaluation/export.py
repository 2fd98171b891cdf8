"""Raw results in the layouts of other toolkits."""

from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from entrack.datasets import Dataset, Sequence
from entrack.errors import EntrackError
from entrack.evaluation import trajectory
from entrack.evaluation.raw import Floats, Results, write_boxes
from entrack.evaluation.score import Truth
from entrack.files import write_bytes, writing

ONE_PASS = ("otb", "got10k", "pysot", "pytracking")
SUPERVISED = ("vot", "vot-binary", "pysot")
LAYOUTS = tuple(dict.fromkeys((*ONE_PASS, *SUPERVISED)))


def check_layouts(truth: Truth, layouts: Collection[str]) -> None:
    """Refuse layouts that are unknown, or for another kind of result."""
    fitting = SUPERVISED if _supervised(truth) else ONE_PASS
    for layout in layouts:
        if layout not in fitting:
            expected = ", ".join(fitting)
            raise EntrackError(
                f"no layout {layout} for results on {truth.name}: expected {expected}"
            )


def _supervised(truth: Truth) -> bool:
    return truth.dataset.format.startswith("vot")


def export(truth: Truth, results: Results, layout: str, out: Path) -> int:
    """Write a tracker's results below `out` as a toolkit expects them; return how many files."""
    count = 0
    for sequence in truth.sequences:
        if _supervised(truth):
            files = _trajectories(sequence.name, results, layout)
        else:
            files = _boxes(sequence, truth.dataset, results, layout)
        for name, data in files:
            path = out / name
            with writing(path):
                path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(path, data if isinstance(data, bytes) else data.encode())
            count += 1
    return count


def _trajectories(name: str, results: Results, layout: str) -> Iterator[tuple[str, str | bytes]]:
    for number, run in enumerate(results.trajectories(name), 1):
        stem = f"baseline/{name}/{name}_{number:03d}"
        if layout == "vot-binary":
            yield f"{stem}.bin", trajectory.write_binary(run)
        else:
            yield f"{stem}.txt", trajectory.write_text(run)


def _boxes(
    sequence: Sequence, dataset: Dataset, results: Results, layout: str
) -> Iterator[tuple[str, str]]:
    name, origin = sequence.name, dataset.origin
    runs = results.boxes(sequence, dataset)
    if not runs:
        return
    # What starts the tracker takes no time of tracking: toolkits ignore the first row.
    seconds = "".join(f"{s:.8f}\n" for s in [0.0, *results.times(name)])
    if layout == "got10k":
        for number, boxes in enumerate(runs, 1):
            yield f"{name}/{name}_{number:03d}.txt", _table(boxes, origin, "%.3f", ",")
        yield f"{name}/{name}_time.txt", seconds
    elif layout == "pytracking":
        theirs = {"otb": name.replace("-", "_"), "uav123": f"uav_{name}"}.get(dataset.format, name)
        yield f"{theirs}.txt", _table(np.round(runs[0]), origin, "%d", "\t")
        yield f"{theirs}_time.txt", seconds
    else:
        yield f"{name}.txt", write_boxes(runs[0], origin)


def _table(boxes: Floats, origin: int, form: str, separator: str) -> str:
    rows = np.nan_to_num(boxes) + np.array([origin, origin, 0, 0])
    return "".join(separator.join(form % v for v in row) + "\n" for row in rows.tolist())
