"""The loop under `entrack.track` and the command line."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import entrack
from entrack import EntrackError
from entrack.run import Recorder, follow, track
from entrack.video import open_source
from fakes import BrightTracker, ball, write_clip


@pytest.fixture
def bright(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(entrack, "load", lambda *_, **__: BrightTracker())


@pytest.mark.usefixtures("bright")
def test_track_yields_each_frame_with_its_estimate(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "clip.mp4", 20)
    for t, (image, estimate) in enumerate(track(path, ball(0)[1])):
        assert np.abs(image.astype(int) - ball(t)[0]).mean() < 6
        np.testing.assert_allclose(estimate.box, ball(t)[1], atol=0.6)
    assert t == 19


@pytest.mark.usefixtures("bright")
def test_track_starts_on_the_part_of_the_box_inside(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "clip.mp4", 12)
    images, estimates = zip(*track(path, (-10, 0, 30, 40), start=5, stop=8), strict=True)
    assert len(images) == 3
    np.testing.assert_array_equal(estimates[0].box, [0, 0, 20, 40])
    assert estimates[0].score == 1 and not estimates[0].lost


@pytest.mark.usefixtures("bright")
@pytest.mark.parametrize("box", [(500, 5, 9, 9), (0, 0, 0, 5), (np.nan, 0, 5, 5), "1,2,3,4"])
def test_track_refuses_what_is_no_box_in_the_picture(tmp_path: Path, box: object) -> None:
    path = write_clip(tmp_path / "clip.mp4", 3)
    with pytest.raises(EntrackError, match="box"):
        list(track(path, box))  # type: ignore[arg-type]


def test_several_boxes_are_followed_at_once(tmp_path: Path) -> None:
    with (
        open_source(write_clip(tmp_path / "clip.mp4", 4)) as source,
        closing(follow(BrightTracker(), source, [ball(0)[1], (100, 80, 10, 10)])) as steps,
    ):
        found = [[e.box for e in estimates] for _, estimates in steps]
    assert np.shape(found) == (4, 2, 4)
    np.testing.assert_array_equal(found[0], [ball(0)[1], (100, 80, 10, 10)])
    np.testing.assert_array_equal(np.array(found)[1:, 1, 2:], [[10, 10]] * 3)


def test_recorder_writes_both_files_while_the_tracker_works(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "clip.mp4", 20)
    with (
        open_source(path) as source,
        Recorder(tmp_path / "o.txt", tmp_path / "o.mp4", fps=25) as recorder,
        closing(follow(BrightTracker(), source, [ball(0)[1]])) as steps,
    ):
        for frame, estimates in steps:
            recorder.write(frame, estimates)
    assert recorder.paths == [tmp_path / "o.txt", tmp_path / "o.mp4"]
    boxes = np.loadtxt(tmp_path / "o.txt", delimiter=",")
    np.testing.assert_allclose(boxes - [1, 1, 0, 0], [ball(t)[1] for t in range(20)], atol=0.6)
    with open_source(tmp_path / "o.mp4") as drawn:
        frames = list(drawn)
    np.testing.assert_allclose([f.time for f in frames], np.arange(20) / 25, atol=1e-4)
    changed = np.abs(frames[9].image.astype(int) - ball(9)[0]).max(axis=-1) > 60
    assert changed[19:23, 26:54].any() and not changed[26:36, 32:48].any()


def test_recorder_without_files_is_no_work(tmp_path: Path) -> None:
    with Recorder(None, None) as recorder:
        assert recorder.paths == []


def test_second_file_that_cannot_be_opened_leaves_nothing_of_the_first(tmp_path: Path) -> None:
    with pytest.raises(EntrackError):
        Recorder(tmp_path / "o.csv", tmp_path / "none" / "o.mp4")
    assert not list(tmp_path.iterdir())
