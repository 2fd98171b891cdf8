"""The colours of a target, and how M is weighed by them."""

from dataclasses import replace

import numpy as np
import pytest

from entrack.colour import LEAST, SLOW, SURE, YOUNG, Colours, Seen
from entrack.config import ColourConfig, Config, RecoveryConfig, UpdateConfig
from entrack.recovery import Past
from entrack.tracker import Tracker
from test_tracker import Averages

RED, BLUE, GREY = (30, 30, 220), (220, 30, 30), (120, 120, 120)
ROI = np.array([0.4, 0.4, 0.2, 0.2])
N = 18


def patch(*squares, size: int = 288, ground=GREY):
    """A window of one colour, with squares of a fifth of its side at (x, y), in shares of it."""
    picture = np.full((size, size, 3), ground, np.uint8)
    side = size // 5
    for (x, y), colour in squares:
        left, top = round(x * size) - side // 2, round(y * size) - side // 2
        picture[max(top, 0) : top + side, max(left, 0) : left + side] = colour
    return picture


def started(picture, config: ColourConfig) -> Colours:
    return Colours.of(picture, ROI, config)


@pytest.mark.parametrize("bins", [8, 16, 32])
def test_a_twin_in_blue_counts_less(bins: int):
    colours = started(patch(((0.5, 0.5), RED)), ColourConfig(bins=bins))
    seen = patch(((0.5 + 4 / N, 0.5), RED), ((0.5 - 4 / N, 0.5), BLUE))

    weighed = colours.weigh(np.ones((N, N), np.float32), seen, ROI[2:])

    assert weighed.dtype == np.float32
    assert weighed[N // 2, N // 2 + 4] == weighed.max() == pytest.approx(1)
    assert weighed[N // 2, N // 2 - 4] < 0.15


def test_colours_that_tell_nothing_change_nothing():
    colours = started(patch(), ColourConfig())
    response = np.random.default_rng(0).normal(size=(N, N)).astype(np.float32)

    weighed = colours.weigh(response, patch(), ROI[2:])

    np.testing.assert_allclose(weighed, response, rtol=1e-5)


def test_where_the_colours_are_not_seen_at_all_nothing_changes_either():
    colours = started(patch(((0.5, 0.5), RED)), ColourConfig())
    response = np.ones((N, N), np.float32)

    weighed = colours.weigh(response, patch(((0.3, 0.5), BLUE)), ROI[2:])

    np.testing.assert_allclose(weighed, response, rtol=1e-5)


def test_the_change_grows_with_the_share_of_another_colour():
    colours = started(patch(((0.5, 0.5), RED)), ColourConfig())

    def change(*squares) -> float:
        return colours.change(Seen.of(patch(*squares), ROI, 16))

    assert change(((0.5, 0.5), RED)) == pytest.approx(np.log(LEAST), abs=1e-4)
    assert change(((0.5, 0.5), BLUE)) == pytest.approx(np.log(LEAST + 1))
    assert -3 < change(((0.5, 0.5), BLUE), ((0.6, 0.5), RED)) < -0.3


def test_a_box_outside_the_window_has_no_colours():
    seen = Seen.of(patch(), np.array([2, 2, 0.2, 0.2]), 16)

    assert seen.inside.sum() == 0
    assert seen.around.sum() == pytest.approx(1)


def test_the_mean_follows_slowly_and_the_first_stays():
    colours = started(patch(((0.5, 0.5), RED)), ColourConfig(rate=0.25))
    blue = Seen.of(patch(((0.5, 0.5), BLUE)), ROI, 16)

    later = colours.learn(blue, score=1.0)

    np.testing.assert_array_equal(later.first, colours.first)
    np.testing.assert_allclose(later.mean.inside, 0.75 * colours.first + 0.25 * blue.inside)


def test_a_tint_is_strange_by_how_much_it_varied_in_the_first_frames():
    def strange(variation: int, frames: int) -> float:
        red = [patch(((0.5, 0.5), (40, 40, 200 - variation * (k % 2)))) for k in range(frames)]
        colours = started(red[0], ColourConfig())
        for picture in red[1:]:
            colours = colours.learn(colours.see(picture, ROI), score=0.0)
        darker, other = (
            colours.strange(colours.see(patch(((0.5, 0.5), colour)), ROI))
            for colour in ((20, 20, 100), (60, 40, 200))
        )
        assert darker < other  # the light's strength counts little
        return other

    assert 1 > strange(0, 20) > strange(40, 20) + 0.1
    assert strange(0, YOUNG) == pytest.approx(strange(0, YOUNG + 20), abs=1e-6)


def test_the_tint_is_what_most_of_a_box_has_whatever_covers_the_rest():
    colours = started(patch(((0.5, 0.5), RED)), ColourConfig())
    half_hidden = patch(((0.5, 0.5), RED), ((0.57, 0.5), (90, 30, 220)))
    another = patch(((0.5, 0.5), (33, 30, 220)))

    assert colours.strange(colours.see(half_hidden, ROI)) == 0
    assert colours.strange(colours.see(another, ROI)) > 0.5


def test_after_the_first_frames_only_a_sure_tint_is_learned_and_slowly():
    colours = started(patch(((0.5, 0.5), RED)), ColourConfig())
    colours = replace(colours, frames=YOUNG)
    blue = colours.see(patch(((0.5, 0.5), BLUE)), ROI)

    assert colours.learn(blue, SURE - 0.01).mean.tint == pytest.approx(colours.mean.tint)
    later = colours.learn(blue, SURE)
    assert later.mean.tint == pytest.approx((1 - SLOW) * colours.mean.tint + SLOW * blue.tint)
    assert later.spread == colours.spread


def test_a_tint_of_another_counts_only_after_a_leap():
    assert Past().swap(0.9) == 0
    assert Past(leap=0.05).swap(0.9) > Past(leap=0.05).swap(0.5) > Past(leap=0.05).swap(0.0) == 0
    assert Past(leap=1.0).swap(0.9) == Past(leap=0.1).swap(0.9)


def test_nothing_is_learned_while_the_tracker_is_unsure():
    config = Config(
        update=UpdateConfig(min_score=1.0), colour=ColourConfig(), recovery=RecoveryConfig(below=0)
    )
    tracker = Tracker(config, Averages())
    frames = [patch(((0.5, 0.5), colour)) for colour in (RED, BLUE)]
    learned = []
    for least in (1.0, 0.0):
        tracker.config = replace(config, update=UpdateConfig(min_score=least))
        tracker.init(frames[0], 288 * ROI)
        before = tracker._targets[0].colours
        tracker.update(frames[1])
        learned.append(tracker._targets[0].colours is not before)
        look = tracker.looks[0]
        assert look is not None and "colour" in look.evidence

    assert learned == [False, True]
