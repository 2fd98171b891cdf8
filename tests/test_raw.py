"""Raw results in every layout: found, read, written, refused."""

import struct
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entrack.datasets.frames import ImageFiles
from entrack.datasets.sequence import Dataset, Sequence
from entrack.datasets.texts import parse_table
from entrack.errors import EntrackError
from entrack.evaluation import raw, trajectory, vot
from entrack.evaluation.region import Regions


def sequence(name="Human4-2", frames=3):
    return Sequence(name, ImageFiles([]), np.tile([9.0, 9, 20, 30], (frames, 1)))


def dataset(*names, origin=1):
    return Dataset("otb", Path(), names, sequence, names, origin)


TEXTS = {
    "OTB": ("Human4-2.txt", "10,10,20,30\n11,10,20,30\n12,10,20,30\n"),
    "tabs, other spelling": ("human4_2.txt", "10\t10\t20\t30\n11\t10\t20\t30\n12\t10\t20\t30\n"),
    "spaces and a folder": ("out/Human4.2.txt", "10 10 20 30\n11 10 20 30\n12 10 20 30\n\n"),
    "alias": ("Human4.txt", "10,10,20,30\n11,10,20,30\n12,10,20,30"),
    "prefix": ("uav_Human4_2.txt", "10,10,20,30\r\n11,10,20,30\r\n12,10,20,30\r\n"),
    "GOT-10k": ("Human4-2/Human4-2_001.txt", "10.000,10.000,20,30\n11,10,20,30\n12,10,20,30\n"),
}


@pytest.mark.parametrize("layout", TEXTS)
@pytest.mark.parametrize("zipped", [False, True])
def test_boxes_are_found_and_read_in_every_layout(tmp_path, layout, zipped):
    name, text = TEXTS[layout]
    place = tmp_path / "results"
    if zipped:
        place = tmp_path / "results.zip"
        with zipfile.ZipFile(place, "w") as archive:
            archive.writestr(name, text)
    else:
        (place / name).parent.mkdir(parents=True)
        (place / name).write_text(text)
    (boxes,) = raw.Results(place).boxes(sequence(), dataset("Human4-2"))
    assert boxes.tolist() == [[9, 9, 20, 30], [10, 9, 20, 30], [11, 9, 20, 30]]


def test_repetitions_and_times_of_got10k(tmp_path):
    folder = tmp_path / "a"
    folder.mkdir()
    (folder / "a_001.txt").write_text("1,1,2,2\n")
    (folder / "a_002.txt").write_text("3,1,2,2\n")
    (folder / "a_time.txt").write_text("0.5,0.5\n0.02,0.04\n0.05,nan\n")
    results = raw.Results(tmp_path)
    assert [b[0, 0] for b in results.boxes(sequence("a", 1), dataset("a"))] == [0, 2]
    assert results.times("a").tolist() == [0.02, 0.05]


def test_our_own_times_are_found_beside_the_boxes(tmp_path):
    (tmp_path / "a.txt").write_text("1,1,2,2\n")
    (tmp_path / "a.time.txt").write_text("9\n0.25\n")
    assert raw.Results(tmp_path).times("a").tolist() == [0.25]
    assert raw.Results(tmp_path).times("b").size == 0


def test_two_files_for_one_sequence_are_refused(tmp_path):
    for name in ("x/a.txt", "y/a.txt"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text("1,1,2,2\n")
    with pytest.raises(EntrackError, match=r"two results for one sequence: x/a.txt and y/a.txt"):
        raw.Results(tmp_path).files("a")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "is empty"),
        ("\n\n", "is empty"),
        ("1,2,3,4\n1,2,3\n", "line 2: 3 numbers, expected 4"),
        ("1,2,3,4,5,6,7,8\n", "8 numbers, expected 4"),
        ("1,2,3,four\n", "line 1: could not convert"),
    ],
)
def test_unreadable_results_say_where(tmp_path, text, why):
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(EntrackError, match=f"a.txt.*{why}"):
        raw.Results(tmp_path).boxes(sequence("a"), dataset("a"))


def test_results_of_another_length_are_refused_unless_allowed():
    boxes = np.zeros((2, 4))
    with pytest.raises(EntrackError, match=r"ATOM: results of 2 frames for a with 3; --allow-"):
        raw.fit_length(boxes, sequence("a"), "ATOM", allow_partial=False)
    cut, kept = raw.fit_length(boxes, sequence("a"), "ATOM", allow_partial=True)
    assert len(cut) == len(kept) == 2
    cut, kept = raw.fit_length(np.zeros((5, 4)), sequence("a"), "ATOM", allow_partial=True)
    assert len(cut) == len(kept) == 3


def test_the_one_sequence_with_longer_published_results_is_cut():
    cut, kept = raw.fit_length(np.zeros((5, 4)), sequence("monkey-17"), "x", allow_partial=False)
    assert len(cut) == len(kept) == 3


def test_what_is_written_is_read_again(tmp_path):
    boxes = np.random.default_rng(0).normal(50, 30, (3, 4))
    (tmp_path / "a.txt").write_text(raw.write_boxes(boxes, 1))
    (again,) = raw.Results(tmp_path).boxes(sequence("a"), dataset("a"))
    np.testing.assert_allclose(again, boxes, atol=5e-5)


RUN = "1\n1.5,2.25,10,20.5\n0,0,5,0,5,5,0,5\n2\n0\n0\n0\n0\n1\n"


def test_vot_text_round_trip():
    run = trajectory.read_text(RUN, "bag_001.txt")
    assert run.codes.tolist() == [1, -1, -1, 2, 0, 0, 0, 0, 1]
    assert run.regions.upright.tolist()[1:3] == [True, False]
    again = trajectory.read_text(trajectory.write_text(run), "bag_001.txt")
    np.testing.assert_array_equal(again.regions.corners, run.regions.corners)
    assert (again.codes == run.codes).all()


def test_vot_binary_round_trip_and_bytes():
    run = trajectory.read_text(RUN, "bag_001.txt")
    data = trajectory.write_binary(run)
    assert data[:6] == struct.pack("<hI", 1, 9)
    assert data[6:11] == struct.pack("<BI", 0, 1)
    assert data[11:28] == struct.pack("<Bffff", 1, 1.5, 2.25, 10, 20.5)
    again = trajectory.read_binary(data, "bag_001.bin")
    np.testing.assert_array_equal(again.regions.corners, run.regions.corners)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "ends in the middle"),
        (struct.pack("<hI", 1, 2) + struct.pack("<BI", 0, 1), "ends in the middle"),
        (struct.pack("<hI", 7, 0), "no binary trajectory of version 1"),
        (struct.pack("<hIB", 1, 1, 3), "holds masks or points"),
        (struct.pack("<hI", 1, 0), "is empty"),
        (struct.pack("<hI", 1, 1) + struct.pack("<BH6f", 2, 3, *range(6)), "6 numbers"),
    ],
)
def test_broken_binary_trajectories_say_what_is_wrong(data, why):
    with pytest.raises(EntrackError, match=f"bag_001.bin.*{why}"):
        trajectory.read_binary(data, "bag_001.bin")


@pytest.mark.parametrize("line", ["1,2", "3", "a,b,c,d", "1,2,3,4,5"])
def test_lines_that_are_no_region_are_refused(line):
    with pytest.raises(EntrackError, match=r"bag_001\.txt"):
        trajectory.read_text(f"1\n{line}\n", "bag_001.txt")


@given(st.text("0123456789.,-enaif \t\n\r;m"))
def test_any_text_is_read_or_refused_with_our_error(text):
    with suppress(EntrackError):
        assert all(len(row) == 4 for row in parse_table(text, [4], "x"))
    with suppress(EntrackError):
        assert len(trajectory.read_text(text, "x")) <= len(text)


@given(st.binary().map(lambda tail: struct.pack("<hI", 1, 3) + tail) | st.binary())
def test_any_bytes_are_read_or_refused_with_our_error(data):
    with suppress(EntrackError):
        assert len(trajectory.read_binary(data, "x")) <= len(data)


def test_trajectories_are_found_in_vots_layout(tmp_path):
    folder = tmp_path / "baseline" / "bag"
    folder.mkdir(parents=True)
    run = trajectory.read_text(RUN, "")
    (folder / "bag_001.txt").write_text(RUN)
    (folder / "bag_002.bin").write_bytes(trajectory.write_binary(run))
    (folder / "bag_001_time.value").write_text("0.5\n0.1\n\n0.2\n")
    results = raw.Results(tmp_path)
    assert [len(r) for r in results.trajectories("bag")] == [9, 9]
    assert results.times("bag").tolist() == [0.1, 0.2]


def test_a_run_without_boxes_is_a_trajectory_of_codes():
    run = vot.Trajectory(np.array([1, 2]), Regions(np.full((2, 8), np.nan), np.zeros(2, bool)))
    assert trajectory.write_text(run) == "1\n2\n"
