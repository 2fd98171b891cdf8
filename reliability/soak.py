"""Track a camera for an hour: does memory grow, does a frame ever wait?

    [nice -n -12] python -m reliability.soak [--minutes 60] [--fps 30]

A made scene is played there and back again, 30 frames a second, through the loop that
`entrack track` runs, with the boxes written to disk. A second process, of ordinary priority however
this one was started, keeps a core busy for ten of every twenty seconds. Latency is from the moment
a frame is there to the moment its box is.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from pathlib import Path

import numpy as np

import entrack
from entrack import box as boxes_
from entrack.datasets.synthetic import configure, synthesise
from entrack.run import Recorder, follow
from entrack.video import Frame
from reliability.figures import parser, tell

SLOPE = 1.0  # MB an hour
P99 = 3.0  # of the median
_WARM = 1 / 12  # share of the time after which memory is expected to stay
_BUSY = """
import os, time
if os.getpriority(os.PRIO_PROCESS, 0) < 0:
    os.setpriority(os.PRIO_PROCESS, 0, 0)
while True:
    until = time.monotonic() + 10
    while time.monotonic() < until:
        sum(range(1000))
    time.sleep(10)
"""


class Camera:
    """Frames of a scene at the times a camera would have them, and when each was there."""

    def __init__(self, fps: float, seconds: float) -> None:
        self._scene = synthesise(
            configure(seed=3, length=150, width=640, height=480, target_size=70)
        )
        self._film = [self._scene.frames[i] for i in range(len(self._scene))]
        self._fps, self._seconds = fps, seconds
        self.there: dict[int, float] = {}
        self.late = 0

    @property
    def box(self) -> np.ndarray:
        """The target in the first frame."""
        return self._scene.boxes[0]

    @property
    def still(self) -> np.ndarray:
        """The first frame."""
        return self._film[0]

    def truth(self, index: int) -> np.ndarray:
        """The target's box in frame `index`."""
        return self._scene.boxes[self._place(index)]

    def frames(self) -> Generator[Frame, None, None]:
        """Yield each frame when it is due; one for which nobody was ready in time is late."""
        began = time.perf_counter()
        for index in range(int(self._seconds * self._fps)):
            wait = began + index / self._fps - time.perf_counter()
            if wait > 0:
                time.sleep(wait)
            self.late += wait < -1 / self._fps
            self.there[index] = time.perf_counter()
            yield Frame(index, index / self._fps, self._film[self._place(index)])

    def _place(self, index: int) -> int:
        length = len(self._film)
        index %= 2 * length - 2
        return index if index < length else 2 * length - 2 - index


def resident(process: int | str = "self") -> float:
    """Memory of a process, by default this one, MB."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def soak(minutes: float, fps: float, contended: bool = True) -> tuple[dict[str, float], list[str]]:
    """Track a camera; return the figures, and what was not as promised."""
    camera = Camera(fps, 60 * minutes)
    count = int(60 * minutes * fps)
    # Filled, so that no page of what is measured with is touched for the first time later on.
    waits, overlaps = np.full(count, np.nan), np.full(count, np.nan)
    memory = np.full((min(count, 4000), 2), np.nan)  # seconds, MB
    every = -(-count // len(memory))
    busy = subprocess.Popen([sys.executable, "-c", _BUSY]) if contended else None
    tracker = entrack.load("default")
    tracker.init(camera.still, camera.box)  # what is compiled once is not waited for in a frame
    tracker.update(camera.still)
    loads: list[float] = []
    try:
        with tempfile.TemporaryDirectory() as folder:
            with Recorder(Path(folder) / "boxes.csv", None, 1, fps) as recorder:
                began = time.perf_counter()
                for frame, [estimate] in follow(tracker, camera.frames(), [camera.box]):
                    now = time.perf_counter()
                    waits[frame.index] = 1e3 * (now - camera.there.pop(frame.index))
                    overlaps[frame.index] = boxes_.iou(estimate.box, camera.truth(frame.index))
                    recorder.write(frame, [estimate])
                    if frame.index % int(60 * fps) == 0:
                        loads.append(os.getloadavg()[0])
                        line = f"{frame.index} frames, {camera.late} late, {resident():.1f} MB, "
                        print(f"{line}load {loads[-1]:.1f}", file=sys.stderr, flush=True)
                    if frame.index % every == 0:
                        memory[frame.index // every] = now - began, resident()
            rows = (Path(folder) / "boxes.csv").read_text().count("\n") - 1
    finally:
        if busy:
            busy.kill()
            busy.wait()
    known = memory[np.isfinite(memory[:, 0]) & (memory[:, 0] > _WARM * 60 * minutes)]
    slope = float(np.polyfit(known[:, 0], known[:, 1], 1)[0] * 3600)
    median, p99 = np.percentile(waits[1:], [50, 99])
    figures = {
        "minutes": minutes,
        "frames": rows,
        "late": camera.late,
        "median_ms": round(float(median), 2),
        "p99_ms": round(float(p99), 2),
        "max_ms": round(float(waits[1:].max()), 1),
        "p99/median": round(float(p99 / median), 2),
        "mb_an_hour": round(slope, 3),
        "mb": round(float(known[-1, 1]), 1),
        "nice": os.getpriority(os.PRIO_PROCESS, 0),
        "load": round(float(np.mean(loads)), 1),
        "mean_iou": round(float(overlaps.mean()), 3),
    }
    broken: list[str] = []
    if rows != count:
        broken.append(f"{count} frames went in, {rows} rows are on disk")
    if p99 > P99 * median:
        broken.append(f"latency p99 is {p99 / median:.2f} × the median, promised < {P99:g}")
    if minutes >= 30 and slope > SLOPE:
        broken.append(f"memory grows by {slope:.2f} MB an hour, promised < {SLOPE:g}")
    return figures, broken


def main() -> int:
    words = parser(__doc__)
    words.add_argument("--minutes", type=float, default=60)
    words.add_argument("--fps", type=float, default=30)
    given = words.parse_args()
    return tell("soak", *soak(given.minutes, given.fps), given.out)


if __name__ == "__main__":
    sys.exit(main())
