"""Whole evaluations of stub trackers on datasets of a few pictures."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from entrack.cli.app import main
from entrack.evaluation.run import Evaluation, Options
from small_data import LENGTHS, Ears, black_out, evaluate, make_folder, make_vot


@pytest.fixture
def data(tmp_path):
    return make_folder(tmp_path / "data")


@pytest.fixture
def vot(tmp_path):
    return make_vot(tmp_path / "vot")


def files(folder: Path):
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*.txt")}


def test_a_run_leaves_boxes_times_and_scores(data, tmp_path):
    out = tmp_path / "out"
    (row,) = evaluate(data, "Still", out=out).rows
    folder = out / "folder" / "stub_trackers-Still"
    assert (folder / "first.txt").read_text().splitlines() == ["5.0000,10.0000,20.0000,20.0000"] * 6
    assert len((folder / "first.time.txt").read_text().splitlines()) == 6
    assert json.loads((out / "scores.json").read_text()) == [row]
    assert (row["sequences"], row["frames"]) == (3, 19)
    # Overlap after a drift of d pixels is (20 − d) / (20 + d).
    over_half = [sum((20 - d) / (20 + d) > 0.5 for d in range(n)) / n for n in LENGTHS.values()]
    assert row["op50"] == pytest.approx(np.mean(over_half), abs=1e-6)
    assert row["fps_mean"] > 0
    low, high = row["auc_95"]
    assert low <= row["auc"] <= high
    assert row["machine"].endswith(sys.platform.capitalize())
    details = json.loads((folder / "scores" / "otb.json").read_text())
    assert len(details["curves"]["success"]) == 21
    assert list(details["per_sequence"]) == ["first", "second", "third"]


def test_results_are_identical_for_any_number_of_workers(data, tmp_path):
    outs = []
    for workers in (1, 2):
        out = tmp_path / str(workers)
        evaluate(data, "Drift", "opencv:mil", out=out, workers=workers)
        outs.append({n: b for n, b in files(out).items() if "time" not in n})
    assert outs[0] == outs[1]


def test_what_is_done_is_not_done_again(data, tmp_path):
    out = tmp_path / "out"
    evaluate(data, "Still", out=out)
    path = out / "folder" / "stub_trackers-Still" / "first.txt"
    path.write_text(path.read_text().replace("5.0000", "6.0000"))
    (out / "folder" / "stub_trackers-Still" / "third.txt").unlink()
    changed = path.stat().st_mtime_ns
    (row,) = evaluate(data, "Still", out=out).rows
    assert path.stat().st_mtime_ns == changed
    assert row["sequences"] == 3


def test_results_of_another_length_are_made_again(data, tmp_path):
    out = tmp_path / "out"
    evaluate(data, "Still", out=out)
    path = out / "folder" / "stub_trackers-Still" / "first.txt"
    path.write_text("5,10,20,20\n")
    (row,) = evaluate(data, "Still", out=out).rows
    assert len(path.read_text().splitlines()) == 6
    assert row["frames"] == 19


def test_rows_of_an_earlier_call_stay(data, tmp_path):
    out = tmp_path / "out"
    evaluate(data, "Still", out=out)
    evaluate(data, "Object", out=out, protocols=("otb", "got10k"))
    rows = json.loads((out / "scores.json").read_text())
    assert [(r["tracker"][14:], r["protocol"]) for r in rows] == [
        ("Still", "otb"), ("Object", "otb"), ("Object", "got10k"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("tracker", "why"), [("Crash", "ZeroDivisionError: dark"), ("Words", "expected a box")]
)
def test_a_crashing_tracker_marks_its_sequence_and_the_rest_go_on(data, tmp_path, tracker, why):
    black_out(data, "second")
    ears = Ears()
    outcome = evaluate(data, tracker, "Still", out=tmp_path / "out", watcher=ears, workers=2)
    folder = tmp_path / "out" / "folder" / f"stub_trackers-{tracker}"
    failed = (folder / "second.failed.txt").read_text()
    assert "failed at frame" in failed
    assert why in failed
    assert not (folder / "second.txt").exists()
    assert any(f"{tracker}/second failed" in message for message in ears.heard)
    rows = {row["tracker"]: row for row in outcome.rows}
    assert rows["stub_trackers:Still"]["sequences"] == 3
    assert rows["stub_trackers:Still"]["failed"] == {}
    if tracker == "Crash":
        row = rows["stub_trackers:Crash"]
        assert (row["sequences"], list(row["failed"])) == (2, ["second"])


def test_a_failed_sequence_is_tried_again_by_the_next_call(data, tmp_path):
    black_out(data, "second")
    out = tmp_path / "out"
    evaluate(data, "Crash", out=out)
    (data / "second" / "0002.png").write_bytes((data / "first" / "0002.png").read_bytes())
    (row,) = evaluate(data, "Crash", out=out).rows
    assert row["failed"] == {}
    assert row["sequences"] == 3
    assert not list(out.rglob("*.failed.txt"))


@pytest.mark.parametrize(("lives", "sequences"), [(2, 3), (99, 2)])
def test_a_killed_worker_is_replaced(data, tmp_path, monkeypatch, lives, sequences):
    monkeypatch.setenv("STUB_FOLDER", str(tmp_path))
    (tmp_path / "lives").write_text(str(lives))
    black_out(data, "first")
    outcome = evaluate(data, "Deadly", out=tmp_path / "out", workers=2)
    assert outcome.rows[0]["sequences"] == sequences
    assert ("killed by SIGKILL, 3 times" in str(outcome.failed)) == (sequences == 2)


def test_nan_and_negative_boxes_are_kept_and_score_as_the_frame_before(data, tmp_path):
    (row,) = evaluate(data, "Sick", out=tmp_path / "out").rows
    (still,) = evaluate(data, "Still", out=tmp_path / "other").rows
    assert row["auc"] == still["auc"]
    text = (tmp_path / "out" / "folder" / "stub_trackers-Sick" / "first.txt").read_text()
    assert text.splitlines()[1] == "nan,0.0000,1.0000,1.0000"


def test_supervised_runs_start_again_five_frames_after_a_failure(vot, tmp_path):
    specs = [f"vot2016:{vot}"], ["stub_trackers:Still"]
    options = Options(("vot2016", "vot-toolkit"))
    rows = Evaluation.prepare(*specs, tmp_path / "out", options).run().rows
    runs = sorted((tmp_path / "out" / "vot2016").rglob("bag_0*.txt"))
    assert [p.name for p in runs] == ["bag_001.txt", "bag_002.txt", "bag_003.txt"]
    lines = runs[0].read_text().splitlines()
    assert [i for i, line in enumerate(lines) if "," not in line] == [0, *range(12, 18)]
    assert lines[12:18] == ["2", "0", "0", "0", "0", "1"]
    assert [row["robustness"] for row in rows] == [pytest.approx(100 / 24, abs=1e-6), 1]
    assert rows[0]["accuracy"] == 1
    mtime = runs[0].stat().st_mtime_ns
    Evaluation.prepare(*specs, tmp_path / "out", options).run()
    assert runs[0].stat().st_mtime_ns == mtime


@pytest.mark.parametrize(
    ("protocols", "failures"),
    [(("vot-toolkit",), 2), (("vot2016",), 0), (("vot2016", "vot-toolkit"), 0)],
)
def test_a_failure_is_what_the_protocols_toolkit_calls_one(vot, tmp_path, protocols, failures):
    """Boxes that share part of a column of pixels: region.c sees an overlap, vot-toolkit none."""
    touching = "14.75,5,24.75,5,24.75,15,14.75,15"
    truth = vot / "bag" / "groundtruth.txt"
    truth.write_text(
        "\n".join([touching if i in (3, 15) else "5,5,15,5,15,15,5,15" for i in range(24)])
    )
    prepared = Evaluation.prepare(
        [f"vot2016:{vot}"], ["stub_trackers:Still"], tmp_path / "out", Options(protocols)
    )
    prepared.run()
    lines = next((tmp_path / "out").rglob("bag_001.txt")).read_text().splitlines()
    assert lines.count("2") == failures


@pytest.mark.parametrize("layout", ["otb", "got10k", "pysot"])
def test_exported_results_score_the_same_when_they_come_back(data, tmp_path, layout):
    out = tmp_path / "out"
    (row,) = evaluate(data, "Drift", out=out, export=(layout,)).rows
    exported = out / "export" / layout / "folder" / "stub_trackers-Drift"
    (again,) = evaluate(data, f"back=raw:{exported}", out=out).rows
    # GOT-10k keeps three decimals.
    assert again["ao"] == pytest.approx(row["ao"], abs=1e-4)


def test_pytracking_gets_whole_pixels_and_tabs(data, tmp_path):
    out = tmp_path / "out"
    evaluate(data, "Drift", out=out, export=("pytracking",))
    text = (out / "export/pytracking/folder/stub_trackers-Drift/first.txt").read_text()
    assert text.splitlines()[0] == "5\t10\t20\t20"


def test_exported_trajectories_score_the_same_when_they_come_back(vot, tmp_path):
    out, data = tmp_path / "out", [f"vot2016:{vot}"]
    options = Options(export=("vot", "vot-binary"))
    (row,) = Evaluation.prepare(data, ["stub_trackers:Still"], out, options).run().rows
    given = [f"{x}=raw:{out}/export/{x}/vot2016/stub_trackers-Still" for x in options.export]
    for again in Evaluation.prepare(data, given, out).run().rows:
        assert again["accuracy"] == row["accuracy"]
        assert again["robustness"] == row["robustness"]


def test_several_values_after_one_option(data, tmp_path, capsys):
    words = ["evaluate", "--tracker", "opencv:mosse", "opencv:kcf", "--data", f"folder:{data}"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:4] == ["dataset", "protocol", "tracker", "sequences"]
    assert [line.split()[2] for line in lines[1:]] == ["opencv:mosse", "opencv:kcf"]


def test_failed_sequences_are_exit_code_1(data, tmp_path, capsys):
    black_out(data, "second")
    words = ["--data", f"folder:{data}", "--tracker", "stub_trackers:Crash"]
    assert main(["evaluate", *words, "--out", str(tmp_path / "out")]) == 1
    assert "1 sequences failed" in capsys.readouterr().err
    assert (tmp_path / "out" / "scores.json").is_file()


@pytest.mark.skipif(os.name == "nt", reason="sends SIGINT")
def test_ctrl_c_keeps_what_is_done_and_the_next_call_goes_on(data, tmp_path):
    script = tmp_path / "slow.py"
    script.write_text(
        "import time\nfrom stub_trackers import Still\n"
        "class Slow(Still):\n"
        "    def update(self, image):\n        time.sleep(0.3)\n        return self.box\n"
    )
    out = tmp_path / "out"
    words = ["--data", f"folder:{data}", "--tracker", "slow:Slow", "--out", str(out)]
    command = [sys.executable, "-m", "entrack", "evaluate", *words]
    paths = os.pathsep.join([str(tmp_path), str(Path(__file__).parent)])
    environment = {**os.environ, "PYTHONPATH": paths}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    done = out / "folder" / "slow-Slow" / "second.txt"
    limit = time.monotonic() + 60
    while not done.exists() and time.monotonic() < limit:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "Traceback" not in error
    (row,) = json.loads((out / "scores.json").read_text())
    assert 1 <= row["sequences"] < row["available"] == 3
    assert not list(out.rglob("*.part"))
    before = done.stat().st_mtime_ns
    subprocess.run(command, env=environment, check=True, capture_output=True)
    (row,) = json.loads((out / "scores.json").read_text())
    assert row["sequences"] == 3
    assert done.stat().st_mtime_ns == before
