"""Where the tracker looks: geometry to a fraction of a pixel, and every kind of picture."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entrack.config import WindowConfig
from entrack.errors import EntrackError
from entrack.window import Window, around, as_bgr, crop


def ramp(height: int = 120, width: int = 160) -> np.ndarray:
    """A picture whose red is its x and whose green is its y, at pixel centres."""
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    return np.dstack([np.zeros_like(x), y, x]).astype(np.uint8)


def test_square_window_has_the_area_of_context_squared_boxes():
    window = around([10, 20, 40, 90], WindowConfig(context=3))
    assert (window.w, window.h) == (180, 180)
    assert (window.x + 90, window.y + 90) == (30, 65)


def test_box_window_is_the_papers_three_boxes():
    window = around([10, 20, 40, 90], WindowConfig(context=3, shape="box"))
    assert (window.w, window.h) == (120, 270)


finite = st.floats(-500, 500)
positive = st.floats(1, 300)


@given(finite, finite, positive, positive, finite, finite, positive, positive)
def test_patch_coordinates_go_there_and_back(x, y, w, h, bx, by, bw, bh):
    window = Window(x, y, w, h, 288)
    box = np.array([bx, by, bw, bh])
    np.testing.assert_allclose(window.to_image(window.to_patch(box)), box, atol=1e-6)


@pytest.mark.parametrize("side", [30.0, 96.0, 100.5])
def test_crop_samples_where_the_window_says(side: float):
    """Pixel i of the patch shows the picture at its centre, x + (i + ½) · side / size."""
    window = Window(20.3, 10.6, side, side, 96)
    patch = crop(ramp(), window).astype(float)
    wanted = 20.3 + (np.arange(96) + 0.5) * side / 96 - 0.5
    np.testing.assert_allclose(patch[48, :, 2], wanted, atol=0.6)  # rounding to uint8 and ⅟32 px


def test_crop_of_a_large_window_averages_and_stays_in_place():
    """Noise is averaged away, a bright square stays where it is."""
    rng = np.random.default_rng(0)
    image = rng.integers(0, 100, (1200, 1600, 3), dtype=np.uint8)
    image[500:700, 700:900] = 255
    window = Window(300.0, 100.0, 1000.0, 1000.0, 100)
    patch = crop(image, window).astype(float)[..., 0]
    bright = np.argwhere(patch > 180)
    np.testing.assert_allclose(bright.min(0), [40, 40], atol=1)
    np.testing.assert_allclose(bright.max(0), [59, 59], atol=1)
    assert patch[:30, :30].std() < 12  # single pixels have a deviation of 29


@pytest.mark.parametrize(("border", "value"), [("replicate", 10), ("mean", 37)])
def test_outside_the_frame_lies_the_border(border: str, value: int):
    image = np.full((40, 40, 3), 10, np.uint8)
    image[:, 20:] = 64
    patch = crop(image, Window(-80, 0, 40, 40, 32), border)
    assert np.abs(patch.astype(int) - value).max() <= 1


@pytest.mark.parametrize(
    "window", [Window(-5000, -5000, 900, 900, 64), Window(30, 9e3, 8e3, 8e3, 64)]
)
def test_windows_far_outside_give_a_patch(window: Window):
    assert crop(ramp(), window).shape == (64, 64, 3)


@pytest.mark.parametrize(
    "picture",
    [
        np.full((20, 30), 128, np.uint8),
        np.full((20, 30, 1), 128, np.uint8),
        np.full((20, 30, 4), 128, np.uint8),
        np.full((20, 30, 3), 128 << 8, np.uint16),
        np.full((20, 30, 3), 128 / 255, np.float32),
        np.full((40, 60, 3), 128, np.uint8)[::2, ::-2],
    ],
    ids=["grey", "grey-1", "rgba", "16-bit", "float", "strided"],
)
def test_pictures_of_every_kind_become_bgr(picture: np.ndarray):
    bgr = as_bgr(picture)
    assert bgr.shape == (20, 30, 3)
    assert bgr.dtype == np.uint8
    assert bgr.flags.c_contiguous
    assert (bgr == 128).all()


@pytest.mark.parametrize(
    "thing",
    [
        np.zeros((3, 4, 5, 6)),
        np.zeros(7),
        "text",
        None,
        np.zeros((9, 9, 2), np.uint8),
        np.zeros((0, 9, 3), np.uint8),
        np.zeros((9, 9, 3), np.int64),
        np.zeros((9, 9, 3), complex),
    ],
)
def test_what_is_no_picture_is_refused_in_one_sentence(thing: object):
    with pytest.raises(EntrackError, match="a frame"):
        as_bgr(thing)


def test_not_a_number_in_a_float_picture_is_black():
    picture = np.full((8, 8, 3), np.nan, np.float32)
    assert (as_bgr(picture) == 0).all()


def test_crop_equals_a_plain_resize_of_an_aligned_window():
    image = np.random.default_rng(1).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    patch = crop(image, Window(0, 0, 64, 64, 128))
    resized = cv2.resize(image, (128, 128), interpolation=cv2.INTER_LINEAR)
    assert np.abs(patch.astype(int) - resized).mean() < 1.5
