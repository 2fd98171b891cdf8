"""Online tracking, §3.2.7: look around the last box, answer, move, and learn the new appearance."""

import math
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack import box as boxes_
from entrack import filter as cf
from entrack import window as windows
from entrack.box import Boxes
from entrack.config import Config
from entrack.errors import EntrackError
from entrack.policy import Policy
from entrack.state import State, held, shifted
from entrack.trunk import Trunk, each

PLACES = 128
"""Centres and sizes are multiples of 1 / 128 pixel. Engines differ in the last bits of a float,
which would grow from frame to frame; cut off, an exported model gives the same boxes."""


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
    """Z: (C, n, n) float32."""
    response: cf.Features
    """M: (n, n) float32, its peak at [n // 2, n // 2] for a target that has not moved (eq. 3)."""
    zoom: float = 1.0
    """How much more of the image than the search window was looked at."""
    z: cf.Features | None = None
    """f1(Z) (C, n, n) (eq. 4); None for a model without a policy."""
    evidence: Mapping[str, float] = field(default_factory=dict[str, float])
    """What the score was computed from, once it was; see `ScoreConfig`."""


@dataclass
class _Target:
    """What is remembered of one target from frame to frame."""

    box: Boxes
    first: Boxes
    template: cf.Features
    weights: cf.Spectrum
    known: object = None
    """What the policy's f1 remembers of the first frame."""
    looks: list[Look] = field(default_factory=list[Look])
    """What was seen in the last frame, at every size that was looked at."""
    state: State | None = None
    look: Look | None = None
    lost: bool = False
    unlearned: windows.Image | None = None
    """The last frame at the new box, of which X' of eq. 14 is made together with the next Z."""
    waited: int = 0
    """Frames since the last such."""
    turn: int = 0
    """Frames until other sizes than the last are looked at, see `ScaleConfig.every`."""


class _Answer(NamedTuple):
    """A decision about one target in one frame."""

    box: Boxes
    evidence: dict[str, float]
    """What the score is computed from; see `ScoreConfig`."""
    sigma: NDArray[np.float64] | None = None
    entropy: float | None = None


class Tracker:
    """Tracks one target, or several in one batch.

    >>> tracker = Tracker(config, trunk)                       # doctest: +SKIP
    >>> tracker.init(frame, box=(310, 120, 48, 90))            # doctest: +SKIP
    >>> tracker.update(next_frame).box                         # doctest: +SKIP
    """

    def __init__(self, config: Config, trunk: Trunk, policy: Policy | None = None) -> None:
        self.config = config
        self.trunk = trunk
        self.policy = policy
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
        self._zooms: list[float] = (config.scale.factor ** np.arange(-half, half + 1.0)).tolist()
        self._sizes = np.log(np.array(self._zooms, np.float32))
        self._parabola = cf.parabola(self._sizes)
        self._rng = np.random.default_rng(config.policy.seed if config.policy else 0)

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
        windows_ = [windows.around(box, self.config.window) for box in started]
        features = self._features(
            [windows.crop(frame, w, self.config.window.border) for w in windows_]
        )
        self._targets = [
            _Target(box, box, x * self._taper, self.fit(x * self._taper))
            for box, x in zip(started, features, strict=True)
        ]
        for k, target in enumerate(self._targets):
            target.turn = k % self.config.scale.every
        if self.policy:
            for target, window, x in zip(self._targets, windows_, features, strict=True):
                roi = window.to_patch(target.box) / window.size
                target.known = self.policy.f1.remember(x, roi.astype(np.float32))
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
        one._targets[0].turn = self._given % self.config.scale.every
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
        if not self._targets:
            self._frame = windows.as_bgr(image)
            return []
        self.observe(image)
        searches = [windows.around(t.box, self.config.window).box for t in self._targets]
        follow = self._follow_policy if self.policy else self._follow_peak
        answers = [follow(target) for target in self._targets]
        scores = [self._move(t, a) for t, a in zip(self._targets, answers, strict=True)]
        ms = 1e3 * (time.perf_counter() - started)
        return [
            Estimate(t.box.copy(), score, t.lost, a.sigma, a.entropy, search, ms)
            for t, a, score, search in zip(self._targets, answers, scores, searches, strict=True)
        ]

    @property
    def looks(self) -> list[Look | None]:
        """What was seen of each target in the last frame; None before the first `update`."""
        return [target.look for target in self._targets]

    def observe(self, image: Any) -> list[State | None]:
        """Look around every target's last box: Z and M (eq. 3), and s (eq. 6) where a policy is.

        `update` is this and an action; the environment of `entrack.learn` acts by itself.
        """
        frame = self._frame = windows.as_bgr(image)
        self._follow_size(frame)
        patches: deque[windows.Image] = deque()
        features = each(self.trunk, self._patches(frame, patches))
        for target in self._targets:
            if target.unlearned is not None:
                self._learn(target, next(features) * self._taper)
            # One by one: the trunk works on those that follow, and arrays of megabytes would be
            # new pages from the system in every frame, which cost more than the arithmetic.
            target.looks = [
                self._look(target, next(features), patches.popleft(), zoom)
                for zoom in self._zooms_of(target)
            ]
            target.look = target.looks[len(target.looks) // 2]
            target.state = self._state(target)
            if target.state:
                target.look = replace(target.look, z=target.state.z)
        return [target.state for target in self._targets]

    def _patches(self, frame: windows.Image, kept: deque[windows.Image]) -> Iterator[windows.Image]:
        """What the trunk sees in a frame: what is unlearned, and what is looked at, `kept`."""
        for target in self._targets:
            if target.unlearned is not None:
                yield target.unlearned
            for zoom in self._zooms_of(target):
                kept.append(self._patch(frame, target.box, zoom))
                yield kept[-1]

    def _zooms_of(self, target: _Target) -> list[float]:
        return [1.0] if target.turn else self._zooms

    def _look(
        self, target: _Target, features: cf.Features, patch: windows.Image, zoom: float
    ) -> Look:
        response = self.respond(target.weights, cf.spectrum(features * self._taper))
        return Look(patch, features, response, zoom)

    @property
    def boxes(self) -> list[Boxes]:
        """The last box (4,) of each target."""
        return [target.box.copy() for target in self._targets]

    def teach(self, image: Any, truth: ArrayLike) -> None:
        """Replace the only target's template by X_t = g(G_t, I_t), as training may (§3.2.5)."""
        [target] = self._targets
        frame = windows.as_bgr(image)
        [x] = self._features([self._patch(frame, np.asarray(truth, np.float64))])
        target.template, target.unlearned = x * self._taper, None
        target.weights = self.fit(target.template)

    def _state(self, target: _Target) -> State | None:
        if self.policy is None or target.look is None:
            return None
        window = windows.around(target.box, self.config.window)
        last = held(target.box, target.first, window.box)
        return self.policy.state(target.look.features, target.look.response, last, target.known)

    def _follow_peak(self, target: _Target) -> _Answer:
        """Move and resize the box to where the response is highest: the filter alone."""
        config = self.config
        target.look = self._best(target)
        peak = cf.peak(target.look.response)
        zoom = target.look.zoom
        window = windows.around(target.box, config.window, zoom)
        cell = window.box[2:] / target.look.response.shape[-1]
        centre = boxes_.centre(target.box) + np.array([peak.dx, peak.dy]) * cell
        size = target.box[2:] * self._grown(target)
        return _Answer(boxes_.from_centre(centre, size), _evidence(peak))

    def _follow_policy(self, target: _Target) -> _Answer:
        """Take one action a_t ~ π(· | s_t) and add it to the box (eq. 7)."""
        assert self.policy is not None and target.look is not None and target.state is not None
        gaussian = self.policy(target.state)
        sampled = self.config.policy is not None and self.config.policy.act == "sample"
        action = gaussian.action(self._rng if sampled else None)
        sides = np.tile(target.box[2:], 2)
        evidence = _evidence(cf.peak(target.look.response))
        evidence["sigma"] = float(np.log(gaussian.sigma).mean())
        box = self._acted(target, action)
        return _Answer(box, evidence, gaussian.sigma * sides, gaussian.entropy)

    def _acted(self, target: _Target, action: ArrayLike) -> Boxes:
        """d_t = d_{t−1} + a_t (eq. 7), its size tempered by the scale search if so configured."""
        box, config = moved(target.box, action), self.config.policy
        if config is None or not (config.search or config.keep_aspect):
            return box
        growth = np.log(np.maximum(box[2:], 1e-3) / target.box[2:])
        if config.keep_aspect:
            growth = np.full(2, growth.mean())
        growth = (1 - config.search) * growth + config.search * np.log(self._grown(target))
        return boxes_.from_centre(boxes_.centre(box), target.box[2:] * np.exp(growth))

    def _best(self, target: _Target) -> Look:
        """The size that answers most of those that were looked at, after the penalties."""
        half = len(target.looks) // 2
        penalties = self.config.scale.penalty ** np.abs(np.arange(-half, half + 1))
        return target.looks[int((_heights(target) * penalties).argmax())]

    def _grown(self, target: _Target) -> float:
        """By what factor the size changes, as far as the scale search says."""
        rate = self.config.scale.rate
        if not self.config.scale.between:
            return 1 + rate * (self._best(target).zoom - 1)
        if len(target.looks) == 1:
            return 1.0
        top = cf.highest(_heights(target), self._sizes, self._parabola)
        return math.exp(rate * top)

    def move(self, actions: ArrayLike) -> list[Boxes]:
        """Add one action (4,) a target to the boxes (eq. 7) and learn the new appearance."""
        given = np.asarray(actions, np.float64).reshape(-1, 4)
        for target, action in zip(self._targets, given, strict=True):
            assert target.look is not None
            evidence = _evidence(cf.peak(target.look.response))
            self._move(target, _Answer(self._acted(target, action), evidence))
        return self.boxes

    def _move(self, target: _Target, answer: _Answer) -> float:
        """Put the box where the answer says, within limits; return the score."""
        limits, config = self.config.limits, self.config.score
        first = target.first[2:]
        sound = bool(np.isfinite(answer.box).all())  # else a network overflowed: stay, and say so
        answer = answer if sound else answer._replace(box=target.box)
        size = np.clip(answer.box[2:], limits.smallest * first, limits.largest * first)
        centre = np.clip(boxes_.centre(answer.box), 0, self._size)
        centre, size = (np.round(v * PLACES) / PLACES for v in (centre, size))
        searched, target.box = target.box, boxes_.from_centre(centre, size)
        evidence = config.bias + sum(
            getattr(config, name) * value for name, value in answer.evidence.items()
        )
        score = float(1 / (1 + np.exp(-evidence))) if sound and np.isfinite(evidence) else 0.0
        assert self._frame is not None and target.look is not None
        target.look = replace(target.look, evidence=answer.evidence)
        target.lost = score < (config.found_above if target.lost else config.lost_below)
        learn, window = self.config.update, self.config.window
        due = learn.rate > 0 and target.waited + 1 >= learn.every and score >= learn.min_score
        target.waited, target.unlearned = 0 if due else target.waited + 1, None
        target.turn = (target.turn - 1) % self.config.scale.every
        if due and learn.seen == "again":
            target.unlearned = self._patch(self._frame, target.box)
        elif due:
            seen = windows.around(searched, window, target.look.zoom)
            x = shifted(target.look.features, seen, windows.around(target.box, window))
            self._learn(target, x * self._taper)
        return score

    def _learn(self, target: _Target, seen: cf.Features) -> None:
        """Eq. 14. No frame needs Ŵ before the next one's response, so X' shares its trunk batch."""
        rate = 1 - (1 - self.config.update.rate) ** self.config.update.every
        target.template = cf.update(target.template, seen, rate)
        target.weights = self.fit(target.template)

    def fit(self, template: cf.Features) -> cf.Spectrum:
        """Ŵ for a template (eq. 2); override it and `respond` to try another filter."""
        return cf.fit(cf.spectrum(template), self._label, self.config.filter.regularisation)

    def respond(self, weights: cf.Spectrum, candidates: cf.Spectrum) -> cf.Features:
        """M (n, n) of a candidate Ẑ (C, n, n // 2 + 1) (eq. 3)."""
        return cf.respond(weights, candidates)

    def _patch(self, frame: windows.Image, box: Boxes, zoom: float = 1.0) -> windows.Image:
        """What the search window around `box` sees."""
        config = self.config.window
        return windows.crop(frame, windows.around(box, config, zoom), config.border)

    def _features(self, patches: list[windows.Image]) -> cf.Features:
        """Z = g(d, I) of each patch (N, C, n, n)."""
        return self.trunk(np.stack(patches))

    def _follow_size(self, frame: windows.Image) -> None:
        """A stream may change its resolution midway: the same scene, so boxes scale with it."""
        size = (frame.shape[1], frame.shape[0])
        if size != self._size:
            ratio = np.tile(np.divide(size, self._size), 2)
            for target in self._targets:
                target.box, target.first = target.box * ratio, target.first * ratio
            self._size = size


def moved(box: ArrayLike, action: ArrayLike) -> Boxes:
    """d_t = d_{t−1} + a_t (eq. 7): `action` (4,) moves the left, top, right and bottom side.

    It is in units of the box's own width and height.

    >>> moved([100, 100, 40, 80], [0.1, 0.1, 0.1, 0.2])
    array([104., 108.,  40.,  88.])
    """
    b = np.asarray(box, np.float64)
    return boxes_.from_corners(boxes_.to_corners(b) + np.asarray(action) * np.tile(b[2:], 2))


def _heights(target: _Target) -> NDArray[np.float32]:
    """How much each of the sizes that were looked at answers (k,)."""
    return np.array([look.response.max() for look in target.looks])


def _evidence(peak: cf.Peak) -> dict[str, float]:
    return {"peak": peak.height, "psr": float(np.log(max(peak.psr, 1e-3)))}


def inside(box: Any, frame: windows.Image) -> Boxes:
    """The part of `box` inside the frame, or one sentence that says why there is none."""
    b = boxes_.check(box)
    height, width = frame.shape[:2]
    clipped = boxes_.clip(b, width, height)
    if clipped[2] < 1 or clipped[3] < 1:
        raise EntrackError(f"box {tuple(b.tolist())} lies outside the {width}×{height} frame")
    return clipped
