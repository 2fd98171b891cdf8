"""Run folders for tests, as `entrack evaluate` writes them."""

import json
from pathlib import Path

import numpy as np

from entrack.peers import Contender

OPE = {"auc": 0.6, "precision": 0.8, "norm_precision": 0.7, "op50": 0.75, "ao": 0.61}
LONGTERM = {
    "f_score": 0.6, "tracking_precision": 0.65, "tracking_recall": 0.56, "roc_auc": 0.8, "ece": 0.1,
    "coverage": 0.7, "coverage_held": 0.75, "refound": 0.5, "refound_frames": 7.0,
}  # fmt: skip
VOT = {"accuracy": 0.55, "robustness": 0.4, "eao": 0.3}


def write_run(
    run: Path,
    trackers: dict[str, float],
    *,
    dataset: str = "otb",
    protocol: str = "otb",
    sequences: int = 5,
    place: str = "/nowhere",
    **row: object,
) -> Path:
    """A run's folder as `entrack evaluate` writes it; each tracker's numbers are times a factor."""
    numbers = VOT if protocol.startswith("vot") else LONGTERM if protocol == "longterm" else OPE
    names = [f"video_{i}" for i in range(sequences)]
    rows = []
    for place_in_list, (tracker, factor) in enumerate(trackers.items()):
        values = {name: round(value * factor, 6) for name, value in numbers.items()}
        bounds = {f"{name}_95": [value - 0.05, value + 0.05] for name, value in values.items()}
        one = {
            "dataset": dataset, "protocol": protocol, "tracker": tracker,
            "sequences": sequences, "frames": 100 * sequences, **values, **bounds,
            "fps_mean": 30.0 + place_in_list, "fps_median": 30.0, "available": sequences,
            "official": 100, "failed": {}, "spec": f"module:Class{place_in_list}",
            "machine": "a machine", **row,
        }  # fmt: skip
        rows.append(one)
        if protocol.startswith("vot"):
            curves = {"expected_overlap": [0, *np.linspace(0.6, 0.2, 399) * factor]}
        elif protocol == "longterm":
            falling, rising = np.linspace(1, 0, 101) * factor, np.linspace(0, 1, 101) * factor
            bins = (np.arange(15) + 0.5) / 15
            curves = {
                "f_score": list(falling),
                "tracking_precision": list(rising),
                "tracking_recall": list(falling),
                "pr_precision": list(falling[::10]),
                "pr_recall": list(rising[::10]),
                "roc": list(rising),
                "calibration_frames": [1 / 15] * 15,
                "calibration_score": [*bins[:-1], None],
                "calibration_share": [*(bins * factor)[:-1], None],
                "found_again": list(np.linspace(0, 0.5, 30) * factor),
            }
        else:
            points = 101 if protocol == "got10k" else 21
            curves = {"success": list(np.linspace(1, 0, points) * factor)}
            if protocol != "got10k":
                rising = list(np.linspace(0, 1, 51) * factor)
                curves |= {"precision": rising, "norm_precision": rising}
        per_sequence = {
            name: {
                "frames": 100,
                "attributes": ["IV", "SV", "ARC"][: i % 4],
                **{key: value * (0.5 + 0.1 * i) for key, value in values.items()},
            }
            for i, name in enumerate(names)
        }
        folder = run / dataset / Contender(tracker, one["spec"]).folder / "scores"
        folder.mkdir(parents=True, exist_ok=True)
        details = {"row": one, "curves": curves, "per_sequence": per_sequence}
        (folder / f"{protocol}.json").write_text(json.dumps(details))
    about = {
        "format": dataset,
        "place": place,
        "official": 100,
        "sequences": dict.fromkeys(names, 100),
    }
    (run / dataset / "dataset.json").write_text(json.dumps(about))
    path = run / "scores.json"
    before = json.loads(path.read_text()) if path.exists() else []
    path.write_text(json.dumps(before + rows))
    return run
