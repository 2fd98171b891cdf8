"""Place and size of a target from one look at it: which boxes near the answer are like it most.

The features inside a box are compared by their cosine with what they have been so far. Where a box
that is a fifth larger is more alike than one that is a fifth smaller, the target has grown; where
one further to the right is more alike than one to the left, it lies further to the right. All are
sampled from the features of one search window: no other size passes through the trunk.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from entrack import box as boxes_
from entrack import filter as cf
from entrack.box import Boxes
from entrack.config import LikenessConfig
from entrack.filter import Features
from entrack.state import GRID, sample_box
from entrack.window import Window

FURTHEST = 0.1
"""Sizes by which the centre is moved at most."""


@dataclass(frozen=True)
class Likeness:
    """What the inside of a target's box has looked like."""

    config: LikenessConfig
    around: Features
    """Mean features (C, 1, 1) of the first frame's window …"""
    inside: Features
    """… and a running mean of what the box's points (C, 8, 8) have beyond them."""

    @classmethod
    def of(
        cls, features: Features, box: Boxes, window: Window, config: LikenessConfig
    ) -> "Likeness":
        """Remember Z (C, n, n) of a window around `box`."""
        around = features.mean(axis=(1, 2), keepdims=True)
        return cls(config, around, sample_box(features, box, window, GRID) - around)

    def fit(self, features: Features, box: Boxes, window: Window) -> tuple[Boxes, float]:
        """The centre (2,) that is most like the target, near `box`, and by what factor it grows."""
        config, centre, size = self.config, boxes_.centre(box), box[2:]
        if not np.isfinite(box).all():
            return centre, 1.0

        def alike(x: float, y: float, factor: float) -> float:
            near = boxes_.from_centre(centre + size * (x, y), size * factor)
            seen = sample_box(features, near, window, GRID) - self.around
            length = float(np.linalg.norm(seen) * np.linalg.norm(self.inside))
            return float((seen * self.inside).sum()) / max(length, 1e-9)

        if config.pull:
            s = config.step
            slope = [alike(s, 0, 1) - alike(-s, 0, 1), alike(0, s, 1) - alike(0, -s, 1)]
            centre = centre + size * np.clip(config.pull * np.array(slope), -FURTHEST, FURTHEST)
        slope = alike(0, 0, config.span) - alike(0, 0, 1 / config.span)
        most = math.log(config.span)
        return centre, math.exp(min(max(config.gain * slope + config.bias, -most), most))

    def learn(self, features: Features, box: Boxes, window: Window) -> "Likeness":
        """One frame later."""
        seen = sample_box(features, box, window, GRID) - self.around
        return replace(self, inside=cf.update(self.inside, seen, self.config.rate))
