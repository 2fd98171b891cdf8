"""Other trackers behind `init` and `update`."""

import numpy as np
import pytest

from entrack.errors import EntrackError
from entrack.peers import parse, parse_all
from entrack.peers.opencv import NETWORKS, PLAIN, OpenCVTracker
from fakes import ball


@pytest.mark.parametrize("name", PLAIN)
def test_every_tracker_of_opencv_starts_and_answers_with_a_box(name):
    tracker = parse(f"opencv:{name}").make()
    image, box = ball(0, (200, 160))
    tracker.init(image, np.array(box, float))
    said = tracker.update(ball(1, (200, 160))[0])
    assert said.score is None
    answer = said.box
    assert answer.shape == (4,)
    assert answer.dtype == np.float64
    assert np.isfinite(answer).all()


def test_a_tracker_that_reports_failure_keeps_its_last_box():
    tracker = OpenCVTracker("kcf", {})

    class Fails:
        def update(self, image):
            return False, (0, 0, 0, 0)

    tracker.init(ball(0)[0], [10.0, 12, 24, 20])
    tracker._tracker = Fails()
    answer = tracker.update(ball(1)[0])
    assert (answer.box.tolist(), answer.lost, answer.score) == ([10, 12, 24, 20], True, None)


def test_networks_are_found_in_their_folder(tmp_path):
    for file in ("nanotrack_backbone_sim.onnx", "nanotrack_head_sim.onnx"):
        (tmp_path / file).write_bytes(b"x")
    nano = parse(f"opencv:nano:{tmp_path}")
    assert nano.name == "opencv:nano"
    assert len(nano.checksum) == 64
    (tmp_path / "another_backbone.onnx").write_bytes(b"x")
    with pytest.raises(EntrackError, match=r"2 files \*backbone\*.onnx in .*, expected one"):
        nano.make()
    for name in NETWORKS:
        with pytest.raises(EntrackError, match=f"opencv:{name} needs its networks"):
            parse(f"opencv:{name}").make()


@pytest.mark.shared
def test_nanotrack_follows_the_ball(shared, capfd):
    tracker = parse(f"opencv:nano:{shared}/peers/nanotrack").make()
    image, box = ball(0, (320, 240))
    tracker.init(image, np.array(box, float))
    for t in range(1, 6):
        image, (x, y, w, h) = ball(t, (320, 240))
        answer = tracker.update(image)
    found = answer.box
    assert "WARN" not in capfd.readouterr().err
    assert 0.5 < answer.score <= 1
    assert not answer.lost
    assert abs(found[0] + found[2] / 2 - x - w / 2) < 6
    assert abs(found[1] + found[3] / 2 - y - h / 2) < 6


def test_names_folders_and_kinds(tmp_path):
    cases = {
        "default": ("default", "model", "default"),
        "opencv:csrt": ("opencv:csrt", "opencv", "opencv-csrt"),
        "package.module:Class": ("package.module:Class", "class", "package.module-Class"),
        f"raw:{tmp_path}/SiamRPN++.zip": ("SiamRPN++", "raw", "SiamRPN++"),
        f"our best=raw:{tmp_path}": ("our best", "raw", "our-best"),
        str(tmp_path): (tmp_path.name, "model", tmp_path.name),
    }
    for text, expected in cases.items():
        found = parse(text)
        assert (found.name, found.kind, found.folder) == expected


def test_names_that_would_share_a_folder_are_refused():
    with pytest.raises(EntrackError, match="two trackers are called"):
        parse_all(["opencv:kcf", "opencv-kcf=cf"])
    with pytest.raises(EntrackError, match="two trackers are called"):
        parse_all(["cf", "CF=default"])


def test_any_class_with_two_methods_is_a_tracker():
    tracker = parse("stub_trackers:Drift")
    assert tracker.checksum is None
    made = tracker.make()
    made.init(None, [1, 2, 3, 4])
    assert made.update(None)[0] > 2


def test_versions():
    assert parse("opencv:kcf").version.startswith("opencv ")
    assert parse("default").version.startswith("entrack ")
    assert parse("numpy:Class").version == f"numpy {np.__version__}"
