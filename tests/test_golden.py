"""Raw results of published trackers score what is known of them, to four digits.

Also the bars of speed and memory for scoring. Everything here needs the research data.
"""

import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from entrack.datasets import open_dataset
from entrack.evaluation import vot
from entrack.evaluation.protocols import find_protocol
from entrack.evaluation.raw import Results
from entrack.evaluation.region import Regions
from entrack.evaluation.run import Evaluation, Options
from entrack.evaluation.score import Truth, score

pytestmark = pytest.mark.shared


@pytest.fixture(scope="module")
def golden(shared: Path) -> Path:
    folder = shared / "golden"
    if not folder.is_dir():
        pytest.skip("needs the golden results: no folder golden in the research data")
    return folder


def values(data: str, results: Path, *protocols: str):
    form = data.partition(":")[0]
    truth = Truth.read(form, open_dataset(data))
    for name in protocols:
        protocol = find_protocol(name, form)
        yield protocol.values(list(score(truth, Results(results), protocol).scores.values()))


@pytest.mark.parametrize(
    ("tracker", "auc", "precision"), [("SiamRPN++", 0.6955, 0.9054), ("ATOM", 0.6670, 0.8791)]
)
def test_otb100(golden, tracker, auc, precision):
    truth = f"otb:{golden}/otb100/groundtruth.json"
    (found,) = values(truth, golden / "otb100" / f"{tracker}.zip", "otb")
    assert round(found["auc"], 4) == auc
    assert round(found["precision"], 4) == precision


def test_lasot(golden):
    truth = f"lasot:{golden}/lasot/annos_test280.zip"
    (found,) = values(truth, golden / "lasot" / "ATOM.zip", "lasot")
    assert round(found["auc"], 4) == 0.5143
    assert round(found["precision"], 4) == 0.5054
    assert round(found["norm_precision"], 4) == 0.5768


def test_a_perfect_tracker_on_lasot(golden):
    dataset = open_dataset(f"lasot:{golden}/lasot/annos_test280.zip")
    lasot = find_protocol("lasot", "lasot")
    assert sum(map(len, dataset)) == 685_360
    found = lasot.values([lasot.ope(s, [s.boxes]) for s in dataset])
    assert round(found["auc"], 4) == 0.9274


def test_vot2019(golden):
    truth = f"vot2019:{golden}/vot2019/VOT2019.json"
    results = golden / "vot2019" / "Ocean.zip"
    pysot, toolkit = values(truth, results, "vot2019", "vot-toolkit")
    assert round(pysot["accuracy"], 4) == 0.5978
    assert round(pysot["robustness"], 4) == 0.4013
    assert round(pysot["eao"], 4) == 0.3226
    # What vot-toolkit 0.9.0's own functions say of the same files.
    assert round(toolkit["robustness"], 3) == 1.354
    assert round(toolkit["eao"], 4) == 0.3170


def test_what_older_releases_of_vot_toolkit_said(golden):
    """Their rules, over the overlap of region.c: "EAO .3146"."""
    dataset = open_dataset(f"vot2019:{golden}/vot2019/VOT2019.json")
    results = Results(golden / "vot2019" / "Ocean.zip")
    total = np.zeros((2, 400))
    for sequence in dataset:
        (run,) = results.trajectories(sequence.name)
        corners = sequence.boxes if sequence.polygons is None else sequence.polygons
        iou = vot.supervised_overlaps(run, Regions.of(corners), None)
        total += vot.expected_overlap_terms(vot.toolkit_fragments(run, iou), 400)
    assert round(float(np.mean(total[0, 46:292] / total[1, 46:292])), 4) == 0.3146


def test_scoring_ten_trackers_on_otb100_takes_seconds(golden, tmp_path):
    trackers = []
    for i in range(5):
        for name in ("ATOM", "SiamRPN++"):
            shutil.copy(golden / "otb100" / f"{name}.zip", tmp_path / f"{name}-{i}.zip")
            trackers.append(f"raw:{tmp_path}/{name}-{i}.zip")
    started = time.process_time()
    evaluation = Evaluation.prepare(
        [f"otb:{golden}/otb100/groundtruth.json"], trackers, tmp_path / "out", Options()
    )
    assert len(evaluation.run().rows) == 10
    assert time.process_time() - started < 15  # 8 on a processor of 2017


def test_scoring_lasot_takes_seconds_and_little_memory(golden, tmp_path):
    """In a process of its own, as memory is counted by process."""
    script = """
import sys, time
from pathlib import Path
from entrack.evaluation.run import Evaluation
golden, out = sys.argv[1:]
started = time.process_time()
Evaluation.prepare(
    [f"lasot:{golden}/lasot/annos_test280.zip"], [f"raw:{golden}/lasot/ATOM.zip"], Path(out)
).run()
seconds = time.process_time() - started
status = Path("/proc/self/status").read_text().split()  # ru_maxrss counts the parent, too
print(seconds, int(status[status.index("VmHWM:") + 1]) / 1024)
"""
    done = subprocess.run(
        [sys.executable, "-c", script, str(golden), str(tmp_path)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    seconds, megabytes = map(float, done.stdout.split())
    assert seconds < 20  # 8 to 11 on a processor of 2017
    assert megabytes < 500
