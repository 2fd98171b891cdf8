"""Trackers that worker processes can import: `stub_trackers:Still` and so on."""

import os
import signal
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np


class Still:
    """Stays where it was put."""

    def init(self, image, box):
        self.box = np.array(box, float)

    def update(self, image):
        return self.box


class Drift(Still):
    """Goes one pixel to the right a frame, and a random part of one."""

    def update(self, image):
        step = 1 + np.random.rand() / 4  # noqa: NPY002
        self.box = self.box + np.array([step, 0, 0, 0])
        return self.box


class Object(Still):
    """Answers with an object that has a box."""

    def update(self, image):
        return self


class Doubting(Still):
    """Stays where it was put, and says that it is a pixel off for each frame that passes."""

    def init(self, image, box):
        super().init(image, box)
        self.t = 0

    def update(self, image):
        self.t += 1
        said = {"score": 1 / (1 + self.t), "lost": self.t > 3, "sigma": np.full(4, self.t)}
        return SimpleNamespace(box=self.box, **said)


class Crash(Still):
    """Fails on dark pictures."""

    def update(self, image):
        if image.max() == 0:
            raise ZeroDivisionError("dark")
        return self.box


class Words(Still):
    """Answers with something that is no box."""

    def update(self, image):
        return "left"


class Sick(Still):
    """Answers NaN and negative sizes."""

    def update(self, image):
        return [np.nan, 0, 1, 1] if image.mean() > 1 else [5, 5, -3, 2]


class Deadly(Still):
    """Kills its process on dark pictures, as often as the file `lives` in the folder says."""

    def update(self, image):
        lives = Path(os.environ["STUB_FOLDER"]) / "lives"
        if image.max() == 0 and (left := int(lives.read_text())):
            lives.write_text(str(left - 1))
            os.kill(os.getpid(), signal.SIGKILL)
        return self.box


class Halves:
    """Has no update."""

    def init(self, image, box):
        pass


def square(number, report):
    """Work for a pool: dies at 13, fails at 7."""
    if number == 13:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 7:
        raise ValueError("seven")
    report(number)
    return number * number


def threads(_, report):
    return os.environ["OMP_NUM_THREADS"]


def nothing(unit, report):
    """Work for a pool that leaves nothing behind."""


def slow_square(payload, report):
    """Work that says that it has begun, and takes a while."""
    folder, number = payload
    Path(folder, f"{number}-{os.getpid()}").touch()
    time.sleep(2)
    return number * number
