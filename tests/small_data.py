"""Datasets of a few pictures, and evaluations of stub trackers on them."""

from pathlib import Path

import cv2
import numpy as np

from entrack.evaluation.run import Evaluation, Options, Watcher

LENGTHS = {"first": 6, "second": 9, "third": 4}
GREY = np.full((48, 64, 3), 100, np.uint8)


def make_folder(folder: Path) -> Path:
    """Three sequences whose box goes one pixel to the right a frame."""
    for name, length in LENGTHS.items():
        (folder / name).mkdir(parents=True)
        for i in range(length):
            cv2.imwrite(str(folder / name / f"{i:04d}.png"), GREY)
        rows = [f"{5 + i},10,20,20" for i in range(length)]
        (folder / f"{name}.txt").write_text("\n".join(rows) + "\n")
    return folder


def make_vot(root: Path) -> Path:
    """A VOT sequence of 24 frames whose target jumps away at frame 12."""
    folder = root / "bag"
    folder.mkdir(parents=True)
    for i in range(1, 25):
        cv2.imwrite(str(folder / f"{i:08d}.jpg"), GREY)
    here, there = "5,5,15,5,15,15,5,15", "40,30,50,30,50,40,40,40"
    (folder / "groundtruth.txt").write_text("\n".join([here] * 12 + [there] * 12) + "\n")
    return root


def black_out(data: Path, name: str, frame: int = 2) -> None:
    """Make a picture dark, which some of the stubs cannot bear."""
    cv2.imwrite(str(data / name / f"{frame:04d}.png"), 0 * GREY)


class Ears(Watcher):
    """Remembers what was said."""

    def __init__(self) -> None:
        self.heard: list[str] = []

    def say(self, message: str) -> None:
        self.heard.append(message)


def evaluate(data, *trackers, out, watcher=None, **options):
    """Run stubs, which are named by their class, or other trackers."""
    specs = [f"stub_trackers:{t}" if t[0].isupper() else t for t in trackers]
    prepared = Evaluation.prepare([f"folder:{data}"], specs, out, Options(**options))
    return prepared.run(watcher)
