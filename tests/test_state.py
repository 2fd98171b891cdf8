"""f1, f2 and s: eqs. 4–6."""

import numpy as np
import pytest

from entrack.state import (
    Conditioned,
    Linear,
    State,
    _convolve,
    f2,
    held,
    sample_box,
    sample_boxes,
    sample_grid,
)
from entrack.window import Window

RNG = np.random.default_rng(0)


def test_f2_is_the_papers_enlargement_and_pooling():
    """Row 7: 18 × 18 → 288 × 288 → mean of 4 × 4 → 72 × 72, directly."""
    m = RNG.normal(size=(18, 18)).astype(np.float32)
    big = np.empty((288, 288))
    for p in range(288):
        for q in range(288):
            y, x = (p + 0.5) / 16, (q + 0.5) / 16  # circular, cell 9 in the middle
            i, j, a, b = int(y), int(x), y % 1, x % 1
            cells = m[np.ix_([i % 18, (i + 1) % 18], [j % 18, (j + 1) % 18])]
            big[p, q] = np.array([1 - a, a]) @ cells @ np.array([1 - b, b])
    pooled = big.reshape(72, 4, 72, 4).mean((1, 3))
    np.testing.assert_allclose(f2(m, 72), pooled.ravel(), atol=1e-5)


def test_a_target_that_has_not_moved_peaks_in_the_middle_of_m():
    m = np.zeros((18, 18), np.float32)
    m[9, 9] = 1
    pooled = f2(m, 72).reshape(72, 72)
    np.testing.assert_allclose(pooled, pooled[::-1, ::-1], atol=1e-6)


def test_the_papers_dimensions():
    """§3.2.8: z 324, m 5184, s 5508."""
    f1 = Linear({"f1.weight": np.ones((1, 256), np.float32), "f1.bias": np.zeros(1, np.float32)})
    z = f1(np.ones((256, 18, 18), np.float32), np.zeros((18, 18)), np.zeros(4), None)
    state = State(z, f2(np.zeros((18, 18), np.float32), 72), np.zeros(4, np.float32))
    assert z.size == 324
    assert state.m.size == 5184
    assert state.z.size + state.m.size == 5508
    assert np.allclose(z, 256)


def test_convolution_equals_a_slow_loop():
    x = RNG.normal(size=(3, 5, 5)).astype(np.float32)
    kernel = RNG.normal(size=(2, 3, 3, 3)).astype(np.float32)  # out, in, row, column
    bias = RNG.normal(size=2).astype(np.float32)
    slow = np.zeros((2, 5, 5))
    for o in range(2):
        for i in range(5):
            for j in range(5):
                for k in range(3):
                    for u in range(3):
                        for v in range(3):
                            if 0 <= i + u - 1 < 5 and 0 <= j + v - 1 < 5:
                                slow[o, i, j] += kernel[o, k, u, v] * x[k, i + u - 1, j + v - 1]
                slow[o, i, j] += bias[o]
    fast = _convolve(x, kernel.transpose(0, 2, 3, 1).reshape(2, -1), bias)
    np.testing.assert_allclose(fast.reshape(2, 5, 5), slow, atol=1e-5)


def test_grid_samples_the_box_and_a_ring_around_it():
    """A feature that says where it is: points come from the centres of 8 × 8 bins."""
    along = (np.arange(18, dtype=np.float32) + 0.5) / 18
    z = np.stack([np.tile(along, (18, 1)), np.tile(along[:, None], (1, 18))])
    points = sample_grid(z, np.array([0.3, 0.4, 0.3, 0.15], np.float32), 8, 8 / 6)
    x = 0.45 + ((np.arange(8) + 0.5) / 8 - 0.5) * 0.3 * 8 / 6
    y = 0.475 + ((np.arange(8) + 0.5) / 8 - 0.5) * 0.15 * 8 / 6
    np.testing.assert_allclose(points[0], np.tile(x, (8, 1)), atol=1e-5)
    np.testing.assert_allclose(points[1], np.tile(y[:, None], (1, 8)), atol=1e-5)


def test_boxes_are_sampled_as_one_is_inside_the_window_and_beyond_its_edge():
    features = np.random.default_rng(0).normal(size=(5, 18, 18)).astype(np.float32)
    window = Window(10, 20, 180, 180, 288)
    boxes = np.array([[70, 80, 60, 60], [0, 150, 33.3, 90], [185, 30, 20, 7]])
    seen = sample_boxes(features, boxes, window, 6)
    for one, box in zip(seen, boxes, strict=True):
        alone = sample_box(features, box, window, 6)
        np.testing.assert_allclose(one.T.reshape(5, 6, 6), alone, atol=1e-5)


def test_held_says_shape_and_growth():
    last = held([5, 5, 80, 20], [0, 0, 40, 40], [0, 0, 120, 120])
    np.testing.assert_allclose(last, [80 / 120, 20 / 120, np.log(2), np.log(0.5)], rtol=1e-5)


def test_weights_that_are_missing_are_named():
    with pytest.raises(KeyError, match="f1"):
        Linear({})
    assert Conditioned({}).layers == 0
