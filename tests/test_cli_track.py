"""`entrack track`: files, summary, and every way in which it can go wrong."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

import entrack
from entrack import EntrackError
from entrack.cli.app import main
from entrack.video import open_source
from fakes import BrightTracker, ball, write_clip

BOX = "10,12,24,20"


@pytest.fixture(autouse=True)
def bright(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(entrack, "load", lambda *_, **__: BrightTracker())


@pytest.fixture
def clip(tmp_path: Path) -> str:
    return str(write_clip(tmp_path / "clip.mp4", 20))


@pytest.fixture
def out(tmp_path: Path) -> Path:
    (tmp_path / "out").mkdir()
    return tmp_path / "out"


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_track_writes_boxes_and_video_and_a_summary(
    clip: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [out / "o.csv", out / "o.mp4"]
    call = ["track", clip, "--box", BOX]
    assert main([*call, "--boxes", str(files[0]), "--video", str(files[1])]) == 0
    shown = capsys.readouterr()
    assert "clip.mp4: 20 frames in" in shown.out and "frames/s" in shown.out
    assert "lost in 5% of the frames" in shown.out  # the tracker's third update
    assert f"wrote {files[0]}" in shown.out and f"wrote {files[1]}" in shown.out
    assert "20/20" in shown.err and "error" not in shown.err
    rows = rows_of(files[0])
    assert [int(row["frame"]) for row in rows] == list(range(20))
    boxes = [[float(row[side]) for side in "xywh"] for row in rows]
    np.testing.assert_allclose(boxes, [ball(t)[1] for t in range(20)], atol=0.6)
    with open_source(files[1]) as video:
        assert len(list(video)) == 20


def test_json_summary(clip: str, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call = ["track", clip, "--box", BOX, "--box", "90,80,20,20", "--boxes", str(out / "o.txt")]
    assert main([*call, "--start", "5", "--stop", "15", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["frames"] == 10 and summary["complete"] is True
    assert summary["lost"] == [0.1, 0.1] and summary["fps"] > 0
    assert summary["files"] == [str(out / "o_1.txt"), str(out / "o_2.txt")]
    assert all(len(np.loadtxt(path, delimiter=",")) == 10 for path in summary["files"])


def test_options_reach_the_tracker(clip: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def load(model: str, threads: int | None) -> BrightTracker:
        asked.append((model, threads))
        return BrightTracker()

    monkeypatch.setattr(entrack, "load", load)
    assert main(["track", clip, "--box", BOX]) == 0
    assert main(["track", clip, "--box", BOX, "--model", "cf", "--threads", "2"]) == 0
    assert asked == [("default", None), ("cf", 2)]


@pytest.mark.parametrize("threads", ["0", "-3", "two"])
def test_impossible_threads_are_a_wrong_call(
    clip: str, threads: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["track", clip, "--box", BOX, "--threads", threads]) == 2
    shown = capsys.readouterr()
    assert "'--threads'" in shown.err and len(shown.err.splitlines()) == 1 and not shown.out


def test_box_partly_outside_is_clipped_and_said_so(
    clip: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["track", clip, "--box", "-10,100,40,40", "--boxes", str(out / "o.csv")]
    assert main(call) == 0
    note = "note: box 1 reaches outside the 160×120 picture: tracking 0,100,30,20"
    assert note in capsys.readouterr().err
    assert [float(rows_of(out / "o.csv")[0][side]) for side in "xywh"] == [0, 100, 30, 20]


@pytest.mark.parametrize(
    ("box", "message"),
    [
        ("200,10,20,20", "box 200,10,20,20 lies outside the 160×120 picture"),
        ("10,10,0,20", "positive width and height"),
        ("10,10,-5,20", "positive width and height"),
        ("nan,10,20,20", "finite"),
        ("1,2,3", "four numbers X,Y,W,H"),
        ("left,top,20,20", "four numbers X,Y,W,H"),
        ("", "four numbers X,Y,W,H"),
    ],
)
def test_impossible_box_is_a_wrong_call(
    clip: str, out: Path, box: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["track", clip, "--box", box, "--boxes", str(out / "o.csv")]) == 2
    shown = capsys.readouterr()
    assert message in shown.err and shown.err.startswith("error: ") and not shown.out
    assert not list(out.iterdir())


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("none.mp4", "there is no video, folder or camera none.mp4"),
        ("*.jpg", "no file matches *.jpg"),
        ("empty", "holds no pictures"),
        ("text.mp4", "text.mp4 cannot be read as a video"),
        ("notes.txt", "notes.txt is not a video"),
    ],
)
def test_what_cannot_be_tracked_is_a_wrong_call(
    source: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    Path("text.mp4").write_text("text")
    Path("notes.txt").write_text("Dear diary,\n" * 200)
    assert main(["track", source, "--box", BOX]) == 2
    shown = capsys.readouterr()
    assert message in shown.err and len(shown.err.splitlines()) == 1


@pytest.mark.parametrize(
    ("option", "name", "code", "message"),
    [
        ("--boxes", "o.xls", 2, "boxes are written as .csv .jsonl .txt, found o.xls"),
        ("--video", "o.avi", 2, "a video is written as .mp4, found o.avi"),
        ("--boxes", "none/o.csv", 1, "No such file or directory"),
        ("--video", "none/o.mp4", 1, "No such file or directory"),
        ("--video", "../clip.mp4", 2, "is the source"),
        ("--boxes", "", 2, "is a folder"),
        ("--video", "../folder.mp4", 2, "is a folder"),
    ],
)
def test_output_that_cannot_be_written(
    clip: str,
    out: Path,
    option: str,
    name: str,
    code: int,
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (out.parent / "folder.mp4").mkdir()
    assert main(["track", clip, "--box", BOX, option, str(out / name)]) == code
    shown = capsys.readouterr()
    assert message in shown.err and len(shown.err.splitlines()) == 1 and not shown.out
    assert not list(out.iterdir()) and Path(clip).exists()


def test_model_that_does_not_load_is_one_sentence(
    clip: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def load(*_: object, **__: object) -> None:
        raise EntrackError("no model nonsense")

    monkeypatch.setattr(entrack, "load", load)
    assert main(["track", clip, "--box", BOX, "--boxes", str(out / "o.csv")]) == 2
    assert capsys.readouterr().err == "error: no model nonsense\n"
    assert not list(out.iterdir())


def test_video_cut_short_keeps_what_was_tracked_and_says_where_it_broke(
    tmp_path: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = write_clip(tmp_path / "clip.mp4", 60).read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: len(whole) // 2])
    call = ["track", str(tmp_path / "cut.mp4"), "--box", BOX]
    assert (
        main([*call, "--boxes", str(out / "o.csv"), "--video", str(out / "o.mp4"), "--json"]) == 1
    )
    shown = capsys.readouterr()
    summary, n = json.loads(shown.out), len(rows_of(out / "o.csv"))
    assert f"error: cut.mp4 breaks off at frame {n}" in shown.err
    assert 10 < n < 60 and summary["frames"] == n and summary["complete"] is False
    with open_source(out / "o.mp4") as video:
        assert len(list(video)) == n
    assert not list(out.glob("*.part"))


def test_picture_of_another_size_midway_is_tracked(tmp_path: Path, out: Path) -> None:
    for t in range(6):
        image = ball(t)[0]
        cv2.imwrite(str(tmp_path / f"{t}.png"), image if t < 3 else cv2.resize(image, (80, 90)))
    call = ["track", str(tmp_path / "*.png"), "--box", BOX]
    assert main([*call, "--boxes", str(out / "o.csv"), "--video", str(out / "o.mp4")]) == 0
    assert len(rows_of(out / "o.csv")) == 6
    with open_source(out / "o.mp4") as video:
        assert {f.image.shape for f in video} == {(120, 160, 3)}


SCRIPT = f"""
import sys, time
sys.path.insert(0, {str(Path(__file__).parent)!r})
import entrack
from fakes import BrightTracker
from entrack.cli.app import main
entrack.load = lambda *_, **__: BrightTracker(EVERY)
sys.exit(main(sys.argv[1:]))
"""


def start(every: str, *call: str, **options: object) -> subprocess.Popen[str]:
    script = SCRIPT.replace("EVERY", every)
    return subprocess.Popen(  # type: ignore[call-overload]
        [sys.executable, "-c", script, *call],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def wait_for(condition: Callable[[], bool]) -> None:
    give_up = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < give_up, "nothing happened"
        time.sleep(0.02)


def test_ctrl_c_finishes_the_files_and_exits_130(tmp_path: Path, out: Path) -> None:
    boxes, video = out / "o.csv", out / "o.mp4"
    call = ["track", str(write_clip(tmp_path / "clip.mp4", 60)), "--box", BOX]
    process = start(
        "lambda t: time.sleep(0.05)", *call, "--boxes", str(boxes), "--video", str(video)
    )
    part = out / "o.csv.part"
    wait_for(lambda: part.exists() and part.read_text().count("\n") > 10)
    process.send_signal(signal.SIGINT)
    shown, errors = process.communicate(timeout=20)
    assert process.returncode == 130 and "Traceback" not in errors
    n = len(rows_of(boxes))
    assert 10 <= n < 60 and f"clip.mp4: {n} frames" in shown
    with open_source(video) as drawn:
        assert len(list(drawn)) == n
    assert not list(out.glob("*.part"))


def test_full_disk_ends_with_one_sentence_and_keeps_what_fits(tmp_path: Path, out: Path) -> None:
    clip = str(write_clip(tmp_path / "clip.mp4", 60))
    limit = "__import__('resource').setrlimit(__import__('resource').RLIMIT_FSIZE, (2000, -1))"
    process = start(
        f"lambda t: {limit}", "track", clip, "--box", BOX, "--boxes", str(out / "o.csv")
    )
    errors = process.communicate(timeout=20)[1]
    assert process.returncode == 1 and "Traceback" not in errors
    assert errors.splitlines()[-1] == f"error: cannot write {out / 'o.csv'}: File too large"
    rows = rows_of(out / "o.csv")
    assert 5 < len(rows) < 60 and all(row["ms"] for row in rows)


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is forbidden to root")
def test_forbidden_folder(clip: str, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out.chmod(0o500)
    assert main(["track", clip, "--box", BOX, "--boxes", str(out / "o.csv")]) == 1
    assert "Permission denied" in capsys.readouterr().err
