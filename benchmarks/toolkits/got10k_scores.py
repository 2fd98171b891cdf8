"""Score results with the got10k toolkit; runs in the toolkit's own environment.

    python got10k_scores.py otb|got10k DATASET RESULTS TRACKER

RESULTS has what the toolkit itself writes. Prints one JSON object.
"""

import contextlib
import json
import sys
import tempfile

import matplotlib

matplotlib.use("Agg")
from got10k.datasets import OTB
from got10k.experiments import ExperimentGOT10k, ExperimentOTB


class LocalOTB(ExperimentOTB):
    """The toolkit's experiment without its download of missing sequences."""

    def __init__(self, root, results, reports):
        self.dataset = OTB(root, 2015, download=False)
        self.result_dir, self.report_dir = results, reports
        self.nbins_iou, self.nbins_ce = 21, 51


def main(kind, dataset, results, tracker):
    with tempfile.TemporaryDirectory() as reports, contextlib.redirect_stdout(sys.stderr):
        if kind == "otb":
            scores = LocalOTB(dataset, results, reports).report([tracker])[tracker]["overall"]
            keys = {"auc": "success_score", "precision": "precision_score", "op50": "success_rate"}
            found = {ours: scores[theirs] for ours, theirs in keys.items()}
        else:
            experiment = ExperimentGOT10k(dataset, "val", results, reports)
            scores = experiment.report([tracker])[tracker]["overall"]
            found = {"ao": scores["ao"], "op50": scores["sr"]}
    print(json.dumps(found))


main(*sys.argv[1:])
