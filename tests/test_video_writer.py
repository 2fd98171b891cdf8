"""The MP4 writer: what is in the file, whatever happens while it is written."""

import errno
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest

from entrack import EntrackError
from entrack.video import VideoWriter, open_source, written_size
from fakes import SIZE, ball, write_clip


def boxes_of_file(path: Path) -> list[str]:
    """Names of an MP4's top-level boxes in order."""
    data, names, at = path.read_bytes(), [], 0
    while at < len(data):
        names.append(data[at + 4 : at + 8].decode())
        at += int.from_bytes(data[at : at + 4])
    return names


def test_file_is_what_browsers_play(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "out.mp4", 30)
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        assert stream.codec_context.name == "h264" and stream.codec_context.pix_fmt == "yuv420p"
        assert stream.frames == 30 and stream.average_rate == 25
        assert float(stream.duration * stream.time_base) == pytest.approx(30 / 25)
    names = boxes_of_file(path)
    assert names.index("moov") < names.index("mdat") and "moof" not in names


def test_times_are_kept_from_the_first_on(tmp_path: Path) -> None:
    times = [7.0, 7.04, 7.1, 8.5, 8.533]
    with open_source(write_clip(tmp_path / "out.mp4", 5, times)) as source:
        np.testing.assert_allclose([f.time for f in source], np.array(times) - 7, atol=1e-4)


def test_times_that_do_not_rise_are_put_in_order(tmp_path: Path) -> None:
    with open_source(write_clip(tmp_path / "out.mp4", 4, [0, 0.04, 0.04, 0.02])) as source:
        times = [f.time for f in source]
    assert len(times) == 4 and (np.diff(times) > 0).all()


def test_colours_survive(tmp_path: Path) -> None:
    colours = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (0, 159, 230), (128, 128, 128)]
    with VideoWriter(tmp_path / "out.mp4") as video:
        for t, colour in enumerate(colours):
            video.write(np.full((64, 64, 3), colour, np.uint8), t / 25)
    with open_source(tmp_path / "out.mp4") as source:
        for frame, colour in zip(source, colours, strict=True):
            np.testing.assert_allclose(frame.image.mean(axis=(0, 1)), colour, atol=5)


def test_odd_sizes_become_even_and_no_pixel_moves(tmp_path: Path) -> None:
    image = ball(2, (161, 121))[0]
    with VideoWriter(tmp_path / "out.mp4") as video:
        video.write(image, 0)
    with open_source(tmp_path / "out.mp4") as source:
        frame = next(iter(source)).image
    assert source.size == (162, 122)
    assert np.abs(frame[:121, :161].astype(int) - image).mean() < 6


def test_pictures_beyond_what_browsers_play_are_shrunk_and_keep_their_times(tmp_path: Path) -> None:
    image = np.zeros((2400, 4800, 3), np.uint8)
    image[:, 2400:] = 255
    assert written_size(image) == (4096, 2048)
    with VideoWriter(tmp_path / "out.mp4") as video:
        for time in (0, 0.04, 0.5):
            video.write(image, time)
    with open_source(tmp_path / "out.mp4") as source:
        assert source.size == (4096, 2048)
        frames = list(source)
    np.testing.assert_allclose([f.time for f in frames], (0, 0.04, 0.5), atol=1e-4)
    assert frames[0].image[:, :2040].max() < 20 and frames[0].image[:, 2056:].min() > 235


def test_frame_of_another_size_is_fitted_between_black_bars(tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "out.mp4") as video:
        video.write(np.full((120, 160, 3), 90, np.uint8), 0)
        video.write(np.full((200, 100, 3), 200, np.uint8), 0.04)
        video.write(np.full((119, 159, 3), 50, np.uint8), 0.08)
    with open_source(tmp_path / "out.mp4") as source:
        frames = [f.image for f in source]
    assert [f.shape for f in frames] == [(120, 160, 3)] * 3
    assert frames[1][:, 55:105].mean() > 190 and frames[1][:, :40].mean() < 10
    assert abs(frames[2][60, 80].mean() - 50) < 5


def test_file_has_its_name_only_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "out.mp4"
    with VideoWriter(path) as video:
        video.write(ball(0)[0], 0)
        assert [p.name for p in tmp_path.iterdir()] == ["out.mp4.part"]
    assert [p.name for p in tmp_path.iterdir()] == ["out.mp4"]


def test_no_frame_no_file(tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "out.mp4"):
        pass
    assert not list(tmp_path.iterdir())


def test_error_in_the_block_leaves_a_playable_file(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), VideoWriter(tmp_path / "out.mp4") as video:
        for t in range(10):
            video.write(ball(t)[0], t / 25)
        raise RuntimeError
    with open_source(tmp_path / "out.mp4") as source:
        assert len(list(source)) == 10


def test_killed_program_leaves_a_playable_part(tmp_path: Path) -> None:
    script = f"""
import os, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from fakes import ball
from entrack.video import VideoWriter
video = VideoWriter({str(tmp_path / "out.mp4")!r})
for t in range(100):
    video.write(ball(t % 20)[0], t / 25)
os._exit(9)
"""
    assert subprocess.run([sys.executable, "-c", script]).returncode == 9
    (tmp_path / "out.mp4.part").rename(tmp_path / "part.mp4")
    with open_source(tmp_path / "part.mp4") as source:
        assert len(list(source)) >= 50


def test_writing_on_after_the_disk_was_full_is_the_same_sentence_again(tmp_path: Path) -> None:
    script = f"""
import resource
import numpy as np
from entrack import EntrackError
from entrack.video import VideoWriter
noise = np.random.default_rng(0).integers(0, 255, (120, 160, 3), np.uint8)
resource.setrlimit(resource.RLIMIT_FSIZE, (16, -1))
video = VideoWriter({str(tmp_path / "out.mp4")!r})
for work in [lambda: video.write(noise, 0)] * 200 + [video.close]:
    try:
        work()
    except EntrackError as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0
    assert set(done.stdout.splitlines()) == {f"cannot write {tmp_path / 'out.mp4'}: File too large"}


@pytest.mark.parametrize("limit", [2_000_000, 1_500_001, 1000])
def test_full_disk_is_one_sentence_and_keeps_what_fits(tmp_path: Path, limit: int) -> None:
    script = f"""
import resource, sys
import numpy as np
from entrack import EntrackError
from entrack.video import VideoWriter
noise = np.random.default_rng(0).integers(0, 255, (120, 160, 3), np.uint8)
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, -1))  # writing beyond fails like a full disk
try:
    with VideoWriter({str(tmp_path / "out.mp4")!r}) as video:
        for t in range(500):
            video.write(np.roll(noise, t, axis=0), t / 25)
except EntrackError as error:
    sys.exit(str(error))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stderr.strip() == f"cannot write {tmp_path / 'out.mp4'}: File too large"
    assert not list(tmp_path.glob("*.part")) and not list(tmp_path.glob("*.index"))
    if limit > 100_000:
        with open_source(tmp_path / "out.mp4") as source:
            assert 0 < len(list(source)) < 500
    else:
        assert not (tmp_path / "out.mp4").exists()


def test_no_room_for_the_index_keeps_every_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("entrack.video.writer._put_index_in_front", full)
    with pytest.raises(EntrackError, match="No space left"):
        write_clip(tmp_path / "out.mp4", 10)
    with open_source(tmp_path / "out.mp4") as source:
        assert len(list(source)) == 10


def test_unwritable_place_says_so_at_once(tmp_path: Path) -> None:
    with pytest.raises(EntrackError, match=r"cannot write .*none/out\.mp4: No such file"):
        VideoWriter(tmp_path / "none" / "out.mp4")
    with pytest.raises(EntrackError, match=r"written as \.mp4, found out\.gif"):
        VideoWriter(tmp_path / "out.gif")


@pytest.mark.parametrize("size", [(16, 16), (2, 2), SIZE])
def test_small_pictures(tmp_path: Path, size: tuple[int, int]) -> None:
    with VideoWriter(tmp_path / "out.mp4") as video:
        video.write(np.zeros((size[1], size[0], 3), np.uint8), 0)
    with open_source(tmp_path / "out.mp4") as source:
        assert source.size == size
