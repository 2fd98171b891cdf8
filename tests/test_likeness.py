"""Place and size from one look: boxes that are more like the target than the answer."""

from dataclasses import replace

import numpy as np
import pytest

from entrack import box as boxes
from entrack.config import Config, LikenessConfig, ScaleConfig, parse
from entrack.errors import EntrackError
from entrack.likeness import FURTHEST, Likeness, Parts
from entrack.tracker import Tracker
from entrack.trunk import Maps
from entrack.window import Window, WindowConfig, around
from test_tracker import Averages

N, C = 18, 24
BOX = np.array([100.0, 80.0, 40.0, 60.0])
RNG = np.random.default_rng(0)
WAVES = RNG.normal(size=(C, 2)), RNG.uniform(0, 2 * np.pi, C)
PLAIN = LikenessConfig(bias=0)


def scene(window: Window, centre=(120.0, 110.0), zoom: float = 1.0) -> Maps:
    """What a trunk would make of a window on smooth waves, which lie `zoom` times as wide."""

    def waves(n: int) -> np.ndarray:
        along = (np.arange(n) + 0.5) / n - 0.5
        x, y = window.x + along * window.w, window.y + along * window.h
        (a, b), phase = WAVES[0].T / (12 * zoom), WAVES[1]
        turned = a[:, None, None] * (x - centre[0]) + b[:, None, None] * (y - centre[1])[:, None]
        return np.cos(turned + phase[:, None, None]).astype(np.float32)

    return Maps(waves(N), waves(2 * N)[::2])


def times(maps: Maps, factor: float) -> Maps:
    return Maps(*(factor * part for part in maps))


def started(config: LikenessConfig = PLAIN) -> tuple[Likeness, Window]:
    window = around(BOX, WindowConfig())
    return Likeness.of(scene(window), BOX, window, config), window


def test_what_has_not_changed_keeps_place_and_size():
    likeness, window = started()
    centre, growth = likeness.fit(scene(window), BOX, window)
    np.testing.assert_allclose(centre, [120, 110], atol=0.3)
    assert growth == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("zoom", [0.9, 0.95, 1.05, 1.1])
def test_the_size_goes_where_the_target_goes(zoom: float):
    likeness, window = started()
    _, growth = likeness.fit(scene(window, zoom=zoom), BOX, window)
    assert 0.2 < np.log(growth) / np.log(zoom) < 3


@pytest.mark.parametrize("off", [(3, 0), (-3, 0), (0, 3), (2, -2)])
def test_the_centre_goes_where_the_target_is(off):
    likeness, window = started()
    centre, _ = likeness.fit(scene(window, centre=BOX[:2] + BOX[2:] / 2 + off), BOX, window)
    before, after = np.hypot(*off), np.hypot(*(centre - [120, 110] - off))
    assert after < before


@pytest.mark.parametrize("off", [(1, 0), (-1.5, 0), (0, 2), (1, -2)])
def test_the_first_look_says_the_whole_of_a_small_move(off):
    likeness, window = started(replace(PLAIN, pull=0, share=1))
    centre, _ = likeness.fit(scene(window, centre=BOX[:2] + BOX[2:] / 2 + off), BOX, window)
    np.testing.assert_allclose(centre - [120, 110], off, atol=0.4)


def test_no_frame_moves_or_grows_the_box_without_limit():
    likeness, window = started(replace(PLAIN, gain=1e6, pull=1e6, share=1))
    centre, growth = likeness.fit(scene(window, centre=(123, 108), zoom=1.1), BOX, window)
    assert growth == pytest.approx(PLAIN.span)
    assert np.all(np.abs(centre - [120, 110]) <= 2 * FURTHEST * BOX[2:] + 1e-9)


def test_a_pull_of_nothing_leaves_the_centre():
    likeness, window = started(replace(PLAIN, pull=0, share=0))
    centre, _ = likeness.fit(scene(window, centre=(125, 110)), BOX, window)
    assert centre.tolist() == [120, 110]


def test_blank_pictures_and_boxes_that_are_none_change_nothing():
    likeness, window = started()
    nothing = times(scene(window), 0)
    blank = Likeness.of(nothing, BOX, window, PLAIN)
    assert blank.fit(nothing, BOX, window)[1] == 1
    assert likeness.fit(scene(window), BOX * np.nan, window)[1] == 1


def test_a_network_that_overflows_is_no_error():
    likeness, window = started()
    assert np.isnan(likeness.fit(times(scene(window), np.nan), BOX, window)[0]).all()
    Likeness.of(times(scene(window), np.nan), BOX, window, PLAIN)


def test_it_learns_what_the_box_looks_like_by_and_by():
    likeness, window = started(replace(PLAIN, rate=0.5, share=0))
    larger = scene(window, zoom=1.1)
    for _ in range(12):
        likeness = likeness.learn(larger, BOX, window)
    _, growth = likeness.fit(larger, BOX, window)
    assert growth == pytest.approx(1, abs=0.01)


def test_a_search_over_sizes_and_likeness_exclude_each_other():
    with pytest.raises(EntrackError, match=r"mine: .*set scale.steps to 1"):
        parse(Config, {"likeness": {}}, "mine")
    assert parse(Config, {"likeness": {}, "scale": {"steps": 1}}, "mine").likeness


def test_how_far_a_box_is_off_is_what_it_has_to_be_moved_back_by():
    likeness, window = started()
    off = likeness.first_fine.off(scene(window).fine, BOX + np.array([2.0, -3.0, 0, 0]), window)
    np.testing.assert_allclose(off * BOX[2:], [2, -3], atol=0.5)


def test_the_score_hears_how_far_a_box_is_off():
    likeness, window = started()
    seen = scene(window)
    assert likeness.off(seen, BOX, window) == pytest.approx(0, abs=1e-6)
    a_little, more = (
        likeness.off(seen, BOX + np.array([dx, 0, 0, 0]), window) for dx in (1.0, 2.0)
    )
    assert more == pytest.approx(4 * a_little, rel=0.3) and 0 < more < 1
    assert likeness.off(times(seen, 50), BOX, window) == 1


@pytest.mark.parametrize("wider", [-0.2, -0.1, 0.0, 0.1, 0.2])
def test_parts_tell_how_much_wider_the_target_is_than_a_box(wider: float):
    window = around(BOX, WindowConfig())
    fine = scene(window).fine
    parts = Parts.of(fine, BOX, window)
    narrow = boxes.from_centre(boxes.centre(BOX), BOX[2:] * np.exp([-wider / 2, wider / 2]))
    assert parts.found(fine, narrow, window).wider == pytest.approx(wider, abs=0.05)
    aside = narrow + np.array([2.0, -3.0, 0, 0])
    assert parts.found(fine, aside, window).wider == pytest.approx(wider, abs=0.05)


@pytest.mark.parametrize("moved", [(0, 0), (5, 0), (-4, 6), (8, -9)])
def test_parts_tell_how_far_what_was_in_a_box_has_gone(moved):
    window = around(BOX, WindowConfig())
    parts = Parts.of(scene(window).fine, BOX, window)
    found = parts.found(scene(window, centre=(120 + moved[0], 110 + moved[1])).fine, BOX, window)
    np.testing.assert_allclose(found.move * BOX[2:], moved, atol=1)
    assert found.scatter < 0.05


def test_a_box_slips_where_it_leaves_what_was_in_it_and_not_where_both_move():
    window, size = around(BOX, WindowConfig()), np.sqrt(40 * 60)
    parts = Parts.of(scene(window).fine, BOX, window)
    still, moved = scene(window).fine, scene(window, centre=(128, 110)).fine
    here, there = np.array([120.0, 110]), np.array([128.0, 110])
    for fine, centre, slip in ((still, here, 0), (moved, there, 0), (still, there, 8 / size)):
        assert parts.slip(fine, BOX, window, centre) == pytest.approx(slip, abs=0.02)
    assert parts.slip(moved, BOX, window, here) == pytest.approx(8 / size, abs=0.02)


def test_parts_that_are_nowhere_tell_nothing():
    window, centre = around(BOX, WindowConfig()), boxes.centre(BOX)
    fine = scene(window).fine
    parts, away = Parts.of(fine, BOX, window), BOX + np.array([5000.0, 0, 0, 0])
    everywhere = np.broadcast_to(parts.around[:, None, None], fine.shape).astype(np.float32)
    for seen, box in ((fine, away), (everywhere, BOX)):
        assert parts.found(seen, box, window).wider == 0
        assert parts.slip(seen, box, window, centre + 9) == 0
    noise = RNG.normal(size=fine.shape).astype(np.float32)
    assert parts.slip(noise, BOX, window, centre + 9) == 0
    with np.errstate(invalid="ignore"):
        assert parts.slip(fine * np.float32(np.inf), BOX, window, centre + 9) == 0


def test_a_trunk_that_tells_no_finer_map_has_z_for_it():
    window = around(BOX, WindowConfig())
    z = scene(window).z
    likeness = Likeness.of(Maps(z, z), BOX, window, PLAIN)
    moved = scene(window, centre=(122, 110)).z
    centre, growth = likeness.fit(Maps(moved, moved), BOX, window)
    assert 120.5 < centre[0] < 123.5 and growth == pytest.approx(1, abs=0.05)


def test_a_filter_without_a_policy_can_use_it_too():
    config = Config(scale=ScaleConfig(steps=1), likeness=LikenessConfig())
    tracker = Tracker(config, Averages())
    frame = RNG.integers(0, 255, (240, 320, 3), dtype=np.uint8)
    tracker.init(frame, BOX)
    for _ in range(3):
        box = tracker.update(frame).box
    np.testing.assert_allclose(box, BOX, atol=12)
