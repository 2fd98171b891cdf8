"""Score a workspace with vot-toolkit; runs in the toolkit's own environment.

    python vot_scores.py WORKSPACE TRACKER

Prints accuracy, robustness and EAO of the experiment "baseline", and each sequence's failures.
"""

import json
import sys

import numpy as np
from vot.analysis.supervised import AverageAccuracyRobustness, EAOCurve, locate_failures_inits
from vot.workspace import Workspace

LOW, HIGH = 108, 371  # VOT2016


def main(workspace, tracker):
    opened = Workspace.load(workspace)
    experiment = opened.stack["baseline"]
    experiment = experiment if not isinstance(experiment, str) else opened.stack[experiment]
    trackers, sequences = opened.registry.resolve(tracker, storage=opened.storage), opened.dataset
    sequences = [experiment.transform(s)[0] for s in sequences]
    average = AverageAccuracyRobustness()
    parts = [average.analysis.subcompute(experiment, trackers[0], s, []) for s in sequences]
    accuracy, robustness, _, _ = average.aggregate(trackers[0], sequences, parts)
    curve = EAOCurve().subcompute(experiment, trackers[0], sequences, [])[0]
    failures = {
        s.name: [
            int(f) for f in locate_failures_inits(experiment.gather(trackers[0], s)[0].regions())[0]
        ]
        for s in sequences
    }
    found = {"accuracy": accuracy, "robustness": robustness, "eao": np.mean(curve[LOW : HIGH + 1])}
    print(json.dumps({"scores": {k: float(v) for k, v in found.items()}, "failures": failures}))


main(*sys.argv[1:])
