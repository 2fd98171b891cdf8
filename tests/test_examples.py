"""The programs in examples/ run as they stand, on a video of the reader's own."""

import subprocess
import sys
from pathlib import Path

import pytest

from entrack.video import VideoWriter, open_source
from fakes import ball, write_clip

EXAMPLES = Path(__file__).parents[1] / "examples"
BOX = "10,12,24,20"


@pytest.fixture
def clip(tmp_path: Path) -> str:
    return str(write_clip(tmp_path / "clip.mp4", 12))


def run(name: str, *arguments: str) -> str:
    call = [sys.executable, str(EXAMPLES / name), *arguments]
    return subprocess.run(call, check=True, capture_output=True, text=True).stdout


def test_loop_prints_a_line_a_frame(clip: str) -> None:
    lines = run("loop.py", clip, BOX).splitlines()
    assert [int(line.split()[0]) for line in lines] == list(range(12))
    assert float(lines[-1].split()[1]) == pytest.approx(10 + 2 * 11, abs=4)


def test_camera_takes_a_file_as_stand_in(clip: str) -> None:
    assert "last seen at [3" in run("camera.py", clip, BOX)


def test_several_objects_are_drawn_into_a_video(clip: str, tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    assert "2 objects" in run("several_objects.py", clip, str(out), BOX, "90,80,20,20")
    with open_source(out) as video:
        assert len(list(video)) == 11


def test_a_tracker_agrees_with_itself(clip: str) -> None:
    said = run("compare.py", clip, BOX, "cf", "cf")
    assert "cf and cf agree to a mean IoU of 1.000" in said and "never part" in said
    assert "agree to a mean IoU of" in run("compare.py", clip, BOX, "cf", "opencv:mosse")


def test_a_policy_of_ones_own_is_better_than_none(tmp_path: Path) -> None:
    pytest.importorskip("gymnasium", reason="needs the extra train")
    # So fast that a box which is only set right is left behind.
    balls = [ball(t) for t in range(0, 60, 3)]
    with VideoWriter(tmp_path / "ball.mp4", 25) as video:
        for k, (picture, _) in enumerate(balls):
            video.write(picture, k / 25)
    rows = [",".join(map(str, box)) for _, box in balls]
    (tmp_path / "ball.txt").write_text("\n".join(rows))
    peak, stay = run("custom_policy.py", f"folder:{tmp_path}").splitlines()
    assert peak.startswith("follow_the_peak") and stay.startswith("stay")
    assert float(peak.split()[2]) > float(stay.split()[2])
    assert float(peak.split()[-1]) > 0.6


def test_the_notebook_runs_and_is_kept_with_small_pictures() -> None:
    nbformat = pytest.importorskip("nbformat", reason="needs nbclient")
    nbclient = pytest.importorskip("nbclient", reason="needs nbclient")
    pytest.importorskip("matplotlib", reason="needs the extra report")
    path = EXAMPLES / "tour.ipynb"
    assert path.stat().st_size < 400_000
    kept = nbformat.read(path, 4)
    fresh = nbclient.NotebookClient(nbformat.read(path, 4), timeout=300).execute()
    for there, here in zip(kept.cells, fresh.cells, strict=True):
        kinds = [[sorted(o.get("data", o)) for o in c.get("outputs", [])] for c in (there, here)]
        assert kinds[0] == kinds[1]
    pictures = [o for cell in kept.cells for o in cell.get("outputs", []) if "data" in o]
    assert len(pictures) == 3
    agreement = fresh.cells[-2].outputs[0].text
    assert float(agreement.split()[6].rstrip(",")) > 0.7


def test_every_example_is_listed_and_run() -> None:
    listed = (EXAMPLES / "README.md").read_text()
    tests = Path(__file__).read_text()
    for path in [*EXAMPLES.glob("*.py"), *EXAMPLES.glob("*.ipynb")]:
        assert f"`{path.name}`" in listed
        assert f'"{path.name}"' in tests
