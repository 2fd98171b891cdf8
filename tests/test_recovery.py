"""What the tracker does in doubt: it holds, searches, finds again, and lets look-alikes be."""

from dataclasses import replace

import numpy as np
import pytest

from entrack import box as boxes
from entrack import filter as cf
from entrack import load
from entrack.box import iou
from entrack.config import (
    ColourConfig,
    Config,
    RecoveryConfig,
    ScaleConfig,
    ScoreConfig,
    UpdateConfig,
    Weights,
    WindowConfig,
    parse,
)
from entrack.errors import EntrackError
from entrack.recovery import Past, Search, likeliest
from entrack.tracker import Estimate, Tracker
from entrack.window import around
from test_tracker import Averages, scene

GROUND = scene((-500, -500))
START = (60, 100, 40, 40)
SURE = Config(
    score=ScoreConfig(bias=-9, first=10, same=10, lost=-3),
    update=UpdateConfig(rate=0.02, min_score=0.5),
    recovery=RecoveryConfig(patience=1),
)


def started(config: Config = SURE) -> Tracker:
    t = Tracker(config, Averages())
    t.init(scene(START[:2]), START)
    for _ in range(3):
        assert not t.update(scene(START[:2])).lost
    return t


def test_a_hidden_target_is_held_reported_lost_and_found_where_it_comes_back():
    t = started()
    held = t.boxes[0]
    hidden = [t.update(GROUND) for _ in range(20)]
    assert all(e.lost and e.score < 0.1 for e in hidden[1:])
    assert all(np.array_equal(e.box, held) for e in hidden[1:])
    back = [t.update(scene((190, 100))) for _ in range(12)]
    assert iou(back[-1].box, (190, 100, 40, 40)) > 0.7
    assert not back[-1].lost and back[-1].score > 0.5


def test_without_recovery_it_stays_where_it_lost_the_target():
    t = started(replace(SURE, recovery=None))
    for _ in range(20):
        assert t.update(GROUND).lost
    for _ in range(12):
        far = t.update(scene((190, 100)))
    assert far.lost and iou(far.box, (190, 100, 40, 40)) == 0


def test_the_search_window_grows_while_lost_and_shrinks_when_found():
    t = started()
    usual = t.update(scene(START[:2])).search[2]
    grown = [t.update(GROUND).search[2] for _ in range(30)]
    assert grown[0] == usual
    assert grown[29] > grown[15] > usual
    for _ in range(4):
        found = t.update(scene(START[:2]))
    assert found.search[2] == pytest.approx(usual, rel=0.1)


class Counts(Averages):
    """Remembers how many patches it saw at once."""

    most = 0

    def __call__(self, patches: np.ndarray) -> np.ndarray:
        self.most = max(self.most, len(patches))
        return super().__call__(patches)


def test_looks_are_bounded():
    trunk = Counts()
    config = replace(SURE, recovery=RecoveryConfig(looks=3, patience=1))
    t = Tracker(config, trunk)
    t.init(scene(START[:2]), START)
    t.update(scene(START[:2]))
    trunk.most = 0
    for _ in range(40):
        t.update(GROUND)
    assert trunk.most == 3 + 2 + 3  # three sizes, the box that is held, where it was, three places


def test_nothing_is_learned_while_lost():
    t = started(replace(SURE, update=UpdateConfig(rate=0.5, min_score=0.0)))
    t.update(GROUND)
    t.update(GROUND)
    before = t._targets[0].template.copy()
    for _ in range(5):
        assert t.update(GROUND).lost
    np.testing.assert_array_equal(t._targets[0].template, before)


def test_the_ground_of_the_first_frame_is_not_the_target():
    t = started()
    places = [60 + 5 * k for k in range(30)]
    for x in places:
        t.update(scene((x, 100)))
    assert iou(t.boxes[0], (places[-1], 100, 40, 40)) > 0.6
    for _ in range(25):
        estimate = t.update(GROUND)
    assert estimate.lost and iou(estimate.box, START) == 0


HELD = np.array([100.0, 100, 40, 40])


def search(**values: object) -> Search:
    config = RecoveryConfig(**({"patience": 1} | values))  # type: ignore[arg-type]
    return Search(HELD, config)


@pytest.mark.parametrize(("jump", "held"), [(0.3, True), (1.0, False)])
def test_a_stronger_likeness_elsewhere_is_not_jumped_to(jump: float, held: bool):
    window = around((100, 100, 40, 40), WindowConfig())
    found = search(jump=jump, leeway=0.3)
    response = 0.5 * cf.label(18, 0.7) + 0.7 * np.roll(cf.label(18, 0.7), 5, axis=1)
    peak = cf.peak(response, found.likely(found.held, window, 18))
    assert (abs(peak.dx) < 0.5) == held
    assert peak.height == pytest.approx(0.5 if held else 0.7, abs=0.05)


def test_a_target_that_moves_as_expected_is_not_doubted():
    window = around((100, 100, 40, 40), WindowConfig())
    moving = search()
    for _ in range(20):
        moving.follow(np.array([20.0, 0]), size=40)  # 3 cells
    weights = moving.likely(moving.held, window, 18)
    assert weights is not None
    assert np.unravel_index(weights.argmax(), weights.shape) == (9, 12)
    assert weights.max() == pytest.approx(1)


def test_the_likeliest_place_is_the_highest_peak_over_its_ground():
    windows = [around((x, 100, 40, 40), WindowConfig()) for x in (100, 300)]
    responses = np.stack([0.9 + 0 * cf.label(18, 0.7), np.roll(cf.label(18, 0.7), 3, axis=0)])
    box = likeliest(responses, windows, np.array([30.0, 50]), (640, 480))
    np.testing.assert_allclose(boxes.centre(box), [320, 140], atol=0.1)
    assert box[2:].tolist() == [30, 50]


def test_the_likeliest_place_is_in_the_picture():
    """Beyond its border every window shows the same, and a challenger would leave for ever."""
    window = around((290, 10, 40, 40), WindowConfig())  # 120 pixels, 6.7 a cell, about (310, 30)
    peak = cf.label(18, 0.7)
    above, right, inside = (np.roll(peak, move, (0, 1)) for move in ((-8, 0), (0, 5), (2, -3)))
    responses = (above + 0.8 * right + 0.5 * inside)[None]
    found = [
        boxes.centre(likeliest(responses, [window], np.array([30.0, 30]), frame)).tolist()
        for frame in ((640, 480), (320, 240))
    ]
    np.testing.assert_allclose(found, [[343.3, 30], [290, 43.3]], atol=0.5)


def test_places_are_inside_the_picture_and_all_are_seen_in_turn():
    lost = search(looks=4, growth=1)
    for _ in range(10):
        lost.decide(0.0, HELD, ScoreConfig())
    seen = [lost.places((320, 240)) for _ in range(12)]
    assert all(len(places) == 4 + 2 for places in seen)
    centres = np.array([boxes.centre(box) for places in seen for box in places])
    assert (centres >= -26).all() and (centres <= [346, 266]).all()
    assert np.hypot(*(centres - [120, 120]).T).max() > 150
    assert len(np.unique(centres, axis=0)) > 30


def test_it_also_looks_where_the_target_was_lost():
    lost, left = search(looks=1), HELD + np.array([70.0, 0, 0, 0])
    lost.decide(0.0, left, ScoreConfig())
    lost.decide(0.0, HELD, ScoreConfig())
    assert [place.tolist() for place in lost.places((320, 240))][-1] == left.tolist()


def test_a_target_that_was_long_followed_without_being_sure_is_searched_further_away():
    at_once, late = search(growth=0.1), search(growth=0.1)
    for _ in range(10):
        late.decide(0.3, HELD, ScoreConfig())
        late.sure(HELD, 0.3)
    for lost in (at_once, late):
        lost.decide(0.0, HELD, ScoreConfig())
    assert (at_once.radius, late.radius) == pytest.approx((0.1 * 40, 1.1 * 40))
    late.sure(HELD, 0.9)
    assert late.radius == 0


def test_a_box_that_is_only_off_is_lost_and_not_searched():
    target = search(patience=1)
    target.decide(0.0, HELD, ScoreConfig(), known=0.6)
    assert target.lost and not target.active


def test_a_doubt_that_passes_starts_no_search():
    target, searched = search(patience=3), []
    for score in (0.0, 0.0, 0.3, 0.0, 0.0, 0.0):
        target.decide(score, HELD, ScoreConfig())
        searched.append(target.active)
    assert searched == [False] * 5 + [True]


COMPARES = Config(
    score=ScoreConfig(bias=4.0, unseen=-4.0, swap=-3.0, lost=-6.0),
    colour=ColourConfig(power=0),
    recovery=RecoveryConfig(glances=2),
    scale=ScaleConfig(steps=1),
)
"""Sure of whatever looks like the target, unless it has leapt and has another tint."""


def two(target: tuple[float, float] | None, other: tuple[float, float]) -> np.ndarray:
    """The target, and one that looks like it in another tint."""
    like = scene(other)
    x, y = (int(v) for v in other)
    like[y : y + 40, x : x + 40] = (like[y : y + 40, x : x + 40] * [0.7, 0.9, 1.0]).astype(np.uint8)
    if target:
        x, y = (int(v) for v in target)
        like[y : y + 40, x : x + 40] = scene(target)[y : y + 40, x : x + 40]
    return like


def over_at_another(config: Config, target: tuple[float, float]) -> list[Estimate]:
    """Go over to another that takes the target's place, while the target comes back elsewhere."""
    t = Tracker(config, Averages())
    t.init(scene((60, 100)), (60, 100, 40, 40))
    for _ in range(40):
        assert t.update(scene((60, 100))).score > 0.9
    t.update(two(None, (80, 100)))
    return [t.update(two(target, (80, 100))) for _ in range(25)]


def test_looks_are_bounded_while_the_target_is_doubted():
    trunk = Counts()
    t = Tracker(replace(COMPARES, score=ScoreConfig(bias=-1.0, lost=-6.0)), trunk)
    t.init(scene((60, 100)), (60, 100, 40, 40))
    for _ in range(40):
        assert not t.update(scene((60, 100))).score > 0.5
    assert trunk.most == 2 + 2 + 1  # X' and one size, two places, a challenger


@pytest.mark.parametrize("target", [(130, 100), (190, 40)], ids=["in the window", "beyond it"])
def test_who_has_the_target_s_tint_is_followed_instead_of_another(target: tuple[float, float]):
    estimates = over_at_another(COMPARES, target)
    right = [bool(iou(e.box, (*target, 40, 40)) > 0.7) for e in estimates]
    assert right[-1] and not right[0] and sorted(right) == right
    assert max(e.search[2] for e in estimates) > 1.1 * estimates[0].search[2]
    kept = over_at_another(replace(COMPARES, recovery=RecoveryConfig()), target)
    assert all(iou(e.box, (80, 100, 40, 40)) > 0.7 for e in kept)


def test_one_of_the_same_tint_is_not_gone_over_to_while_the_target_is_half_hidden():
    both = np.maximum(scene((60, 100)), scene((150, 100)))
    hidden = both.copy()
    hidden[122:145, 55:105] = GROUND[122:145, 55:105]
    score = ScoreConfig(bias=-5.0, first=7.0, swap=-0.1, lost=-6.0)
    t = Tracker(replace(COMPARES, score=score), Averages())
    t.init(both, (60, 100, 40, 40))
    for _ in range(35):
        assert t.update(both).score > 0.5
    doubted = [t.update(hidden) for _ in range(30)]
    assert all(0.1 < e.score < 0.5 for e in doubted)
    assert all(iou(e.box, (60, 100, 40, 40)) > 0.6 for e in doubted)


def test_a_score_that_falls_is_doubted_and_one_that_is_modest_for_ever_is_not_for_long():
    followed = search(glances=2, patience=3, sure_above=0.5, wary_below=0.75)

    def doubted(score: float, frames: int) -> list[bool]:
        states: list[bool] = []
        for _ in range(frames):
            followed.sure(HELD, score)
            states.append(followed.doubting)
            assert bool(followed.places((640, 360))) == followed.doubting
            assert (followed.area(HELD)[2] > HELD[2]) == followed.doubting
        return states

    assert not any(doubted(0.9, 60))
    fallen = doubted(0.65, 150)
    assert fallen[:10] == [False] * 2 + [True] * 8 and not any(fallen[100:])
    assert doubted(0.45, 60)[2:] == [True] * 58  # not sure of it at all
    assert not any(doubted(0.65, 20))
    assert not any(doubted(0.9, 60)) and any(doubted(0.65, 3))


def test_a_challenger_has_to_lead_for_several_frames_in_a_row():
    doubted = search(glances=2, wins=3, lead=0.5)
    won = [doubted.compare(HELD, lead) for lead in (1.0, 1.0, 0.4, 1.0, 1.0, 1.0)]
    assert won == [False] * 5 + [True]


def test_who_has_gone_over_to_another_compares_on_for_a_while():
    doubted = search(glances=2, wins=1, watch=5, patience=2)
    for _ in range(2):
        doubted.sure(HELD, 0.6)
    doubted.usual = 0.6
    assert doubted.doubting and doubted.compare(HELD, lead=1.0)
    doubted.restart(HELD)
    doubting: list[bool] = []
    for _ in range(7):
        doubted.sure(HELD, 0.95)
        doubting.append(doubted.doubting)
    assert doubting == [True] * 4 + [False] * 3


def test_comparing_needs_colours():
    with pytest.raises(EntrackError, match=r"glances compares tints: add \[colour\]"):
        parse(Config, {"recovery": {"glances": 1}}, "mine.toml")


def test_a_glimpse_does_not_count_as_found():
    lost = search(confirm=3)
    lost.decide(0.0, HELD, ScoreConfig())
    states = []
    for found in (True, True, False, True, True, True):
        lost.decide(float(found), HELD, ScoreConfig())
        states.append(lost.lost)
    assert states == [True, True, True, True, True, False]


def test_it_says_lost_long_before_it_searches_and_a_search_is_lost_until_its_find_is_sure():
    limits = ScoreConfig(lost_below=0.3, found_above=0.45)
    target, states = search(below=0.1, found_above=0.2, confirm=1), []
    for score in (0.4, 0.25, 0.35, 0.05, 0.15, 0.25, 0.5):
        target.decide(score, HELD, limits)
        states.append((target.lost, target.active))
    lost, searched = (False, True, True, True, True, True, False), (3, 4)
    assert states == [(flag, k in searched) for k, flag in enumerate(lost)]


def test_a_model_with_a_spread_knows_sigma_without_a_policy():
    t = started(replace(SURE, spread=Weights(bias=-3, first=-1)))
    sure = t.update(scene(START[:2])).sigma
    assert sure is not None and sure.shape == (4,)
    assert (0 < sure).all() and (sure < 0.06 * 40).all()
    unsure = t.update(GROUND).sigma
    assert unsure is not None and (unsure > sure).all()


def test_a_change_of_resolution_while_lost_scales_what_is_held():
    t = started()
    for _ in range(3):
        t.update(GROUND)
    large = t.update(np.repeat(np.repeat(GROUND, 2, 0), 2, 1))
    np.testing.assert_allclose(large.box, 2 * np.array(START), atol=6)


def test_a_leap_lowers_the_score_for_long():
    doubts = replace(SURE.score, bias=-34, leap=-3.0)
    t = started(Config(score=doubts))
    sure = t.update(scene(START[:2])).score
    there = scene((START[0] + 24, START[1]))
    after = [t.update(there) for _ in range(30)]
    assert iou(after[-1].box, (START[0] + 24, START[1], 40, 40)) > 0.8
    assert sure > 0.95 > 0.5 > after[0].score
    assert after[0].score < after[-1].score < sure


def test_a_search_undoes_a_leap_and_is_one_itself_where_it_finds_something():
    there = np.array(START, float)
    found = search()
    found.sure(there, 1.0)
    found.follow(np.array([40.0, 30.0]), size=40, rival=0.8)
    assert found.past.leap == pytest.approx(0.8)
    found.restart(None)
    assert found.past.leap == 0
    found.restart(there + np.array([30, 0, 0, 0]))
    found.follow(np.zeros(2), size=40, rival=0.6)
    assert found.past.leap == pytest.approx(0.6 * 30 / 40)


def test_a_leap_is_relative_to_the_usual_motion():
    search = Search(np.array(START, float), None)
    for _ in range(20):
        search.follow(np.array([10.0, 0.0]), size=40)
    assert search.past.leap == pytest.approx(0.25 * 0.99**19)


def test_a_leap_is_off_what_was_in_the_box_where_that_is_known():
    search = Search(np.array(START, float), None)
    search.follow(np.array([20.0, 0.0]), size=40, rival=0.5, slip=0.0)
    assert search.past.leap == 0 and search.past.unrest == pytest.approx(0.05)
    search.follow(np.zeros(2), size=40, rival=0.5, slip=0.08)
    assert search.past.leap == pytest.approx(0.04)


def test_a_picture_that_is_pushed_is_no_leap_and_a_box_that_is_laid_beside_its_target_is():
    rng = np.random.default_rng(0)
    wide = rng.integers(0, 255, (30, 50, 3), np.uint8).repeat(8, 0).repeat(8, 1)
    pushed, t = [wide[:, k : k + 320].copy() for k in (0, 0, 8, 2)], load("default", threads=1)
    t.init(pushed[0], (140, 100, 40, 40))
    for frame in pushed[1:]:
        t.update(frame)
    [target] = t._targets
    still, steps = target.search.past.leap, target.search.past.unrest
    assert still < 0.03 and steps > 0.02
    t.observe(pushed[-1])
    t.move([0.3, 0, 0.3, 0])
    assert target.search.past.leap > 4 * still
    target.restart(None)
    assert target.parts is None
    t.update(pushed[-1])
    assert target.parts is not None


def test_a_target_that_leaps_in_every_frame_is_restless():
    restless, leaps_once = (Search(np.array(START, float), None) for _ in range(2))
    for k in range(40):
        restless.follow(np.array([10.0 * (-1) ** k, 0.0]), size=40)
        leaps_once.follow(np.array([10.0 * (k == 20), 0.0]), size=40)
    assert 0.2 < restless.past.unrest < 0.5
    assert restless.past.evidence["unrest"] == 0.2  # the most that counts
    assert leaps_once.past.unrest < 0.02


def test_leaps_count_up_to_a_tenth_of_a_size():
    small, large, larger = (Past(leap=leap).evidence["leap"] for leap in (0.05, 0.1, 1.0))
    assert small < large == larger


def test_the_shipped_models_say_lost_at_once_when_the_picture_is_black():
    frame = np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8)
    for name in ("default", "longterm"):
        t = load(name, threads=1)
        t.init(frame, (140, 100, 40, 40))
        assert not t.update(frame).lost
        assert t.update(np.zeros_like(frame)).lost
