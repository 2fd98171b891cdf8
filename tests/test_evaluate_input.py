"""What `entrack evaluate` says of datasets, results and calls that are not as they should be."""

import json
from pathlib import Path

import pytest

from entrack.cli.app import main
from entrack.errors import EntrackError
from entrack.evaluation.run import Evaluation
from small_data import LENGTHS, Ears, evaluate, make_folder


@pytest.fixture
def data(tmp_path):
    return make_folder(tmp_path / "data")


def refused(tmp_path, data, tracker, *words):
    return main(
        ["evaluate", "--data", data, "--tracker", tracker, "--out", str(tmp_path / "out"), *words]
    )


def results(tmp_path, name="ours", **lengths):
    folder = tmp_path / name
    folder.mkdir()
    for sequence, length in (LENGTHS | lengths).items():
        if length:
            (folder / f"{sequence}.txt").write_text("5,10,20,20\n" * length)
    return f"raw:{folder}"


def test_given_results_are_scored_without_pictures(data, tmp_path, capsys):
    for picture in data.rglob("*.png"):
        picture.unlink()
    assert refused(tmp_path, f"folder:{data}", results(tmp_path), "--json") == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["sequences"] == 3


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        ({"second": 5}, "results of 5 frames for second with 9; --allow-partial"),
        ({"second": 12}, "results of 12 frames for second with 9"),
        ({"second": 0}, "no results for 1 of 3 sequences of folder: second; --allow-partial"),
    ],
)
def test_results_of_another_length_are_refused_unless_allowed(data, tmp_path, capsys, bad, why):
    given = results(tmp_path, **bad)
    assert refused(tmp_path, f"folder:{data}", given) == 2
    assert why in capsys.readouterr().err
    assert refused(tmp_path, f"folder:{data}", given, "--allow-partial", "--json") == 0
    (row,) = json.loads(capsys.readouterr().out)
    if bad["second"]:
        assert row["partial"] == {"second": f"{bad['second']} results for 9 frames"}
    else:
        assert row["sequences"] == 2


def test_an_empty_result_is_refused(data, tmp_path, capsys):
    given = results(tmp_path)
    Path(given[4:], "first.txt").write_text("")
    assert refused(tmp_path, f"folder:{data}", given) == 2
    assert "first.txt is empty" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("dataset", "tracker", "words", "why"),
    [
        ("folder:nowhere", "opencv:mosse", [], "there is no folder or file nowhere"),
        ("otb:DATA", "opencv:mosse", [], "no otb sequence in DATA: looked for DATA/Basketball/"),
        ("ootb:DATA", "opencv:mosse", [], "FORMAT one of otb, uav123"),
        ("DATA", "opencv:mosse", [], "a dataset is FORMAT:DIR"),
        ("folder:DATA", "opencv:sift", [], "OpenCV has no tracker sift"),
        ("folder:DATA", "opencv:nano", [], "opencv:nano needs its networks"),
        ("folder:DATA", "opencv:nano:DATA", [], "0 files *backbone*.onnx in DATA"),
        ("folder:DATA", "nowhere:Tracker", [], "cannot import nowhere"),
        ("folder:DATA", "stub_trackers:Nobody", [], "no attribute 'Nobody'"),
        ("folder:DATA", "stub_trackers:Halves", [], "has no method update"),
        ("folder:DATA", "raw:nowhere", [], "there is no folder or file nowhere"),
        ("folder:DATA", "nothing", [], "no model nothing"),
        ("folder:DATA", "opencv:mosse", ["--protocol", "vot2016"], "does not fit folder"),
        ("folder:DATA", "opencv:mosse", ["--protocol", "ope"], "no protocol ope"),
        ("folder:DATA", "opencv:mosse", ["--export", "vot"], "no layout vot"),
    ],
)
def test_calls_that_cannot_work_say_why(data, tmp_path, capsys, dataset, tracker, words, why):
    def place(text):
        return text.replace("DATA", str(data))

    assert refused(tmp_path, place(dataset), place(tracker), *words) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert place(why) in error


def test_two_trackers_or_datasets_of_one_name_are_refused(data, tmp_path):
    (tmp_path / "a").mkdir()
    given = results(tmp_path), results(tmp_path / "a")
    with pytest.raises(EntrackError, match=r"two trackers are called ours: .* NAME=TRACKER"):
        evaluate(data, *given, out=tmp_path / "out")
    named = evaluate(data, given[0], f"theirs={given[1]}", out=tmp_path / "out")
    assert [row["tracker"] for row in named.rows] == ["ours", "theirs"]
    with pytest.raises(EntrackError, match="two datasets are called folder"):
        Evaluation.prepare([f"folder:{data}"] * 2, [given[0]], tmp_path / "out")


def test_ground_truth_of_eight_numbers_is_left_out_and_told_of(data, tmp_path):
    (data / "first.txt").write_text("1,1,5,1,5,5,1,5\n" * 6)
    ears = Ears()
    (row,) = evaluate(data, "Still", out=tmp_path / "out", watcher=ears).rows
    assert row["sequences"] == 2
    assert "first.txt, line 1: 8 numbers, expected 4" in ears.heard[0]


def test_a_sequence_without_a_valid_frame_is_left_out_and_told_of(data, tmp_path):
    (data / "first.txt").write_text("nan,nan,nan,nan\n" * 6)
    ears = Ears()
    (row,) = evaluate(data, "Still", out=tmp_path / "out", watcher=ears).rows
    assert row["sequences"] == 2
    assert "first has no frame with a valid box" in ears.heard[0]
    for name in ("second", "third"):
        (data / f"{name}.txt").write_text("0,0,0,0\n")
    with pytest.raises(EntrackError, match="no sequence can be scored"):
        evaluate(data, "Still", out=tmp_path / "out")


def test_tracking_begins_with_the_first_valid_box(data, tmp_path):
    text = (data / "first.txt").read_text().splitlines()
    (data / "first.txt").write_text("\n".join(["nan,nan,nan,nan"] * 2 + text[2:]) + "\n")
    evaluate(data, "Still", out=tmp_path / "out")
    lines = (tmp_path / "out/folder/stub_trackers-Still/first.txt").read_text().splitlines()
    assert lines[:3] == ["nan,nan,nan,nan"] * 2 + ["7.0000,10.0000,20.0000,20.0000"]


def test_a_half_copied_dataset_is_scored_as_far_as_it_goes(data, tmp_path):
    for picture in sorted((data / "second").iterdir())[4:]:
        picture.unlink()
    outcome = evaluate(data, "Still", out=tmp_path / "out")
    assert outcome.rows[0]["sequences"] == 2
    assert "4 pictures for 9 boxes" in str(outcome.failed)


def test_results_of_another_model_are_not_mixed(data, tmp_path):
    out = tmp_path / "out"
    evaluate(data, "t=opencv:mosse", out=out)
    path = out / "folder" / "t" / "run.json"
    run = json.loads(path.read_text())
    path.write_text(json.dumps(run | {"version": "opencv 1.0"}))
    with pytest.raises(EntrackError, match=r"version opencv 1.0, now it is .* another --out"):
        evaluate(data, "t=opencv:mosse", out=out)
