"""What a look says of a box, and which of several is the target's.

The tracker answers with one box. This says how much speaks for it; and, in doubt, whether something
else is more like the target, or where a lost one is worth a closer look.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from entrack import box as boxes_
from entrack import filter as cf
from entrack.box import Boxes
from entrack.config import Config
from entrack.recovery import in_sight, likeliest, near
from entrack.target import Look, Target
from entrack.trunk import Maps
from entrack.window import Image, Window


class Judge:
    """Sees with a tracker's filter: `fit` and `respond` are the tracker's, eqs. 2 and 3.

    `frame` is the picture's width and height.
    """

    def __init__(
        self,
        config: Config,
        taper: cf.Features,
        fit: Callable[[cf.Features], cf.Spectrum],
        respond: Callable[[cf.Spectrum, cf.Spectrum], cf.Features],
        frame: tuple[int, int],
    ) -> None:
        self.config, self._frame = config, frame
        self._taper, self._fit, self._respond = taper, fit, respond
        self._compares = any(w.compares for w in (config.score, config.spread) if w)

    def look(
        self, target: Target, maps: Maps, patch: Image, window: Window, zoom: float = 1.0
    ) -> Look:
        """M (eq. 3) of Z in a window."""
        seen = cf.spectrum(maps.z * self._taper)
        return Look(window, patch, *maps, seen, self._respond(target.weights, seen), zoom)

    def evidence(self, target: Target, look: Look, peak: cf.Peak, box: Boxes) -> dict[str, float]:
        """What the features say of a box, for the score."""
        seen = {"peak": peak.height, "psr": float(np.log(max(peak.psr, 1e-3)))}
        if not np.isfinite(box).all():
            return seen
        if target.likeness:
            seen["off"] = target.likeness.off(look.maps, box, look.window)
        if not self._compares:
            return seen
        response = self._respond(target.origin.weights, look.spectrum)
        return seen | target.origin.evidence(response, look.features, box, look.window)

    def recover(self, target: Target, score: float) -> float:
        """Hold on to what is sure, or go where a lost target may be; return the score to report."""
        search, look = target.search, target.look
        assert look is not None
        if not search.active:
            search.sure(target.box, self.config.score.known(look.evidence) if score else 0.0)
            return self._compare(target, score) if search.doubting else score
        if not search.confirmed:
            target.restart(self._likeliest(target) if target.places else None)
        evidence = {"lost": 1.0, "gone": float(np.log(search.gone))}
        target.look = replace(look, evidence=evidence)
        return self.config.score.chance(evidence)

    def _compare(self, target: Target, score: float) -> float:
        """Go over to something else that is more like the target; return the score to report."""
        search, look, colours = target.search, target.look, target.colours
        if not (look and colours and target.places):
            return score
        if search.challenger is not None:
            seen = target.elsewhere[0], target.patches[0], target.places[0]
            there = target.coloured(self.look(target, *seen))
            box = self._nearby(target, there)
            own, other = target.colours_in(look, target.box), target.colours_in(there, box)
            assert own and other
            peak = cf.peak(there.response, near(len(there.response)))
            evidence = self.evidence(target, there, peak, box)
            evidence |= target.recalled(replace(search.past, leap=1.0), other)
            weights = self.config.score
            lead = weights.identity(evidence) - weights.identity(look.evidence)
            if search.compare(box, lead if colours.nearer(other, own) else 0.0):
                target.restart(box)
                target.look = replace(look, evidence=evidence)
                return self.config.score.chance(evidence)
        if search.challenger is None:
            search.challenger = self._likeliest(target, besides=look)
        return score

    def _nearby(self, target: Target, look: Look) -> Boxes:
        """The box about the middle of a window that looks most like the first."""
        response = self._respond(target.origin.weights, look.spectrum)
        peak = cf.peak(response, near(len(response)))
        shift = np.array([peak.dx, peak.dy]) * look.window.box[2:] / len(response)
        size = target.search.held[2:]
        centre = in_sight(boxes_.centre(look.window.box) + shift, size, self._frame)
        return boxes_.from_centre(centre, size)

    def _likeliest(self, target: Target, besides: Look | None = None) -> Boxes:
        """Where a target is likeliest: in the places looked at, or what is `besides` its box."""
        places, patches = target.places, target.patches
        features = [maps.z for maps in target.elsewhere]
        if besides:
            places, patches = [besides.window, *places], [besides.patch, *patches]
            features = [besides.features, *features]
        # Of what was learned since, the target alone counts, too: its surroundings stay behind.
        recent = self._fit(target.template * target.origin.taper)
        both = [target.origin.weights, recent]
        responses = np.stack([self._mean(both, cf.spectrum(z)) for z in features])
        size, own = target.search.held[2:], target.box if besides else None
        if target.colours:
            sizes = [size / window.box[2:] for window in places]
            parts = zip(responses, patches, sizes, strict=True)
            responses = np.stack([target.colours.weigh(*part) for part in parts])
        return likeliest(responses, places, size, self._frame, own)

    def _mean(self, filters: list[cf.Spectrum], candidate: cf.Spectrum) -> cf.Features:
        """What several filters answer, in the mean."""
        return np.mean([self._respond(weights, candidate) for weights in filters], axis=0)
