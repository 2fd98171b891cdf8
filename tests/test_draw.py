"""Overlays and filmstrips: where ink is, and where it is not."""

import numpy as np
import pytest

from entrack import Estimate
from entrack.draw import PALETTE, filmstrip, overlay

GREY = np.full((360, 640, 3), 120, np.uint8)


def estimate(
    box: tuple[float, float, float, float] = (200, 120, 80, 60),
    score: float = 0.8,
    lost: bool = False,
    sigma: list[float] | None = None,
) -> Estimate:
    b = np.array(box, np.float64)
    search = np.array([b[0] - b[2], b[1] - b[3], 3 * b[2], 3 * b[3]])
    return Estimate(b, score, lost, None if sigma is None else np.array(sigma), None, search, 10.0)


def inked(image: np.ndarray, ground: np.ndarray = GREY) -> np.ndarray:
    return (image != ground).any(axis=-1)


def near(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    return (np.abs(image.astype(int) - colour) < 30).all(axis=-1)


def test_picture_itself_is_not_drawn_on() -> None:
    image = GREY.copy()
    overlay(image, [estimate()], 3, 25.0)
    np.testing.assert_array_equal(image, GREY)


def test_box_is_drawn_on_its_sides_in_the_first_colour() -> None:
    drawn = near(overlay(GREY, [estimate()]), PALETTE[0])
    for y, x in [(150, 200), (150, 280), (180, 240)]:
        assert drawn[y - 2 : y + 2, x - 2 : x + 2].any()
    assert not inked(overlay(GREY, [estimate()]))[130:170, 210:270].any()


def test_a_smaller_copy_is_drawn_as_the_small_picture_is() -> None:
    large = np.full((720, 1280, 3), 120, np.uint8)
    sigma = [4.0, 8.0, 4.0, 8.0]
    big = estimate((400, 240, 160, 120), sigma=[2 * s for s in sigma])
    drawn = overlay(large, [big, None], 3, 25.0, (640, 360))
    np.testing.assert_array_equal(drawn, overlay(GREY, [estimate(sigma=sigma), None], 3, 25.0))


def test_objects_differ_in_colour() -> None:
    image = overlay(GREY, [estimate((50, 100, 60, 60)), estimate((400, 100, 60, 60))])
    assert near(image[:, :150], PALETTE[0]).any() and not near(image[:, :150], PALETTE[1]).any()
    assert near(image[:, 350:], PALETTE[1]).any() and not near(image[:, 350:], PALETTE[0]).any()


def test_lost_box_has_gaps() -> None:
    def coverage(lost: bool) -> float:
        image = overlay(GREY, [estimate(lost=lost)])
        return float(near(image[130:170, 198:202], PALETTE[0]).any(axis=1).mean())

    assert coverage(lost=False) == 1.0
    assert 0.3 < coverage(lost=True) < 0.9


def test_score_bar_grows_with_the_score() -> None:
    def white(score: float) -> int:
        return int(near(overlay(GREY, [estimate(score=score)])[:120], (255, 255, 255)).sum())

    assert white(0.0) < white(0.4) < white(0.9)


def test_band_is_as_wide_as_sigma() -> None:
    sigma = [4.0, 8, 12, 16]
    plain, banded = overlay(GREY, [estimate()]), overlay(GREY, [estimate(sigma=sigma)])
    rows, columns = np.nonzero(inked(banded, plain))
    assert (columns.min(), columns.max() + 1) == (200 - 4, 280 + 12)
    assert rows.max() + 1 == 180 + 16
    assert not inked(banded, plain)[129:163, 205:267].any()


@pytest.mark.parametrize(
    "box",
    [
        (-50, -40, 100, 80),
        (600, 340, 100, 80),
        (-500, -500, 20, 20),
        (0, 0, 640, 360),
        (5000, 90, 9, 9),
        (100, 100, 0.2, 0.2),
    ],
)
@pytest.mark.parametrize("lost", [False, True])
def test_boxes_beyond_the_picture_can_be_drawn(
    box: tuple[float, float, float, float], lost: bool
) -> None:
    image = overlay(GREY, [estimate(box, lost=lost, sigma=[900, 1, 30, 2])], 1, 1.0)
    assert image.shape == GREY.shape and image.dtype == np.uint8


@pytest.mark.parametrize("shape", [(16, 16, 3), (40, 900, 3), (2160, 3840, 3)])
def test_any_size_of_picture(shape: tuple[int, int, int]) -> None:
    image = np.full(shape, 120, np.uint8)
    assert inked(overlay(image, [estimate((2, 2, 9, 9))], 1234, 99.0), image).any()


def test_lines_are_wider_on_larger_pictures() -> None:
    def width(scale: int) -> int:
        image = np.full((360 * scale, 640 * scale, 3), 120, np.uint8)
        box = np.multiply((200, 120, 80, 60), scale)
        drawn = overlay(image, [estimate(tuple(box.tolist()))])
        return int(near(drawn[150 * scale, 190 * scale : 210 * scale], PALETTE[0]).sum())

    assert width(4) > width(1)


def test_status_is_in_the_lower_left_corner() -> None:
    changed = inked(overlay(GREY, [], 12, 30.0))
    assert changed[-10:, :10].all() and not changed[:320].any() and not changed[:, 400:].any()
    assert not inked(overlay(GREY, [])).any()


def test_filmstrip_sets_frames_in_rows_with_scaled_boxes() -> None:
    images = [np.full((100, 200, 3), 20 * i + 40, np.uint8) for i in range(6)]
    boxes = [[50.5, 25.5, 100, 50]] * 5 + [[np.nan] * 4]
    strip = filmstrip(images, boxes, labels=[f"frame {i}" for i in range(6)], columns=3, width=612)
    assert strip.shape == (206, 612, 3)
    for i in range(6):
        top, left = 106 * (i // 3), 206 * (i % 3)
        cell = strip[top : top + 100, left : left + 200]
        assert (cell[40:60, 90:110] == 20 * i + 40).all()  # the middle is untouched
        assert near(cell[50:52, 46:54], PALETTE[0]).any() == (i < 5)
    assert (strip[100:106] == 255).all() and (strip[:, 200:206] == 255).all()


def test_filmstrip_shows_the_truth_in_white() -> None:
    strip = filmstrip([GREY], [[200.5, 120.5, 80, 60]], truth=[[300.5, 120.5, 80, 60]], width=640)
    assert near(strip[140:160, 298:303], (255, 255, 255)).any()
    assert near(strip[140:160, 198:203], PALETTE[0]).any()
