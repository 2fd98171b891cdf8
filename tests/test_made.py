"""The suite of `synthetic:hard`, made when it is asked for."""

import json

import numpy as np
import pytest

from entrack.cli.app import main
from entrack.datasets import open_dataset, synthetic
from entrack.datasets.synthetic import Props, hard
from entrack.errors import EntrackError


def test_the_suite_is_sixty_sequences_that_open_at_once():
    dataset = open_dataset("synthetic:hard")
    assert len(dataset) == 60
    assert dataset.names[:3] == (
        "hard-000000-full_occlusion",
        "hard-000001-out_of_view-lookalikes",
        "hard-000002-lookalikes",
    )


def test_it_is_the_same_as_the_library_makes():
    (made,) = hard(1)
    opened = open_dataset("synthetic:hard")[0]
    np.testing.assert_array_equal(opened.boxes, made.boxes)
    np.testing.assert_array_equal(opened.absent, made.absent)
    np.testing.assert_array_equal(opened.frames[120], made.frames[120])
    assert opened.absent.sum() >= 10


def test_count_and_seed_choose_others():
    dataset = open_dataset("synthetic:hard,seed=5000,count=2")
    assert [name[:11] for name in dataset.names] == ["hard-005000", "hard-005001"]
    assert dataset.place == "hard,count=2,seed=5000"
    assert open_dataset(f"synthetic:{dataset.place}").names == dataset.names


def test_a_folder_is_still_a_folder(tmp_path, capsys):
    assert main(["data", "synth", str(tmp_path / "hard"), "--count", "1", "--length", "3"]) == 0
    dataset = open_dataset(f"synthetic:{tmp_path / 'hard'}")
    assert [len(s) for s in dataset] == [3]
    assert dataset.place == str(tmp_path / "hard")


@pytest.mark.parametrize(
    ("option", "why"),
    [
        ("sead=1", "no option 'sead=1', expected count=NUMBER, seed=NUMBER or props=DIR"),
        ("count=few", "no option 'count=few'"),
        ("count=0", "has no sequence"),
        ("props=nowhere", "nowhere needs masks/"),
    ],
)
def test_options_that_make_no_sense_are_refused(option, why):
    with pytest.raises(EntrackError, match=why):
        open_dataset(f"synthetic:hard,{option}")


def test_what_cannot_be_staged_with_given_things_is_cast_anew(monkeypatch):
    tried = []

    def stage(config, props, name):
        tried.append(config.seed)
        if len(tried) < 3:
            raise EntrackError("found no way")
        return name

    monkeypatch.setattr(synthetic, "synthesise", stage)
    name, config = next(synthetic.hard_plan(1, seed=7))
    assert synthetic.hard_sequence(name, config, Props()) == name
    assert tried == [7, 1_000_007, 2_000_007]
    tried.clear()
    with pytest.raises(EntrackError, match="found no way"):
        synthetic.hard_sequence(name, config)
    assert tried == [7], "without things of one's own the suite is what it is"


def test_a_suite_is_evaluated_and_the_report_finds_its_frames(tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="needs the extra report")
    from entrack.report import strips, timeline
    from entrack.report.runs import read_sections
    from entrack.report.style import styles

    out = tmp_path / "out"
    words = ["--data", "synthetic:hard,count=1", "--tracker", "stub_trackers:Doubting"]
    assert main(["evaluate", *words, "--out", str(out), "--protocol", "longterm", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["dataset"], row["frames"]) == ("synthetic", 240)
    assert row["refound"] in (0, 1)
    (section,) = read_sections([out])
    looks = styles([row["tracker"]])
    pictures, why = strips.filmstrips(section, looks, ())
    assert len(pictures) == 1 and not why
    ((name, _, _, make),) = timeline.drawings(section, looks, section.sequences)
    assert name == "timeline-hard-000000-full_occlusion"
    overlap, score = (axes.lines[0].get_ydata() for axes in make().axes)
    absent = open_dataset("synthetic:hard")[0].absent
    np.testing.assert_array_equal(np.isnan(overlap), absent)
    assert score[1:].tolist() == pytest.approx([1 / (1 + t) for t in range(1, 240)], abs=1e-6)
