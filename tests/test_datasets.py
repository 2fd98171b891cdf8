"""Every format, read from a few files made here; the real ones where they are beside us."""

import json
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from entrack.datasets import lists, open_dataset
from entrack.datasets.frames import NumberedImages, VideoFrames
from entrack.datasets.texts import parse_table
from entrack.errors import EntrackError
from entrack.video import VideoWriter


def pictures(folder: Path, numbers, form="{:04d}.jpg"):
    """Pictures whose grey level is their number."""
    folder.mkdir(parents=True, exist_ok=True)
    for n in numbers:
        cv2.imwrite(str(folder / form.format(n)), np.full((48, 64, 3), n, np.uint8))


def text(path: Path, content: str):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)


def levels(sequence):
    return [round(float(frame.mean())) for frame in sequence.frames]


def test_otb_ranges_separators_and_one_based_boxes(tmp_path):
    # Tiger1 begins with its sixth picture; its file has boxes for the first five too.
    pictures(tmp_path / "Tiger1/img", range(1, 9))
    text(tmp_path / "Tiger1/groundtruth_rect.txt", "".join(f"{n}\t2\t5\t6\n" for n in range(1, 9)))
    text(tmp_path / "Skating2/groundtruth_rect.2.txt", "3,4,5,6\n0,0,0,0\n")
    dataset = open_dataset(f"otb:{tmp_path}")
    assert dataset.names == ("Skating2-2", "Tiger1")
    assert (len(dataset.official), len(dataset.missing)) == (100, 98)
    skating, tiger = dataset
    assert levels(tiger) == [6, 7, 8]
    assert tiger.boxes[0].tolist() == [5, 1, 5, 6]
    assert skating.boxes[0].tolist() == [2, 3, 5, 6]
    assert np.isnan(skating.boxes[1]).all()


def test_official_lists():
    otb, uav = lists.otb(), lists.uav123()
    assert (len(otb), len({t.folder for t in otb.values()})) == (100, 98)
    assert sum(t.frames for t in otb.values()) == 59_035
    assert otb["David"][1:3] == (300, 770)
    assert otb["Human4-2"].truth == "groundtruth_rect.2.txt"
    assert otb["Tiger1"].skip == 5
    assert (len(uav), len({t.folder for t in uav.values()})) == (123, 91)
    assert uav["bird1_2"][:3] == ("bird1", 775, 1477)
    assert lists.uav123_10fps()["bird1_2"][1:3] == (259, 493)
    test, train = lists.lasot_test(), lists.lasot_train()
    assert (len(test), len(train), set(test) & set(train)) == (280, 1120, set())
    assert lists.lasot_attributes()[0] == "IV"
    assert len(lists.lasot_attributes()) == 14
    assert all(len(set(lists.vot(year))) == 60 for year in lists.VOT_YEARS)
    assert set(lists.sources()) == {"otb100", "uav123", "lasot", "vot"}


@pytest.mark.parametrize(("version", "first"), [("UAV123", 775), ("UAV123_10fps", 259)])
def test_uav123_by_start_and_end(tmp_path, version, first):
    folder = tmp_path / "data_seq" / version / "bird1"
    folder.mkdir(parents=True)
    for n in (first, first + 1):
        cv2.imwrite(str(folder / f"{n:06d}.jpg"), np.full((8, 8, 3), n % 100, np.uint8))
    text(tmp_path / "anno" / version / "bird1_2.txt", "2,3,4,5\nNaN,NaN,NaN,NaN\n")
    (bird,) = open_dataset(f"uav123:{tmp_path}")
    assert bird.name == "bird1_2"
    assert levels(bird) == [first % 100, first % 100 + 1]
    assert bird.boxes[0].tolist() == [1, 2, 4, 5]
    assert np.isnan(bird.boxes[1]).all()


def test_lasot_flags_of_absence(tmp_path):
    folder = tmp_path / "airplane" / "airplane-1"
    pictures(folder / "img", range(1, 5), "{:08d}.jpg")
    text(folder / "groundtruth.txt", "1,1,5,5\n" * 4)
    text(folder / "full_occlusion.txt", "0,1,0,0")
    text(folder / "out_of_view.txt", "0\n0\n0\n1\n")
    dataset = open_dataset(f"lasot:{tmp_path}")
    assert dataset[0].absent.tolist() == [False, True, False, True]
    assert levels(dataset[0]) == [1, 2, 3, 4]
    assert len(dataset.missing) == 279
    text(folder / "out_of_view.txt", "0,0,0")
    with pytest.raises(EntrackError, match=r"out_of_view.txt has 3 flags, expected 4 of 0 or 1"):
        dataset[0]


def test_lasot_annotations_of_its_toolkit_in_a_zip_file(tmp_path):
    with zipfile.ZipFile(tmp_path / "annos.zip", "w") as archive:
        archive.writestr("annos/airplane-1.txt", "1,1,5,5\n" * 2)
        archive.writestr("annos/absent/airplane-1.txt", "0\n1\n")
        archive.writestr("annos/att/airplane-1.txt", "1,0,0,0,0,0,0,0,0,0,0,0,0,1")
    (airplane,) = open_dataset(f"lasot:{tmp_path}/annos.zip")
    assert airplane.attributes == ("IV", "ARC")
    assert airplane.absent.tolist() == [False, True]
    assert len(airplane.frames) == 0


def test_vot_corners_boxes_and_size(tmp_path):
    folder = tmp_path / "sequences" / "bag"
    pictures(folder / "color", range(1, 3), "{:08d}.jpg")
    text(folder / "groundtruth.txt", "10,20,40,20,40,60,10,60\n11,20,41,20,41,60,11,60\n")
    text(folder / "sequence", "width=64\nheight=48\n")
    text(tmp_path / "sequences" / "list.txt", "bag\n")
    dataset = open_dataset(f"vot2018:{tmp_path}")
    (bag,) = dataset
    assert bag.boxes[0].tolist() == [10, 20, 30, 40]
    assert bag.polygons[1, 0] == 11
    assert bag.picture_size() == (64, 48)
    assert levels(bag) == [1, 2]
    assert len(dataset.official) == 60


@pytest.mark.parametrize("split", ["", "val"])
def test_got10k_cover_and_resolution(tmp_path, split):
    folder = tmp_path / split / "clip"
    pictures(folder, range(1, 4), "{:08d}.jpg")
    text(folder / "groundtruth.txt", "1,1,5,5\n1,1,5,5\n0,0,0,0\n")
    text(folder / "absence.label", "0\n1\n1\n")
    text(folder / "meta_info.ini", "[METAINFO]\nresolution: (640, 360)\n")
    text(tmp_path / split / "list.txt", "clip\nother\n")
    dataset = open_dataset(f"got10k:{tmp_path}")
    (clip,) = dataset
    assert dataset.missing == ("other",)
    assert clip.absent.tolist() == [False, True, True]
    assert clip.picture_size() == (640, 360)
    text(folder / "cover.label", "8\n3\n0\n")
    assert dataset[0].absent.tolist() == [False, False, True]


def test_folder_of_videos_and_pictures(tmp_path):
    with VideoWriter(tmp_path / "film.mp4", 25) as video:
        for n in range(6):
            video.write(np.full((48, 64, 3), 40 * n, np.uint8), n / 25)
    text(tmp_path / "film.txt", "1,2,3,4\n" * 5 + "nan,nan,nan,nan\n")
    pictures(tmp_path / "still", range(3))
    text(tmp_path / "still.txt", "1 2 3 4\n" * 3)
    text(tmp_path / "notes.txt", "no video of this name\n")
    dataset = open_dataset(f"folder:{tmp_path}")
    assert dataset.names == ("film", "still")
    film = dataset[0]
    assert film.absent.tolist() == [False] * 5 + [True]
    assert np.abs(np.array(levels(film)) - 40 * np.arange(6)).max() < 6
    back = [round(float(film.frames[i].mean())) for i in (4, 1, 1, 3, -1)]
    assert np.abs(np.array(back) - [160, 40, 40, 120, 200]).max() < 6
    with pytest.raises(IndexError):
        film.frames[6]


def test_a_video_with_fewer_frames_than_boxes_says_so(tmp_path):
    with VideoWriter(tmp_path / "film.mp4", 25) as video:
        for n in range(3):
            video.write(np.zeros((48, 64, 3), np.uint8), n / 25)
    frames = VideoFrames(tmp_path / "film.mp4", 5)
    with pytest.raises(EntrackError, match=r"film.mp4 has 3 frames, expected 5"):
        frames[4]
    assert frames[2].shape == (48, 64, 3)
    (tmp_path / "film.mp4").write_bytes(b"no video")
    with pytest.raises(EntrackError, match="cannot read the video"):
        VideoFrames(tmp_path / "film.mp4", 5)[0]


def test_missing_and_broken_pictures_are_named(tmp_path):
    pictures(tmp_path, [1, 3])
    frames = NumberedImages(tmp_path, 3, 1)
    assert frames[2].shape == (48, 64, 3)
    with pytest.raises(EntrackError, match=r"0002.jpg does not exist"):
        frames[1]
    (tmp_path / "0003.jpg").write_bytes(b"")
    with pytest.raises(EntrackError, match=r"0003.jpg is not a picture that can be read"):
        frames[2]


def test_ground_truth_alone_from_a_json_file(tmp_path):
    path = tmp_path / "truth.json"
    rows = {"gt_rect": [[1, 1, 5, 5], [0, 0, 0, 0]], "attr": ["SV"]}
    path.write_text(json.dumps({"human4_2": rows, "mine": rows}))
    first, second = open_dataset(f"otb:{path}")
    assert (first.name, second.name) == ("Human4-2", "mine")
    assert first.boxes[0].tolist() == [0, 0, 5, 5]
    assert first.attributes == ("SV",)
    assert first.picture_size() is None


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        '{"a": 1}',
        '{"a": {"gt_rect": "x"}}',
        '{"a": {}}',
        '{"a": {"gt_rect": [[1,1,2,2]], "absent": "x"}}',
        '{"a": {"gt_rect": [[1,1,2,2]], "attr": 5}}',
        '{"a": {"gt_rect": [[1,1,2,2]], "absent": [1, 1]}}',
        '{"a": {"gt_rect": []}}',
    ],
)
def test_other_json_files_are_refused(tmp_path, content):
    (tmp_path / "truth.json").write_text(content)
    with pytest.raises(EntrackError, match=r"truth\.json|2 absence flags for 1 boxes"):
        list(open_dataset(f"otb:{tmp_path}/truth.json"))


@pytest.mark.parametrize("form", ["otb", "uav123", "lasot", "vot2016", "got10k", "folder"])
def test_a_folder_without_such_sequences_says_what_was_looked_for(tmp_path, form):
    with pytest.raises(EntrackError, match=rf"in {tmp_path}: looked for {tmp_path}"):
        open_dataset(f"{form}:{tmp_path}")
    with pytest.raises(EntrackError, match=r"there is no folder"):
        open_dataset(f"{form}:{tmp_path}/nowhere")


def test_tables_take_every_separator_and_tell_the_line_of_an_error():
    for content in ("1,2\n3,4\n", "1\t2\r\n3\t4", "\ufeff1 2\n3 4\n\n", "1;2\n3;4"):
        assert parse_table(content, [2], "x").tolist() == [[1, 2], [3, 4]]
    with pytest.raises(EntrackError, match=r"x, line 2: 1 numbers, expected 2"):
        parse_table("1,2\n3\n", [2], "x")
    with pytest.raises(EntrackError, match=r"x, line 1: 8 numbers, expected 4 \(x, y, w, h\)"):
        parse_table("1,2,3,4,5,6,7,8\n", [4], "x")


@pytest.mark.shared
def test_the_data_beside_the_repository_opens(shared):
    counts = {"otb": (13, 3326), "uav123": (5, 547), "lasot": (1, 240)}
    for form, (sequences, frames) in counts.items():
        dataset = open_dataset(f"{form}:{shared}/data/{form}")
        assert (len(dataset), sum(map(len, dataset))) == (sequences, frames)
    train = open_dataset(f"folder:{shared}/data/train")
    assert (len(train), sum(map(len, train))) == (48, 8340)
    assert len(open_dataset(f"vot2016:{shared}/data/vot")) == 2
