"""The recipes of docs/contributing.md, as they are printed there."""

import re
import sys
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest

from entrack import EntrackError
from entrack.box import iou
from entrack.datasets import FORMATS, open_dataset
from entrack.peers import parse
from entrack.video import open_source
from fakes import ball, write_clip

PAGE = (Path(__file__).parents[1] / "docs" / "contributing.md").read_text()
RECIPES = dict(re.findall(r'```python title="(\w+)\.py"\n(.*?)```', PAGE, re.DOTALL))


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The recipes as files, importable from there."""
    for name, text in RECIPES.items():
        (tmp_path / f"{name}.py").write_text(text)
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def test_each_recipe_is_short() -> None:
    chapters = re.split(r"^## Add an? ", PAGE, flags=re.MULTILINE)[1:]
    assert [chapter.split()[0] for chapter in chapters] == ["dataset", "trunk", "filter", "policy"]
    assert max(len(chapter.splitlines()) for chapter in chapters) < 60


def test_the_dataset(written: Path) -> None:
    import_module("corners")
    try:
        with pytest.raises(EntrackError, match=r"NAME\.json"):
            open_dataset(f"corners:{written}")
        (written / "walk").mkdir()
        for number in range(3):
            cv2.imwrite(str(written / "walk" / f"{number}.png"), np.full((40, 60, 3), number))
        (written / "walk.json").write_text("[[10, 12, 30, 20], null, [12, 12, 32, 20]]")
        [sequence] = open_dataset(f"corners:{written}")
    finally:
        FORMATS.pop("corners")
    assert sequence.boxes[0].tolist() == [10, 12, 20, 8]
    assert sequence.absent.tolist() == [False, True, False]
    assert sequence.frames[2].shape == (40, 60, 3) and sequence.frames[2][0, 0, 0] == 2


@pytest.mark.parametrize("spec", ["gradients:tracker", "whitened:tracker", "peak_policy:tracker"])
def test_the_trackers(written: Path, spec: str) -> None:
    assert f"--tracker {spec}" in PAGE
    tracker = parse(spec).make()
    with open_source(write_clip(written / "clip.mp4", 12)) as source:
        for frame in source:
            if frame.index == 0:
                tracker.init(frame.image, ball(0)[1])
            else:
                estimate = tracker.update(frame.image)
    assert iou(estimate.box, ball(11)[1]) > 0.6
    if spec.startswith("peak"):
        assert estimate.sigma is not None and (estimate.sigma > 0).all()


def test_pages_name_tests_that_exist() -> None:
    there = "\n".join(path.read_text() for path in Path(__file__).parent.glob("test_*.py"))
    pages = (Path(__file__).parents[1] / "docs").glob("*.md")
    named = {name for page in pages for name in re.findall(r"`(test_\w+)`", page.read_text())}
    assert len(named) > 25
    assert [name for name in sorted(named) if f"def {name}(" not in there] == []
