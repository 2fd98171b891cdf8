"""Sources: every kind of video as frames, and what is said of broken ones."""

import threading
import weakref
from fractions import Fraction
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from entrack import EntrackError
from entrack.video import Frame, open_source
from fakes import SIZE, ball, write_clip


def noise_video(path: Path, frames: int = 60, first_pts: int = 0, rotation: int = 0) -> Path:
    """A video of noise with B frames, as an encoder of a camera makes it, index in front."""
    rng = np.random.default_rng(0)
    with av.open(str(path), "w", options={"movflags": "faststart"}) as file:
        stream = file.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        if rotation:
            if not hasattr(stream, "set_display_rotation"):
                pytest.skip("this PyAV cannot write a rotation")
            stream.set_display_rotation(rotation)
        for t in range(frames):
            image = rng.integers(0, 255, (SIZE[1], SIZE[0], 3), np.uint8)
            if rotation:
                image = quadrants()
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = t + first_pts, Fraction(1, 25)
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    return path


def quadrants() -> np.ndarray:
    """Red in the left top, green in the right top, blue in the left bottom, black."""
    image = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    image[:60, :80], image[:60, 80:], image[60:, :80] = (0, 0, 255), (0, 255, 0), (255, 0, 0)
    return image


def until_error(source: str | Path) -> tuple[list[Frame], str]:
    """The frames before a source breaks, and what it says then."""
    frames = []
    with open_source(source) as opened, pytest.raises(EntrackError) as error:
        for frame in opened:
            frames.append(frame)
    return frames, str(error.value)


def test_video_file_yields_every_frame_with_its_time(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "clip.mp4", 20)
    with open_source(path) as source:
        assert (source.name, source.size, source.fps, source.length) == ("clip.mp4", SIZE, 25, 20)
        frames = list(source)
    assert [f.index for f in frames] == list(range(20))
    np.testing.assert_allclose([f.time for f in frames], np.arange(20) / 25, atol=1e-4)
    for frame in frames:
        assert frame.image.dtype == np.uint8 and frame.image.flags.c_contiguous
        assert np.abs(frame.image.astype(int) - ball(frame.index)[0]).mean() < 6


def test_first_frame_is_there_until_it_is_iterated_over_and_then_not_kept(tmp_path: Path) -> None:
    with open_source(write_clip(tmp_path / "clip.mp4", 3)) as source:
        first = weakref.ref(source.first)
        frames = iter(source)
        assert next(frames) is first()
        next(frames)
        assert first() is None


def test_variable_frame_rate_keeps_its_times(tmp_path: Path) -> None:
    times = [0, 0.04, 0.08, 0.5, 0.55, 1.0, 1.75]
    with open_source(write_clip(tmp_path / "vfr.mp4", 7, times)) as source:
        np.testing.assert_allclose([f.time for f in source], times, atol=1e-4)


@pytest.mark.parametrize(
    ("start", "stop", "indices"), [(0, 5, range(5)), (7, 9, range(7, 9)), (15, 99, range(15, 20))]
)
@pytest.mark.parametrize("kind", ["video", "folder"])
def test_part(tmp_path: Path, kind: str, start: int, stop: int, indices: range) -> None:
    path = write_clip(tmp_path / "clip.mp4", 20)
    if kind == "folder":
        for t in range(20):
            cv2.imwrite(str(tmp_path / f"{t}.png"), ball(t)[0])
        path = tmp_path
    with open_source(path, start, stop) as source:
        frames = list(source)
    assert [f.index for f in frames] == list(indices) and source.length == len(indices)
    np.testing.assert_allclose([f.time for f in frames], np.array(indices) / 25, atol=1e-4)
    assert np.abs(frames[0].image.astype(int) - ball(start)[0]).mean() < 6


@pytest.mark.parametrize(("start", "stop"), [(-1, None), (5, 5), (5, 3), (20, None)])
def test_impossible_part_is_an_error(tmp_path: Path, start: int, stop: int | None) -> None:
    path = write_clip(tmp_path / "clip.mp4", 20)
    with pytest.raises(EntrackError, match=r"start|ends before frame 20"):
        open_source(path, start, stop)


@pytest.mark.parametrize("rotation", [90, 180, 270])
def test_rotation_metadata_is_applied_as_opencv_does(tmp_path: Path, rotation: int) -> None:
    path = noise_video(tmp_path / "phone.mp4", 3, rotation=rotation)
    with open_source(path) as source:
        image = next(iter(source)).image
    expected = cv2.VideoCapture(str(path)).read()[1]
    assert image.shape == expected.shape and source.size == expected.shape[1::-1]
    assert np.abs(image.astype(int) - expected).mean() < 8
    assert image.flags.c_contiguous


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "avi"])
def test_video_cut_short_yields_what_is_there_then_says_where_it_broke(
    tmp_path: Path, suffix: str
) -> None:
    whole = noise_video(tmp_path / f"whole.{suffix}").read_bytes()
    cut = tmp_path / f"cut.{suffix}"
    cut.write_bytes(whole[: len(whole) // 2])
    frames, message = until_error(cut)
    assert 25 <= len(frames) <= 31
    assert message.startswith(f"cut.{suffix} breaks off at frame {len(frames)}")


def test_video_whose_second_half_is_zeros_breaks_off(tmp_path: Path) -> None:
    data = bytearray(noise_video(tmp_path / "v.mp4").read_bytes())
    data[len(data) // 2 :] = bytes(len(data) - len(data) // 2)
    (tmp_path / "v.mp4").write_bytes(data)
    frames, message = until_error(tmp_path / "v.mp4")
    assert 20 <= len(frames) < 40 and "breaks off" in message


def test_damage_in_the_middle_is_passed_over(tmp_path: Path) -> None:
    data = bytearray(noise_video(tmp_path / "v.mp4").read_bytes())
    middle = len(data) // 2
    data[middle : middle + 3000] = np.random.default_rng(1).bytes(3000)
    (tmp_path / "v.mp4").write_bytes(data)
    with open_source(tmp_path / "v.mp4") as source:
        assert 55 <= len(list(source)) <= 60


def test_trimmed_video_is_not_called_broken(tmp_path: Path) -> None:
    """An edit list hides the first ten frames, which the header counts."""
    with open_source(noise_video(tmp_path / "trimmed.mp4", first_pts=-10)) as source:
        frames = list(source)
    assert len(frames) == 50 and frames[0].time == 0


@pytest.mark.parametrize("name", ["text.mp4", "notes.txt", "empty.mp4", "sound.wav", "half.mp4"])
def test_what_is_no_video_says_so(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"" if "empty" in name else b"Dear diary,\n" * 200)
    if name == "sound.wav":
        with av.open(str(path), "w") as file:
            sound = file.add_stream("pcm_s16le", rate=8000, layout="mono")
            frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), layout="mono")
            frame.sample_rate = 8000
            file.mux(sound.encode(frame))
    if name == "half.mp4":  # its index was never written
        with av.open(str(path), "w") as file:
            stream = file.add_stream("libx264", rate=25)
            stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
            file.mux(stream.encode(av.VideoFrame.from_ndarray(ball(0)[0], format="bgr24")))
            file.mux(stream.encode())
            kept = path.read_bytes()
        path.write_bytes(kept or b"\0\0\0\x18ftypisom")
    with pytest.raises(EntrackError, match=rf"{name} (is not a video|cannot be read as a video)"):
        open_source(path)


def test_video_without_frames_says_so(tmp_path: Path) -> None:
    path = tmp_path / "none.avi"
    with av.open(str(path), "w") as file:
        stream = file.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuvj420p"
        file.start_encoding()
    with pytest.raises(EntrackError, match=r"none\.avi"):
        open_source(path)


def test_missing_things_say_what_was_looked_for(tmp_path: Path) -> None:
    for source, message in {
        str(tmp_path / "no.mp4"): r"no video.*no\.mp4",
        str(tmp_path): "holds no pictures",
        str(tmp_path / "*.jpg"): r"no file matches .*\*\.jpg",
        "77": "camera 77 cannot be opened",
        "http://127.0.0.1:9/clip.mp4": "cannot be read as a video: Connection refused",
    }.items():
        with pytest.raises(EntrackError, match=message):
            open_source(source)


def test_pictures_come_in_natural_order_as_bgr_bytes(tmp_path: Path) -> None:
    colour = ball(3)[0]
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
    cv2.imwrite(str(tmp_path / "frame10.png"), colour)
    cv2.imwrite(str(tmp_path / "frame9.png"), grey)
    cv2.imwrite(str(tmp_path / "frame2.png"), cv2.cvtColor(colour, cv2.COLOR_BGR2BGRA))
    cv2.imwrite(str(tmp_path / "frame1.TIFF"), colour.astype(np.uint16) * 257)
    (tmp_path / "readme.txt").write_text("not a picture")
    (tmp_path / "._frame1.png").write_bytes(b"what some systems leave behind")
    with open_source(tmp_path) as source:
        frames = list(source)
    assert source.name == tmp_path.name and source.length == 4
    for frame, expected in zip(
        frames, [colour, colour, cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), colour], strict=True
    ):
        np.testing.assert_array_equal(frame.image, expected)


def test_glob_chooses_pictures_of_a_folder_by_any_name(tmp_path: Path) -> None:
    folder = tmp_path / "[2026] trip"
    folder.mkdir()
    for name in ("a2.png", "a10.png", "b1.png"):
        cv2.imwrite(str(folder / name), np.full((8, 8, 3), int(name[1:-4]), np.uint8))
    with open_source(str(folder / "a*.png")) as source:
        assert [int(f.image[0, 0, 0]) for f in source] == [2, 10]


def test_unreadable_picture_is_named_when_its_turn_comes(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "1.png"), ball(0)[0])
    (tmp_path / "2.png").write_bytes(b"no picture")
    frames, message = until_error(tmp_path)
    assert len(frames) == 1 and "2.png is not a picture" in message


def test_picture_of_another_size_comes_as_it_is(tmp_path: Path) -> None:
    for t, size in enumerate([(160, 120), (80, 60)]):
        cv2.imwrite(str(tmp_path / f"{t}.png"), ball(0, size)[0])
    with open_source(tmp_path) as source:
        assert [f.image.shape[:2] for f in source] == [(120, 160), (60, 80)]


class FakeCamera:
    """Three frames, then the plug is pulled."""

    released = False

    def __init__(self, number: int) -> None:
        self.left = 3

    def isOpened(self) -> bool:
        return True

    def get(self, what: int) -> float:
        return 0.0

    def read(self) -> tuple[bool, np.ndarray | None]:
        self.left -= 1
        return (True, ball(0)[0]) if self.left >= 0 else (False, None)

    def release(self) -> None:
        FakeCamera.released = True


def test_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", FakeCamera)
    with open_source("0") as source:
        assert (source.name, source.length, source.size) == ("camera 0", None, SIZE)
        assert next(iter(source)).index == 0
    assert FakeCamera.released
    frames, message = until_error("0")
    assert len(frames) == 3 and message == "camera 0 stopped at frame 3"
    assert 0 <= frames[0].time <= frames[1].time <= frames[2].time < 5


def test_folder_named_like_a_camera_is_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "0").mkdir()
    cv2.imwrite(str(tmp_path / "0" / "1.png"), ball(0)[0])
    monkeypatch.chdir(tmp_path)
    assert open_source("0").length == 1


def test_address(tmp_path: Path) -> None:
    write_clip(tmp_path / "clip.mp4", 5)
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    handler.log_message = lambda *_: None  # type: ignore[attr-defined]
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}"
        with open_source(f"{address}/clip.mp4") as source:
            assert len(list(source)) == 5
        with pytest.raises(EntrackError, match="404"):
            open_source(f"{address}/none.mp4")
        server.shutdown()


def test_frames_are_decoded_when_asked_for(tmp_path: Path) -> None:
    """A video of which only the beginning is read does not fail for its end."""
    whole = noise_video(tmp_path / "v.mp4").read_bytes()
    (tmp_path / "v.mp4").write_bytes(whole[: len(whole) // 2])
    with open_source(tmp_path / "v.mp4", stop=10) as source:
        assert len(list(source)) == 10


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="lists open files in /proc")
def test_closing_lets_go_of_the_file(tmp_path: Path) -> None:
    def is_open() -> bool:
        return path in [link.resolve() for link in Path("/proc/self/fd").iterdir()]

    path = write_clip(tmp_path / "clip.mp4", 20).resolve()
    source = open_source(path)
    next(iter(source))
    assert is_open()
    source.close()
    assert not is_open()
