"""Box files: what stands in them, and that they are whole whatever happens."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from entrack import EntrackError, Estimate
from entrack.boxfiles import COLUMNS, BoxWriter
from entrack.video import Frame

PLAIN = Estimate(
    np.array([10.25, 20, 30, 40]), 0.875, False, None, None, np.array([0.0, 1, 2, 3]), 12.3456
)
FULL = Estimate(
    np.array([1.0, 2, 3, 4]),
    0.125,
    True,
    np.array([0.5, 1, 1.5, 2]),
    -1.25,
    np.array([0.0, 1, 2, 3]),
    5.0,
)


def frame(index: int) -> Frame:
    return Frame(index, index / 25, np.zeros((8, 8, 3), np.uint8))


def test_csv_has_a_row_for_each_frame_and_object(tmp_path: Path) -> None:
    with BoxWriter(tmp_path / "out.csv", objects=2) as out:
        out.write(frame(7), [PLAIN, FULL])
    rows = list(csv.DictReader((tmp_path / "out.csv").open()))
    assert tuple(rows[0]) == COLUMNS
    first, second = ({k: v and float(v) for k, v in row.items()} for row in rows)
    assert first == dict(
        zip(COLUMNS, [7, 0.28, 1, 10.25, 20, 30, 40, 0.875, 0, *[""] * 5, 12.35], strict=True)
    )
    assert second == dict(
        zip(COLUMNS, [7, 0.28, 2, 1, 2, 3, 4, 0.125, 1, 0.5, 1, 1.5, 2, -1.25, 5], strict=True)
    )


def test_jsonl_has_an_object_a_line(tmp_path: Path) -> None:
    with BoxWriter(tmp_path / "out.jsonl", objects=2) as out:
        out.write(frame(7), [PLAIN, FULL])
    first, second = map(json.loads, (tmp_path / "out.jsonl").read_text().splitlines())
    assert first == {
        "frame": 7,
        "time": 0.28,
        "object": 1,
        "box": [10.25, 20, 30, 40],
        "score": 0.875,
        "lost": False,
        "sigma": None,
        "entropy": None,
        "search": [0, 1, 2, 3],
        "ms": 12.35,
    }
    assert second["lost"] is True and second["sigma"] == [0.5, 1, 1.5, 2]
    assert second["object"] == 2 and second["entropy"] == -1.25


def test_otb_text_is_1_based_one_file_an_object(tmp_path: Path) -> None:
    with BoxWriter(tmp_path / "one.txt") as out:
        out.write(frame(0), [PLAIN])
    assert (tmp_path / "one.txt").read_text() == "11.250,21.000,30.000,40.000\n"
    with BoxWriter(tmp_path / "two.txt", objects=2) as out:
        out.write(frame(0), [PLAIN, FULL])
        out.write(frame(1), [PLAIN, PLAIN])
    assert out.paths == [tmp_path / "two_1.txt", tmp_path / "two_2.txt"]
    assert np.loadtxt(out.paths[0], delimiter=",").shape == (2, 4)
    np.testing.assert_array_equal(
        np.loadtxt(out.paths[1], delimiter=","), [[2, 3, 3, 4], [11.25, 21, 30, 40]]
    )


def test_rows_are_on_disk_at_once_and_named_at_the_end(tmp_path: Path) -> None:
    with BoxWriter(tmp_path / "out.csv") as out:
        out.write(frame(0), [PLAIN])
        assert [p.name for p in tmp_path.iterdir()] == ["out.csv.part"]
        assert len((tmp_path / "out.csv.part").read_text().splitlines()) == 2
    assert [p.name for p in tmp_path.iterdir()] == ["out.csv"]


def test_error_in_the_block_keeps_the_rows(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), BoxWriter(tmp_path / "out.txt") as out:
        out.write(frame(0), [PLAIN])
        raise RuntimeError
    assert len((tmp_path / "out.txt").read_text().splitlines()) == 1


def test_no_row_no_file(tmp_path: Path) -> None:
    with BoxWriter(tmp_path / "out.csv"):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", ["csv", "jsonl", "txt"])
def test_full_disk_is_one_sentence_and_leaves_whole_rows(tmp_path: Path, suffix: str) -> None:
    script = f"""
import resource, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from entrack import EntrackError
from entrack.boxfiles import BoxWriter
from test_boxfiles import FULL, frame
resource.setrlimit(resource.RLIMIT_FSIZE, (5_003, -1))  # writing beyond fails like a full disk
try:
    with BoxWriter({str(tmp_path / f"out.{suffix}")!r}) as out:
        for t in range(1000):
            out.write(frame(t), [FULL])
except EntrackError as error:
    sys.exit(str(error))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    path = tmp_path / f"out.{suffix}"
    assert done.stderr.strip() == f"cannot write {path}: File too large"
    lines = path.read_text().splitlines(keepends=True)
    assert len(lines) > 20 and all(line.endswith("\n") for line in lines)
    assert {line.count(",") for line in lines} == {lines[0].count(",")}
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_wrong_names_say_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(EntrackError, match=r"written as \.csv \.jsonl \.txt, found out\.xls"):
        BoxWriter(tmp_path / "out.xls")
    with pytest.raises(EntrackError, match=r"cannot write .*none/out\.csv: No such file"):
        BoxWriter(tmp_path / "none" / "out.csv")
