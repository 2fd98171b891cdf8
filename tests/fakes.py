"""Stand-ins for what tests of video and command line do not test."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from entrack.tracker import Estimate
from entrack.video import VideoWriter

SIZE = (160, 120)  # width, height


def ball(t: int, size: tuple[int, int] = SIZE) -> tuple[np.ndarray, tuple[int, int, int, int]]:
    """A textured picture with a white 24×20 box that moves right and down; and that box."""
    width, height = size
    y, x = np.mgrid[:height, :width]
    image = np.stack([40 + 30 * np.sin(x / 9), 60 + 30 * np.sin(y / 7), 50 + 0 * x], axis=-1)
    box = (10 + 2 * t, 12 + t, 24, 20)
    image[box[1] : box[1] + box[3], box[0] : box[0] + box[2]] = 255
    return image.astype(np.uint8), box


def write_clip(path: Path, frames: int = 20, times: Sequence[float] | None = None) -> Path:
    """A video of `ball`, 25 frames a second or at `times`."""
    with VideoWriter(path, 25) as video:
        for t in range(frames):
            video.write(ball(t)[0], t / 25 if times is None else times[t])
    return path


class BrightTracker:
    """Follows the white pixels nearest to its boxes; calls `every` at each update."""

    def __init__(self, every: Callable[[int], None] = lambda t: None) -> None:
        self.every = every
        self.t = 0

    def init_many(self, image: np.ndarray, boxes: Sequence[np.ndarray]) -> None:
        self.sizes = [np.asarray(box)[2:] for box in boxes]

    def update_many(self, image: np.ndarray) -> list[Estimate]:
        self.t += 1
        self.every(self.t)
        ys, xs = np.nonzero(image.min(axis=-1) > 200)
        centre = np.array([xs.mean() + 0.5, ys.mean() + 0.5]) if len(xs) else np.zeros(2)
        boxes = [np.concatenate([centre - size / 2, size]) for size in self.sizes]
        return [Estimate(b, 0.75, self.t == 3, None, None, b, 10.0) for b in boxes]
