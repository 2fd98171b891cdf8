"""Track under a progress bar and say what came out: for `track` and `demo`."""

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from entrack.box import Boxes
from entrack.cli.console import progress
from entrack.run import ManyTracker, Recorder, follow
from entrack.tracker import Estimate
from entrack.video import Frame, Source


@dataclass
class Summary:
    """What was done so far; true also when the work breaks off."""

    source: str
    files: list[Path]
    frames: int = 0
    seconds: float = 0.0
    lost: list[int] = field(default_factory=list[int])
    """Frames in which each object was lost."""
    complete: bool = False

    def add(self, estimates: list[Estimate]) -> None:
        """Count a frame."""
        self.lost = self.lost or [0] * len(estimates)
        self.frames += 1
        for number, estimate in enumerate(estimates):
            self.lost[number] += estimate.lost

    @property
    def fps(self) -> float:
        """Frames a second, with decoding, drawing and encoding."""
        return self.frames / self.seconds if self.seconds else 0.0

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "source": self.source,
            "frames": self.frames,
            "seconds": round(self.seconds, 3),
            "fps": round(self.fps, 2),
            "lost": [round(n / self.frames, 4) for n in self.lost],
            "files": [str(path) for path in self.files],
            "complete": self.complete,
        }

    def __str__(self) -> str:
        lost = ", ".join(f"{n / self.frames:.0%}" for n in self.lost)
        lines = [
            f"{self.source}: {self.frames} frames in {self.seconds:.1f} s, {self.fps:.1f} frames/s",
            f"lost in {lost} of the frames",
            *(f"wrote {path}" for path in self.files),
        ]
        return "\n".join(lines)


def run(
    tracker: ManyTracker,
    source: Source,
    boxes: list[Boxes],
    recorder: Recorder,
    summary: Summary,
    each: Callable[[Frame, list[Estimate]], object] = lambda frame, estimates: None,
) -> None:
    """Track and record all of a source, then finish the files; `each` sees every frame."""
    began = time.perf_counter()
    try:
        with (
            recorder,
            progress(source.name, source.length) as advance,
            closing(follow(tracker, source, boxes)) as steps,
        ):
            for frame, estimates in steps:
                recorder.write(frame, estimates)
                summary.add(estimates)
                each(frame, estimates)
                advance()
        summary.complete = True
    finally:
        summary.seconds = time.perf_counter() - began
