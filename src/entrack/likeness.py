"""Place and size of a target from one look at it: what near the answer is like it most.

What is inside a box is compared with what the target has looked like, by the cosine of features.
Where a box that is a fifth larger is more alike than one that is a fifth smaller, the target has
grown; where one further to the right is more alike than one to the left, it lies further to the
right. That holds on to a target which another one crosses, and is biased by whatever is beside it.
So most of the place is found as Lucas and Kanade do it, with features for grey values: how those of
the first frame's box change where it is moved or grown says which move explains what is seen now
(S. Baker and I. Matthews, *Lucas-Kanade 20 years on*, 2004; the inverse compositional way).
All is sampled from what the trunk saw in one search window, of which nothing else is asked: Z says
best what a thing is, and the finer map that it was made of where its sides are.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from entrack import box as boxes_
from entrack import filter as cf
from entrack.box import Boxes
from entrack.config import LikenessConfig
from entrack.filter import Features
from entrack.state import GRID, sample_boxes, unit
from entrack.trunk import Maps
from entrack.window import Window

FURTHEST = 0.1
"""Sizes by which the centre is moved at most, by each of the two."""
FINER = 12
"""Points on a side of the box that the finer map is compared at; Z at `state.GRID`."""
AROUND, AROUND_FINER = 5, 9
"""The same for the first look, whose box is larger than the target …"""
WIDER = 1.4
"""… by this factor: where it ends says more than what is in its middle."""
CLEARLY = 0.1
"""Sizes from which on a box is clearly off."""
ALONG = ((np.arange(GRID) + 0.5) / GRID - 0.5).astype(np.float32)
"""Where the parts of the first box are, in sizes from its centre …"""
WITHIN, HEAT = 0.3, 0.04
"""… so near to which each is looked for, and by how much less alike it is hardly there …"""
SHARP = 0.002
"""… and how well its place is known at best: the square of its error."""
CLOSEST = 0.2
"""Parts do not come nearer together than that."""
SCATTERED = 0.1
"""Sizes by which parts may lie about, in the mean: beyond, they were not found again."""


@dataclass(frozen=True)
class Inside:
    """What a map of the trunk's has in a target's box, beyond what it had around the first one."""

    around: Features
    """Means (C,) of the first frame's window."""
    seen: Features
    """What `side` × `side` points of the box have beyond them (side², C)."""
    side: int

    @classmethod
    def of(cls, features: Features, box: Boxes, window: Window, side: int) -> "Inside":
        """Remember `box` in a window with features (C, n, n)."""
        around = features.mean(axis=(1, 2))
        return cls(around, sample_boxes(features, [box], window, side)[0] - around, side)

    def alike(self, features: Features, boxes: Boxes, window: Window) -> Features:
        """How like it several boxes (k, 4) are: cosines (k,)."""
        seen = sample_boxes(features, boxes, window, self.side) - self.around
        length = np.linalg.norm(seen, axis=(1, 2)) * np.linalg.norm(self.seen)
        return (seen * self.seen).sum(axis=(1, 2)) / np.maximum(length, np.float32(1e-9))

    def learn(self, features: Features, box: Boxes, window: Window, rate: float) -> "Inside":
        """Go on with a running mean."""
        seen = sample_boxes(features, [box], window, self.side)[0] - self.around
        return replace(self, seen=cf.update(self.seen, seen, rate))


@dataclass(frozen=True)
class FirstLook:
    """What a map had in and around the first box, and what of that changes with the box."""

    seen: Features
    """What `side` × `side` points had (side² · C,) …"""
    moves: Features
    """… and what moves the box, in sizes to the right and down, by what they change (…, 2)."""
    side: int

    @classmethod
    def of(
        cls, features: Features, box: Boxes, window: Window, side: int, step: float
    ) -> "FirstLook":
        """Remember `box` in a window with features (C, n, n), and boxes that are `step` away."""
        moved = np.vstack([np.eye(4), -np.eye(4), np.zeros((1, 4))]) * step
        centres = boxes_.centre(box) + moved[:, :2] * box[2:]
        near = boxes_.from_centre(centres, WIDER * box[2:] * np.exp(moved[:, 2:]))
        points = sample_boxes(features, near, window, side).reshape(9, -1)
        # What the features change by for a move of one size: right, down, wider and higher. The
        # last two are there to be told from the first, and are not asked for.
        change = (points[:4] - points[4:8]) / np.float32(2 * step)
        sound = np.isfinite(change).all()  # else a network overflowed
        moves = np.linalg.pinv(change if sound else np.zeros_like(change))[:, :2]
        return cls(points[8], moves, side)

    def off(self, features: Features, box: Boxes, window: Window) -> Boxes:
        """How far a box is off: sizes to the right and down (2,)."""
        wider = boxes_.from_centre(boxes_.centre(box), WIDER * box[2:])
        change = sample_boxes(features, [wider], window, self.side).ravel() - self.seen
        return np.asarray(change @ self.moves, np.float64)


class Found(NamedTuple):
    """Where the parts of a box have gone."""

    move: Boxes
    """How far to the right and down, in sizes (2,): the mean of all."""
    scatter: float
    """How far from that they are, in sizes, in the mean."""
    wider: float
    """By what logarithm they are further apart from left to right than from top to bottom."""


NOWHERE = Found(np.zeros(2), math.inf, 0.0)


@dataclass(frozen=True)
class Parts:
    """What a map had at points of a box, each of which is looked for by itself.

    Those of the first box say how wide the target has become; those of the last one, where what was
    in it is now: Lucas and Kanade once more, without their small steps.
    """

    around: Features
    """Means (C,) of that frame's window."""
    seen: Features
    """What `GRID` × `GRID` points of the box had beyond them, at length 1 (GRID², C)."""

    @classmethod
    def of(cls, features: Features, box: Boxes, window: Window) -> "Parts":
        """Remember `box` in a window with features (C, n, n)."""
        inside = Inside.of(features, box, window, GRID)
        return cls(inside.around, unit(inside.seen, axis=1))

    def found(self, features: Features, box: Boxes, window: Window) -> Found:
        """Look for each near where it would be in `box`: a soft maximum of cosines.

        In mean and least squares those count that are found, and found in one place.
        """
        n = features.shape[-1]
        left, top, w, h = (window.to_patch(box) * (n / window.size)).tolist()
        where = np.arange(n, dtype=np.float32) + np.float32(0.5)  # cells, in sizes from its centre
        x, y = ((where - start) / size - np.float32(0.5) for start, size in ((left, w), (top, h)))
        columns, rows = (np.flatnonzero(np.abs(c) < 0.5 + WITHIN) for c in (x, y))
        if not (len(columns) and len(rows)):
            return NOWHERE
        x, y = x[columns], y[rows]
        cells = features[:, rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        cells = unit(cells.swapaxes(0, 1) - self.around[:, None], axis=1)
        # Row by row: small products, for which no BLAS wakes its threads.
        alike = np.matmul(self.seen, cells).swapaxes(0, 1)
        across, down = np.tile(ALONG, GRID), np.repeat(ALONG, GRID)
        near = np.abs(y - down[:, None])[:, :, None] < WITHIN
        near = near & (np.abs(x - across[:, None])[:, None] < WITHIN)
        alike = np.where(near, alike, np.float32(-9))  # no cosine, and no share of the maximum
        best = alike.max(axis=(1, 2), keepdims=True)
        share = np.exp((alike - best) / HEAT)
        share /= share.sum(axis=(1, 2), keepdims=True)
        right, lower = share.sum(axis=1), share.sum(axis=2)
        found = np.stack([right @ x, lower @ y])
        spread = right @ x**2 + lower @ y**2 - (found**2).sum(axis=0)
        counts = np.maximum(best.ravel(), 0) ** 4 / (SHARP + spread)
        total = float(counts.sum())
        if not total > 0:  # nothing is alike, or a network overflowed
            return NOWHERE
        counts /= total
        places = np.stack([across, down])
        moves = found - places
        move = moves @ counts
        scatter = float(np.hypot(*(moves - move[:, None])) @ counts)
        grown = (_slope(*pair, counts) for pair in zip(places, found, strict=True))
        width, height = (math.log(max(g, CLOSEST)) for g in grown)
        return Found(move.astype(np.float64), scatter, width - height)

    def slip(self, features: Features, box: Boxes, window: Window, centre: Boxes) -> float:
        """How far a new centre is from where what was in `box` has gone, in sizes.

        0 where that cannot be told, for its parts are all over the place.
        """
        found = self.found(features, box, window)
        if found.scatter > SCATTERED:
            return 0.0
        off = centre - boxes_.centre(box) - found.move * box[2:]
        return math.hypot(*off) / math.sqrt(box[2] * box[3])


def _slope(x: Features, y: Features, counts: Features) -> float:
    """Of the line that fits y (k,) best, whose `counts` are 1 in all: the factor of x (k,)."""
    off = x - counts @ x
    return float((counts * off) @ (y - counts @ y)) / max(float((counts * off) @ off), 1e-9)


@dataclass(frozen=True)
class Likeness:
    """What a target's box has looked like."""

    config: LikenessConfig
    first: FirstLook
    """Of Z, which says whether the box is where it should be …"""
    first_fine: FirstLook
    """… and of the finer map, which says where that is."""
    coarse: Inside
    """A running mean of what Z has in the box."""
    fine: Inside
    """The same of the finer map."""

    @classmethod
    def of(cls, maps: Maps, box: Boxes, window: Window, config: LikenessConfig) -> "Likeness":
        """Remember what is in a window around `box`."""
        return cls(
            config,
            FirstLook.of(maps.z, box, window, AROUND, config.step),
            FirstLook.of(maps.fine, box, window, AROUND_FINER, config.step),
            Inside.of(maps.z, box, window, GRID),
            Inside.of(maps.fine, box, window, FINER),
        )

    def off(self, maps: Maps, box: Boxes, window: Window) -> float:
        """For the score: how far `box` is off by Z, 0 to 1; see `entrack.config.Weights`."""
        away = math.hypot(*self.first.off(maps.z, box, window))
        return min(away / CLEARLY, 1.0) ** 2

    def fit(self, maps: Maps, box: Boxes, window: Window) -> tuple[Boxes, float]:
        """The centre (2,) that is most like the target, near `box`, and by what factor it grows."""
        config, centre, size = self.config, boxes_.centre(box), box[2:]
        if not np.isfinite(box).all():
            return centre, 1.0
        centre = centre - size * _near(config.share * self.first_fine.off(maps.fine, box, window))
        if not np.isfinite(centre).all():
            return centre, 1.0
        aside = config.step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
        beside = boxes_.from_centre(centre + size * aside, size)
        sizes = np.outer([config.span, 1 / config.span], size)
        resized = boxes_.from_centre(centre, sizes)
        alike = self.fine.alike(maps.fine, np.vstack([beside, resized]), window)
        right, left, below, above, larger, smaller = alike.tolist()
        centre = centre + size * _near(config.pull * np.array([right - left, below - above]))
        larger_too, smaller_too = self.coarse.alike(maps.z, resized, window).tolist()
        most = math.log(config.span)
        growth = config.gain * (larger - smaller + larger_too - smaller_too) + config.bias
        return centre, math.exp(min(max(growth, -most), most))

    def learn(self, maps: Maps, box: Boxes, window: Window) -> "Likeness":
        """One frame later."""
        coarse = self.coarse.learn(maps.z, box, window, self.config.rate)
        fine = self.fine.learn(maps.fine, box, window, self.config.rate)
        return replace(self, coarse=coarse, fine=fine)


def _near(move: ArrayLike) -> Boxes:
    return np.clip(np.asarray(move, np.float64), -FURTHEST, FURTHEST)
