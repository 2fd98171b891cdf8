"""The clip that comes with the package: plays anywhere, and its boxes are where its cup is."""

import importlib.util
from pathlib import Path

import av
import numpy as np
import pytest

from entrack.datasets.frames import VideoFrames

ROOT = Path(__file__).parents[1]
DEMO = ROOT / "src/entrack/assets/demo"


@pytest.fixture(scope="module")
def boxes():
    return np.loadtxt(DEMO / "clip.txt", delimiter=",")


def test_the_clip_is_small_and_plays_in_a_browser(boxes):
    data = (DEMO / "clip.mp4").read_bytes()
    assert len(data) <= 2e6
    assert data.index(b"moov") < data.index(b"mdat")
    with av.open(str(DEMO / "clip.mp4")) as clip:
        stream = clip.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert 10 <= stream.frames / stream.average_rate <= 15
        assert stream.frames == len(boxes)


def test_its_target_can_be_followed(boxes):
    """Steps far below the target's size, and a size that changes by less than 3 % a frame."""
    size = np.sqrt(boxes[:, 2] * boxes[:, 3])
    centres = boxes[:, :2] + boxes[:, 2:] / 2
    assert (np.hypot(*np.diff(centres, axis=0).T) / size[1:]).max() < 0.1
    assert np.abs(np.diff(np.log(size))).max() < 0.03
    assert size.max() / size.min() > 1.8


def test_the_script_makes_this_very_clip(boxes):
    pytest.importorskip("skimage", reason="needs scikit-image's photographs (extra dev)")
    script = ROOT / "scripts/make_demo_clip.py"
    spec = importlib.util.spec_from_file_location("make_demo_clip", script)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    scene = module.make_scene()
    np.testing.assert_allclose(scene.boxes, boxes, atol=0.01)
    frames = VideoFrames(DEMO / "clip.mp4", len(boxes))
    for t in (0, 170, 389):
        difference = frames[t].astype(float) - scene.render(t)
        assert np.abs(difference).mean() < 6
    assert 0.1 < scene.visible.min() < 0.5
    assert not scene.absent.any()
