"""The colours of a target, next to those around it: what the trunk hardly sees.

It was trained to know a thing in any light, so that a copy in another tint is the same to it. A
histogram sees nothing else. M is lowered where a box would hold few of the colours that the target
has and its surroundings have not (the histograms are those of Staple, L. Bertinetto et al., 2016).
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack import filter as cf
from entrack.box import Boxes
from entrack.config import ColourConfig
from entrack.filter import Features
from entrack.window import Image

STRIDE = 2
"""Pixels of the patch from one that is counted to the next."""
INNER = 0.8
"""Share of a box's sides within which colours are the target's; its corners are often not …"""
OUTER = 1.2
"""… and beyond which they are those around it."""
RARE = 1e-4
"""A share of pixels so small that it says nothing."""
DOUBT = 0.1
"""Where the target's colours are seen less than this, nowhere is better than elsewhere."""
LEAST = 0.02
"""Differences far below it are none."""

Codes = NDArray[np.uint16]
Shares = NDArray[np.float32]


def codes(patch: Image, bins: int) -> Codes:
    """Which of bins³ colours every second pixel of a patch (S, S, 3) has: (S / 2, S / 2).

    >>> codes(np.full((4, 4, 3), (0, 128, 255), np.uint8), bins=4)
    array([[11, 11],
           [11, 11]], dtype=uint16)
    """
    level = (patch[::STRIDE, ::STRIDE] // (256 // bins)).astype(np.uint16)
    return (level[..., 0] * bins + level[..., 1]) * bins + level[..., 2]


@dataclass(frozen=True)
class Seen:
    """The shares (bins³,) that colours have in a box, and around it; each sums to 1."""

    inside: Shares
    around: Shares

    @classmethod
    def of(cls, patch: Image, roi: Boxes, bins: int) -> "Seen":
        """Count the colours of a window; `roi` is the box in shares of the window."""
        seen = codes(patch, bins)

        def count(weights: Features) -> Shares:
            total = np.bincount(seen.ravel(), weights.ravel(), bins**3).astype(np.float32)
            return total / np.float32(max(total.sum(), 1e-9))

        n, (x, y, w, h) = len(seen), roi.tolist()
        inner, outer = (
            np.outer(covered(y + h / 2, f * h, n), covered(x + w / 2, f * w, n))
            for f in (INNER, OUTER)
        )
        return cls(count(inner), count(1 - outer))


def covered(centre: ArrayLike, length: float, n: int) -> Features:
    """How much of each of n pixels lines cover (…, n); in shares of the window's side.

    >>> covered([0.5, 1], 0.5, 4)
    array([[0., 1., 1., 0.],
           [0., 0., 0., 1.]], dtype=float32)
    """
    middle = n * np.asarray(centre, np.float64)[..., None] - np.arange(n)
    half = n * length / 2
    ends = np.clip([middle - half, middle + half], 0, 1)
    return (ends[1] - ends[0]).astype(np.float32)


@dataclass(frozen=True)
class Colours:
    """What is remembered of a target's colours."""

    config: ColourConfig
    first: Shares
    """Of the target in the first frame."""
    mean: Seen
    """Running means."""

    @classmethod
    def of(cls, patch: Image, roi: Boxes, config: ColourConfig) -> "Colours":
        """Start with a box in the first frame's window, in shares of it."""
        seen = Seen.of(patch, roi, config.bins)
        return cls(config, seen.inside, seen)

    def learn(self, seen: Seen) -> "Colours":
        """One frame later."""
        rate, mean = self.config.rate, self.mean
        inside = cf.update(mean.inside, seen.inside, rate)
        return replace(self, mean=Seen(inside, cf.update(mean.around, seen.around, rate)))

    def change(self, seen: Seen) -> float:
        """The logarithm of how much the colours differ from the first box's.

        That is 1 less the Bhattacharyya coefficient, 0 for the same and 1 for none in common.
        """
        alike = float(np.sqrt(self.first * seen.inside).sum())
        return math.log(LEAST + max(1 - alike, 0.0))

    def weigh(self, response: Features, patch: Image, size: Boxes) -> Features:
        """M (n, n), lowered where the colours are others'; `size` (2,) in shares of the window."""
        seen = codes(patch, self.config.bins)
        own = (self.first + self.mean.inside) / 2
        chance = own / (own + self.mean.around + RARE)
        n = response.shape[-1]
        # Where the target would be for each cell of M, in shares of the window's side.
        places = np.arange(n, dtype=np.float64) / n + (0.5 - n // 2 / n)
        columns, rows = (covered(places, INNER * side, len(seen)) for side in size.tolist())
        found = _means(rows) @ chance[seen] @ _means(columns).T + DOUBT
        weight = (found / found.max()) ** self.config.power
        return np.where(response > 0, weight * response, response).astype(np.float32)


def _means(weights: Features) -> Features:
    return weights / weights.sum(axis=1, keepdims=True)
