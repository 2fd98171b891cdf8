"""Many clips from a list, each to files of its own."""

import json
from pathlib import Path

import numpy as np
import pytest

from entrack.batch import read_list, run_clips
from entrack.cli.app import main
from entrack.errors import EntrackError
from fakes import ball, write_clip

FRAMES = 5


@pytest.fixture
def videos(tmp_path: Path) -> Path:
    """Two clips, and one that is none."""
    folder = tmp_path / "videos"
    folder.mkdir()
    write_clip(folder / "first.mp4", FRAMES)
    write_clip(folder / "second.mp4", FRAMES)
    (folder / "broken.mp4").write_bytes(b"no video")
    return folder


def write_list(folder: Path, *rows: str, header: str = "source,x,y,w,h,name") -> Path:
    path = folder / "clips.csv"
    path.write_text("\n".join((header, *rows)) + "\n")
    return path


BOX = ",".join(map(str, ball(0)[1]))


def test_each_clip_has_files_of_its_own_and_a_second_call_makes_nothing(videos, tmp_path, capsys):
    clips = write_list(videos, f"first.mp4,{BOX},", f"second.mp4,{BOX},b/two")
    out = tmp_path / "out"
    words = ["track", "--batch", str(clips), "--boxes", str(out / "{name}.csv"), "--json"]
    assert main([*words, "--video", str(out / "{name}.mp4")]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["clips"], told["before"], told["frames"]) == (2, 0, 2 * FRAMES)
    found = sorted(p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file())
    assert found == ["b/two.csv", "b/two.mp4", "first.csv", "first.mp4"]
    assert not list(out.rglob(".*"))
    table = np.genfromtxt(out / "first.csv", delimiter=",", names=True)
    x, y, *_ = ball(FRAMES - 1)[1]
    assert table["frame"].tolist() == list(range(FRAMES))
    assert abs(table["x"][-1] - x) < 4 and abs(table["y"][-1] - y) < 4
    before = (out / "first.csv").stat().st_mtime_ns
    (out / "b" / "two.csv").unlink()
    assert main([*words, "--video", str(out / "{name}.mp4")]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["clips"], told["before"]) == (1, 1)
    assert (out / "first.csv").stat().st_mtime_ns == before


def test_a_clip_that_fails_is_told_and_the_others_are_done(videos, tmp_path, capsys):
    clips = write_list(videos, f"broken.mp4,{BOX},", f"second.mp4,{BOX},")
    words = ["track", "--batch", str(clips), "--boxes", str(tmp_path / "{name}.jsonl")]
    assert main(words) == 1
    assert "1 clips failed, such as broken" in capsys.readouterr().err
    assert "broken.mp4" in (tmp_path / "broken.jsonl.failed.txt").read_text()
    assert not (tmp_path / "broken.jsonl").exists()
    assert len((tmp_path / "second.jsonl").read_text().splitlines()) == FRAMES
    write_clip(videos / "broken.mp4", FRAMES)
    assert main(words) == 0
    assert not list(tmp_path.glob("*.failed.txt"))


def test_rows_of_one_name_are_objects_of_one_clip(videos, tmp_path):
    path = write_list(videos, f"first.mp4,{BOX},a", "first.mp4,90,80,30,20,a")
    (clip,) = read_list(path, tmp_path / "{name}.txt", None)
    assert len(clip.boxes) == 2
    assert [e.value for e in run_clips([clip]) if e.kind == "done"] == [FRAMES]
    assert clip.done()
    assert sorted(p.name for p in tmp_path.glob("*.txt")) == ["a_1.txt", "a_2.txt"]


def test_start_and_stop_are_frames_of_the_source(videos, tmp_path):
    path = write_list(videos, f"first.mp4,{BOX},1,3", header="source,x,y,w,h,start,stop")
    clips = read_list(path, tmp_path / "{name}.csv", None)
    assert [e.value for e in run_clips(clips) if e.kind == "done"] == [2]


@pytest.mark.parametrize(
    ("rows", "why"),
    [
        (["first.mp4,1,2,3,none,"], "line 2: a box is four numbers"),
        ([f"first.mp4,{BOX},a", f"second.mp4,{BOX},a"], "line 3: another clip is called a already"),
        ([f"first.mp4,{BOX},../up"], r"line 2: '../up' is no name for a file"),
        ([f"first.mp4,{BOX},.hidden"], "line 2: '.hidden' is no name for a file"),
        ([], "lists no clip"),
    ],
)
def test_lists_that_cannot_be_used_name_their_line(tmp_path, rows, why):
    with pytest.raises(EntrackError, match=why):
        read_list(write_list(tmp_path, *rows), tmp_path / "{name}.csv", None)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--batch", "clips.csv", "--box", "1,2,3,4"], "takes SOURCE, --box"),
        (["--batch", "clips.csv"], "writes a table or a video"),
        (["--batch", "clips.csv", "--boxes", "one.csv"], "put {name} into it"),
        (["--batch", "clips.csv", "--boxes", "{name}.xml"], "written as .csv .jsonl .txt"),
        (["a.mp4"], "either --box X,Y,W,H or --select"),
        (["a.mp4", "--box", "1,2,3,4", "--workers", "2"], "are for a --batch"),
        (["--batch", "absent.csv", "--boxes", "{name}.csv"], "there is no list absent.csv"),
    ],
)
def test_calls_that_do_not_fit_are_exit_code_2(tmp_path, monkeypatch, capsys, words, why):
    monkeypatch.chdir(tmp_path)
    write_list(tmp_path, f"first.mp4,{BOX},")
    assert main(["track", *words]) == 2
    assert why in capsys.readouterr().err
