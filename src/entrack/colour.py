"""The colours of a target, next to those around it: what the trunk hardly sees.

It was trained to know a thing in any light, so that a copy in another tint is the same to it. A
histogram sees nothing else. M is lowered where a box would hold few of the colours that the target
has and its surroundings have not (the histograms are those of Staple, L. Bertinetto et al., 2016).
A histogram is coarse. Finer is a target's tint, the one that most of it has: whatever has another
one than the first frames is somebody else, however much it looks like the target.
"""

import math
from dataclasses import dataclass, replace
from typing import cast

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
CORE = 0.7
"""Share of a box's sides within which its tint is seen."""
OTHERS = 0.02
"""How much a pixel counts whose colour is not the target's."""
NEAR, STEPS = 0.05, 3
"""The commonest tint is sought among those not much further away than this, in so many steps."""
DARK = 8
"""Grey levels that are added to a pixel's, for in the dark there is more noise than tint."""
STEADY = 0.01
"""A tint is known no better than by this."""
YOUNG = 30
"""Frames in which the tint is learned, and how much it varies; after them …"""
SURE, SLOW = 0.7, 0.01
"""… a frame counts by the second of these, and only where the score is at least the first."""
ORDINARY = 0.5
"""A tint that is off by up to so many times what is usual for a target says nothing, as in grey
footage. Those that are off by far more are alike: a target may have another side, in another."""
LOGS = np.log(np.arange(256, dtype=np.float32) + DARK)

NEARER = 1.65
"""How many times as far off as the tint of something else that of what is followed has to be,
`ORDINARY` added to both: two that have the target's tint are told apart by where they are."""

Codes = NDArray[np.uint16]
Shares = NDArray[np.float32]


def codes(patch: Image, bins: int) -> Codes:
    """Which of bins³ colours every second pixel of a patch (S, S, 3) has: (S / 2, S / 2).

    >>> codes(np.full((4, 4, 3), (0, 128, 255), np.uint8), bins=4)
    array([[11, 11],
           [11, 11]], dtype=uint16)
    """
    blue, green, red = (  # one by one: four times as fast as all of them
        (patch[::STRIDE, ::STRIDE, channel] // (256 // bins)).astype(np.uint16)
        for channel in range(3)
    )
    return (blue * bins + green) * bins + red


@dataclass(frozen=True)
class Seen:
    """What colours a box has, and what is around it."""

    inside: Shares
    """The shares (bins³,) that colours have in the box, which sum to 1, …"""
    around: Shares
    """… and around it."""
    tint: Features
    """The commonest tint (3,) of what in the box has the target's colours: logarithms of blue,
    green and red, less the mean of the three, so that the light's strength does not count."""

    @classmethod
    def of(cls, patch: Image, roi: Boxes, bins: int, chance: Shares | None = None) -> "Seen":
        """Count the colours of a window; `roi` is the box in shares of the window.

        `chance` (bins³,) is how much a pixel of each colour is the target's, see `chance_of`; by
        default, what is seen here decides.
        """
        seen = codes(patch, bins)

        def within(share: float) -> Features:
            x, y, w, h = roi.tolist()
            rows, columns = (covered(y + h / 2, share * h, n), covered(x + w / 2, share * w, n))
            return np.outer(rows, columns)

        def count(weights: Features) -> Shares:
            total = np.bincount(seen.ravel(), weights.ravel(), bins**3).astype(np.float32)
            return total / np.float32(max(total.sum(), 1e-9))

        n = len(seen)
        inside, around = count(within(INNER)), count(1 - within(OUTER))
        chance = chance_of(inside, around) if chance is None else chance
        core = within(CORE)
        rows, columns = core.any(1), core.any(0)  # a small part of the window, as a rule
        if not rows.any():
            return cls(inside, around, np.zeros(3, np.float32))
        part = np.ix_(rows, columns)
        weights = core[part] * (chance[seen[part]] + np.float32(OTHERS))
        logs = np.ascontiguousarray(LOGS[patch[::STRIDE, ::STRIDE][part]].reshape(-1, 3).T)
        tints = logs - logs.mean(axis=0)
        return cls(inside, around, commonest(tints, weights.ravel().astype(np.float32)))


def chance_of(own: Shares, around: Shares) -> Shares:
    """How much a pixel of each colour (bins³,) is the target's, by the shares of its own."""
    return cast(Shares, own / (own + around + RARE))


def commonest(tints: Features, weights: Features) -> Features:
    """Where most of the tints (3, N) of pixels are: mean shift from their median.

    Their mean would follow whatever else is in the box.

    >>> tints = np.array([[0, 0, 0, 0.01, 0.01, 1], np.zeros(6), [0, 0, 0, 0.01, 0.01, -1]])
    >>> commonest(tints.astype(np.float32), np.ones(6, np.float32)).round(3)
    array([0.004, 0.   , 0.004], dtype=float32)
    """
    order = tints.argsort(axis=1)
    sums = weights[order].cumsum(axis=1)
    half = (sums < sums[:, -1:] / 2).sum(axis=1, keepdims=True)
    found = np.take_along_axis(tints, np.take_along_axis(order, half, 1), 1)
    for _ in range(STEPS):
        away = np.square(tints - found).sum(axis=0)
        near = weights * (np.exp(away * np.float32(-0.5 / NEAR**2)) + np.float32(RARE))
        found = (tints @ near / near.sum())[:, None]
    return found[:, 0]


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
    chance: Shares
    """How much a pixel of each colour was the target's then."""
    mean: Seen
    """Running means."""
    spread: float = STEADY
    """How far the tint was from its mean, in the frames in which both were learned."""
    frames: int = 1
    """Of which there have been so many."""

    @classmethod
    def of(cls, patch: Image, roi: Boxes, config: ColourConfig) -> "Colours":
        """Start with a box in the first frame's window, in shares of it."""
        seen = Seen.of(patch, roi, config.bins)
        return cls(config, seen.inside, chance_of(seen.inside, seen.around), seen)

    def see(self, patch: Image, roi: Boxes) -> Seen:
        """Look at a box in a later window, in shares of it."""
        return Seen.of(patch, roi, self.config.bins, self.chance)

    def learn(self, seen: Seen, score: float) -> "Colours":
        """One frame later."""
        rate, mean, young = self.config.rate, self.mean, self.frames < YOUNG
        inside = cf.update(mean.inside, seen.inside, rate)
        around = cf.update(mean.around, seen.around, rate)
        rate = 1 / (self.frames + 1) if young else SLOW * (score >= SURE)
        wider = rate * (self._off(seen) - self.spread) if young else 0.0
        mean = Seen(inside, around, cf.update(mean.tint, seen.tint, rate))
        return replace(self, mean=mean, spread=self.spread + wider, frames=self.frames + young)

    def change(self, seen: Seen) -> float:
        """The logarithm of how much the colours differ from the first box's.

        That is 1 less the Bhattacharyya coefficient, 0 for the same and 1 for none in common.
        """
        alike = float(np.sqrt(self.first * seen.inside).sum())
        return math.log(LEAST + max(1 - alike, 0.0))

    def strange(self, seen: Seen) -> float:
        """How unlike the first frames' the tint is, by what is usual for this target: 0 to 1."""
        off = self._unusual(seen)
        return max(off - ORDINARY, 0.0) / (off + ORDINARY)

    def nearer(self, seen: Seen, other: Seen) -> bool:
        """Whether the tint is clearly nearer to the first frames' than the other's."""
        return self._unusual(other) + ORDINARY > NEARER * (self._unusual(seen) + ORDINARY)

    def _unusual(self, seen: Seen) -> float:
        """How far off the tint is, in units of what is usual for this target."""
        return self._off(seen) / (STEADY + self.spread)

    def _off(self, seen: Seen) -> float:
        return float(np.linalg.norm(seen.tint - self.mean.tint))

    def weigh(self, response: Features, patch: Image, size: Boxes) -> Features:
        """M (n, n), lowered where the colours are others'; `size` (2,) in shares of the window."""
        seen = codes(patch, self.config.bins)
        own = cf.update(self.first, self.mean.inside, 0.5)
        chance = chance_of(own, self.mean.around)
        n = response.shape[-1]
        # Where the target would be for each cell of M, in shares of the window's side.
        places = np.arange(n, dtype=np.float64) / n + (0.5 - n // 2 / n)
        columns, rows = (covered(places, INNER * side, len(seen)) for side in size.tolist())
        found = _means(rows) @ chance[seen] @ _means(columns).T + DOUBT
        weight = (found / found.max()) ** self.config.power
        return np.where(response > 0, weight * response, response).astype(np.float32)


def _means(weights: Features) -> Features:
    return weights / weights.sum(axis=1, keepdims=True)
