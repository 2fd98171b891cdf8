"""Place and size of a target from one look at it: what near the answer is like it most.

What is inside a box is compared with what the target has looked like, by the cosine of features.
Where a box that is a fifth larger is more alike than one that is a fifth smaller, the target has
grown; where one further to the right is more alike than one to the left, it lies further to the
right. That holds on to a target which another one crosses, and is biased by whatever is beside it.
So most of the place is found as Lucas and Kanade do it, with features for grey values: how those of
the first frame's box change where it is moved or grown says which move explains what is seen now
(S. Baker and I. Matthews, *Lucas-Kanade 20 years on*, 2004; the inverse compositional way).
All is sampled from the features of one search window: nothing else passes through the trunk.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from entrack import box as boxes_
from entrack import filter as cf
from entrack.box import Boxes
from entrack.config import LikenessConfig
from entrack.filter import Features
from entrack.state import GRID, sample_boxes
from entrack.window import Window

FURTHEST = 0.1
"""Sizes by which the centre is moved at most."""
POINTS = 5
"""Points on a side of the box that the place is found by, which is larger than the target …"""
WIDER = 1.4
"""… by this factor: where it ends says more than what is in its middle."""


@dataclass(frozen=True)
class Likeness:
    """What a target's box has looked like."""

    config: LikenessConfig
    around: Features
    """Mean features (C,) of the first frame's window."""
    first: Features
    """What 5 × 5 points in and around the first box have beyond them (25 · C,) …"""
    moves: Features
    """… and what moves the box, in sizes to the right and down, by what they change (25 · C, 2)."""
    inside: Features
    """A running mean of what the box's 8 × 8 points have beyond the window (64, C)."""

    @classmethod
    def of(
        cls, features: Features, box: Boxes, window: Window, config: LikenessConfig
    ) -> "Likeness":
        """Remember Z (C, n, n) of a window around `box`."""
        around = features.mean(axis=(1, 2))
        moved = np.vstack([np.eye(4), -np.eye(4), np.zeros((1, 4))]) * config.step
        centres = boxes_.centre(box) + moved[:, :2] * box[2:]
        near = boxes_.from_centre(centres, WIDER * box[2:] * np.exp(moved[:, 2:]))
        points = sample_boxes(features, near, window, POINTS).reshape(9, -1)
        # What the features change by for a move of one size: right, down, wider and higher. The
        # last two are there to be told from the first, and are not asked for.
        change = (points[:4] - points[4:8]) / np.float32(2 * config.step)
        sound = np.isfinite(change).all()  # else a network overflowed
        moves = np.linalg.pinv(change if sound else np.zeros_like(change))[:, :2]
        first = points[8] - np.tile(around, POINTS**2)
        inside = sample_boxes(features, [box], window, GRID)[0] - around
        return cls(config, around, first, moves, inside)

    def fit(self, features: Features, box: Boxes, window: Window) -> tuple[Boxes, float]:
        """The centre (2,) that is most like the target, near `box`, and by what factor it grows."""
        config, centre, size = self.config, boxes_.centre(box), box[2:]
        if not np.isfinite(box).all():
            return centre, 1.0
        aside = config.step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
        beside = self._alike(features, centre + size * aside, size, window)
        right, left, below, above = beside.tolist()
        wider = boxes_.from_centre(centre, WIDER * size)
        seen = sample_boxes(features, [wider], window, POINTS)[0] - self.around
        off = (seen.ravel() - self.first) @ self.moves
        move = config.pull * np.array([right - left, below - above]) - config.share * off
        centre = centre + size * np.clip(move, -FURTHEST, FURTHEST)
        if not np.isfinite(centre).all():
            return centre, 1.0
        sizes = np.outer([config.span, 1 / config.span], size)
        larger, smaller = self._alike(features, centre, sizes, window).tolist()
        most = math.log(config.span)
        growth = config.gain * (larger - smaller) + config.bias
        return centre, math.exp(min(max(growth, -most), most))

    def learn(self, features: Features, box: Boxes, window: Window) -> "Likeness":
        """One frame later."""
        seen = sample_boxes(features, [box], window, GRID)[0] - self.around
        return replace(self, inside=cf.update(self.inside, seen, self.config.rate))

    def _alike(self, features: Features, centre: Boxes, size: Boxes, window: Window) -> Features:
        """How like the target the boxes (k,) of these centres and sizes are."""
        seen = sample_boxes(features, boxes_.from_centre(centre, size), window, GRID) - self.around
        return cosines(seen, self.inside)


def cosines(seen: Features, known: Features) -> Features:
    """The cosines (k,) of several boxes' features (k, points, C) with those that are known."""
    length = np.linalg.norm(seen, axis=(1, 2)) * np.linalg.norm(known)
    return (seen * known).sum(axis=(1, 2)) / np.maximum(length, np.float32(1e-9))
