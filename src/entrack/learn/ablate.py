"""`entrack ablate`: a training run and a score for every cell of a grid and every seed.

OUT/config.json                     what was asked for; another ablation is refused
OUT/clips/, OUT/shared/             what cells have in common: frames; looks and warm starts
OUT/cells/<cell>/seed-<k>/run/      the run, as `entrack train` writes it
OUT/cells/<cell>/seed-<k>/score.json   numbers by dataset and sequence; the cell is done
"""

import csv
import hashlib
import json
import shutil
from collections.abc import Callable, Generator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from entrack.errors import EntrackError
from entrack.evaluation.run import Evaluation, Options
from entrack.files import copy, write_bytes
from entrack.learn.config import TrainConfig
from entrack.learn.grids import GRIDS, cells
from entrack.learn.train import Report, Source, Training
from entrack.model import Model
from entrack.trunks import checkpoint

Numbers = dict[str, dict[str, dict[str, float]]]
"""By dataset and by "overlap" (AUC, or mean IoU) and "lost" (share of frames with IoU 0), by
sequence."""

VALIDATION = "validation"
"""Name of the dataset of validation clips, for cells that are scored on nothing else."""


@dataclass(frozen=True)
class Plan:
    """What is to be trained and measured."""

    grid: str
    base: TrainConfig
    model: Model
    source: Source
    tests: tuple[str, ...] = ()
    """Datasets that cells are scored on, each `"FORMAT:DIR"`; by default 60 frames of each of the
    validation clips."""
    seeds: int = 3
    one_start: bool = False
    """All seeds go on from the looks and the warm start of the first."""
    only: tuple[str, ...] = ()
    """Some of the cells."""

    def runs(self) -> list[tuple[str, int, TrainConfig]]:
        """Cells and seeds, seed by seed, so that every cell is soon seen once."""
        grid = cells(self.grid, self.base)
        for name in self.only:
            if name not in grid:
                raise EntrackError(f"{self.grid} has no cell {name!r}: it has {', '.join(grid)}")
        wanted = [(name, c) for name, c in grid.items() if not self.only or name in self.only]
        start = self.base.seed if self.one_start else None
        return [
            (name, seed, replace(config, seed=config.seed + seed, start_seed=start))
            for seed in range(self.seeds)
            for name, config in wanted
        ]


def ablate(
    plan: Plan,
    out: Path,
    workers: int = 1,
    resume: bool = False,
    report: Report = lambda stage, step, steps, values: None,
    scored: Callable[[], object] = lambda: None,
) -> dict[str, str]:
    """Train and score what is not done yet; return what was left out, and why.

    `scored` is called after every cell. More seeds and other cells may be asked for later.
    """
    runs = plan.runs()
    asked = {
        "grid": plan.grid, "base": asdict(plan.base), "model": plan.model.checksum,
        "data": list(plan.source.data), "tests": list(plan.tests),
        "one start": plan.one_start,
    }  # fmt: skip
    checkpoint.claim(out, asked, resume)
    left_out: dict[str, str] = {}
    for step, (name, seed, config) in enumerate(runs, 1):
        folder = _folder(out, name, seed)
        if not (folder / "score.json").exists():
            training = _training(plan, config, out, folder / "run", workers, report)
            model = training()
            left_out |= training.failed
            numbers = (
                _evaluate(plan.tests, model, folder / "evaluation", workers)
                if plan.tests
                else _validate(training)
            )
            _keep_warm(out, training)
            write_bytes(folder / "score.json", json.dumps(numbers, indent=1).encode())
        for used_up in ("episodes", "policies"):
            shutil.rmtree(folder / "run" / used_up, ignore_errors=True)
        report("cells", step, len(runs), {})
        scored()
    return left_out


def read_scores(out: Path) -> dict[str, dict[int, Numbers]]:
    """Numbers of all cells that are done, by cell and seed."""
    found: dict[str, dict[int, Numbers]] = {}
    for name, seed, folder in _done(out):
        found.setdefault(name, {})[seed] = json.loads((folder / "score.json").read_text())
    return found


def read_curves(out: Path) -> dict[str, dict[int, dict[int, float]]]:
    """Overlap on the validation clips by cell, seed and rounds learned, where it was looked at."""
    found: dict[str, dict[int, dict[int, float]]] = {}
    for name, seed, folder in _done(out):
        path = folder / "run" / "sac.csv"
        if not path.exists():
            continue
        with path.open(newline="") as file:
            rows = [(int(r["step"]), float(r["iou_validation"])) for r in csv.DictReader(file)]
        seen = {step - 1: value for step, value in rows if np.isfinite(value)}
        if seen:
            found.setdefault(name, {})[seed] = seen
    return found


def _done(out: Path) -> Generator[tuple[str, int, Path]]:
    """Cell, seed and folder of all that is done."""
    for path in sorted((out / "cells").glob("*/seed-*/score.json")):
        name = (path.parent.parent / "name.txt").read_text(encoding="utf-8")
        yield name, int(path.parent.name.removeprefix("seed-")), path.parent


def write_tables(grid: str, out: Path) -> list[str]:
    """Write table and plot of each dataset to `OUT/ablation*`, and `OUT/curves`.

    Returns the tables as Markdown.
    """
    from entrack.report.ablation import write_ablation, write_curves  # matplotlib is an extra
    from entrack.report.formats import markdown

    found, known = read_scores(out), GRIDS[grid]
    datasets = dict.fromkeys(d for seeds in found.values() for n in seeds.values() for d in n)
    texts: list[str] = []
    for number, dataset in enumerate(datasets):
        overlap, lost = (
            {c: {s: n[dataset][kind] for s, n in seeds.items()} for c, seeds in found.items()}
            for kind in ("overlap", "lost")
        )
        path = out / (f"ablation-{number + 1}" if number else "ablation")
        table = write_ablation(
            known.title, dataset, overlap, lost, list(known.cells), known.reference,
            known.published, path,
        )  # fmt: skip
        texts.append(markdown(table))
    write_curves(known.title, read_curves(out), list(known.cells), out / "curves")
    return texts


def _folder(out: Path, cell: str, seed: int) -> Path:
    """Where a run is; the cell's name is in a file, as not every name may be a folder's."""
    plain = "".join(c if c.isalnum() or c in "-." else "_" for c in cell)
    folder = out / "cells" / plain / f"seed-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    write_bytes(folder.parent / "name.txt", cell.encode())
    return folder


def _training(
    plan: Plan, config: TrainConfig, out: Path, run: Path, workers: int, report: Report
) -> Training:
    """A run that shares its clips, and its looks and warm start where a cell has the same."""
    run.mkdir(exist_ok=True)
    shared = _shared(out, config)
    for name, place in ("clips", out / "clips"), ("bank", shared / "bank"):
        place.mkdir(parents=True, exist_ok=True)
        if not (run / name).exists():
            (run / name).symlink_to(place.resolve(), target_is_directory=True)
    warm = shared / "warm.safetensors"
    if warm.exists() and not (run / warm.name).exists():
        copy(warm, run / warm.name)
    begun = (run / "config.json").exists()
    return Training(config, plan.model, plan.source, run, workers, resume=begun, report=report)


def _shared(out: Path, config: TrainConfig) -> Path:
    """Folder of looks and warm starts, by all that they depend on."""
    tracker, policy = config.tracker, config.tracker.policy
    parts: list[Any] = [config.data, config.bank, config.warm, tracker.window, tracker.filter]
    known = [asdict(part) if part else None for part in parts]
    text = json.dumps([*known, policy.reach if policy else None, config.first_seed])
    return out / "shared" / hashlib.sha256(text.encode()).hexdigest()[:12]


def _keep_warm(out: Path, training: Training) -> None:
    made = training.run / "warm.safetensors"
    kept = _shared(out, training.config) / made.name
    if made.exists() and not kept.exists():
        copy(made, kept)


def _evaluate(tests: tuple[str, ...], model: Path, out: Path, workers: int) -> Numbers:
    """Numbers by sequence as `entrack evaluate` has them."""
    evaluation = Evaluation.prepare(list(tests), [f"cell={model}"], out, Options(workers=workers))
    outcome = evaluation.run()
    if outcome.failed:
        name, why = next(iter(outcome.failed.items()))
        raise EntrackError(f"{model} failed on {name}: {why}")
    numbers: Numbers = {}
    for row in outcome.rows:
        path = out / row["dataset"] / "cell" / "scores" / f"{row['protocol']}.json"
        by_name: dict[str, Any] = json.loads(path.read_text())["per_sequence"]
        key = "auc" if "auc" in row else "ao"
        if key not in row:
            raise EntrackError(f"{row['dataset']} has no AUC or AO: use a one-pass benchmark")
        numbers[f"{row['dataset']} ({key.upper()}, protocol {row['protocol']})"] = {
            "overlap": {name: s[key] for name, s in by_name.items()},
            "lost": {name: 1 - s["curves"]["success"][0] for name, s in by_name.items()},
        }
    return numbers


def _validate(training: Training) -> Numbers:
    """Numbers of the last look at the validation clips."""
    overlaps = training.validation()
    if not overlaps:
        raise EntrackError("there is nothing to score on: no validation clips, and no --test")
    return {
        f"{VALIDATION} (mean IoU of 60 frames)": {
            "overlap": {name: float(np.nanmean(o)) for name, o in overlaps.items()},
            "lost": {name: float(np.mean(o[np.isfinite(o)] <= 0)) for name, o in overlaps.items()},
        }
    }
