"""Ground truth without pictures: one JSON file a benchmark, as pysot and others distribute it.

`{"<sequence>": {"gt_rect": [[x, y, w, h], …], "absent": […], "attr": […]}, …}`: enough for scoring
results that somebody else has.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from entrack.datasets import lists
from entrack.datasets.boxes import upright_boxes, zero_based
from entrack.datasets.frames import ImageFiles
from entrack.datasets.sequence import Dataset, Sequence
from entrack.datasets.texts import name_key
from entrack.errors import EntrackError
from entrack.files import read_bytes

_LARGEST = 64_000_000  # bytes: LaSOT, the largest benchmark, has 30 million
_ORIGINS = {"otb": 1, "uav123": 1, "lasot": 1, "got10k": 1}


def open_annotations(name: str, path: Path) -> Dataset:
    """Open a JSON file as a dataset of the format `name`, which says how its boxes count."""
    try:
        content: dict[str, Any] = json.loads(read_bytes(path, _LARGEST))
        truths = {key: value["gt_rect"] for key, value in content.items()}
    except EntrackError:
        raise
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        form = '{"NAME": {"gt_rect": [[x, y, w, h], …]}, …}'
        raise EntrackError(f"{path} is not of the form {form}: {error!r}") from error
    official = _official(name)
    known = {name_key(n): n for n in official}
    keys = {known.get(name_key(key), key): key for key in truths}
    origin = _ORIGINS.get(name, 0)

    def read(sequence: str) -> Sequence:
        entry = content[keys[sequence]]
        try:
            rows = np.array(entry["gt_rect"], np.float64)
            # pysot's flag is 1 where the target is there.
            absent = np.array(entry.get("absent", np.ones(len(rows))), np.float64).reshape(-1) == 0
            labels = tuple(map(str, entry.get("attr", ())))
        except (TypeError, ValueError) as error:
            raise EntrackError(f"{path}, {sequence}: {error}") from error
        if rows.ndim != 2 or not len(rows) or rows.shape[1] not in (4, 8):
            raise EntrackError(f"{path}, {sequence}: gt_rect is not a list of 4 or 8 numbers a row")
        corners = rows if rows.shape[1] == 8 else None
        boxes = zero_based(rows, origin) if corners is None else upright_boxes(rows)
        return Sequence(sequence, ImageFiles([]), boxes, absent, corners, labels)

    order = [n for n in official if n in keys] + [n for n in keys if n not in known.values()]
    return Dataset(name, path, tuple(order), read, official, origin)


def _official(name: str) -> tuple[str, ...]:
    if name.startswith("vot"):
        return lists.vot(name)
    named = {"otb": lists.otb, "uav123": lists.uav123, "lasot": lists.lasot_test}
    return tuple(named[name]()) if name in named else ()
