"""The aspect ratio that is told: found afresh in every look, and worked with in none."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

import entrack
from entrack.aspect import MOST, Aspect
from entrack.box import area, centre
from entrack.config import AspectConfig, Config, parse
from entrack.errors import EntrackError
from entrack.filter import Features
from entrack.tracker import Tracker
from entrack.trunk import Maps
from entrack.window import Image, Window

WINDOW = Window(0.0, 0.0, 288.0, 288.0, 288)
BOX = np.array([96.0, 96.0, 96.0, 96.0])


@pytest.fixture(scope="module")
def default() -> Tracker:
    return entrack.load("default", threads=1)


def _picture(wider: float) -> Image:
    """A patterned plate of 60 × 60 pixels before a ground, made `wider` for its height."""
    rng = np.random.default_rng(3)
    ground = cv2.resize(rng.integers(60, 120, (12, 16, 3), dtype=np.uint8), (320, 240))
    plate = cv2.resize(rng.integers(0, 256, (5, 5, 3), dtype=np.uint8), (60, 60))
    w, h = round(60 * np.sqrt(wider)), round(60 / np.sqrt(wider))
    x, y = 160 - w // 2, 120 - h // 2
    ground[y : y + h, x : x + w] = cv2.resize(plate, (w, h))
    return ground


def _features() -> Maps:
    rng = np.random.default_rng(0)
    return Maps(*(rng.normal(size=(8, n, n)).astype(np.float32) for n in (18, 36)))


def _each(maps: Maps, change: Callable[[Features], Features]) -> Maps:
    return Maps(*(change(part) for part in maps))


def _aspect(mean: float) -> Aspect:
    return replace(Aspect.of(_features(), BOX, WINDOW, AspectConfig()), mean=mean)


@pytest.mark.parametrize("wider", [1.8, 1 / 1.8])
def test_a_target_that_is_stretched_has_a_box_that_is(default: Tracker, wider: float) -> None:
    steps = np.exp(np.linspace(0, np.log(wider), 25))
    default.init(_picture(1.0), (130, 90, 60, 60))
    for step in [*steps, *[wider] * 10]:
        told = default.update(_picture(step)).box
    kept = default._targets[0].box
    np.testing.assert_allclose(kept[2] / kept[3], 1, atol=0.02)
    assert abs(np.log(told[2] / told[3]) - np.log(wider)) < abs(np.log(wider)) / 2


def test_what_is_told_changes_no_look(default: Tracker) -> None:
    plain = Tracker(replace(default.config, aspect=None), default.trunk, default.policy)
    for tracker in (default, plain):
        tracker.init(_picture(1.0), (130, 90, 60, 60))
    for step in np.linspace(1, 1.8, 15):
        told, kept = (tracker.update(_picture(step)) for tracker in (default, plain))
        assert told.score == kept.score
        np.testing.assert_array_equal(default._targets[0].box, kept.box)
    assert told.box[2] / told.box[3] > kept.box[2] / kept.box[3] + 0.1


def test_a_stretched_box_keeps_its_centre_and_area() -> None:
    box = np.array([10.0, 20.0, 30.0, 60.0])
    told = _aspect(0.5).stretch(box)
    np.testing.assert_allclose(centre(told), centre(box))
    assert area(told) == pytest.approx(area(box))
    assert np.log(told[2] / told[3] * 2) == pytest.approx(0.35)  # less the slack


@pytest.mark.parametrize(
    ("mean", "change"), [(0.14, 0.0), (-0.15, 0.0), (-0.35, -0.2), (3.0, MOST)]
)
def test_small_changes_are_none_and_large_ones_end(mean: float, change: float) -> None:
    assert _aspect(mean).change == pytest.approx(change)


def test_what_is_as_wide_as_it_is_high_tells_no_change_and_the_action_does() -> None:
    # To the right as it is downwards.
    features = _each(_features(), lambda part: part + part.swapaxes(1, 2))
    aspect = Aspect.of(features, BOX, WINDOW, AspectConfig(action=1.5, rate=0.4))
    assert aspect.then(features, BOX, WINDOW, 0.0).mean == pytest.approx(0, abs=1e-5)
    assert aspect.then(features, BOX, WINDOW, 0.2).mean == pytest.approx(0.4 * 1.5 * 0.2, abs=1e-5)
    assert abs(_aspect(0.0).then(_features(), BOX, WINDOW, 0.0).mean) > 1e-3


@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_network_that_overflowed_tells_nothing() -> None:
    aspect = _aspect(0.4)
    assert aspect.then(_features(), BOX, WINDOW, float("nan")) == aspect
    infinite = _each(_features(), lambda part: part * np.float32(np.inf))
    assert aspect.then(infinite, BOX, WINDOW, 0.0).mean == aspect.mean


def test_only_boxes_that_keep_their_aspect_are_stretched() -> None:
    with pytest.raises(EntrackError, match=r"set policy\.keep_aspect"):
        parse(Config, {"aspect": {}, "policy": {}}, "mine.toml")
    assert parse(Config, {"aspect": {}}, "mine.toml").aspect == AspectConfig()
