"""Protocol longterm: what is recorded, what counts, and whole evaluations."""

import json

import numpy as np
import pytest

from entrack.cli.app import main
from entrack.datasets.frames import ImageFiles
from entrack.datasets.sequence import Sequence
from entrack.errors import EntrackError
from entrack.evaluation.certainty import COLUMNS, Certainty
from entrack.evaluation.protocols import find_protocol
from entrack.evaluation.raw import Results
from entrack.tracker import Estimate
from small_data import evaluate, make_folder

BOX, OFF, GONE = [10.0, 10, 20, 20], [70.0, 70, 20, 20], [np.nan] * 4
LONGTERM = find_protocol("longterm", "folder")


def sequence(boxes, absent=None):
    flags = np.zeros(len(boxes), bool) if absent is None else np.array(absent, bool)
    return Sequence("a", ImageFiles([]), np.array(boxes, float), flags, size=(100, 100))


def said(**columns):
    length = len(next(iter(columns.values())))
    certainty = Certainty.silent(length)
    for name, values in columns.items():
        getattr(certainty, name)[:] = values
    return certainty


def values(*triples):
    scores = [LONGTERM.certain(s, np.array(b, float), c) for s, b, c in triples]
    return LONGTERM.values(scores)


def test_what_an_estimate_says_survives_the_file():
    certainty = Certainty.silent(3)
    answer = Estimate(
        np.array(BOX), 0.123456789, True, np.array([1.0, 2, 3, 4]), -1.5, np.array(OFF), 9.0
    )
    certainty.hear(1, answer)
    certainty.hear(2, np.array(BOX))  # a tracker that gives a box and nothing else
    text = certainty.write()
    assert text.splitlines()[0] == ",".join(COLUMNS)
    assert text.splitlines()[1] == text.splitlines()[3] == "," * 10
    again = Certainty.read(text, "a.score.csv")
    assert again.score[1] == pytest.approx(0.123456789, abs=1e-9)
    assert (again.lost[1], again.sigma[1].tolist()) == (1, [1, 2, 3, 4])
    np.testing.assert_array_equal(again.table[[0, 2]], np.full((2, 11), np.nan))


def test_a_file_that_is_none_is_one_sentence():
    with pytest.raises(
        EntrackError, match=r"a\.csv has a column 'certainty', expected score, lost"
    ):
        Certainty.read("certainty\n1\n", "a.csv")
    with pytest.raises(EntrackError, match=r"a\.csv, line 3: could not convert .*'high'"):
        Certainty.read("score\n0.5\nhigh\n", "a.csv")
    with pytest.raises(EntrackError, match=r"a\.csv, line 2: 1 values, expected 2"):
        Certainty.read("score,lost\n0.5\n", "a.csv")


def test_frames_are_ranked_by_the_score_or_else_by_the_decision():
    scored = said(score=[np.nan, 0.3, 0.8], lost=[np.nan, 0, 1])
    assert scored.confidence[1:].tolist() == [0.3, 0.8]
    assert said(lost=[np.nan, 0, 1]).confidence.tolist() == [1, 1, 0]
    assert Certainty.silent(2).confidence.tolist() == [1, 1]


def test_a_perfect_tracker_that_knows_is_perfect():
    truth = sequence([BOX] * 5, [0, 0, 0, 1, 1])
    sure = said(score=[np.nan, 1.0, 1.0, 0.0, 0.0])
    got = values((truth, [BOX] * 5, sure))
    for name in ("f_score", "tracking_precision", "tracking_recall", "roc_auc"):
        assert got[name] == 1
    assert got["ece"] == 0
    boast = values((truth, [BOX] * 5, said(score=[np.nan, 1.0, 1.0, 1.0, 1.0])))
    assert (boast["tracking_precision"], boast["tracking_recall"]) == (0.5, 1)
    assert (boast["roc_auc"], boast["ece"]) == (0.5, 0.5)


def test_the_frame_of_the_start_does_not_count_nor_those_before_it():
    truth = sequence([GONE, BOX, BOX, BOX])
    # On its first frames the tracker would be wrong and sure.
    sure = said(score=[1.0, 1.0, 0.9, 0.9])
    got = values((truth, [OFF, OFF, BOX, BOX], sure))
    assert (got["tracking_precision"], got["tracking_recall"]) == (1, 1)
    assert got["ece"] == pytest.approx(0.1)


def test_frames_without_a_box_are_absent():
    truth = sequence([BOX, BOX, GONE])
    got = values((truth, [BOX] * 3, said(score=[np.nan, 0.9, 0.2])))
    assert (got["f_score"], got["roc_auc"]) == (1, 1)


def test_f_is_made_of_means_over_sequences():
    good = (sequence([BOX] * 3), [BOX] * 3, said(score=[np.nan, 0.9, 0.9]))
    bad = (sequence([BOX] * 9), [BOX] + [OFF] * 8, said(score=[np.nan] + [0.9] * 8))
    got = values(good, bad)
    assert (got["tracking_precision"], got["tracking_recall"]) == (0.5, 0.5)


def test_a_tracker_that_says_nothing_has_no_area_and_no_calibration():
    got = values((sequence([BOX] * 3), [BOX, BOX, OFF], Certainty.silent(3)))
    assert got["f_score"] == 0.5
    assert np.isnan([got[n] for n in ("roc_auc", "ece", "coverage", "refound")]).all()
    decided = values((sequence([BOX] * 3), [BOX, BOX, OFF], said(lost=[np.nan, 0, 1])))
    assert decided["roc_auc"] == 1
    assert np.isnan(decided["ece"])


def test_scores_beyond_one_are_ranked_but_are_no_chances():
    got = values((sequence([BOX] * 3), [BOX, BOX, OFF], said(score=[np.nan, 7.0, 3.0])))
    assert got["roc_auc"] == 1
    assert np.isnan(got["ece"])


def test_coverage_counts_sides_where_the_target_is_seen():
    truth = sequence([BOX] * 4, [0, 0, 0, 1])
    boxes = [BOX, [11.0, 10, 19, 20], OFF, BOX]
    sigma = np.array([[np.nan] * 4, [0.5, 0.5, 0.5, 0.5], [1, 1, 1, 100], [1, 1, 1, 1]], float)
    got = values((truth, boxes, said(sigma=sigma)))
    assert got["coverage"] == pytest.approx((3 + 1) / 8)
    assert got["coverage_held"] == pytest.approx(3 / 4)


def test_returns_of_all_sequences_are_one_pool():
    truth = sequence([BOX] * 60, [0] * 5 + [1] * 15 + [0] * 40)
    late = [BOX] * 5 + [OFF] * 19 + [BOX] * 36
    never = [BOX] * 5 + [OFF] * 55
    quiet = Certainty.silent(60)
    short = (sequence([BOX] * 9), [BOX] * 9, quiet.first(9))
    got = values((truth, late, quiet), (truth, never, quiet), short)
    assert got["refound"] == 0.5
    assert got["refound_frames"] == 5
    assert np.isnan(values((truth, never, quiet))["refound_frames"])


def test_intervals_hold_the_value():
    rng = np.random.default_rng(0)
    scores = []
    for _ in range(30):
        right = rng.random(40) < 0.7
        boxes = [BOX] + [BOX if r else OFF for r in right]
        noisy = np.clip(0.3 + 0.4 * right + rng.normal(0, 0.2, 40), 0, 1)
        c = said(score=np.append(np.nan, noisy))
        scores.append(LONGTERM.certain(sequence([BOX] * 41), np.array(boxes), c))
    found, bounds = LONGTERM.values(scores), LONGTERM.intervals(scores, draws=200)
    assert set(found) == set(bounds)
    for name in ("f_score", "roc_auc"):
        low, high = bounds[name]
        assert low < found[name] < high
        assert high - low < 0.2


def test_curves_pass_through_the_numbers():
    c = said(score=[np.nan, 0.9, 0.7, 0.2, 0.1])
    truth = sequence([BOX] * 5)
    score = LONGTERM.certain(truth, np.array([BOX, BOX, BOX, OFF, OFF]), c)
    curves, found = LONGTERM.curves([score]), LONGTERM.values([score])
    assert curves["f_score"].max() == pytest.approx(found["f_score"])
    assert curves["tracking_recall"][[0, 50, 80, 100]].tolist() == [0.5, 0.5, 0.25, 0]
    assert curves["roc"].mean() == pytest.approx(found["roc_auc"])
    assert np.nansum(curves["calibration_frames"]) == pytest.approx(1)


@pytest.fixture
def data(tmp_path):
    return make_folder(tmp_path / "data")


def test_a_run_records_what_the_tracker_says(data, tmp_path):
    out = tmp_path / "out"
    (row,) = evaluate(data, "Doubting", out=out, protocols=("longterm",)).rows
    file = out / "folder" / "stub_trackers-Doubting" / "second.score.csv"
    kept = Certainty.read(file.read_text(), "")
    assert kept.score[1:].tolist() == pytest.approx([1 / (1 + t) for t in range(1, 9)], abs=1e-8)
    assert kept.lost[1:].tolist() == [0, 0, 0, 1, 1, 1, 1, 1]
    assert kept.sigma[3].tolist() == [3, 3, 3, 3]
    assert np.isnan(kept.table[0]).all() and np.isnan(kept.table[:, 6:]).all()
    assert 0 < row["f_score"] <= 1 and row["f_score_95"][0] <= row["f_score"]
    assert row["coverage"] == pytest.approx(1)  # it is off by as much as it says
    assert row["refound"] is None
    # Trackers that say nothing leave no file.
    evaluate(data, "Still", out=out)
    assert not list((out / "folder" / "stub_trackers-Still").glob("*.score.csv"))


def test_our_own_results_are_scored_again_with_what_was_said(data, tmp_path):
    out = tmp_path / "out"
    (row,) = evaluate(data, "Doubting", out=out, protocols=("longterm",)).rows
    given = f"back=raw:{out}/folder/stub_trackers-Doubting"
    (again,) = evaluate(data, given, out=out, protocols=("longterm",)).rows
    assert {n: row[n] for n in ("f_score", "roc_auc", "ece", "coverage")} == {
        n: again[n] for n in ("f_score", "roc_auc", "ece", "coverage")
    }


def test_confidences_of_vot_are_read(data, tmp_path):
    folder = tmp_path / "theirs" / "longterm" / "third"
    folder.mkdir(parents=True)
    (folder / "third_001.txt").write_text("5,10,20,20\n" * 4)
    (folder / "third_001_confidence.value").write_text("\n0.9\n0.8\n0.1\n")
    results = Results(tmp_path / "theirs")
    assert len(results.files("third")) == 1
    assert results.certainty("third", 4).score[1:].tolist() == [0.9, 0.8, 0.1]
    with pytest.raises(EntrackError, match=r"third_001_confidence.value has 4 frames, the boxes 5"):
        results.certainty("third", 5)


def test_names_that_end_in_a_number_keep_their_own_scores(tmp_path):
    for name, score in (("bag_001", "0.1"), ("bag_002", "0.2")):
        (tmp_path / f"{name}.txt").write_text("5,10,20,20\n")
        (tmp_path / f"{name}.score.csv").write_text(f"score\n{score}\n")
    results = Results(tmp_path)
    assert [results.certainty(n, 1).score[0] for n in ("bag_001", "bag_002")] == [0.1, 0.2]
    assert not results.certainty("bag_003", 1)


def test_the_command_prints_what_is_known(data, tmp_path, capsys):
    words = ["--data", f"folder:{data}", "--tracker", "stub_trackers:Doubting", "opencv:mosse"]
    out = ["--out", str(tmp_path / "out"), "--protocol", "longterm"]
    assert main(["evaluate", *words, *out]) == 0
    heading, first, second = capsys.readouterr().out.splitlines()
    # Nothing is lost here, so that there is no area under a ROC curve.
    assert "f_score" in heading and "ece" in heading and "auc" not in heading
    assert first.split()[1] == "longterm" and "–" in second
    details = json.loads(
        (tmp_path / "out/folder/stub_trackers-Doubting/scores/longterm.json").read_text()
    )
    assert len(details["curves"]["f_score"]) == 101
