"""What one page works on: a video, the objects in it, and what is known of them in each frame."""

import copy
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from entrack.boxfiles import BoxWriter
from entrack.datasets.frames import Image
from entrack.draw import overlay
from entrack.looks import heat
from entrack.run import begin
from entrack.tracker import Estimate, Tracker
from entrack.video import Frame, VideoWriter, written_size


class Footage(Protocol):
    """Frames by number: a `Clip`, or a `Recording` of a camera that grows while it is used."""

    name: str
    size: tuple[int, int]
    fps: float

    def __len__(self) -> int: ...
    def __getitem__(self, index: int) -> Frame: ...
    def close(self) -> None:
        """Let go of what it reads."""
        ...


@dataclass
class Target:
    """One object: its tracker, and what that said of each frame so far."""

    tracker: Tracker
    estimates: dict[int, Estimate] = field(default_factory=dict[int, Estimate])
    heats: dict[int, Image] = field(default_factory=dict[int, Image])
    """The response map of each frame as a picture, a few hundred bytes."""
    last: int = -1
    """The frame up to which the tracker has come."""

    def put(self, frame: Frame, box: ArrayLike) -> None:
        """Say where the object is; what was known of later frames no longer holds."""
        [estimate] = begin(self.tracker, frame, [box])
        for known in (self.estimates, self.heats):
            for index in [i for i in known if i >= frame.index]:
                del known[index]
        self.estimates[frame.index], self.last = estimate, frame.index

    def follow(self, frame: Frame) -> None:
        """Look at a frame, if it is the one after the last."""
        if frame.index != self.last + 1 or self.last < 0:
            return
        estimate, look = self.tracker.update(frame.image), self.tracker.looks[0]
        self.estimates[frame.index], self.last = estimate, frame.index
        if look is not None:
            self.heats[frame.index] = heat(look.response)


class Session:
    """The work of one page. Not to be called from two threads at a time.

    Each object has a tracker of its own, so that correcting one, or adding one midway, leaves what
    is known of the others as it is; all share one trunk.

    Parameters
    ----------
    footage
        Closed with the session.
    tracker
        A fresh tracker; one like it is made for every object.
    """

    def __init__(self, footage: Footage, tracker: Tracker) -> None:
        self.footage, self._tracker = footage, tracker
        self.targets: list[Target] = []
        self.frame = footage[0]
        """The frame that is looked at."""
        self._times: dict[int, float] = {}

    @property
    def estimates(self) -> list[Estimate | None]:
        """What is known of each object in the frame looked at."""
        return [target.estimates.get(self.frame.index) for target in self.targets]

    def go(self, index: int) -> None:
        """Look at another frame, the nearest there is."""
        self.frame = self.footage[min(max(index, 0), len(self.footage) - 1)]

    def put(self, number: int, box: ArrayLike) -> None:
        """Say where object `number` is in this frame; a number that is not there yet adds one.

        Raises
        ------
        EntrackError
            If the box lies outside the frame.
        """
        target = Target(copy.copy(self._tracker)) if number >= len(self.targets) else None
        (target or self.targets[number]).put(self.frame, box)
        self._times[self.frame.index] = self.frame.time
        if target:
            self.targets.append(target)

    def remove(self, number: int) -> None:
        """Forget an object."""
        del self.targets[number]

    def resume(self) -> None:
        """Where nothing is known of any object, go to the last frame in which something is."""
        if self.targets and not any(self.estimates):
            self.go(max(target.last for target in self.targets))

    def forward(self) -> bool:
        """Go to the next frame and track in it what is not known yet; False at the end."""
        if self.frame.index + 1 >= len(self.footage):
            return False
        try:
            self.frame = self.footage[self.frame.index + 1]
        except IndexError:  # the file promised more frames than it has
            return False
        for target in self.targets:
            target.follow(self.frame)
        self._times[self.frame.index] = self.frame.time
        return True

    @property
    def fresh(self) -> bool:
        """Whether the frame looked at is the last one of an object: just tracked, not replayed."""
        return any(target.last == self.frame.index for target in self.targets)

    def known(self) -> Generator[tuple[int, list[Estimate | None]], None, None]:
        """Every frame in which something is known, in order, with the estimates of all objects."""
        frames = {index for target in self.targets for index in target.estimates}
        for index in sorted(frames):
            yield index, [target.estimates.get(index) for target in self.targets]

    def write_boxes(self, path: Path) -> None:
        """Write CSV or JSONL, as `entrack track` does."""
        nothing = np.empty((0, 0, 3), np.uint8)
        with BoxWriter(path) as writer:
            for index, estimates in self.known():
                writer.write(Frame(index, self._times[index], nothing), estimates)

    def write_video(self, path: Path) -> Generator[float, None, None]:
        """Write the annotated MP4 of the frames known, and yield the share that is done."""
        known = dict(self.known())
        frames = range(min(known), max(known) + 1)
        with VideoWriter(path, self.footage.fps) as video:
            for index in frames:
                frame = self.footage[index]
                size = written_size(frame.image)
                drawn = overlay(frame.image, known.get(index, []), index, size=size)
                video.write(drawn, frame.time)
                yield (index - frames.start + 1) / len(frames)

    def close(self) -> None:
        """Let go of the footage and the trackers, whoever still holds the session."""
        self.footage.close()
        self.targets.clear()
        del self._tracker

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
