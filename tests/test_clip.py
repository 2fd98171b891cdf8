"""Frames by number: the same ones that a source yields in order, and nothing of other files."""

import weakref
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from entrack import EntrackError
from entrack.video import Clip, open_source
from fakes import write_clip
from test_video_sources import noise_video

UNEVEN = [t / 25 + 0.02 * (t % 3) for t in range(60)]


@pytest.mark.parametrize(
    "make",
    [
        lambda folder: noise_video(folder / "clip.mp4"),
        lambda folder: noise_video(folder / "clip.mkv"),
        lambda folder: noise_video(folder / "clip.mp4", first_pts=50),
        lambda folder: noise_video(folder / "clip.mp4", rotation=90),
        lambda folder: write_clip(folder / "clip.mp4", 60, UNEVEN),
    ],
    ids=["B frames", "Matroska", "later start", "turned", "uneven times"],
)
def test_frames_are_those_of_the_source(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    path = make(tmp_path)
    with open_source(path) as source:
        frames = list(source)
        size, fps = source.size, source.fps
    order = [0, 1, 2, 50, 51, 3, 59, 58, 57, 20, *np.random.default_rng(1).permutation(60)[:20]]
    with Clip(path) as clip:
        assert (len(clip), clip.size, clip.fps) == (60, size, fps)
        for index in order:
            frame = clip[int(index)]
            assert frame.index == index
            assert frame.time == pytest.approx(frames[index].time, abs=1e-9)
            np.testing.assert_array_equal(frame.image, frames[index].image)


def test_no_frame_before_the_first_or_after_the_last(tmp_path: Path) -> None:
    with Clip(write_clip(tmp_path / "clip.mp4", 5)) as clip:
        for index in (-1, 5, 1000):
            with pytest.raises(IndexError):
                clip[index]
        assert clip[4].index == 4


def test_only_few_frames_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("entrack.video.clip._CACHE", 0)
    with Clip(write_clip(tmp_path / "clip.mp4", 20)) as clip:
        for index in (*range(20), *range(19, -1, -1)):
            assert clip[index].index == index
        assert len(clip._kept) == 2


def test_a_closed_clip_holds_no_frame(tmp_path: Path) -> None:
    clip = Clip(write_clip(tmp_path / "clip.mp4", 5))
    frame = weakref.ref(clip[3].image)
    assert frame() is not None
    clip.close()
    assert frame() is None and clip[3].index == 3  # and it may be used again


@pytest.mark.parametrize(
    "content",
    [
        b"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{other}\n#EXT-X-ENDLIST\n",
        b"ffconcat version 1.0\nfile '{other}'\n",
        b"hello",
        b"",
    ],
    ids=["playlist", "concatenation", "text", "nothing"],
)
def test_a_file_that_names_others_is_no_video(tmp_path: Path, content: bytes) -> None:
    other = write_clip(tmp_path / "other.mp4", 5)
    path = tmp_path / "upload.mp4"
    path.write_bytes(content.replace(b"{other}", str(other).encode()))
    with pytest.raises(EntrackError, match=r"mine\.mp4 is not a video that can be read"):
        Clip(path, "mine.mp4")
