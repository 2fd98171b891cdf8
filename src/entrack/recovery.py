"""When in doubt: what a tracker remembers of the target's first look, and where it searches.

Nothing of this moves a box while the score is high. When it has fallen, or is low, a few places are
looked at in each frame, and what is more like the target there than what is followed, for several
frames, is followed instead. When the score is very low, the last box that was sure is held, and
more places are looked at, further and further away from there. The filter of the first frame, which
never learns, says which of them is worth a closer look; there the tracker works as ever, and if its
score stays higher, it has found the target.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from entrack import box as boxes_
from entrack import filter as cf
from entrack.box import Boxes
from entrack.config import RecoveryConfig, ScoreConfig
from entrack.state import GROWN, sample_box
from entrack.window import Window

HERE, ELSEWHERE = 1.5, 2.5
"""Cells from the box's centre up to which a response is the box's, and from which on another's."""
FORGET = 0.01
"""Share of the greatest leap that is forgotten in a frame."""
LEAST, MOST = 0.02, 0.1
"""Leaps far below the one are none, and those above the other alike: whoever has leapt that far may
have gone over to another, and no further leap tells more."""
RESTLESS = 0.1
"""Share of a frame in the running mean of how far from where it is expected a target is …"""
UNREST = 0.2
"""… which does not count above this, in sizes."""
NOTHING = 0.2
"""A height of the first look's response below which it is doubted that anything like it is seen."""
FAINT = 0.02
"""A height below which a response says nothing."""
POINTS = 6
"""Points a side at which the features in two boxes are compared."""
USUAL = 0.02
"""Share of a frame in the running mean of the score …"""
FALL = 0.05
"""… from which it has to fall by this to be doubted: footage whose score is modest throughout is no
reason to look elsewhere in every frame."""
ORIGIN = GROWN
"""Width of the taper around the first box, in units of its size: a target's own place in the first
frame looks like the target to a filter that sees more, and is where it is not once it has moved."""


@dataclass(frozen=True)
class Origin:
    """The target in the first frame, and nothing of what was around it."""

    taper: cf.Features
    """(n, n): 1 in the middle of the box, 0 where the target is not."""
    weights: cf.Spectrum
    """Ŵ of features so tapered."""
    points: cf.Features
    """Features (C, 6, 6) inside the box, less `mean`."""
    mean: cf.Features
    """Mean features (C, 1, 1) of the window."""

    @classmethod
    def of(
        cls,
        features: cf.Features,
        box: Boxes,
        window: Window,
        fit: Callable[[cf.Features], cf.Spectrum],
    ) -> "Origin":
        """Remember Z (C, n, n) of a window around `box`."""
        n = features.shape[-1]
        taper = cf.hann(n, n * ORIGIN * math.sqrt(box[2] * box[3] / (window.w * window.h)))
        mean = features.mean(axis=(1, 2), keepdims=True)
        points = sample_box(features, box, window, POINTS) - mean
        return cls(taper, fit(features * taper), points, mean)

    def evidence(
        self, response: cf.Features, features: cf.Features, box: Boxes, window: Window
    ) -> dict[str, float]:
        """How much `box` looks like it: `first`, `unseen`, `rival`, `same`, see `config.Weights`.

        `response` (n, n) is that of `weights`, in a window with features Z (C, n, n).
        """
        n = response.shape[-1]
        apart = _apart(n, box, window)
        first = float(response[apart <= HERE].max())
        rival = float(response[apart > ELSEWHERE].max()) / max(first, FAINT)
        seen = sample_box(features, box, window, POINTS) - self.mean
        length = float(np.linalg.norm(seen) * np.linalg.norm(self.points))
        same = float((seen * self.points).sum()) / max(length, 1e-9)
        unseen = 1 - min(max(first / NOTHING, 0.0), 1.0)
        rival = min(max(rival, 0.0), 2.0)
        return {"first": first, "unseen": unseen, "rival": rival, "same": same}


@dataclass(frozen=True)
class Past:
    """What has happened since the first frame, which no later picture tells.

    >>> Past().then(away=0.5, leapt=0.5, rival=0.8).then(away=0.0, leapt=0.0, rival=0.8)
    Past(leap=0.396, unrest=0.045)
    """

    leap: float = 0.0
    """The greatest leap so far, see `entrack.config.Weights`."""
    unrest: float = 0.0
    """The running mean of how far from where it was expected the target was, in sizes."""

    def then(self, away: float, leapt: float, rival: float) -> "Past":
        """One frame later, in sizes up to 1.

        The target was `away` from where it was expected, and the box `leapt` off what was in it.
        """
        return Past(
            max((1 - FORGET) * self.leap, leapt * rival),
            (1 - RESTLESS) * self.unrest + RESTLESS * away,
        )

    @property
    def evidence(self) -> dict[str, float]:
        """For the score."""
        leap, unrest = math.log(LEAST + min(self.leap, MOST)), min(self.unrest, UNREST)
        return {"leap": leap, "unrest": unrest}

    def swap(self, strange: float) -> float:
        """For the score: a leap, and now a tint as strange as that."""
        return strange * math.log1p(min(self.leap, MOST) / LEAST)


def _away(n: int, place: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far each cell of a response, which wraps around, is from a place (2,): (2, n, n)."""
    x, y = (np.arange(n) - place[:, None] + n / 2) % n - n / 2
    return np.stack(np.broadcast_arrays(x, y[:, None]))


def _apart(n: int, box: Boxes, window: Window) -> NDArray[np.float64]:
    """How many rows or columns each cell of a window's response is from a box's centre: (n, n)."""
    return np.maximum(*np.abs(_away(n, boxes_.centre(window.to_patch(box)) * n / window.size)))


def _within(n: int, window: Window, size: Boxes, frame: tuple[int, int]) -> NDArray[np.bool_]:
    """Which cells (n, n) of a window's response stand for a box that is partly in the frame."""
    across = (np.arange(n) - n // 2)[:, None] / n + 0.5  # in shares of the window
    centres = across * (window.w, window.h) + (window.x, window.y)
    x, y = (in_sight(centres, size, frame) == centres).T
    return y[:, None] & x


def near(n: int) -> cf.Features:
    """1 where a response (n, n) may be that of what is in the middle of the window, else 0."""
    apart = np.maximum(*np.abs(_away(n, np.full(2, n / 2))))
    return (apart <= ELSEWHERE).astype(np.float32)


def likeliest(
    responses: cf.Features,
    windows: list[Window],
    size: Boxes,
    frame: tuple[int, int],
    other: Boxes | None = None,
) -> Boxes:
    """The box of `size` (2,) where windows (N) answer most, by their responses (N, n, n).

    Some of it is in the `frame` (width and height): beyond, windows show the border's pixels.

    Features are not tapered here, so that a target off the centre answers as well; what a flat
    ground answers is left out of account, and so is what is at the box `other`.
    """
    responses = responses - np.median(responses, axis=(1, 2), keepdims=True)
    n = responses.shape[-1]
    counts = np.stack([_within(n, window, size, frame) for window in windows])
    if other is not None:
        counts &= np.stack([_apart(n, other, window) for window in windows]) > ELSEWHERE
    responses = np.where(counts, responses, responses.min())
    best = int(responses.max(axis=(1, 2)).argmax())
    window, peak = windows[best], cf.peak(responses[best])
    cell = window.box[2:] / n
    centre = boxes_.centre(window.box) + np.array([peak.dx, peak.dy]) * cell
    return boxes_.from_centre(in_sight(centre, size, frame), size)


def in_sight(centre: Boxes, size: Boxes, frame: tuple[int, int]) -> Boxes:
    """The nearest centres (…, 2) of boxes of `size` (2,) that are partly in the frame."""
    return np.clip(centre, -size / 2, frame + size / 2)


@dataclass
class Search:
    """Whether one target is lost, and the search for it.

    Sizes are √(width × height) of the box that is held.
    """

    held: Boxes
    """The last box that was sure: what is reported while the target is searched."""
    config: RecoveryConfig | None
    """None says that a target is lost, and does nothing about it."""
    lost: bool = False
    active: bool = False
    """Whether the target is searched."""
    gone: int = 0
    """Frames for which it has been searched."""
    unsure: int = 0
    """Frames between that box and the search, in which it was followed all the same."""
    wary: int = 0
    """Frames in a row in which it was followed, and doubted."""
    usual: float = 1.0
    """A running mean of the score."""
    missed: int = 0
    """Frames in a row in which it seemed to be lost."""
    confirmed: int = 0
    """Frames in a row in which it seemed to be found."""
    left: Boxes | None = None
    """Where it was when it was first missed after that box."""
    step: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    """How the target's centre moves from frame to frame, a running mean (2,) in pixels."""
    past: Past = Past()
    """What tells that it may be another one by now; that of the box that is held is …"""
    held_past: Past = Past()
    """… this."""
    far: float = 0.0
    """How far from that box it looks for the target in this frame, in sizes."""
    challenger: Boxes | None = None
    """Something else, which may be the target rather than what is followed …"""
    wins: int = 0
    """… and has seemed to be for so many frames."""
    watched: int = 0
    """Frames for which something else is doubted that is followed instead."""
    visited: dict[tuple[int, int], int] = field(default_factory=dict[tuple[int, int], int])
    """When each place was looked at last."""

    @property
    def size(self) -> float:
        """Of the box that is held, pixels."""
        return math.sqrt(self.held[2] * self.held[3])

    @property
    def radius(self) -> float:
        """How far from the held box's centre the target is searched, pixels."""
        if not self.config:
            return 0.0
        frames = self.unsure + self.gone if self.active else self.wary
        return self.size * min(self.config.growth * frames, self.config.reach)

    def follow(
        self,
        step: NDArray[np.float64],
        size: float,
        rival: float = 1.0,
        slip: float | None = None,
    ) -> None:
        """Hear how far the centre of a box of this size moved (2,), and how like it another is.

        And by how many sizes it moved off what had been in it, if that is known: else any step is a
        leap that is unlike those before.
        """
        away = max(math.hypot(*(step - self.step)) / size, self.far)
        leapt = away if slip is None else max(slip, self.far)
        self.past, self.far = self.past.then(min(away, 1.0), min(leapt, 1.0), rival), 0.0
        self.step = (self.step + step) / 2

    def likely(self, box: Boxes, window: Window, n: int) -> cf.Features | None:
        """How much each cell (n, n) of a window's response counts, if `box` was the last one.

        A target can be anywhere; but nothing jumps by chance just when something like it is near.
        """
        if self.config is None or self.active:
            return None
        place = (boxes_.centre(box) + self.step - (window.x, window.y)) * n / (window.w, window.h)
        leeway = self.config.leeway + 2 * self.past.unrest
        leeway *= n * math.sqrt(box[2] * box[3] / (window.w * window.h))
        near = np.exp(-(_away(n, place) ** 2).sum(axis=0) / (2 * leeway**2))
        return (self.config.jump + (1 - self.config.jump) * near).astype(np.float32)

    def sure(self, box: Boxes, score: float) -> None:
        """Hear what a box that is followed scores, or would if it sat right.

        If it is high enough, that box is come back to if the next ones are none; if it is lower
        than it should be, or follows another since lately, something else may be the target.
        """
        self.unsure, self.wary, usual = self.unsure + 1, self.wary + 1, self.usual
        self.watched = max(self.watched - 1, 0)
        self.usual += USUAL * (score - usual)
        if self.config and score >= self.config.sure_above:
            self.held, self.held_past, self.gone, self.unsure = box.copy(), self.past, 0, 0
            if not self.watched and score >= min(self.config.wary_below, usual - FALL):
                self.wary, self.visited, self.challenger, self.wins = 0, {}, None, 0

    def decide(
        self, score: float, box: Boxes, limits: ScoreConfig, known: float | None = None
    ) -> None:
        """Hear the score and the box of this frame, and what it would score if it sat right.

        A box that is only off is no reason to look elsewhere.
        """
        if self.config:
            known = score if known is None else known
            found = score >= self.config.found_above if self.active else known >= self.config.below
            self.confirmed = self.confirmed + 1 if found else 0
            self.missed = 0 if self.confirmed else self.missed + 1
            few = self.confirmed < self.config.confirm
            self.active = few if self.active else self.missed >= self.config.patience
            self.gone += self.active
            if self.active and self.gone == 1:
                self.left = box.copy()
        self.lost = score < (limits.found_above if self.lost else limits.lost_below) or self.active

    @property
    def doubting(self) -> bool:
        """Whether it looks for something that is more like the target than what it follows."""
        if self.active or not (self.config and self.config.glances):
            return False
        return self.wary >= self.config.patience

    def compare(self, challenger: Boxes, lead: float) -> bool:
        """Hear where the challenger is, and its lead in logits; say whether to follow it now."""
        assert self.config
        self.wins = self.wins + 1 if lead > self.config.lead else 0
        self.challenger = challenger if self.wins else None
        won = self.wins >= self.config.wins
        self.watched = self.config.watch if won else self.watched
        return won

    def restart(self, place: Boxes | None) -> Boxes:
        """Where to work in the next frame: at `place`, or where the target was last."""
        place = self.held.copy() if place is None else place
        self.challenger, self.wins = None, 0
        self.step, self.past = np.zeros(2), self.held_past
        self.far = math.hypot(*(boxes_.centre(place) - boxes_.centre(self.held))) / self.size
        return place

    def places(self, frame: tuple[int, int]) -> list[Boxes]:
        """Where else to look: for a lost target, where it was last, where it was lost, and around.

        Of the places around, at most `looks`, or `glances` if it is only doubted, those that were
        not seen for longest come first, then the nearest. A challenger comes before all others.
        `frame` is the picture's width and height.
        """
        if not (self.config and (self.active or self.doubting)):
            return []
        stride, radius = self.config.stride * self.size, self.radius
        centre, steps = boxes_.centre(self.held), int(radius / stride)
        around = [
            (i, j)
            for i in range(-steps, steps + 1)
            for j in range(-steps, steps + 1)
            if math.hypot(i, j) * stride <= radius
            and -stride / 2 <= centre[0] + i * stride <= frame[0] + stride / 2
            and -stride / 2 <= centre[1] + j * stride <= frame[1] + stride / 2
        ]
        around.sort(key=lambda place: (self.visited.get(place, 0), math.hypot(*place)))
        if self.active:
            around.remove((0, 0))
            chosen = [(0, 0), *around[: self.config.looks]]
        else:
            chosen = around[: self.config.glances]
        self.visited |= dict.fromkeys(chosen, self.wary + self.gone)
        centres = [centre + np.array(place) * stride for place in chosen]
        if self.active and self.left is not None:
            centres.append(boxes_.centre(self.left))
        if self.challenger is not None:
            centres.insert(0, boxes_.centre(self.challenger))
        return [boxes_.from_centre(place, self.held[2:]) for place in centres]

    def area(self, window: Boxes) -> Boxes:
        """All that is searched (4,), with windows as large as `window`."""
        if not (self.active or self.doubting):
            return window
        reach = self.radius + np.asarray(window[2:]) / 2
        around = boxes_.from_centre(boxes_.centre(self.held), 2 * reach)
        return around if self.active else boxes_.union(around, window)
