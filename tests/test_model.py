"""Model folders: what is accepted, and what is refused in one sentence."""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import entrack
from entrack.errors import EntrackError
from entrack.model import SHIPPED, assets, load_model


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the shipped model that may be damaged."""
    copy = tmp_path / "models" / "cf"
    shutil.copytree(assets() / "models" / "cf", copy)
    shutil.copytree(assets() / "trunk", tmp_path / "trunk")
    return copy


def test_longterm_is_default_with_a_search():
    default, longterm = (load_model(name).config for name in ("default", "longterm"))
    update = replace(longterm.update, min_score=default.update.min_score)
    without = replace(longterm, update=update, recovery=None, spread=default.spread)
    assert longterm.recovery and without == default


@pytest.mark.parametrize("name", sorted(set(SHIPPED) - {"paper"}))
def test_every_shipped_model_tracks(name: str):
    tracker = entrack.load(name, threads=1)
    rng = np.random.default_rng(0)
    frame = rng.integers(0, 255, (120, 160, 3), dtype=np.uint8)
    tracker.init(frame, (40, 30, 50, 40))
    estimate = tracker.update(frame)
    np.testing.assert_allclose(estimate.box, [40, 30, 50, 40], atol=2)
    assert estimate.score > 0.5 and not estimate.lost


def test_the_papers_model_acts_as_printed_though_it_does_not_follow():
    tracker = entrack.load("paper", threads=1)
    assert tracker.config.scale.steps == 1 and tracker.config.recovery is None
    frame = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    tracker.init(frame, (40, 30, 50, 40))
    estimate = tracker.update(frame)
    assert np.isfinite(estimate.box).all() and estimate.sigma is not None
    [look] = tracker.looks
    assert look is not None and look.z is not None and look.z.shape == (1, 18, 18)


def test_a_folder_is_a_model(folder: Path):
    assert load_model(folder).config == load_model("cf").config


def test_unknown_models_are_refused():
    with pytest.raises(EntrackError, match="no model nonsense: expected default, longterm, cf"):
        load_model("nonsense")


def test_a_missing_file_is_named(folder: Path):
    (folder.parents[1] / "trunk" / "trunk.onnx").unlink()
    with pytest.raises(EntrackError, match=r"incomplete: .*trunk\.onnx is missing"):
        load_model(folder)


def test_an_altered_file_is_named(folder: Path):
    trunk = folder.parents[1] / "trunk" / "trunk.onnx"
    content = bytearray(trunk.read_bytes())
    content[1000] ^= 1
    trunk.write_bytes(content)
    with pytest.raises(EntrackError, match=r"trunk\.onnx was altered"):
        load_model(folder)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("context = 3.0", "context = 30.0", r"config\.window\.context"),
        ("context = 3.0", "kontext = 3.0", r"config\.window\.kontext"),
        ("context = 3.0", 'context = "wide"', r"config\.window\.context"),
        ("context = 3.0", "context = ", "not a TOML file"),
        ("[files.trunk]", "[files.other]", "names no trunk"),
    ],
)
def test_a_wrong_key_is_named(folder: Path, old: str, new: str, message: str):
    path = folder / "model.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(EntrackError, match=message):
        load_model(folder)


def test_unknown_engines_are_refused():
    with pytest.raises(EntrackError, match="no engine 'abacus': there are openvino, onnxruntime"):
        entrack.load("cf", engine="abacus")


@pytest.mark.parametrize("threads", [0, -3])
def test_less_than_one_thread_is_refused(threads: int):
    with pytest.raises(EntrackError, match=f"at least 1, found {threads}"):
        entrack.load("cf", threads=threads)


def test_engines_agree_on_boxes():
    pytest.importorskip("onnxruntime")
    rng = np.random.default_rng(1)
    frame = cv2.resize(rng.integers(0, 255, (24, 32, 3), dtype=np.uint8), (320, 240))
    moved = np.roll(frame, (4, -7), axis=(0, 1))
    boxes = []
    for engine in ("openvino", "onnxruntime"):
        tracker = entrack.load("cf", engine=engine, threads=1)
        tracker.init(frame, (120, 90, 60, 50))
        boxes.append(tracker.update(moved).box)
    np.testing.assert_allclose(boxes[0], boxes[1], atol=0.5)
    np.testing.assert_allclose(boxes[0][:2], [113, 94], atol=2)
