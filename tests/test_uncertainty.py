"""Measures of whether a tracker knows when it is lost, against their definitions as slow loops."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from entrack.evaluation import uncertainty as un

TIED = st.sampled_from([0.0, 0.1, 0.25, 0.5, 0.5, 0.9, 1.0])
FRAMES = st.lists(st.tuples(TIED, st.floats(0, 1), st.booleans()), min_size=1, max_size=25)


def columns(frames):
    score, iou, present = (np.array(c) for c in zip(*frames, strict=True))
    return score, iou, present.astype(bool)


@settings(max_examples=80, deadline=None)
@given(FRAMES)
def test_precision_and_recall_are_their_definitions(frames):
    score, iou, present = columns(frames)
    at = np.array([np.inf, 0.95, 0.5, 0.2, 0.0, -np.inf])
    precision, recall = un.precision_recall(iou, present, score, at)
    for threshold, p, r in zip(at, precision, recall, strict=True):
        overlaps = [
            (i if here else 0.0)
            for s, i, here in zip(score, iou, present, strict=True)
            if s >= threshold
        ]
        assert p == pytest.approx(sum(overlaps) / len(overlaps) if overlaps else 1)
        assert r == pytest.approx(sum(overlaps) / max(present.sum(), 1))


def test_the_best_threshold_leaves_out_what_is_absent():
    # Two good frames, then two in which the target is gone: only those below .5.
    iou, present = [0.8, 0.8, 0.7, 0.7], [True, True, False, False]
    at = un.thresholds([0.9, 0.8, 0.3, 0.2])
    f = un.f_score(*un.precision_recall(iou, present, [0.9, 0.8, 0.3, 0.2], at))
    assert at[f.argmax()] == 0.8
    assert f.max() == pytest.approx(0.8)
    careless = un.f_score(*un.precision_recall(iou, present, np.ones(4), [1.0]))
    assert careless[0] == pytest.approx(2 * 0.4 * 0.8 / 1.2)


def test_many_scores_are_thinned_evenly_by_rank():
    scores = np.random.default_rng(0).permutation(np.linspace(0, 1, 5001) ** 4)
    at = un.thresholds(scores, 11)
    assert at == pytest.approx(np.linspace(1, 0, 11) ** 4)


@settings(max_examples=80, deadline=None)
@given(FRAMES, st.lists(st.integers(0, 3), min_size=25, max_size=25))
def test_the_area_is_the_chance_that_a_good_frame_scores_higher(frames, weights):
    score, _, good = columns(frames)
    w = np.array(weights[: len(score)])
    wins, pairs = 0.0, 0
    for i in np.flatnonzero(good):
        for j in np.flatnonzero(~good):
            both = w[i] * w[j]
            pairs += both
            wins += both * ((score[i] > score[j]) + 0.5 * (score[i] == score[j]))
    found = un.area(*un.roc(score, good, w))
    assert np.isnan(found) if pairs == 0 else found == pytest.approx(wins / pairs)


def test_a_roc_curve_runs_from_corner_to_corner():
    false, true = un.roc([0.9, 0.8, 0.8, 0.1], [True, True, False, False])
    assert false.tolist() == [0, 0, 0.5, 1]
    assert true.tolist() == [0, 0.5, 1, 1]


@settings(max_examples=60, deadline=None)
@given(FRAMES)
def test_the_calibration_error_is_its_definition(frames):
    score, _, event = columns(frames)
    expected = 0.0
    for b in range(15):
        inside = [
            k for k, s in enumerate(score) if b / 15 <= s < (b + 1) / 15 or (s == 1 and b == 14)
        ]
        if inside:
            gap = abs(np.mean(score[inside]) - np.mean(event[inside]))
            expected += len(inside) / len(score) * gap
    assert un.calibration_error(un.calibration(score, event)) == pytest.approx(expected)


def test_an_honest_score_is_calibrated_and_a_boastful_one_is_not():
    rng = np.random.default_rng(0)
    chance = rng.uniform(0, 1, 20_000)
    event = rng.uniform(0, 1, 20_000) < chance
    assert un.calibration_error(un.calibration(chance, event)) < 0.02
    assert un.calibration_error(un.calibration(np.sqrt(chance), event)) > 0.1
    assert np.isnan(un.calibration_error(un.calibration([], [])))


def test_one_sigma_of_gaussian_sides_covers_two_thirds():
    rng = np.random.default_rng(0)
    corners = np.array([50.0, 60, 90, 130]) + rng.normal(0, 1, (5000, 4)) * [1, 2, 3, 4]
    boxes = np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1)
    truth = np.tile([50.0, 60, 40, 70], (5000, 1))
    inside = un.covered(truth, boxes, np.tile([1.0, 2, 3, 4], (5000, 1)))
    assert inside.mean(axis=0) == pytest.approx(np.full(4, 0.683), abs=0.02)
    assert not un.covered(truth, boxes, np.full((5000, 4), np.nan)).any()


def seen(*runs):
    """Alternate runs of seen and unseen frames, seen ones first."""
    return np.concatenate([np.full(n, k % 2 == 0) for k, n in enumerate(runs)])


@pytest.mark.parametrize(
    ("runs", "expected"),
    [
        ((50,), []),
        ((5, 10, 30), [15]),
        ((5, 9, 30), []),  # too short to be a test
        ((5, 10, 29), []),  # too little to see afterwards
        ((0, 20, 40), []),  # never seen before
        ((5, 20), []),  # never seen again
        ((5, 6, 4, 6, 30), [21]),  # a glimpse in between
        ((5, 6, 5, 6, 30), []),  # two short absences
        ((5, 12, 30, 12, 35), [17, 59]),
        ((5, 12, 20, 12, 35), [49]),
    ],
)
def test_which_returns_are_a_test(runs, expected):
    assert un.returns(seen(*runs)) == expected


def test_found_again_counts_returns_by_frames_it_took():
    present = seen(5, 12, 40, 12, 40)
    iou = np.zeros(len(present))
    iou[17 + 3] = 0.6  # in the fourth frame, and lost again
    iou[69 + 10 :] = 0.5  # not more than a half
    found = un.found_again(iou, present)
    assert found.tolist() == [0] * 3 + [1] * 27
    iou[69 + 29] = 0.51
    assert un.found_again(iou, present)[-2:].tolist() == [1, 2]
    assert un.found_again(np.ones(len(present)), present)[0] == 2
