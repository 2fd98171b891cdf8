"""Figures, films and Rerun recordings of what the tracker saw."""

from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest

import entrack
from entrack.cli.app import main
from entrack.looks import coloured, principal
from entrack.tracker import Estimate
from entrack.video import open_source
from fakes import ball, write_clip

BOX = "10,12,24,20"


@pytest.fixture
def clip(tmp_path: Path) -> str:
    return str(write_clip(tmp_path / "clip.mp4", 8))


def test_cells_that_are_alike_have_one_colour() -> None:
    rng = np.random.default_rng(0)
    kinds = rng.integers(0, 3, (18, 18))
    features = rng.normal(size=(3, 64))[kinds].transpose(2, 0, 1).astype(np.float32)
    picture = principal(features)
    colours = [np.unique(picture[kinds == k], axis=0) for k in range(3)]
    assert [len(c) for c in colours] == [1, 1, 1]
    assert len(np.unique(np.concatenate(colours), axis=0)) == 3


def test_the_response_is_brightest_at_its_peak() -> None:
    heat = np.zeros((18, 18), np.uint8)
    heat[4, 12] = 255
    grey = coloured(heat, 180).astype(int).sum(axis=-1)
    i, j = np.unravel_index(grey.argmax(), grey.shape)
    assert (i // 10, j // 10) == (4, 12)


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_a_figure_of_one_frame(clip: str, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"way{suffix}"
    assert main(["explain", clip, "--box", BOX, "--out", str(out), "--frame", "5"]) == 0
    if suffix == ".png":
        height, width = cv2.imread(str(out)).shape[:2]
        assert width > 4 * height
    if suffix == ".svg":
        text = out.read_text()
        for words in ("search window", "features Z", "response M", "160×120, frame 5"):
            assert words in text


def test_a_result_of_a_run_knows_its_frames_box_and_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, out = tmp_path / "data", tmp_path / "way.svg"
    data.mkdir()
    write_clip(data / "ball.mp4", 8)
    (data / "ball.txt").write_text("\n".join(",".join(map(str, ball(t)[1])) for t in range(8)))
    call = ["evaluate", "--data", f"folder:{data}", "--out", str(tmp_path / "run")]
    assert main([*call, "--tracker", "cf-baseline", "opencv:mosse"]) == 0
    run = tmp_path / "run" / "folder"
    call = ["explain", str(run / "cf-baseline" / "ball.txt"), "--out", str(out)]
    assert main([*call, "--frame", "5"]) == 0
    assert "160×120, frame 5" in out.read_text()
    capsys.readouterr()
    for source, said in (
        (run / "opencv-mosse" / "ball.txt", "only models of entrack"),
        (tmp_path / "ball.txt", "no result of a run"),
        (data / "ball.mp4", "a video needs --box"),
    ):
        assert main(["explain", str(source), "--out", str(out)]) == 2
        assert said in capsys.readouterr().err


def test_a_film_of_all_frames_but_the_first(clip: str, tmp_path: Path) -> None:
    out = tmp_path / "way.mp4"
    assert main(["explain", clip, "--box", BOX, "--out", str(out), "--stop", "5"]) == 0
    with open_source(out) as film:
        frames = [frame.image for frame in film]
    assert len(frames) == 4
    assert np.abs(frames[0].astype(int) - frames[-1]).mean() > 0.5


def test_sigma_is_drawn_where_the_model_tells_it(
    clip: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, spread = tmp_path / "plain.svg", tmp_path / "spread.svg"
    call = ["explain", clip, "--box", BOX, "--frame", "2", "--model", "cf-baseline", "--out"]
    assert main([*call, str(plain)]) == 0
    update = entrack.Tracker.update_many

    def unsure(self: entrack.Tracker, image: np.ndarray) -> list[Estimate]:
        return [
            Estimate(e.box, e.score, e.lost, np.full(4, 3.0), 1.0, e.search, e.ms)
            for e in update(self, image)
        ]

    monkeypatch.setattr(entrack.Tracker, "update_many", unsure)
    assert main([*call, str(spread)]) == 0
    assert spread.read_text().count("stroke-dasharray") == 2 + plain.read_text().count(
        "stroke-dasharray"
    )


@pytest.mark.parametrize(
    ("out", "frame", "said"),
    [("way.gif", "3", "explained as .png"), ("way.png", "100", "ends before frame 100")],
)
def test_what_cannot_be_explained(
    clip: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], out: str, frame: str, said: str
) -> None:
    path = tmp_path / out
    assert main(["explain", clip, "--box", BOX, "--out", str(path), "--frame", frame]) == 1
    assert said in capsys.readouterr().err and not path.exists()


def test_a_rerun_recording_has_everything_of_every_frame(clip: str, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs the extra rerun")
    chunks = pytest.importorskip("rerun.chunk", reason="needs a Rerun that reads recordings")
    out = tmp_path / "run.rrd"
    assert main(["track", clip, "--box", BOX, "--box", "90,80,20,20", "--rerun", str(out)]) == 0
    assert not out.with_name("run.rrd.part").exists()
    rows: Counter[str] = Counter()
    for chunk in chunks.RrdReader(out).stream():
        rows[str(chunk.entity_path).replace("\\", "")] += chunk.num_rows
    assert rows["/frame"] == 8
    for name in ("object 1", "object 2"):
        assert rows[f"/frame/{name}/box"] == rows[f"/score/{name}"] == 8
        for what in ("search window", "response", "features"):
            assert rows[f"/seen/{name}/{what}"] == 7  # nothing is looked for in the first frame


def test_a_recording_that_cannot_be_written_is_said_first(
    clip: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun", reason="needs the extra rerun")
    assert main(["track", clip, "--box", BOX, "--rerun", str(tmp_path / "no" / "run.rrd")]) == 1
    assert "cannot write" in capsys.readouterr().err
