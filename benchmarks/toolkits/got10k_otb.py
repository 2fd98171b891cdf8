"""Run got10k's own OTB experiment with entrack as its tracker, beside `entrack evaluate`.

    python benchmarks/toolkits/got10k_otb.py OTB --tracker cf --out DIR   # pip install got10k

The toolkit reads the pictures, calls `entrack.interop.got10k.Tracker`, keeps the boxes and scores
them; then `entrack evaluate` does all of that itself, on the sequences that are there. Prints both.
"""

import argparse
import contextlib
import json
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from got10k.datasets import OTB
from got10k.experiments import ExperimentOTB

from entrack.evaluation.run import Evaluation, Options
from entrack.interop.got10k import Tracker

KEYS = {"auc": "success_score", "precision": "precision_score", "op50": "success_rate"}


class LocalOTB(ExperimentOTB):
    """The toolkit's experiment without its download of missing sequences."""

    def __init__(self, root: Path, out: Path) -> None:
        self.dataset = OTB(str(root), 2015, download=False)
        self.result_dir, self.report_dir = str(out / "results"), str(out / "reports")
        self.nbins_iou, self.nbins_ce = 21, 51


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("root", type=Path)
    words.add_argument("--tracker", default="cf")
    words.add_argument("--out", type=Path, required=True)
    given = words.parse_args()
    name = given.tracker
    with contextlib.redirect_stdout(sys.stderr):
        experiment = LocalOTB(given.root, given.out / "got10k")
        experiment.run(Tracker(name, name))
        overall = experiment.report([name])[name]["overall"]
        options = Options(("otb",), threads=1)
        run = Evaluation.prepare([f"otb:{given.root}"], [name], given.out / "entrack", options)
        (row,) = run.run().rows
    theirs = {ours: round(overall[key], 6) for ours, key in KEYS.items()}
    print(json.dumps({"tracker": name, "got10k": theirs, "entrack": {k: row[k] for k in KEYS}}))


if __name__ == "__main__":
    main()
