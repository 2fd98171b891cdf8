"""The tracker in the shapes of other libraries, run by these libraries where they are installed."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import entrack
from entrack.box import iou
from entrack.interop import got10k, opencv
from fakes import ball


def follow_with_opencvs_methods(tracker, least=0.6):
    """A loop as it is written for the trackers of OpenCV; `least` is the IoU asked for."""
    image, box = ball(0)
    tracker.init(image, box)
    for t in range(1, 8):
        image, truth = ball(t)
        found, box = tracker.update(image)
        assert found
        cv2.rectangle(image, box, (0, 255, 0), 2)  # takes whole pixels only
        assert iou(box, truth) >= least
    return box


@pytest.mark.parametrize(
    ("create", "least"), [(cv2.TrackerMIL.create, 0), (opencv.Tracker.create, 0.6)]
)
def test_a_loop_for_opencvs_trackers_runs_with_ours(create, least):
    box = follow_with_opencvs_methods(create(), least)
    assert [type(side) for side in box] == [int] * 4


def test_the_score_is_that_of_the_last_estimate():
    tracker = opencv.Tracker()
    assert tracker.getTrackingScore() == 1
    follow_with_opencvs_methods(tracker)
    assert tracker.getTrackingScore() == tracker.estimate.score
    tracker.init(*ball(0))
    lost = [tracker.update(np.zeros_like(ball(0)[0]))[0] for _ in range(5)]
    assert not lost[-1]
    assert tracker.getTrackingScore() < 0.4


def test_supervision_gets_detections_that_it_can_draw():
    sv = pytest.importorskip("supervision", reason="supervision is not installed")
    from entrack.interop.supervision import detections

    tracker = entrack.load(threads=1)
    image, box = ball(0)
    tracker.init_many(image, [box, (100, 80, 30, 20)])
    tracker.drop(0)
    tracker.add(box)
    estimates = tracker.update_many(ball(1)[0])
    found = detections(estimates, tracker.ids, with_lost=True)
    assert isinstance(found, sv.Detections)
    assert found.tracker_id.tolist() == [1, 2]
    np.testing.assert_allclose(found.xyxy[:, 2:] - found.xyxy[:, :2], found_sizes(estimates), 1e-5)
    np.testing.assert_allclose(found.confidence, [e.score for e in estimates], 1e-5)
    drawn = sv.BoxAnnotator().annotate(image.copy(), found)
    assert (drawn != image).any()
    assert len(detections([])) == 0
    assert len(detections(estimates[0], with_lost=True)) == 1


def found_sizes(estimates):
    return np.array([e.box[2:] for e in estimates])


def test_got10ks_experiment_scores_as_our_protocol_does(tmp_path: Path):
    pytest.importorskip("got10k", reason="the got10k toolkit is not installed")
    import matplotlib

    matplotlib.use("Agg")
    from got10k.experiments import ExperimentGOT10k

    from entrack.evaluation.run import Evaluation, Options

    root = write_got10k(tmp_path / "GOT-10k")
    folders = {"result_dir": str(tmp_path / "results"), "report_dir": str(tmp_path / "reports")}
    experiment = ExperimentGOT10k(str(root), "val", **folders)
    experiment.run(got10k.Tracker("cf", "cf"), visualize=False)
    theirs = experiment.report(["cf"])["cf"]["overall"]
    run = Evaluation.prepare([f"got10k:{root}"], ["cf"], tmp_path / "run", Options(("got10k",)))
    (ours,) = run.run().rows
    assert theirs["ao"] == pytest.approx(ours["ao"], abs=1e-3)
    assert theirs["ao"] > 0.6


def test_got10ks_tracker_counts_from_1_and_takes_pictures_of_pil(tmp_path: Path):
    image_of = pytest.importorskip("PIL.Image").fromarray
    root = write_got10k(tmp_path / "GOT-10k") / "val" / "GOT-10k_Val_000001"
    files = sorted(root.glob("*.jpg"))
    x, y, w, h = ball(0)[1]
    tracker = got10k.Tracker("cf")
    boxes, seconds = tracker.track([str(f) for f in files], np.array([x + 1, y + 1, w, h]))
    assert boxes[0].tolist() == [x + 1, y + 1, w, h]
    assert iou(boxes[-1] - [1, 1, 0, 0], ball(len(files) - 1)[1]) > 0.6
    assert (seconds > 0).all()
    pictures = [image_of(cv2.imread(str(f))[:, :, ::-1]) for f in files]
    tracker.init(pictures[0], boxes[0])
    again = [tracker.update(picture) for picture in pictures[1:]]
    np.testing.assert_array_equal(again, boxes[1:])


def write_got10k(root: Path, frames: int = 6) -> Path:
    """A set "val" of one sequence."""
    name = "GOT-10k_Val_000001"
    folder = root / "val" / name
    folder.mkdir(parents=True)
    truth = []
    for t in range(frames):
        image, (x, y, w, h) = ball(t)
        cv2.imwrite(str(folder / f"{t + 1:08d}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 100])
        truth.append([x + 1, y + 1, w, h])
    np.savetxt(folder / "groundtruth.txt", truth, "%d", ",")
    np.savetxt(folder / "cover.label", [8] * frames, "%d")
    np.savetxt(folder / "absence.label", [0] * frames, "%d")
    np.savetxt(folder / "cut_by_image.label", [0] * frames, "%d")
    height, width = image.shape[:2]
    (folder / "meta_info.ini").write_text(f"[METAINFO]\nresolution: ({width}, {height})\n")
    (root / "val" / "list.txt").write_text(f"{name}\n")
    return root
