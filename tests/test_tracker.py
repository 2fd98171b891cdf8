"""The tracker as its caller sees it, on a trunk of local averages that needs no weights."""

import cv2
import numpy as np
import pytest

from entrack.box import iou
from entrack.config import Config, ScaleConfig, UpdateConfig
from entrack.errors import EntrackError
from entrack.tracker import Tracker


class Averages:
    """Mean colour and gradients of each 16 × 16 cell: enough to follow a textured patch."""

    precision = "fp32"

    def __call__(self, patches: np.ndarray) -> np.ndarray:
        x = patches.astype(np.float32) / 255
        n, size = x.shape[0], x.shape[1] // 16
        grey = x.mean(-1)
        dx, dy = np.gradient(grey, axis=2), np.gradient(grey, axis=1)
        planes = [x[..., c] - 0.5 for c in range(3)]
        planes += [np.maximum(s * d, 0) * 8 for d in (dx, dy) for s in (1, -1)]
        stacked = np.stack(planes, 1)
        return stacked.reshape(n, len(planes), size, 16, size, 16).mean((3, 5)).astype(np.float32)


def scene(place: tuple[float, float], size: float = 40, shape=(240, 320)) -> np.ndarray:
    """A textured square at `place` (its left top corner) on a textured ground."""
    rng = np.random.default_rng(3)
    ground = cv2.resize(rng.integers(60, 120, (12, 16, 3), dtype=np.uint8), (320, 240))
    target = rng.integers(0, 255, (5, 5, 3), dtype=np.uint8)
    target = cv2.resize(target, (64, 64), interpolation=cv2.INTER_NEAREST)
    matrix = np.array([[size / 64, 0, place[0]], [0, size / 64, place[1]]])
    layer = cv2.warpAffine(target, matrix, (320, 240))
    mask = cv2.warpAffine(np.full((64, 64), 1.0), matrix, (320, 240))[..., None]
    image = (mask * layer + (1 - mask) * ground).astype(np.uint8)
    return image if shape == (240, 320) else cv2.resize(image, shape[::-1])


def tracker(**sections: object) -> Tracker:
    return Tracker(Config(**sections), Averages())  # type: ignore[arg-type]


def test_follows_a_moving_target():
    t = tracker()
    t.init(scene((100, 80)), (100, 80, 40, 40))
    for k in range(1, 30):
        truth = [100 + 3 * k, 80 + 2 * np.sin(k / 3), 40, 40]
        estimate = t.update(scene((truth[0], truth[1])))
        assert iou(estimate.box, truth) > 0.75
        assert 0 <= estimate.score <= 1
        assert not estimate.lost


def test_follows_a_growing_target_with_three_scales_and_not_with_one():
    def grow(steps: int) -> float:
        t = tracker(scale=ScaleConfig(steps=steps))
        t.init(scene((120, 90)), (120, 90, 40, 40))
        size = 40.0
        for _ in range(25):
            size *= 1.015
            box = t.update(scene((140 - size / 2, 110 - size / 2), size)).box
        return float(iou(box, [140 - size / 2, 110 - size / 2, size, size]))

    assert grow(3) > 0.8
    assert grow(1) < 0.6


def test_several_targets_in_one_batch_are_tracked_as_each_alone():
    frames = [scene((100 + 2 * k, 80)) for k in range(6)]
    boxes = [(100, 80, 40, 40), (30, 150, 50, 30)]
    together = tracker()
    together.init_many(frames[0], boxes)
    alone = [tracker(), tracker()]
    for t, box in zip(alone, boxes, strict=True):
        t.init(frames[0], box)
    for frame in frames[1:]:
        for t, estimate in zip(alone, together.update_many(frame), strict=True):
            np.testing.assert_allclose(estimate.box, t.update(frame).box, atol=1e-3)


def test_a_target_that_is_added_is_tracked_as_from_a_start_of_its_own():
    frames = [scene((100 + 2 * k, 80)) for k in range(8)]
    together, alone = tracker(), tracker()
    together.init(frames[0], (30, 150, 50, 30))
    for frame in frames[1:4]:
        together.update(frame)
    alone.init(frames[3], (106, 80, 40, 40))
    assert together.add((106, 80, 40, 40)) == 1
    for frame in frames[4:]:
        _, added = together.update_many(frame)
        np.testing.assert_allclose(added.box, alone.update(frame).box, atol=1e-3)
    assert together.ids == [0, 1]


def test_targets_come_and_go_and_no_id_is_given_twice():
    t = tracker()
    assert t.add((100, 80, 40, 40), scene((100, 80))) == 0
    assert t.add((30, 150, 50, 30)) == 1
    t.drop(0)
    [still] = t.update_many(scene((104, 80)))
    assert iou(still.box, (30, 150, 50, 30)) > 0.9
    t.drop(1)
    assert t.update_many(scene((108, 80))) == []
    with pytest.raises(EntrackError, match="no target left"):
        t.update(scene((108, 80)))
    assert t.add((108, 80, 40, 40)) == 2
    assert iou(t.update(scene((112, 80))).box, (112, 80, 40, 40)) > 0.75
    with pytest.raises(EntrackError, match=r"no target 1: there are \[2\]"):
        t.drop(1)


def test_a_box_that_cannot_be_added_changes_nothing():
    t = tracker()
    with pytest.raises(EntrackError, match="add before init"):
        t.add((100, 80, 40, 40))
    t.init(scene((100, 80)), (100, 80, 40, 40))
    with pytest.raises(EntrackError, match="outside the 320×240 frame"):
        t.add((400, 10, 20, 20))
    assert t.ids == [0]
    assert iou(t.update(scene((104, 80))).box, (104, 80, 40, 40)) > 0.75


def test_a_target_is_added_in_the_size_that_the_stream_has_now():
    t = tracker()
    t.init(scene((100, 80)), (100, 80, 40, 40))
    t.add((200, 160, 80, 80), scene((100, 80), shape=(480, 640)))
    first, second = t.update_many(scene((104, 80), shape=(480, 640)))
    np.testing.assert_allclose(first.box, second.box, atol=1)


def test_update_before_init_is_refused():
    with pytest.raises(EntrackError, match="update before init"):
        tracker().update(scene((0, 0)))


def test_update_with_several_targets_is_refused():
    t = tracker()
    t.init_many(scene((100, 80)), [(100, 80, 40, 40), (10, 10, 20, 20)])
    with pytest.raises(EntrackError, match="update_many"):
        t.update(scene((100, 80)))


@pytest.mark.parametrize("box", [(400, 10, 20, 20), (-50, 10, 20, 20), (10, 240, 20, 20)])
def test_a_box_outside_the_frame_is_refused(box: tuple[int, ...]):
    with pytest.raises(EntrackError, match="outside the 320×240 frame"):
        tracker().init(scene((0, 0)), box)


def test_a_box_partly_outside_is_clipped():
    t = tracker()
    t.init(scene((-20, 80)), (-20, 80, 40, 40))
    box = t.update(scene((-20, 80))).box
    assert iou(box, [0, 80, 20, 40]) > 0.8


def test_targets_take_turns_in_looking_at_other_sizes():
    class Counts(Averages):
        seen: list[int]

        def __call__(self, patches: np.ndarray) -> np.ndarray:
            self.seen.append(len(patches))
            return super().__call__(patches)

    trunk = Counts()
    config = Config(scale=ScaleConfig(every=3, factor=1.06), update=UpdateConfig(rate=0))
    t = Tracker(config, trunk)
    trunk.seen = []
    t.init_many(scene((100, 80)), [(100, 80, 40, 40), (110, 90, 30, 30)])
    t.add((105, 85, 35, 35))
    trunk.seen.clear()
    for k in range(1, 10):
        boxes = [e.box for e in t.update_many(scene((100, 80), 40 + k))]
    assert trunk.seen == [5] * 9  # one of three looks at three sizes
    assert boxes[0][2] > 42


@pytest.mark.parametrize(
    ("change", "passes"),
    [({}, 11), ({"every": 3}, 3), ({"seen": "shifted"}, 0)],  # the last frame's would come later
    ids=["exact", "every-third", "shifted"],
)
def test_updates_cost_passes_of_the_trunk(change: dict[str, object], passes: int):
    class Counts(Averages):
        patches = 0

        def __call__(self, patches: np.ndarray) -> np.ndarray:
            self.patches += len(patches)
            return super().__call__(patches)

    trunk = Counts()
    t = Tracker(Config(update=UpdateConfig(rate=0.05, **change)), trunk)  # type: ignore[arg-type]
    t.init(scene((100, 80)), (100, 80, 40, 40))
    for k in range(1, 13):
        box = t.update(scene((100 + 3 * k, 80))).box
    assert trunk.patches - 1 - 12 * t.config.scale.steps == passes
    assert iou(box, [136, 80, 40, 40]) > 0.8


def test_a_shifted_template_is_what_the_trunk_would_see_at_the_new_box():
    t = tracker(update=UpdateConfig(rate=1, seen="shifted"), scale=ScaleConfig(steps=1))
    t.init(scene((100, 80)), (100, 80, 40, 40))
    frame = scene((112, 87))
    t.update(frame)
    [target] = t._targets
    shifted = target.template.copy()
    t.teach(frame, target.box)
    error = np.linalg.norm(shifted - target.template) / np.linalg.norm(target.template)
    t.teach(frame, (100, 80, 40, 40))
    unshifted = np.linalg.norm(shifted - target.template) / np.linalg.norm(target.template)
    assert error < 0.3 < unshifted


def test_the_template_forgets_as_fast_when_it_learns_less_often():
    templates = []
    for every in (1, 4):
        t = tracker(update=UpdateConfig(rate=0.05, every=every))
        t.init(scene((100, 80)), (100, 80, 40, 40))
        other = scene((100, 80))[::-1].copy()
        first = t._targets[0].template.copy()
        for _ in range(9):
            t.update(other)
            t._targets[0].box = np.array([100.0, 80, 40, 40])
        templates.append(np.linalg.norm(t._targets[0].template - first))
    assert templates[0] == pytest.approx(templates[1], rel=0.15)


def test_init_again_starts_afresh():
    t = tracker()
    t.init(scene((100, 80)), (100, 80, 40, 40))
    t.update(scene((110, 80)))
    t.init(scene((200, 150)), (200, 150, 40, 40))
    assert iou(t.update(scene((203, 150))).box, [203, 150, 40, 40]) > 0.8


@pytest.mark.parametrize(
    "change",
    [
        lambda image: image,
        lambda image: cv2.cvtColor(image, cv2.COLOR_BGR2BGRA),
        lambda image: image.astype(np.uint16) << 8,
        lambda image: image.astype(np.float64) / 255,
        lambda image: np.asfortranarray(image),
    ],
    ids=["bgr", "bgra", "16-bit", "float", "fortran"],
)
def test_pictures_of_every_kind_give_the_same_box(change):
    t = tracker()
    t.init(change(scene((100, 80))), (100, 80, 40, 40))
    assert iou(t.update(change(scene((106, 82)))).box, [106, 82, 40, 40]) > 0.85


def test_a_change_of_resolution_midway_scales_the_box():
    t = tracker()
    t.init(scene((100, 80)), (100, 80, 40, 40))
    t.update(scene((102, 80)))
    box = t.update(scene((104, 80), shape=(480, 640))).box
    assert iou(box, [208, 160, 80, 80]) > 0.8


def test_target_that_leaves_and_comes_back_is_found_at_the_border():
    t = tracker(update=UpdateConfig(rate=0.01, min_score=0.5))
    t.init(scene((200, 100)), (200, 100, 40, 40))
    places = [200 + 6 * k for k in range(24)]
    for x in [*places, *reversed(places)]:
        estimate = t.update(scene((x, 100)))
        assert np.isfinite(estimate.box).all()
        centre = estimate.box[:2] + estimate.box[2:] / 2
        assert (0 <= centre).all() and (centre <= [320, 240]).all()
    assert iou(estimate.box, [200, 100, 40, 40]) > 0.5


@pytest.mark.parametrize(
    "box", [(150, 110, 4, 4), (150, 110, 16, 16), (0, 0, 320, 240), (0, 0, 1, 240)]
)
def test_targets_of_any_size_stay_finite(box: tuple[int, ...]):
    t = tracker()
    t.init(scene((100, 80)), box)
    for k in range(5):
        estimate = t.update(scene((100 + 5 * k, 80)))
        assert np.isfinite(estimate.box).all() and (estimate.box[2:] > 0).all()


@pytest.mark.parametrize("level", [0, 128, 255])
def test_featureless_frames_stay_finite(level: int):
    flat = np.full((240, 320, 3), level, np.uint8)
    t = tracker()
    t.init(flat, (100, 80, 40, 40))
    for _ in range(5):
        estimate = t.update(flat)
        assert np.isfinite(estimate.box).all() and np.isfinite(estimate.score)


def test_size_stays_within_the_limits():
    t = tracker()
    t.init(scene((100, 80)), (100, 80, 40, 40))
    rng = np.random.default_rng(0)
    for _ in range(150):
        box = t.update(rng.integers(0, 255, (240, 320, 3), dtype=np.uint8)).box
        assert (box[2:] >= 40 * 0.2 - 1e-6).all() and (box[2:] <= 40 * 5 + 1e-6).all()


def test_lost_and_found_again_with_hysteresis():
    t = tracker(update=UpdateConfig(rate=0.0))
    t.init(scene((140, 100)), (140, 100, 40, 40))
    assert not t.update(scene((140, 100))).lost
    hidden = [t.update(np.full((240, 320, 3), 90, np.uint8)) for _ in range(3)]
    assert all(e.lost and e.score < 0.2 for e in hidden)
    back = [t.update(scene((140, 100))) for _ in range(3)]
    assert not back[-1].lost


def test_same_input_same_output():
    def run() -> np.ndarray:
        t = tracker()
        t.init(scene((100, 80)), (100, 80, 40, 40))
        return np.array([t.update(scene((100 + 3 * k, 80))).box for k in range(1, 8)])

    np.testing.assert_array_equal(run(), run())


def test_looks_show_where_the_response_came_from():
    t = tracker(scale=ScaleConfig(steps=1))
    t.init(scene((100, 80)), (100, 80, 40, 40))
    assert t.looks == [None]
    estimate = t.update(scene((106, 80)))
    [look] = t.looks
    assert look is not None
    assert look.patch.shape == (288, 288, 3)
    assert look.features.shape == (7, 18, 18)
    cell = estimate.search[2] / 18
    found = np.unravel_index(look.response.argmax(), look.response.shape)
    assert abs((found[1] - 9) * cell - 6) < cell
    assert found[0] == 9
