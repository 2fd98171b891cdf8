"""Cut-outs of clips: whole things, in their own motion, at exact boxes elsewhere."""

import cv2
import numpy as np
import pytest

from entrack.datasets.cutpaste import cut, cut_clip, props
from entrack.datasets.synthetic import Film, Props, configure, synthesise
from entrack.errors import EntrackError


def clip(length=20, growth=1.0, hidden=(), red=(40, 60, 200)):
    """Frames and masks of an ellipse that crosses a striped picture and swings its long side."""
    for t in range(length):
        frame = np.zeros((120, 200, 3), np.uint8)
        frame[:, ::4] = 90
        mask = np.zeros((120, 200), np.uint8)
        size = growth ** (t / length)
        axes = int(24 * size), int((14 + 3 * np.sin(t)) * size)
        cv2.ellipse(mask, (60 + 4 * t, 60), axes, 0, 0, 360, 255, -1)
        if t in hidden:
            mask[:, 60 + 4 * t - 3 : 60 + 4 * t + 3] = 0
        frame[mask > 0] = red
        yield frame, mask


def test_a_film_shows_the_thing_alone_and_keeps_its_motion():
    film = cut(clip())
    assert film is not None
    assert len(film) == 20
    heights = np.array([np.ptp(hull[:, 1]) for hull in film.hulls])
    widths = np.array([np.ptp(hull[:, 0]) for hull in film.hulls])
    assert np.ptp(heights) > 8  # it still swings
    assert np.ptp(widths) < 3
    for levels, hull in zip(film.pictures, film.hulls, strict=True):
        solid = levels[0][..., 3] > 250
        assert np.abs(levels[0][solid][:, :3] - [40, 60, 200.0]).max() < 30  # no stripe came along
        assert np.abs(hull.mean(axis=0)).max() < 6  # in the middle of its picture


def test_what_remains_is_the_thing_at_one_size():
    film = cut(clip(40, growth=1.6))
    assert film is not None
    widths = np.array([np.ptp(hull[:, 0]) for hull in film.hulls])
    assert np.ptp(widths) / widths.mean() < 0.12  # the clip's own is 1.6


def test_a_film_ends_where_something_hides_the_thing_or_it_touches_the_border():
    film = cut(clip(30, hidden={6, 7, 8}))
    assert film is not None
    assert len(film) == 20  # from frame 9 until the border at frame 29
    assert cut(clip(20, hidden={6, 12})) is None


def test_the_longest_side_and_the_length_are_as_asked():
    film = cut(clip(), size=32, longest=9)
    assert film is not None
    assert len(film) == 9
    assert 26 <= max(np.ptp(hull, axis=0).max() for hull in film.hulls) <= 32


def test_pasted_boxes_are_those_of_the_pasted_pixels():
    film = cut(clip())
    assert film is not None
    config = configure(width=240, height=180, target_size=40, length=30, noise=0, lookalikes=1)
    sequence = synthesise(
        config, Props(backgrounds=[np.full((90, 120, 3), 30, np.uint8)], sprites=[film])
    )
    assert isinstance(sequence.frames, Film)
    seen = np.flatnonzero(sequence.frames.scene.visible == 1)[::7]
    for t in seen:
        red = sequence.frames[int(t)][..., 2] > 110
        count, _, stats, _ = cv2.connectedComponentsWithStats(red.astype(np.uint8))
        boxes = stats[1:count, :4]
        nearest = boxes[np.abs(boxes - sequence.boxes[t]).sum(axis=1).argmin()]
        np.testing.assert_allclose(nearest, sequence.boxes[t], atol=2)


def test_a_folder_without_masks_is_refused_with_a_sentence(tmp_path):
    with pytest.raises(EntrackError, match=r"needs masks/ID/%08d.png and images"):
        props(tmp_path)


@pytest.mark.shared
def test_a_real_thing_is_cut_out_of_its_clip(shared):
    data = shared / "data"
    film = cut_clip(data / "train" / "0001.mp4", data / "masks" / "0001", longest=10)
    assert film is not None
    assert len(film) == 10
    first = np.ptp(film.hulls[0], axis=0)
    row = np.loadtxt(data / "train" / "0001.txt", delimiter=",")[0]
    assert first[0] / first[1] == pytest.approx(row[2] / row[3], rel=0.1)
    alpha = film.shapes[0][0] > 127
    assert 0.2 < alpha.sum() / np.prod(first) < 0.9  # a swan, not a rectangle
