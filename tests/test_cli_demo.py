"""`entrack demo`: what it leaves behind and what it says."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import entrack
from entrack.cli import demo
from entrack.cli.app import main
from entrack.video import open_source
from fakes import BrightTracker, ball, write_clip


@pytest.fixture(autouse=True)
def made_up_clip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "assets" / "demo"
    folder.mkdir(parents=True)
    write_clip(folder / "clip.mp4", 30)
    np.savetxt(folder / "clip.txt", [ball(t)[1] for t in range(30)], "%.2f", ",")
    monkeypatch.setattr(demo, "assets", lambda: tmp_path / "assets")
    monkeypatch.setattr(entrack, "load", lambda *_, **__: BrightTracker())


def test_demo_writes_three_files_and_the_score(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "folder"
    assert main(["demo", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert sorted(p.name for p in out.iterdir()) == ["boxes.csv", "filmstrip.png", "tracked.mp4"]
    for path in out.iterdir():
        assert f"wrote {path}" in shown
    assert "30 frames" in shown and "frames/s" in shown
    score = float(shown.split("AUC ")[1].split()[0])
    assert 0.9 < score <= 20 / 21 + 1e-3  # a perfect tracker scores 20/21
    with open_source(out / "tracked.mp4") as video:
        assert len(list(video)) == 30
    strip = cv2.imread(str(out / "filmstrip.png"))
    assert strip is not None and strip.shape[1] > 1000


def test_demo_that_cannot_write_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("in the way")
    assert main(["demo", "--out", str(tmp_path / "file")]) == 1
    assert "error: cannot write" in capsys.readouterr().err
