"""The tracker behind vot-toolkit, and the toolkit itself where it is installed."""

import os
import subprocess
import sys
from configparser import ConfigParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from entrack.box import iou
from entrack.cli.app import main
from entrack.datasets.boxes import upright_boxes
from entrack.errors import EntrackError
from entrack.evaluation.run import Evaluation, Options
from entrack.interop.vot import as_box, create_tracker
from fakes import ball

SLANTED = [(334.02, 128.36), (438.19, 188.78), (396.39, 260.83), (292.23, 200.41)]


@pytest.fixture
def frames(tmp_path: Path) -> list[str]:
    paths = [tmp_path / f"{t:08d}.jpg" for t in range(1, 7)]
    for t, path in enumerate(paths):
        cv2.imwrite(str(path), ball(t)[0], [cv2.IMWRITE_JPEG_QUALITY, 100])
    return [str(path) for path in paths]


def test_the_toolkits_calls_are_answered_with_rectangles(frames):
    tracker = create_tracker("cf", "1")
    [(first, _)] = tracker.init(frames[0], (tuple(ball(0)[1]), {}), {})
    assert first == tuple(ball(0)[1])
    for t, frame in enumerate(frames[1:], 1):
        [(rectangle, told)] = tracker.update({"depth": "absent.png", "color": frame}, [], {})
        assert [type(side) for side in rectangle] == [float] * 4
        assert iou(rectangle, ball(t)[1]) > 0.6
        assert 0 <= told["confidence"] <= 1


def test_objects_may_appear_later(frames):
    tracker = create_tracker("cf")
    tracker.init(frames[0], [((90, 80, 30, 20), {})])
    found = tracker.update(frames[1], [(tuple(ball(1)[1]), {})])
    assert found[1] == (tuple(ball(1)[1]), {})
    _, (moved, _) = tracker.update(frames[2], [])
    assert iou(moved, ball(2)[1]) > 0.6


def test_regions_of_every_kind_become_boxes():
    mask = np.zeros((20, 30), np.uint8)
    mask[5:9, 10:17] = 1
    np.testing.assert_array_equal(as_box(mask.tolist()), [10, 5, 7, 4])
    np.testing.assert_array_equal(as_box([(1, 2), (5, 2), (3, 8)]), [1, 2, 4, 6])
    single = [(float(np.float32(x)), float(np.float32(y))) for x, y in SLANTED]
    np.testing.assert_array_equal(as_box(single), upright_boxes(np.ravel(SLANTED)))
    diamond = as_box([(2, 0), (4, 2), (2, 4), (0, 2)])
    np.testing.assert_allclose(diamond[2:].prod(), 8)
    with pytest.raises(EntrackError, match="expected a rectangle, polygon or mask"):
        as_box([1, 2])


def test_a_workspace_keeps_its_other_trackers(tmp_path, capsys):
    (tmp_path / "trackers.ini").write_text("[other]\ncommand = x\n")
    assert main(["vot", "init", str(tmp_path), "--stack", "vot2016/rgb"]) == 0
    ini = ConfigParser()
    ini.read(tmp_path / "trackers.ini")
    assert ini.sections() == ["other", "entrack", "entrack-trax"]
    assert ini["entrack"]["command"] == "entrack.interop.vot:create_tracker"
    assert (ini["entrack"]["protocol"], ini["entrack"]["arg_model"]) == ("python", "default")
    assert ini["entrack-trax"]["command"].endswith("-m entrack.interop.vot default")
    assert "stack: vot2016/rgb" in (tmp_path / "config.yaml").read_text()
    before = (tmp_path / "trackers.ini").read_text()
    for words, why in [
        ([], "has a tracker entrack already"),
        (["--name", "b", "--stack", "vot2018/shortterm"], "config.yaml exists"),
        (["--name", "a b"], "found a b"),
        (["--name", "b", "--model", "none"], "no model none"),
    ]:
        assert main(["vot", "init", str(tmp_path), *words]) == 2
        assert why in capsys.readouterr().err
    assert (tmp_path / "trackers.ini").read_text() == before


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """A workspace with a sequence whose target jumps away, so that trackers fail once."""
    pytest.importorskip("vot", reason="vot-toolkit is not installed: it lives beside other OpenCVs")
    folder = tmp_path / "workspace"
    bag = folder / "sequences" / "bag"
    (bag / "color").mkdir(parents=True)
    rows = []
    for t in range(24):
        image, (x, y, w, h) = ball(t if t < 12 else 40 - t)
        cv2.imwrite(str(bag / "color" / f"{t + 1:08d}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 100])
        rows.append(f"{x},{y},{x + w},{y},{x + w},{y + h},{x},{y + h}")
    (bag / "groundtruth.txt").write_text("\n".join(rows) + "\n")
    (bag / "sequence").write_text("name=bag\nchannels.color=color/%08d.jpg\n")
    (folder / "sequences" / "list.txt").write_text("bag\n")
    assert main(["vot", "init", str(folder), "--model", "cf", "--stack", "vot2016/rgb"]) == 0
    return folder


def vot(workspace: Path, module: str, *words: str) -> str:
    """Run the command `vot` in a workspace; return what it says."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "MPLBACKEND": "agg"}
    command = [sys.executable, "-m", module, *words]
    done = subprocess.run(
        command, cwd=workspace, env=environment, capture_output=True, text=True, check=True
    )
    assert "Traceback" not in done.stderr
    return done.stdout + done.stderr


@pytest.mark.parametrize("name", ["entrack", "entrack-trax"])
def test_the_toolkits_own_test_passes(workspace, name):
    if name == "entrack-trax":
        pytest.importorskip("trax")
    told = vot(workspace, "vot", "--registry", str(workspace / "trackers.ini"), "test", name)
    assert "Test concluded success" in told


@pytest.mark.parametrize("name", ["entrack", "entrack-trax"])
def test_a_supervised_run_is_the_same_as_ours(workspace, tmp_path, name):
    words = ["evaluate", "--workspace", str(workspace), "--experiments", "baseline", name]
    vot(workspace, "entrack.interop.vot_supervised", *words)
    options = Options(("vot-toolkit",))
    data = [f"vot2016:{workspace}"]
    theirs = f"theirs=raw:{workspace / 'results' / name}"
    given, own = Evaluation.prepare(data, [theirs, "cf"], tmp_path / "run", options).run().rows
    for number in ("accuracy", "robustness", "eao"):
        assert given[number] == pytest.approx(own[number], abs=1e-3)
    assert own["robustness"] >= 1
