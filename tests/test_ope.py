"""One-pass scores against slow loops and cases counted by hand."""

import numpy as np
import pytest

from entrack.evaluation import ope


def slow_iou(a, b):
    width = max(0.0, min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0]))
    height = max(0.0, min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1]))
    shared = width * height
    return shared / (a[2] * a[3] + b[2] * b[3] - shared)


@pytest.fixture
def boxes():
    random = np.random.default_rng(3)
    truth = np.c_[random.uniform(0, 50, (200, 2)), random.uniform(5, 40, (200, 2))]
    return truth, truth + random.normal(0, 4, (200, 4)).round()


def test_curves_equal_slow_loops(boxes):
    truth, predicted = boxes
    iou = [slow_iou(t, p) for t, p in zip(truth, predicted, strict=True)]
    success = [sum(i > k * 0.05 for i in iou) / 200 for k in range(21)]
    np.testing.assert_allclose(ope.success_curve(ope.overlaps(truth, predicted)), success)

    def centre(b):
        return b[0] + (b[2] - 1) / 2, b[1] + (b[3] - 1) / 2

    pixels, relative = [], []
    for t, p in zip(truth, predicted, strict=True):
        (tx, ty), (px, py) = centre(t), centre(p)
        pixels.append(((tx - px) ** 2 + (ty - py) ** 2) ** 0.5)
        relative.append((((tx - px) / t[2]) ** 2 + ((ty - py) / t[3]) ** 2) ** 0.5)
    precision = [sum(d <= k for d in pixels) / 200 for k in range(51)]
    normalised = [sum(d <= k / 100 for d in relative) / 200 for k in range(51)]
    errors = ope.centre_errors(truth, predicted)
    np.testing.assert_allclose(ope.precision_curve(errors), precision)
    errors = ope.norm_errors(truth, predicted)
    np.testing.assert_allclose(ope.norm_precision_curve(errors), normalised)


def test_success_is_strict_and_precision_is_not():
    truth = [[0.0, 0, 10, 10]]
    half = [[0.0, 0, 10, 5]]  # IoU exactly .5
    assert ope.success_curve(ope.overlaps(truth, half))[10] == 0
    twenty = [[12.0, 16, 10, 10]]  # exactly 20 px away
    assert ope.precision_curve(ope.centre_errors(truth, twenty))[20] == 1


def test_a_perfect_tracker_misses_the_threshold_one(boxes):
    truth = boxes[0].round(1)
    assert ope.auc(ope.success_curve(ope.overlaps(truth, truth))) == pytest.approx(20 / 21)


@pytest.mark.parametrize("bad", [[0, 0, 0, 0], [5, 5, 10, -1], [np.nan] * 4])
def test_invalid_truth_is_a_failure_in_success_and_the_protocols_choice_in_precision(bad):
    truth, predicted = [[0.0, 0, 10, 10], bad], [[0.0, 0, 10, 10], [0.0, 0, 10, 10]]
    assert ope.overlaps(truth, predicted).tolist() == [1, -1]
    assert ope.precision_curve(ope.centre_errors(truth, predicted))[20] == 0.5
    assert ope.precision_curve(ope.centre_errors(truth, predicted, -1))[20] == 1
    assert ope.norm_precision_curve(ope.norm_errors(truth, predicted, -1))[20] == 1


@pytest.mark.parametrize("bad", [[np.nan] * 4, [3, 3, -2, 5], [3, 3, 0, 0], [np.inf, 3, 1, 1]])
def test_an_invalid_prediction_repeats_the_one_before(bad):
    truth = np.tile([0.0, 0, 10, 10], (4, 1))
    predicted = [[0, 0, 10, 10], [5, 0, 10, 10], bad, bad]
    repaired = ope.repair(truth, predicted)
    assert repaired[2:].tolist() == [[5, 0, 10, 10]] * 2
    assert np.isfinite(ope.overlaps(truth, repaired)).all()


def test_frames_are_the_denominator_where_given():
    assert ope.success_curve([1.0, 1.0], [0.5], frames=4).tolist() == [0.5]
    assert ope.precision_curve([0.0], [20], frames=4).tolist() == [0.25]


def test_got10k_clips_corner_then_size():
    # Published rule: a box that sticks out by 5 on the left is moved, not cut.
    assert ope.clipped_overlaps([[0, 0, 10, 10]], [[-5, 0, 10, 10]], (50, 50)) == 1
    assert ope.clipped_overlaps([[45, 0, 10, 10]], [[45, 0, 5, 10]], (50, 50)) == 1
    assert ope.clipped_overlaps([[45, 0, 10, 10]], [[45, 0, 5, 10]]) == 0.5
    assert ope.clipped_overlaps([[0, 0, 10, 10]], [[np.nan] * 4], (50, 50)) == 0
