"""Boxes: algebra that holds for all of them, and what a user may type."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entrack import box as b
from entrack.errors import EntrackError

place = st.floats(-1e4, 1e4)
side = st.floats(1e-3, 1e4)
boxes = st.tuples(place, place, side, side).map(np.array)


@given(boxes)
def test_corners_and_centres_go_there_and_back(box):
    np.testing.assert_allclose(b.from_corners(b.to_corners(box)), box, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(b.from_centre(b.centre(box), box[2:]), box, rtol=1e-6, atol=1e-6)


@given(boxes, boxes)
def test_iou_is_symmetric_and_between_zero_and_one(one, other):
    value = b.iou(one, other)
    assert 0 <= value <= 1 + 1e-9
    assert value == pytest.approx(b.iou(other, one))
    assert b.iou(one, one) == pytest.approx(1, rel=1e-6)


def test_iou_against_counting_pixels():
    one, other = [2, 3, 10, 6], [7, 1, 9, 5]
    masks = []
    for x, y, w, h in (one, other):
        mask = np.zeros((20, 20), bool)
        mask[y : y + h, x : x + w] = True
        masks.append(mask)
    counted = (masks[0] & masks[1]).sum() / (masks[0] | masks[1]).sum()
    assert b.iou(one, other) == pytest.approx(counted)


def test_iou_broadcasts_and_keeps_not_a_number():
    many = np.array([[0, 0, 2, 2], [5, 5, 1, 1], [np.nan] * 4])
    np.testing.assert_allclose(b.iou(many, [0, 0, 2, 2]), [1, 0, np.nan])


def test_empty_boxes_overlap_nothing():
    assert b.iou([0, 0, 0, 5], [0, 0, 0, 5]) == 0


@pytest.mark.parametrize("text", ["", "1,2,3", "a,b,c,d", "1,2,3,4,5", "1;2;3;4"])
def test_what_is_not_four_numbers_is_refused(text: str):
    with pytest.raises(EntrackError, match="four numbers"):
        b.parse(text)


@pytest.mark.parametrize("text", ["1,2,0,4", "1,2,3,-4"])
def test_a_box_without_area_is_refused(text: str):
    with pytest.raises(EntrackError, match="positive width and height"):
        b.parse(text)


@pytest.mark.parametrize("text", ["1,2,nan,4", "inf,2,3,4"])
def test_a_box_without_finite_numbers_is_refused(text: str):
    with pytest.raises(EntrackError, match="finite"):
        b.parse(text)


@pytest.mark.parametrize("thing", [None, "text", [1, 2, 3], [[1, 2, 3, 4]], ["a", 1, 2, 3]])
def test_what_is_no_box_is_refused(thing: object):
    with pytest.raises(EntrackError, match="four numbers"):
        b.check(thing)
