"""What a report says equals what was measured; what cannot be reported is one sentence."""

import csv
import json
import math
import re
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from entrack import EntrackError
from entrack.cli.app import main
from entrack.report import formats, published, write_report
from entrack.report.comparison import compare, holm
from entrack.report.runs import read_sections
from entrack.report.table import Cell, Column, Line, Table
from entrack.report.tables import attributes, overall, worst_first
from fake_runs import write_run

pytest.importorskip("matplotlib", reason="needs the extra report")
pytest.importorskip("jinja2", reason="needs the extra report")


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_numbers_are_those_of_scores_json(tmp_path):
    run = write_run(tmp_path / "run", {"a": 1.0, "b": 0.9, "c": 1.05})
    write_report([run], tmp_path / "out")
    rows = {row["tracker"]: row for row in json.loads((run / "scores.json").read_text())}
    written = read_csv(tmp_path / "out" / "tables" / "otb-otb-overall.csv")
    ours = [row for row in written if row["quoted"] == "no"]
    assert [row["Tracker"] for row in ours] == ["c", "a", "b"], "the best first"
    for row in ours:
        expected = rows[row["Tracker"]]
        assert float(row["AUC"]) == expected["auc"]
        assert float(row["P (20 px)"]) == expected["precision"]
        assert [float(row["AUC 95% low"]), float(row["AUC 95% high"])] == expected["auc_95"]
        assert float(row["Frames/s"]) == expected["fps_mean"]
    html = (tmp_path / "out" / "report.html").read_text()
    assert "0.630" in html and "A  c [0.630]" in html  # the table, and the plot's legend


def test_quoted_numbers_are_marked_and_never_the_best(tmp_path):
    write_report([write_run(tmp_path / "run", {"a": 1.0})], tmp_path / "out")
    rows = read_csv(tmp_path / "out" / "tables" / "otb-otb-overall.csv")
    quoted = {row["Tracker"]: row for row in rows if row["quoted"] == "yes"}
    assert float(quoted["the paper: MERT"]["AUC"]) == 0.655
    assert all(row["Source"].startswith("quoted: ") for row in quoted.values())
    html = (tmp_path / "out" / "report.html").read_text()
    for line in re.findall(r'<tr class="quoted">.*?</tr>', html.split('id="quoted"')[0], re.DOTALL):
        assert "best" not in line


def test_quotes_stand_only_beside_their_own_protocol(tmp_path):
    run = write_run(tmp_path / "run", {"a": 1.0})
    write_run(run, {"a": 1.0}, protocol="got10k")
    sections = read_sections([run])
    assert [s.name for s in sections] == ["otb-otb", "otb-got10k"]
    assert [any(line.quoted for line in overall(s).lines) for s in sections] == [True, False]


def test_the_papers_tables_are_whole():
    tables = {table.name: table for table in published.reference_tables()}
    shapes = {name: (len(t.lines), len(t.columns)) for name, t in tables.items()}
    assert shapes["paper-table-2"] == (15, 12)
    assert shapes["paper-table-3"] == (6, 6)
    assert shapes["paper-table-4"] == (7, 2)
    assert shapes["paper-table-5-vot2016"] == (8, 4)
    assert shapes["paper-table-5-vot2018"] == (9, 4)
    assert all(line.quoted for table in tables.values() for line in table.lines)


def test_the_papers_tables_are_as_printed(shared):
    printed = [line.split("\t") for line in (shared / "paper.txt").read_text("utf-8").splitlines()]
    rows = {tuple(map(number, row[-3:] if row[0].startswith("VOT20") else row)) for row in printed}
    rows |= {tuple(map(number, row[-3:])) for row in printed}
    for table in published.reference_tables():
        values = [[number(str(cell.value or "-")) for cell in line.cells] for line in table.lines]
        if table.name == "paper-table-2":
            assert all(tuple(line) in rows for line in values)
        elif table.name.startswith("paper-table-5"):
            assert all(tuple(line[1:]) in rows for line in values)
        elif table.name.startswith("paper-table"):
            for column in range(len(table.columns)):
                found = tuple(line[column] for line in values)
                assert any(row[1:] == found or row == found for row in rows), found


def number(word: str) -> str | float:
    try:
        return float(word)
    except ValueError:
        return word


def test_attributes_are_means_of_their_sequences(tmp_path):
    (section,) = read_sections([write_run(tmp_path / "run", {"a": 1.0, "b": 0.5}, sequences=8)])
    table = attributes(section)
    assert table is not None
    sequences = section.results[0].sequences.values()
    expected = np.mean([s["auc"] for s in sequences if "SV" in s["attributes"]])
    line = next(line for line in table.lines if line.cells[0].value == "SV")
    assert line.cells[1].value == 4
    assert line.cells[2].value == pytest.approx(expected)
    assert [line.cells[0].value for line in table.lines] == ["All", "IV", "SV", "ARC"]


def test_the_worst_sequence_comes_first_whichever_way_is_better(tmp_path):
    run = write_run(tmp_path / "run", {"a": 1.0})
    write_run(run, {"a": 1.0}, dataset="vot2018", protocol="vot2018")
    for section in read_sections([run]):
        from entrack.report.metrics import by_sequence

        order = worst_first(section, by_sequence(section.protocol)[0])
        # The helper's numbers grow with the sequence: more AUC, but more failures, too.
        assert order[0] == ("video_0" if section.protocol == "otb" else "video_4")


def test_a_difference_is_found_where_there_is_one_and_only_there():
    random = np.random.default_rng(1)
    noise = random.normal(0, 0.1, (200, 30))
    alike = [compare(row, np.ones(30)).p for row in noise]
    assert 0.01 < np.mean(np.array(alike) < 0.05) < 0.10, "5 % of no differences pass"
    better = compare(noise[0] - noise[0].mean() + 0.1, np.ones(30))
    assert better.p < 0.001 and better.interval[0] > 0
    assert compare([0.5], [1]).p == 1.0, "one sequence proves nothing"
    weighted = compare([0.1, -0.1], [3, 1])
    assert weighted.mean == pytest.approx(0.05)


def test_holm_against_its_definition():
    p = [0.01, 0.02, 0.03, 0.5]
    assert holm(p) == pytest.approx([0.04, 0.06, 0.06, 0.5])
    assert holm(list(reversed(p))) == pytest.approx([0.5, 0.06, 0.06, 0.04])


NASTY = Table(
    "t", "50 % of a_b", (Column("Tracker"), Column("A & B", 3, higher=True)),
    (Line((Cell(r"x_1\{^}|<b>#$~"), Cell(0.5, (0.4, 0.6)))), Line((Cell("y"), Cell(None)))),
)  # fmt: skip


def test_latex_escapes_and_balances():
    text = formats.latex(NASTY)
    assert r"x\_1\textbackslash{}\{\textasciicircum{}\}|\textless{}b\textgreater{}\#\$" in text
    assert r"A \& B" in text and r"50 \% of a\_b" in text
    bare = re.sub(r"\\[{}&%$#_\\]", "", text)
    assert bare.count("{") == bare.count("}")
    rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert all(re.sub(r"\\&", "", row).count("&") == 1 for row in rows) and len(rows) == 3
    assert not re.search(r"(?<!\\)[_#$%]", text.replace(r"\textbackslash{}", ""))


def test_markdown_has_as_many_columns_everywhere():
    lines = [x for x in formats.markdown(NASTY).splitlines() if x.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {3}
    assert "<b>" not in formats.markdown(NASTY)


def test_names_cannot_become_markup(tmp_path):
    evil = "<script>alert(1)</script>"
    run = write_run(tmp_path / "run", {evil: 1.0, "b": 0.9}, failed={evil: evil})
    html = write_report([run], tmp_path / "out").read_text()
    assert "<script>alert" not in html and "&lt;script&gt;alert" in html
    assert html.count("<script>") == 1


def test_two_runs_with_one_tracker_are_told_apart(tmp_path):
    runs = [
        write_run(tmp_path / name, {"a": f, "only " + name: 0.5})
        for name, f in (("x", 1.0), ("y", 0.8))
    ]
    (section,) = read_sections(runs)
    assert {r.tracker for r in section.results} == {"a (x)", "a (y)", "only x", "only y"}
    same = [write_run(tmp_path / d / "run", {"a": 1.0}) for d in ("p", "q")]
    (section,) = read_sections(same)
    assert {r.tracker for r in section.results} == {f"a ({run})" for run in same}


def test_other_sequences_are_pointed_out(tmp_path):
    runs = [write_run(tmp_path / n, {n: 1.0}, sequences=c) for n, c in (("x", 5), ("y", 4))]
    html = write_report(runs, tmp_path / "out").read_text()
    assert "not scored on the same sequences" in html
    comparison = read_csv(tmp_path / "out" / "tables" / "otb-otb-comparison.csv")
    assert comparison[0]["Better / worse on"].endswith("of 4")


@pytest.mark.parametrize("protocol", ["otb", "vot2018", "vot-toolkit"])
def test_one_tracker_without_pictures(tmp_path, protocol):
    dataset = "otb" if protocol == "otb" else "vot2018"
    run = write_run(tmp_path / "run", {"a": 1.0}, dataset=dataset, protocol=protocol)
    html = write_report([run], tmp_path / "out").read_text()
    assert "No filmstrips: " in html and "Against" not in html
    names = {path.stem for path in (tmp_path / "out" / "plots").glob("*.svg")}
    expected = "success" if protocol == "otb" else "expected-overlap"
    assert (
        f"{dataset}-{protocol}-{expected}".replace("vot2018-vot2018-", "vot2018-vot2018-") in names
    )
    assert all((tmp_path / "out" / "plots" / f"{name}.png").exists() for name in names)


def test_longterm_has_its_own_plots_and_numbers(tmp_path):
    run = write_run(tmp_path / "run", {"a": 0.9, "b": 1.0}, protocol="longterm", dataset="folder")
    html = write_report([run], tmp_path / "out").read_text()
    names = {path.stem for path in (tmp_path / "out" / "plots").glob("*.svg")}
    drawn = "reliability roc f-score tracking-precision tracking-recall precision-recall".split()
    expected = [*drawn, "found-again", "radar", "speed"]
    assert {f"folder-longterm-{name}" for name in expected} == names
    rows = read_csv(tmp_path / "out" / "tables" / "folder-longterm-overall.csv")
    assert [row["Tracker"] for row in rows] == ["b", "a"], "the greatest F first"
    assert (float(rows[0]["ROC AUC"]), float(rows[1]["ECE"])) == (0.8, 0.09)
    assert "B  a [0.720]" in html and "share of returns found" in html
    reliability = (tmp_path / "out" / "plots" / "folder-longterm-reliability.svg").read_text()
    # The less wrong comes first, whatever its F is.
    assert reliability.index("a [0.090]") < reliability.index("b [0.100]")


def test_a_tracker_that_says_nothing_is_left_out_of_plots_of_scores(tmp_path):
    run = write_run(tmp_path / "run", {"a": 1.0, "mute": 0.9}, protocol="longterm")
    path = run / "otb" / "mute" / "scores" / "longterm.json"
    details = json.loads(path.read_text())
    for curve in ("roc", "calibration_frames", "calibration_score", "calibration_share"):
        del details["curves"][curve]
    path.write_text(json.dumps(details))
    write_report([run], tmp_path / "out")
    plots = tmp_path / "out" / "plots"
    assert "mute" in (plots / "otb-longterm-f-score.svg").read_text()
    for name in ("roc", "reliability"):
        assert "mute" not in (plots / f"otb-longterm-{name}.svg").read_text()


def test_filmstrips_show_every_trackers_boxes(tmp_path):
    from entrack.datasets import open_dataset
    from entrack.evaluation.run import Evaluation, Options

    assert main(["data", "synth", str(tmp_path / "made"), "--count", "2", "--length", "12"]) == 0
    data = f"synthetic:{tmp_path / 'made'}"
    dataset = open_dataset(data)
    for name in dataset.names:
        boxes = dataset.read(name).boxes
        for tracker, shift in (("still", 0), ("off", 9)):
            path = tmp_path / tracker / f"{name}.txt"
            path.parent.mkdir(exist_ok=True)
            np.savetxt(path, boxes + np.array([shift, 0, 0, 0]), delimiter=",")
    given = [f"raw:{tmp_path / t}" for t in ("still", "off")]
    Evaluation.prepare([data], given, tmp_path / "run", Options()).run()
    html = write_report(
        [tmp_path / "run"], tmp_path / "out", sequences=[dataset.names[1]]
    ).read_text()
    strips = list((tmp_path / "out" / "strips").iterdir())
    assert [strip.stem for strip in strips] == [f"synthetic-otb-{dataset.names[1]}"]
    assert html.count('src="data:image/jpeg') == 1 and "No filmstrips" not in html
    shutil.rmtree(tmp_path / "off")
    html = write_report([tmp_path / "run"], tmp_path / "out").read_text()
    assert "Without boxes that can be read: off." in html


def bad_runs(tmp_path: Path) -> dict[str, Path]:
    folders = {name: tmp_path / name for name in ("empty", "torn", "other", "nothing", "curveless")}
    for folder in folders.values():
        folder.mkdir()
    (folders["torn"] / "scores.json").write_text('[{"dataset": "ot')
    (folders["other"] / "scores.json").write_text('{"a": 1}')
    (folders["nothing"] / "scores.json").write_text("[]")
    shutil.rmtree(folders["curveless"])
    run = write_run(folders["curveless"], {"a": 1.0})
    (run / "otb" / "a" / "scores" / "otb.json").unlink()
    return folders


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("empty", "there is no"),
        ("torn", "is not JSON"),
        ("other", "is not a list of rows"),
        ("nothing", "no tracker has a score yet"),
        ("curveless", "otb.json: No such file"),
        ("missing", "there is no"),
    ],
)
def test_a_run_that_is_none_is_one_sentence(tmp_path, capsys, name, message):
    bad_runs(tmp_path)
    assert main(["report", str(tmp_path / name)]) in (1, 2)
    said = capsys.readouterr().err
    assert message in said and len(said.splitlines()) == 1
    assert not (tmp_path / name / "report").exists()


def test_wrong_names_are_said_with_the_right_ones(tmp_path):
    run = write_run(tmp_path / "run", {"a": 1.0, "b": 0.5})
    with pytest.raises(EntrackError, match="no tracker c in these runs: they have a, b"):
        write_report([run], tmp_path / "out", baseline="c")
    with pytest.raises(EntrackError, match="no sequence v in these runs: they have video_0, "):
        write_report([run], tmp_path / "out", sequences=["v"])
    with pytest.raises(EntrackError, match="is given 2 times"):
        write_report([run, run / ".." / "run"], tmp_path / "out")


def test_the_same_run_gives_the_same_files(tmp_path):
    run = write_run(tmp_path / "run", {"a": 1.0, "b": 0.5})
    for out in ("x", "y"):
        write_report([run], tmp_path / out)
    files = sorted(p.relative_to(tmp_path / "x") for p in (tmp_path / "x").rglob("*.*"))
    assert len(files) > 20
    for file in files:
        assert (tmp_path / "x" / file).read_bytes() == (tmp_path / "y" / file).read_bytes(), file


def test_the_baseline_can_be_chosen(tmp_path, capsys):
    run = write_run(tmp_path / "run", {"a": 1.0, "b": 0.5}, sequences=12)
    assert main(["report", str(run), "--baseline", "b"]) == 0
    assert Path(capsys.readouterr().out.strip()) == run / "report" / "report.html"
    (row,) = read_csv(run / "report" / "tables" / "otb-otb-comparison.csv")
    assert row["Tracker"] == "a" and row["Verdict"] == "better"
    sections = read_sections([run])[0].results
    gain = np.mean([sections[0].sequences[n]["auc"] / 2 for n in sections[0].sequences])
    assert math.isclose(float(row["Difference"]), gain, rel_tol=1e-6)


def test_a_hundred_sequences_of_ten_trackers_take_seconds(tmp_path):
    run = write_run(
        tmp_path / "run", {f"tracker {i}": 1 - i / 20 for i in range(10)}, sequences=100
    )
    started = time.process_time()
    write_report([run], tmp_path / "out")
    assert time.process_time() - started < 20  # 11 on a processor of 2017
