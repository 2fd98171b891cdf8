"""How wide and how high a target has become: what is told of its box, and nothing works with.

A person turns, a runner stretches, a car comes round a corner: the first box's aspect ratio is soon
another. Whoever follows the new one from frame to frame drifts, for every look errs a little. So
the tracker works with boxes of the first one's aspect, and each look says afresh how far that is
off: the policy would have widened the box, features in a wider box are more like the first, and
parts of the first box are wider apart. A running mean of all is what the told box is stretched by.
It changes no later look.
"""

from dataclasses import dataclass, replace

import numpy as np

from entrack import box as boxes_
from entrack.box import Boxes
from entrack.config import AspectConfig
from entrack.likeness import Inside, Parts
from entrack.state import GRID
from entrack.trunk import Maps
from entrack.window import Window

STEP = 0.2
"""Logarithm of the ratio by which a box is made wider, and lower, to compare."""
MOST = 0.8
"""Logarithm of the greatest change that is told."""


@dataclass(frozen=True)
class Aspect:
    """By how much a target is wider than its first box."""

    config: AspectConfig
    inside: Inside
    """What Z has in the first box, …"""
    parts: Parts
    """… and the finer map at points of it."""
    mean: float = 0.0
    """A running mean of the logarithm by which each look found the aspect ratio changed."""

    @classmethod
    def of(cls, maps: Maps, box: Boxes, window: Window, config: AspectConfig) -> "Aspect":
        """Remember what is in a window around `box`."""
        inside, parts = Inside.of(maps.z, box, window, GRID), Parts.of(maps.fine, box, window)
        return cls(config, inside, parts)

    def then(self, maps: Maps, box: Boxes, window: Window, action: float) -> "Aspect":
        """One frame later: the target is in `box`, which the action would have made so much wider.

        `action` is the logarithm of the change of the aspect ratio.
        """
        sizes = box[2:] * np.exp(np.outer([STEP / 2, -STEP / 2], [1, -1]))
        boxes = boxes_.from_centre(boxes_.centre(box), sizes)
        wider, narrower = self.inside.alike(maps.z, boxes, window).tolist()
        found = self.config.action * action + self.config.alike * (wider - narrower)
        if self.config.parts:
            found += self.config.parts * self.parts.found(maps.fine, box, window).wider
        if not np.isfinite(found):
            return self
        return replace(self, mean=self.mean + self.config.rate * (found - self.mean))

    @property
    def change(self) -> float:
        """The logarithm that is told: 0 where the change is small, for then it may be none."""
        beyond = max(abs(self.mean) - self.config.slack, 0.0)
        return float(np.copysign(min(beyond, MOST), self.mean))

    def stretch(self, box: Boxes) -> Boxes:
        """A box of the first one's aspect as it is told: of the same centre and area."""
        size = box[2:] * np.exp(np.array([0.5, -0.5]) * self.change)
        return boxes_.from_centre(boxes_.centre(box), size)
