"""Online tracking, §3.2.7: look around the last box, answer, move, and learn the new appearance."""

import math
import time
from collections import deque
from collections.abc import Iterable, Iterator
from copy import copy
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack import box as boxes_
from entrack import filter as cf
from entrack import window as windows
from entrack.aspect import Aspect
from entrack.box import Boxes
from entrack.colour import Colours
from entrack.config import Config
from entrack.errors import EntrackError
from entrack.judge import Judge
from entrack.likeness import Likeness, Parts
from entrack.policy import Policy
from entrack.recovery import Origin, Search
from entrack.scale import ScaleSearch
from entrack.state import State, held, shifted
from entrack.target import Answer, Estimate, Look, Target
from entrack.trunk import Maps, Trunk, each

__all__ = ["PLACES", "Estimate", "Look", "Tracker"]

PLACES = 128
"""Centres and sizes are multiples of 1 / 128 pixel. Engines differ in the last bits of a float,
which would grow from frame to frame; cut off, an exported model gives the same boxes."""


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
        self._targets: list[Target] = []
        self.ids: list[int] = []
        """Numbers of the targets, in the order of what `update_many` returns."""
        self._given = 0  # ids, of which none is given twice
        self._frame: windows.Image | None = None
        self._size = (0, 0)
        cells = config.window.size // 16
        sigma = config.filter.label_sigma * cells / config.window.context
        self._label = cf.spectrum(cf.label(cells, sigma))
        self._taper = cf.hann(cells) if config.filter.hann else np.ones((cells, cells), np.float32)
        self._scale = ScaleSearch(config.scale)
        self._rng = np.random.default_rng(config.policy.seed if config.policy else 0)
        weights = config.score, config.spread
        self._leaps = config.likeness is not None and any(w.leaps for w in weights if w)

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
        size = frame.shape[1], frame.shape[0]
        started = [boxes_.inside(box, *size) for box in boxes]
        if not started:
            raise EntrackError("there is no box to track")
        self._size = size
        windows_ = [windows.around(box, self.config.window) for box in started]
        patches = [windows.crop(frame, w, self.config.window.border) for w in windows_]
        seen = list(each(self.trunk, patches))
        self._targets = [
            self._start(*known) for known in zip(started, windows_, patches, seen, strict=True)
        ]
        for k, target in enumerate(self._targets):
            target.turn = k % self.config.scale.every
        if self.policy:
            for target, window, maps in zip(self._targets, windows_, seen, strict=True):
                roi = window.to_patch(target.box) / window.size
                target.known = self.policy.f1.remember(maps.z, roi.astype(np.float32))
        self.ids, self._given = list(range(len(started))), len(started)

    def _start(
        self, box: Boxes, window: windows.Window, patch: windows.Image, maps: Maps
    ) -> Target:
        x = maps.z
        template, search = x * self._taper, Search(box, self.config.recovery)
        origin = Origin.of(x, box, window, self.fit)
        target = Target(box, box, template, self.fit(template), origin, search)
        if self.config.colour:
            roi = window.to_patch(box) / window.size
            target.colours = Colours.of(patch, roi, self.config.colour)
        if self.config.likeness:
            target.likeness = Likeness.of(maps, box, window, self.config.likeness)
        if self.config.aspect:
            target.aspect = Aspect.of(maps, box, window, self.config.aspect)
        if self._leaps:
            target.parts = Parts.of(maps.fine, box, window)
        return target

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
        searches = [
            t.search.area(windows.around(t.box, self.config.window).box) for t in self._targets
        ]
        follow = self._follow_policy if self.policy else self._follow_peak
        answers = [follow(target) for target in self._targets]
        moves = [self._move(t, a) for t, a in zip(self._targets, answers, strict=True)]
        scores = [self._judge.recover(t, s) for t, s in zip(self._targets, moves, strict=True)]
        ms = 1e3 * (time.perf_counter() - started)
        return [
            Estimate(t.told, score, t.search.lost, self._sigma(t, a), a.entropy, search, ms)
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
        seen = each(self.trunk, self._patches(frame, patches))
        for target in self._targets:
            if target.unlearned is not None:
                self._learn(target, next(seen).z * self._taper)
            # One by one: the trunk works on those that follow, and arrays of megabytes would be
            # new pages from the system in every frame, which cost more than the arithmetic.
            target.looks = [
                self._judge.look(target, next(seen), patches.popleft(), window, zoom)
                for zoom, window in self._windows_of(target)
            ]
            target.look = target.looks[len(target.looks) // 2]
            if self.policy:
                target.look = target.coloured(target.look)
            target.state = self._state(target)
            if target.state:
                target.look = replace(target.look, z=target.state.z)
            target.elsewhere = list(islice(seen, len(target.places)))
        return [target.state for target in self._targets]

    def _patches(self, frame: windows.Image, kept: deque[windows.Image]) -> Iterator[windows.Image]:
        """What the trunk sees in a frame.

        For each target that is what is unlearned, what is looked at, which is `kept`, and places
        where it may be besides, if it is lost or doubted.
        """
        for target in self._targets:
            if target.unlearned is not None:
                yield target.unlearned
            for _, window in self._windows_of(target):
                kept.append(windows.crop(frame, window, self.config.window.border))
                yield kept[-1]
            boxes = target.search.places(self._size)
            target.places = [windows.around(box, self.config.window) for box in boxes]
            target.patches = []
            for window in target.places:
                target.patches.append(windows.crop(frame, window, self.config.window.border))
                yield target.patches[-1]

    def _windows_of(self, target: Target) -> list[tuple[float, windows.Window]]:
        """What is looked at around the last box, at every zoom that has its turn."""
        zooms = [1.0] if target.turn else self._scale.zooms
        return [(zoom, windows.around(target.box, self.config.window, zoom)) for zoom in zooms]

    @property
    def boxes(self) -> list[Boxes]:
        """The last box (4,) of each target."""
        return [target.told for target in self._targets]

    def teach(self, image: Any, truth: ArrayLike) -> None:
        """Replace the only target's template by X_t = g(G_t, I_t), as training may (§3.2.5)."""
        [target] = self._targets
        frame = windows.as_bgr(image)
        [maps] = each(self.trunk, [self._patch(frame, np.asarray(truth, np.float64))])
        target.template, target.unlearned = maps.z * self._taper, None
        target.weights = self.fit(target.template)

    def _state(self, target: Target) -> State | None:
        if self.policy is None or target.look is None:
            return None
        window = windows.around(target.box, self.config.window)
        last = held(target.box, target.first, window.box)
        return self.policy.state(target.look.features, target.look.response, last, target.known)

    def _follow_peak(self, target: Target) -> Answer:
        """Move and resize the box to where the response is highest: the filter alone."""
        target.look = target.coloured(self._scale.best(target.looks))
        window, response = target.look.window, target.look.response
        peak = cf.peak(response, target.search.likely(target.box, window, response.shape[-1]))
        cell = window.box[2:] / response.shape[-1]
        centre = boxes_.centre(target.box) + np.array([peak.dx, peak.dy]) * cell
        centre, grown = self._fitted(target, centre)
        box = boxes_.from_centre(centre, target.box[2:] * grown)
        return Answer(box, self._judge.evidence(target, target.look, peak, box))

    def _follow_policy(self, target: Target) -> Answer:
        """Take one action a_t ~ π(· | s_t) and add it to the box (eq. 7)."""
        assert self.policy is not None and target.look is not None and target.state is not None
        gaussian = self.policy(target.state)
        sampled = self.config.policy is not None and self.config.policy.act == "sample"
        action = gaussian.action(self._rng if sampled else None)
        sides = np.tile(target.box[2:], 2)
        box, wider = self._acted(target, action)
        evidence = self._judge.evidence(target, target.look, cf.peak(target.look.response), box)
        evidence["sigma"] = float(np.log(gaussian.sigma).mean())
        return Answer(box, evidence, gaussian.sigma * sides, gaussian.entropy, wider)

    def _acted(self, target: Target, action: ArrayLike) -> tuple[Boxes, float]:
        """d_t = d_{t−1} + a_t (eq. 7), tempered by likeness and scale search if so configured.

        And how much wider than high the action alone makes the box: a logarithm.
        """
        box, config = boxes_.moved(target.box, action), self.config.policy
        growth = np.log(np.maximum(box[2:], 1e-3) / target.box[2:])
        wider = float(growth[0] - growth[1])
        if not config or not (config.search or config.keep_aspect or target.likeness):
            return box, wider
        if config.keep_aspect:
            growth = np.full(2, growth.mean())
        centre, grown = self._fitted(target, boxes_.centre(box))
        growth = (1 - config.search) * growth + config.search * np.log(grown)
        return boxes_.from_centre(centre, target.box[2:] * np.exp(growth)), wider

    def _fitted(self, target: Target, centre: Boxes) -> tuple[Boxes, float]:
        """The centre set right, and by what factor the size changes."""
        if not (target.likeness and target.look):
            return centre, self._scale.grown(target.looks)
        box = boxes_.from_centre(centre, target.box[2:])
        window = windows.around(target.box, self.config.window)
        return target.likeness.fit(target.look.maps, box, window)

    def move(self, actions: ArrayLike) -> list[Boxes]:
        """Add one action (4,) a target to the boxes (eq. 7) and learn the new appearance."""
        given = np.asarray(actions, np.float64).reshape(-1, 4)
        for target, action in zip(self._targets, given, strict=True):
            assert target.look is not None
            box, wider = self._acted(target, action)
            peak = cf.peak(target.look.response)
            evidence = self._judge.evidence(target, target.look, peak, box)
            self._move(target, Answer(box, evidence, wider=wider))
        return self.boxes

    def _move(self, target: Target, answer: Answer) -> float:
        """Put the box where the answer says, within limits; return the score."""
        limits, config = self.config.limits, self.config.score
        first = target.first[2:]
        sound = bool(np.isfinite(answer.box).all())  # else a network overflowed: stay, and say so
        answer = answer if sound else answer._replace(box=target.box)
        size = np.clip(answer.box[2:], limits.smallest * first, limits.largest * first)
        centre = np.clip(boxes_.centre(answer.box), 0, self._size)
        centre, size = (np.round(v * PLACES) / PLACES for v in (centre, size))
        searched, target.box = target.box, boxes_.from_centre(centre, size)
        search = target.search
        step, side = centre - boxes_.centre(searched), math.sqrt(searched[2] * searched[3])
        seen = answer.evidence
        assert self._frame is not None and target.look is not None
        slip = target.slipped(searched) if self._leaps else None
        search.follow(step, side, seen.get("rival", 1.0), slip)
        learn, window = self.config.update, self.config.window
        colours = target.colours_in(target.look, target.box)
        evidence = seen | target.recalled(search.past, colours)
        score = config.chance(evidence) if sound else 0.0
        look = target.look = replace(target.look, evidence=evidence)
        known = config.known(evidence) if sound else 0.0
        search.decide(score, target.box, config, known)
        learns = score >= learn.min_score and not search.active
        if learns:
            target.learn(colours, answer.wider, score)
        due = learns and learn.rate > 0 and target.waited + 1 >= learn.every
        target.waited, target.unlearned = 0 if due else target.waited + 1, None
        target.turn = (target.turn - 1) % self.config.scale.every
        if due and learn.seen == "again":
            target.unlearned = self._patch(self._frame, target.box)
        elif due:
            x = shifted(look.features, look.window, windows.around(target.box, window))
            self._learn(target, x * self._taper)
        return score

    def _sigma(self, target: Target, answer: Answer) -> NDArray[np.float64] | None:
        """σ of the four sides in pixels: as `entrack calibrate` found it, or else the policy's."""
        spread = self.config.spread
        if spread is None or target.look is None:
            return answer.sigma
        return np.tile(target.told[2:], 2) * math.exp(min(spread.total(target.look.evidence), 9))

    def _learn(self, target: Target, seen: cf.Features) -> None:
        """Eq. 14. No frame needs Ŵ before the next one's response, so X' shares its trunk batch."""
        rate = 1 - (1 - self.config.update.rate) ** self.config.update.every
        target.template = cf.update(target.template, seen, rate)
        target.weights = self.fit(target.template)

    @property
    def _judge(self) -> Judge:
        # One that is kept would hold the tracker, which holds it: memory that only a sweep frees.
        return Judge(self.config, self._taper, self.fit, self.respond, self._size)

    def fit(self, template: cf.Features) -> cf.Spectrum:
        """Ŵ for a template (eq. 2); override it and `respond` to try another filter."""
        return cf.fit(cf.spectrum(template), self._label, self.config.filter.regularisation)

    def respond(self, weights: cf.Spectrum, candidates: cf.Spectrum) -> cf.Features:
        """M (n, n) of a candidate Ẑ (C, n, n // 2 + 1) (eq. 3)."""
        return cf.respond(weights, candidates)

    def _patch(self, frame: windows.Image, box: Boxes) -> windows.Image:
        """What the search window around `box` sees."""
        config = self.config.window
        return windows.crop(frame, windows.around(box, config), config.border)

    def _follow_size(self, frame: windows.Image) -> None:
        """A stream may change its resolution midway: the same scene, so boxes scale with it."""
        size = (frame.shape[1], frame.shape[0])
        if size != self._size:
            ratio = np.tile(np.divide(size, self._size), 2)
            for target in self._targets:
                target.resize(ratio)
            self._size = size
