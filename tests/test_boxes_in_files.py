"""From a benchmark's boxes to the program's."""

import numpy as np

from entrack.datasets.boxes import upright_boxes, zero_based


def test_an_upright_rectangle_stays_as_it_is():
    assert upright_boxes([10, 20, 40, 20, 40, 60, 10, 60]).tolist() == [10, 20, 30, 40]


def test_the_box_of_a_rotated_rectangle_has_its_area_and_its_middle():
    angle = np.deg2rad(30)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corners = np.array([[-20, -10], [20, -10], [20, 10], [-20, 10]]) @ turn.T + (100, 50)
    x, y, w, h = upright_boxes(corners.ravel())
    np.testing.assert_allclose(w * h, 800)
    np.testing.assert_allclose([x + w / 2, y + h / 2], [100, 50])


def test_missing_corners_make_a_missing_box():
    assert np.isnan(upright_boxes(np.full((2, 8), np.nan))).all()


def test_boxes_count_from_zero_and_empty_ones_are_missing():
    rows = np.array([[1, 1, 10, 10], [5, 5, 0, 3], [0, 0, 0, 0]], float)
    boxes = zero_based(rows, 1)
    assert boxes[0].tolist() == [0, 0, 10, 10]
    assert np.isnan(boxes[1:]).all()
