"""Online tracking, §3.2.7: look around the last box, answer, move, and learn the new appearance."""

import time
from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack import box as boxes_
from entrack import filter as cf
from entrack import window as windows
from entrack.box import Boxes
from entrack.config import Config
from entrack.errors import EntrackError
from entrack.trunk import Trunk


@dataclass(frozen=True)
class Estimate:
    """What the tracker says of one frame."""

    box: Boxes
    """`(x, y, w, h)` (4,) float64, 0-based continuous pixels."""
    score: float
    """In [0, 1]: how sure the tracker is that the box overlaps the target (IoU > ½)."""
    lost: bool
    """The tracker's decision, with hysteresis, that it does not see the target."""
    sigma: NDArray[np.float64] | None
    """Standard deviation of the four sides, pixels; None for a model without a policy."""
    entropy: float | None
    """Entropy of the policy, nats; None for a model without a policy."""
    search: Boxes
    """The search window as a box (4,)."""
    ms: float
    """Milliseconds that the frame took, shared by all targets of the frame."""


@dataclass(frozen=True)
class Look:
    """What the tracker saw of one target in the last frame; for drawing and explaining."""

    patch: windows.Image
    """The search window's content (S, S, 3) uint8 BGR."""
    features: cf.Features
    """Z, tapered: (C, n, n) float32."""
    response: cf.Features
    """M: (n, n) float32, its peak at [n // 2, n // 2] for a target that has not moved (eq. 3)."""


@dataclass
class _Target:
    """What is remembered of one target from frame to frame."""

    box: Boxes
    first: Boxes
    template: cf.Features
    weights: cf.Spectrum
    look: Look | None = None
    lost: bool = False
    unlearned: windows.Image | None = None
    """The last frame at the new box, of which X' of eq. 14 is made together with the next Z."""


class Tracker:
    """Tracks one target, or several in one batch.

    >>> tracker = Tracker(config, trunk)                       # doctest: +SKIP
    >>> tracker.init(frame, box=(310, 120, 48, 90))            # doctest: +SKIP
    >>> tracker.update(next_frame).box                         # doctest: +SKIP
    """

    def __init__(self, config: Config, trunk: Trunk) -> None:
        self.config = config
        self.trunk = trunk
        self._targets: list[_Target] = []
        self.ids: list[int] = []
        """Numbers of the targets, in the order of what `update_many` returns."""
        self._given = 0  # ids, of which none is given twice
        self._frame: windows.Image | None = None
        self._size = (0, 0)
        cells = config.window.size // 16
        sigma = config.filter.label_sigma * cells / config.window.context
        self._label = cf.spectrum(cf.label(cells, sigma))
        self._taper = cf.hann(cells) if config.filter.hann else np.ones((cells, cells), np.float32)
        half = config.scale.steps // 2
        self._steps = np.arange(-half, half + 1)
        self._zooms: list[float] = (config.scale.factor ** self._steps.astype(np.float64)).tolist()

    def init(self, image: Any, box: ArrayLike) -> None:
        """Start on `box` `(x, y, w, h)` in the first frame; whatever was tracked is forgotten.

        Parameters
        ----------
        image
            (H, W, 3) uint8 BGR; grey, RGBA, 16 bit and floats in [0, 1] are accepted too.
        box
            A box that is partly outside the frame is clipped to it.

        Raises
        ------
        EntrackError
            If the box is no box or lies outside the frame, or the image is no image.
        """
        self.init_many(image, [box])

    def init_many(self, image: Any, boxes: Iterable[ArrayLike]) -> None:
        """Start on several boxes (N, 4) at once; see `init`."""
        frame = self._frame = windows.as_bgr(image)
        started = [inside(box, frame) for box in boxes]
        if not started:
            raise EntrackError("there is no box to track")
        self._size = (frame.shape[1], frame.shape[0])
        templates = self._features([self._patch(frame, box) for box in started])
        self._targets = [
            _Target(box, box, template, self._fit(template))
            for box, template in zip(started, templates, strict=True)
        ]
        self.ids, self._given = list(range(len(started))), len(started)

    def add(self, box: ArrayLike, image: Any = None) -> int:
        """Track one more target, from the frame seen last on; return its id, see `ids`.

        Parameters
        ----------
        box
            `(x, y, w, h)` in that frame.
        image
            That frame once more, if something was drawn on it; or the first frame of all.

        Raises
        ------
        EntrackError
            If the box cannot be tracked, or there is no frame yet.
        """
        frame = self._frame if image is None else windows.as_bgr(image)
        if frame is None:
            raise EntrackError("add before init: the tracker has seen no frame yet")
        if self._targets:
            self._follow_size(frame)
        one = copy(self)
        one.init_many(frame, [box])
        self._targets, self._size = [*self._targets, *one._targets], one._size
        self._frame = frame
        self.ids, self._given = [*self.ids, self._given], self._given + 1
        return self.ids[-1]

    def drop(self, id: int) -> None:
        """Stop to track a target; the others keep their ids."""
        if id not in self.ids:
            raise EntrackError(f"there is no target {id}: there are {self.ids}")
        place = self.ids.index(id)
        self._targets = self._targets[:place] + self._targets[place + 1 :]
        self.ids = self.ids[:place] + self.ids[place + 1 :]

    def update(self, image: Any) -> Estimate:
        """Find the target of `init` in the next frame."""
        if len(self._targets) > 1:
            raise EntrackError("there are several targets: call update_many")
        if self._frame is not None and not self._targets:
            raise EntrackError("there is no target left: call init or add")
        return self.update_many(image)[0]

    def update_many(self, image: Any) -> list[Estimate]:
        """Find every target in the next frame, in the order in which they were given (`ids`)."""
        if self._frame is None:
            raise EntrackError("update before init: the tracker does not know its target yet")
        started = time.perf_counter()
        frame = self._frame = windows.as_bgr(image)
        if not self._targets:
            return []
        self._follow_size(frame)
        searches = [windows.around(t.box, self.config.window).box for t in self._targets]
        looks = [self._patch(frame, t.box, zoom) for t in self._targets for zoom in self._zooms]
        due = [t for t in self._targets if t.unlearned is not None]
        seen = [t.unlearned for t in due if t.unlearned is not None]
        features = self._features(seen + looks)
        for target, x in zip(due, features[: len(due)], strict=True):
            self._learn(target, x)
        candidates = features[len(due) :].reshape(
            len(self._targets), len(self._zooms), *features.shape[1:]
        )
        patches = [looks[k : k + len(self._zooms)] for k in range(0, len(looks), len(self._zooms))]
        scores = [
            self._move(t, p, z) for t, p, z in zip(self._targets, patches, candidates, strict=True)
        ]
        for target, score in zip(self._targets, scores, strict=True):
            learn = self.config.update.rate > 0 and score >= self.config.update.min_score
            target.unlearned = self._patch(frame, target.box) if learn else None
        ms = 1e3 * (time.perf_counter() - started)
        return [
            Estimate(t.box.copy(), score, t.lost, None, None, search, ms)
            for t, score, search in zip(self._targets, scores, searches, strict=True)
        ]

    @property
    def looks(self) -> list[Look | None]:
        """What was seen of each target in the last frame; None before the first `update`."""
        return [target.look for target in self._targets]

    def _move(
        self, target: _Target, patches: list[windows.Image], candidates: cf.Features
    ) -> float:
        """Move and resize the box to where the response is highest; return the score."""
        config = self.config
        responses = cf.respond(target.weights, cf.spectrum(candidates))
        penalties = config.scale.penalty ** np.abs(self._steps)
        best = int((responses.max(axis=(-2, -1)) * penalties).argmax())
        peak = cf.peak(responses[best])
        target.look = Look(patches[best], candidates[best], responses[best])
        window = windows.around(target.box, config.window, self._zooms[best])
        cell = window.box[2:] / responses.shape[-1]
        centre = boxes_.centre(target.box) + np.array([peak.dx, peak.dy]) * cell
        size = target.box[2:] * (1 + config.scale.rate * (self._zooms[best] - 1))
        limits = config.limits
        size = np.clip(size, limits.smallest * target.first[2:], limits.largest * target.first[2:])
        target.box = boxes_.from_centre(np.clip(centre, 0, self._size), size)
        score = self._score(peak)
        found = config.score.found_above if target.lost else config.score.lost_below
        target.lost = score < found
        return score

    def _score(self, peak: cf.Peak) -> float:
        c = self.config.score
        evidence = c.bias + c.peak * peak.height + c.psr * np.log(max(peak.psr, 1e-3))
        return float(1 / (1 + np.exp(-evidence)))

    def _learn(self, target: _Target, seen: cf.Features) -> None:
        """Eq. 14. No frame needs Ŵ before the next one's response, so X' shares its trunk batch."""
        target.template = cf.update(target.template, seen, self.config.update.rate)
        target.weights = self._fit(target.template)

    def _fit(self, template: cf.Features) -> cf.Spectrum:
        return cf.fit(cf.spectrum(template), self._label, self.config.filter.regularisation)

    def _patch(self, frame: windows.Image, box: Boxes, zoom: float = 1.0) -> windows.Image:
        """What the search window around `box` sees."""
        config = self.config.window
        return windows.crop(frame, windows.around(box, config, zoom), config.border)

    def _features(self, patches: list[windows.Image]) -> cf.Features:
        """Z = g(d, I) of each patch, tapered; (N, C, n, n)."""
        return self.trunk(np.stack(patches)) * self._taper

    def _follow_size(self, frame: windows.Image) -> None:
        """A stream may change its resolution midway: the same scene, so boxes scale with it."""
        size = (frame.shape[1], frame.shape[0])
        if size != self._size:
            ratio = np.tile(np.divide(size, self._size), 2)
            for target in self._targets:
                target.box, target.first = target.box * ratio, target.first * ratio
            self._size = size


def inside(box: Any, frame: windows.Image) -> Boxes:
    """The part of `box` inside the frame, or one sentence that says why there is none."""
    b = boxes_.check(box)
    height, width = frame.shape[:2]
    clipped = boxes_.clip(b, width, height)
    if clipped[2] < 1 or clipped[3] < 1:
        raise EntrackError(f"box {tuple(b.tolist())} lies outside the {width}×{height} frame")
    return clipped
