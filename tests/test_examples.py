"""The programs in examples/ run as they stand, on a video of the reader's own."""

import subprocess
import sys
from pathlib import Path

import pytest

from entrack.video import open_source
from fakes import write_clip

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


def test_every_example_is_listed_and_run() -> None:
    listed = (EXAMPLES / "README.md").read_text()
    tests = Path(__file__).read_text()
    for path in EXAMPLES.glob("*.py"):
        assert f"`{path.name}`" in listed
        assert f'"{path.name}"' in tests
