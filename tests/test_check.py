"""`entrack data`: what it finds, and what it says of it."""

import json

import cv2
import numpy as np
import pytest

from entrack.cli.app import main
from entrack.datasets import open_dataset
from entrack.datasets.check import check


@pytest.fixture
def lasot(tmp_path):
    """One complete sequence of ten pictures."""
    folder = tmp_path / "airplane" / "airplane-1"
    (folder / "img").mkdir(parents=True)
    picture = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    for n in range(1, 11):
        cv2.imwrite(str(folder / "img" / f"{n:08d}.jpg"), picture)
    (folder / "groundtruth.txt").write_text("5,5,20,20\n" * 10)
    for flags in ("full_occlusion.txt", "out_of_view.txt"):
        (folder / flags).write_text(",".join("0" * 10))
    return tmp_path


def findings(root, form="lasot", **options):
    found = check(open_dataset(f"{form}:{root}"), **options)
    return [f"{f.kind}: {f.text}" for f in found if f.sequence == "airplane-1"]


def rows(root, content):
    (root / "airplane/airplane-1/groundtruth.txt").write_text(content)


def picture(root, number):
    return root / "airplane/airplane-1/img" / f"{number:08d}.jpg"


def test_nothing_is_wrong_with_a_complete_sequence(lasot):
    assert findings(lasot) == findings(lasot, every_frame=True) == []


def test_missing_sequences_say_what_was_looked_for(lasot):
    missing = [f for f in check(open_dataset(f"lasot:{lasot}")) if f.kind == "missing"]
    assert len(missing) == 279
    assert f"there is no {lasot}/airplane/airplane-9/groundtruth.txt (not" in str(missing[0])


def test_gaps_and_counts_of_pictures(lasot):
    picture(lasot, 4).unlink()
    (found,) = findings(lasot)
    assert found == f"error: 1 of 10 pictures missing: {picture(lasot, 4)}"
    for n in range(1, 11):
        picture(lasot, n).unlink(missing_ok=True)
    (found,) = findings(lasot)
    assert found.startswith("error: no pictures in ")
    assert found.endswith("looked for 00000001.jpg to 00000010.jpg")


def test_more_pictures_than_boxes(lasot):
    rows(lasot, "5,5,20,20\n" * 8)
    for flags in ("full_occlusion.txt", "out_of_view.txt"):
        (lasot / "airplane/airplane-1" / flags).write_text(",".join("0" * 8))
    (found,) = findings(lasot)
    assert found.endswith("img has 2 more pictures than there are boxes")


def test_pictures_that_are_cut_off(lasot):
    path = picture(lasot, 5)
    path.write_bytes(path.read_bytes()[:-80])
    assert findings(lasot) == [f"error: unreadable pictures: {path}"]
    picture(lasot, 10).write_bytes(b"")
    assert str(picture(lasot, 10)) in findings(lasot)[0]


def test_pictures_broken_inside_need_a_look_at_every_frame(lasot):
    path = picture(lasot, 5)
    data = path.read_bytes()
    path.write_bytes(data[:2] + bytes(len(data) - 4) + data[-2:])
    assert findings(lasot) == []
    assert findings(lasot, every_frame=True) == [f"error: unreadable pictures: {path}"]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("5,5,20,20\n" * 7 + "0,0,0,0\n" * 3, "note: zero or NaN boxes in frames 8–10"),
        ("nan,nan,nan,nan\n" * 10, "unusable: no frame has a valid box"),
        ("", "unusable: .* is empty, expected one line a frame"),
        ("5,5,20\n", "unusable: .*line 1: 3 numbers, expected 4"),
        ("1,1,2,1,2,2,1,2\n" * 10, "unusable: .*8 numbers, expected 4"),
        ("5,5,20,20\n" * 9 + "5,five,20,20\n", "unusable: .*line 10: could not convert.*'five'"),
        ("5,5,20,20\n" * 9 + "90,5,5,5\n", "note: boxes outside the 64×48 picture in frames 10"),
        ("0,5,20,20\n" * 10, "note: boxes look as if they counted pixels from 0; lasot counts"),
    ],
)
def test_boxes(lasot, content, expected):
    import re

    rows(lasot, content)
    (found,) = findings(lasot)
    assert re.match(expected, found)


def test_boxes_of_a_folder_that_count_from_one(lasot):
    folder = lasot / "mine"
    folder.mkdir()
    (lasot / "airplane/airplane-1/img").rename(folder / "airplane-1")
    (folder / "airplane-1.txt").write_text("1,1,20,20\n" * 9 + "45,29,20,20\n")
    (found,) = findings(folder, "folder")
    assert "counted pixels from 1; folder counts from 0" in found


def test_the_official_length(tmp_path):
    (tmp_path / "Deer" / "img").mkdir(parents=True)
    for n in range(1, 41):
        cv2.imwrite(str(tmp_path / f"Deer/img/{n:04d}.jpg"), np.zeros((8, 8, 3), np.uint8))
    (tmp_path / "Deer" / "groundtruth_rect.txt").write_text("1,1,4,4\n" * 40)
    found = [f.text for f in check(open_dataset(f"otb:{tmp_path}")) if f.sequence == "Deer"]
    assert found == ["40 boxes, the official list has 71"]


def test_the_command_tells_what_is_scored(lasot, capsys):
    picture(lasot, 4).unlink()
    assert main(["data", "check", f"lasot:{lasot}"]) == 1
    said = capsys.readouterr()
    assert "error: airplane-1: 1 of 10 pictures missing" in said.out
    assert said.out.endswith("1 of 280 sequences of lasot will be scored\n")
    assert "280 sequences" in said.err
    assert main(["data", "check", f"lasot:{lasot}", "--json"]) == 1
    assert len(json.loads(capsys.readouterr().out)["findings"]) == 280
    assert main(["data", "check", f"lasot:{lasot}/nowhere"]) == 2


def test_the_command_is_content_with_what_is_complete(lasot, capsys):
    folder = lasot / "mine"
    folder.mkdir()
    (lasot / "airplane/airplane-1/img").rename(folder / "a")
    (folder / "a.txt").write_text("4,4,20,20\n" * 10)
    assert main(["data", "check", f"folder:{folder}"]) == 0
    assert capsys.readouterr().out == "1 of 1 sequences of folder will be scored\n"


def test_formats_are_listed(capsys):
    assert main(["data", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [
        "otb", "uav123", "lasot", "vot2016", "vot2018", "vot2019", "got10k", "folder", "synthetic",
    ]  # fmt: skip
    assert "100 targets" in lines[0]


def test_synthetic_sequences_are_made_and_found_complete(tmp_path, capsys):
    words = ["--count", "2", "--length", "4", "--show", "scale", "rotation", "--seed", "3"]
    assert main(["data", "synth", str(tmp_path), *words]) == 0
    assert capsys.readouterr().out == f"2 sequences in {tmp_path}\n"
    assert main(["data", "check", f"synthetic:{tmp_path}"]) == 0
    assert [len(s) for s in open_dataset(f"synthetic:{tmp_path}")] == [4, 4]
    assert main(["data", "synth", str(tmp_path), "--show", "beauty"]) == 2
