"""Compare shapes of trunks at one small budget: AUC of `cf` on the validation clips against time.

    python benchmarks/trunk_candidates.py train --shared SHARED --out OUT      # resumes
    python benchmarks/trunk_candidates.py measure --shared SHARED --out OUT    # table and plot

SHARED is the folder of the research data; a candidate takes minutes on two idle cores. Compare the
candidates with each other: the shipped trunk, marked with a star, was trained on far more.
"""

import argparse
import csv
import shutil
from dataclasses import replace
from pathlib import Path
from statistics import median
from time import perf_counter

import matplotlib.pyplot as plt
import numpy as np

from entrack.config import Config, WindowConfig, read
from entrack.datasets import open_dataset
from entrack.errors import EntrackError
from entrack.evaluation import ope
from entrack.model import assets, load_model
from entrack.tracker import Tracker
from entrack.trunk import Trunk, load_trunk
from entrack.trunks.crops import Image, load_stills
from entrack.trunks.distil import DistilConfig
from entrack.trunks.export import export
from entrack.trunks.finetune import FinetuneConfig
from entrack.trunks.importing import read_resnet18
from entrack.trunks.material import gather
from entrack.trunks.networks import StudentConfig
from entrack.trunks.pairs import PairConfig
from entrack.trunks.quantise import quantise
from entrack.trunks.train import TrunkTrainConfig, train_trunk

CANDIDATES = {
    "wide": StudentConfig(widths=(32, 96, 192), depths=(1, 2, 2)),  # the shipped trunk's shape
    "half": StudentConfig(widths=(32, 64, 128), depths=(1, 2, 2)),
    "deep": StudentConfig(widths=(32, 64, 128), depths=(1, 2, 4)),
    "stem": StudentConfig(stem=(24, 48), widths=(48, 96, 160), depths=(1, 2, 2)),
    "rep": StudentConfig(widths=(32, 64, 128), depths=(2, 4, 6), block="rep"),
    "separable": StudentConfig(widths=(32, 64, 128), depths=(2, 3, 4), block="separable"),
    "wide-224": StudentConfig(widths=(32, 96, 192), depths=(1, 2, 2)),
    "wide-192": StudentConfig(widths=(32, 96, 192), depths=(1, 2, 2)),
}
SIZES = {"wide-224": 224, "wide-192": 192}
"""Sides of the patches that are not 288: distilled as "wide", which must come first."""
CROPS, PAIRS = 10_000, 1_600
STARTS, FRAMES = (0, 50, 100, 150), 70
PRESETS = assets().parent / "presets"


def train(shared: Path, out: Path, names: list[str]) -> None:
    """Train each candidate for the same number of crops and pairs."""
    full = read(TrunkTrainConfig, PRESETS / "trunk.toml")
    data = shared / "data"
    material = gather(
        full.material,
        [f"folder:{data / 'train'}"],
        data / "images",
        data / "unlabelled",
        data,
        print,
    )
    for name in names:
        pair = PairConfig(window=WindowConfig(size=size_of(name)))
        config = TrunkTrainConfig(
            material=full.material,
            student=CANDIDATES[name],
            distil=DistilConfig(crops=CROPS),
            finetune=(FinetuneConfig(pairs=PAIRS, lr=5e-4, made=0.2, pair=pair),),
        )
        run = out / name
        if name in SIZES and not run.exists():
            run.mkdir()
            shutil.copy(out / "wide" / "distil.safetensors", run)
        if not (run / "trunk.onnx").exists():
            weights = shared / "trunk" / "resnet18_layer3_folded.npz"
            train_trunk(config, material, weights, run, resume=True, report=_report(name))


def _report(name: str):
    def report(stage: str, step: int, steps: int, values: dict[str, float]) -> None:
        if step % 100 == 0:
            print(name, stage, f"{step}/{steps}", values, flush=True)

    return report


def validation_auc(trunk: Trunk, shared: Path, size: int) -> float:
    """Mean success of `cf` over runs of 70 frames from up to four places of each validation clip.

    Whole clips would say less: one of them lost early or late moves the mean by .05.
    """
    config = read(Config, PRESETS / "cf.toml")
    config = replace(config, window=replace(config.window, size=size))
    names = read(TrunkTrainConfig, PRESETS / "trunk.toml").material.validation
    dataset = open_dataset(f"folder:{shared / 'data' / 'train'}")
    scores: list[float] = []
    for name in names:
        sequence = dataset.read(name)
        present = ope.valid(sequence.boxes)
        for start in STARTS:
            run = range(start, min(start + FRAMES, len(sequence)))
            if len(run) < FRAMES // 2 or not present[start]:
                continue
            tracker = Tracker(config, trunk)
            tracker.init(sequence.frames[start], sequence.boxes[start])
            boxes = [sequence.boxes[start]]
            boxes += [tracker.update(sequence.frames[t]).box for t in run[1:]]
            there = present[run.start : run.stop]
            truth = sequence.boxes[run.start : run.stop][there]
            overlaps = ope.overlaps(truth, np.array(boxes)[there])
            scores.append(ope.auc(ope.success_curve(overlaps)))
    return float(np.mean(scores))


def size_of(name: str) -> int:
    """Side of the patches that a trunk is for."""
    return SIZES.get(name.split()[0], 288)


def milliseconds(trunks: dict[str, Trunk], rounds: int = 200) -> dict[str, float]:
    """Median time of one patch; the trunks take turns, so noise falls on all alike."""
    noise = np.random.default_rng(0).integers(0, 255, (1, 288, 288, 3), dtype=np.uint8)
    patches = {name: noise[:, : size_of(name), : size_of(name)].copy() for name in trunks}
    times: dict[str, list[float]] = {name: [] for name in trunks}
    for _ in range(rounds):
        for name, trunk in trunks.items():
            start = perf_counter()
            trunk(patches[name])
            times[name].append(1e3 * (perf_counter() - start))
    return {name: median(values) for name, values in times.items()}


def _as_run(name: str, folder: Path, stills: list[Image]) -> tuple[str, Path]:
    """A candidate in int8, or, where its features drift too far for that, as it was trained."""
    file = folder / "int8.onnx"
    try:
        if not file.exists():
            quantise(folder / "trunk.onnx", stills, file)
    except EntrackError as error:
        print(f"{name}: {error}", flush=True)
        return f"{name} (float)", folder / "trunk.onnx"
    return name, file


def measure(shared: Path, out: Path, names: list[str]) -> None:
    """Quantise what is trained; write its accuracy and time as a table and a plot."""
    trained = [name for name in names if (out / name / "trunk.onnx").exists()]
    stills = load_stills(shared / "data" / "images")
    files = dict(_as_run(name, out / name, stills) for name in trained)
    files["shipped"] = load_model("cf").trunk
    files["ResNet-18"] = out / "resnet18.onnx"
    weights = shared / "trunk" / "resnet18_layer3_folded.npz"
    export(read_resnet18(weights), files["ResNet-18"])
    trunks = {name: load_trunk(file, threads=2) for name, file in files.items()}
    times = milliseconds(trunks)
    scores: dict[str, float] = {}
    for name, trunk in trunks.items():
        scores[name] = validation_auc(trunk, shared, size_of(name))
        print(f"{name}: {times[name]:.2f} ms, AUC {scores[name]:.4f}", flush=True)
    with (out / "candidates.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["name", "ms", "validation_auc"])
        writer.writerows([name, f"{times[name]:.3f}", f"{scores[name]:.4f}"] for name in trunks)
    draw(out)
    print((out / "candidates.csv").read_text())


def draw(out: Path) -> None:
    """The table as a picture, `out/candidates.png`."""
    figure, axes = plt.subplots(figsize=(6, 4))
    axes.margins(0.12)
    with (out / "candidates.csv").open() as file:
        for row in csv.DictReader(file):
            name, at = row["name"], (float(row["ms"]), float(row["validation_auc"]))
            axes.plot(*at, "*" if name in ("shipped", "ResNet-18") else "o")
            axes.annotate(name, at, (6, 4), textcoords="offset points")
    axes.set(
        xlabel="ms a patch (int8; ResNet-18 in what the machine is fast at)",
        xscale="log",
        ylabel="validation AUC, short runs",
    )
    axes.set_xticks([1, 2, 4, 8, 16], labels=["1", "2", "4", "8", "16"])
    axes.minorticks_off()
    figure.savefig(out / "candidates.png", dpi=110, bbox_inches="tight")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("action", choices=["train", "measure"])
    parser.add_argument("--shared", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--names", nargs="+", default=list(CANDIDATES))
    arguments = parser.parse_args()
    action = {"train": train, "measure": measure}[arguments.action]
    action(arguments.shared, arguments.out, arguments.names)


if __name__ == "__main__":
    main()
