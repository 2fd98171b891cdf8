"""The Python in the README runs as it stands there."""

import re
from pathlib import Path

import numpy as np
import pytest

from entrack.video import VideoWriter

ROOT = Path(__file__).resolve().parents[1]
BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)


def test_examples_run_one_after_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    assert len(BLOCKS) >= 2
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 255, (480, 640, 3), dtype=np.uint8)
    with VideoWriter(Path("surfer.mp4"), 30) as writer:
        for k in range(4):
            writer.write(picture, k / 30)
    names: dict[str, object] = {"frame": picture, "next_frame": picture}
    names |= {"x": 125, "y": 180, "w": 137, "h": 167}
    exec("\n".join(BLOCKS), names)  # the README's own code
    found = names["estimate"].box  # type: ignore[attr-defined]
    np.testing.assert_allclose(found, [125, 180, 137, 167], atol=12)
