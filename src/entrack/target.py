"""What is known of one target: what the tracker says of it, saw of it, and remembers of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from entrack import box as boxes_
from entrack import filter as cf
from entrack.aspect import Aspect
from entrack.box import Boxes
from entrack.colour import Colours, Seen
from entrack.likeness import Likeness, Parts
from entrack.recovery import Origin, Past, Search
from entrack.state import State
from entrack.trunk import Maps
from entrack.window import Image, Window


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
    """Standard deviation of the four sides, pixels: the true side is no further away in 68 % of all
    frames; None for a model that knows neither a spread nor a policy."""
    entropy: float | None
    """Entropy of the policy, nats; None for a model without a policy."""
    search: Boxes
    """The search window as a box (4,), which grows while the target is searched or doubted."""
    ms: float
    """Milliseconds that the frame took, shared by all targets of the frame."""


@dataclass(frozen=True)
class Look:
    """What the tracker saw of one target in the last frame; for drawing and explaining."""

    window: Window
    """The search window."""
    patch: Image
    """Its content (S, S, 3) uint8 BGR."""
    features: cf.Features
    """Z: (C, n, n) float32."""
    fine: cf.Features
    """What the trunk saw on the way to it, in smaller cells: (C', 2n, 2n) float32; Z once more from
    a trunk that does not tell."""
    spectrum: cf.Spectrum
    """Ẑ of the tapered features."""
    response: cf.Features
    """M: (n, n) float32, its peak at [n // 2, n // 2] for a target that has not moved (eq. 3)."""
    zoom: float = 1.0
    """How much more of the image was looked at than `WindowConfig` says."""
    z: cf.Features | None = None
    """f1(Z) (C, n, n) (eq. 4); None for a model without a policy."""
    evidence: Mapping[str, float] = field(default_factory=dict[str, float])
    """What the score was computed from, once it was; see `entrack.config.Weights`."""

    @property
    def maps(self) -> Maps:
        """Both, as the trunk makes them."""
        return Maps(self.features, self.fine)


class Answer(NamedTuple):
    """A decision about one target in one frame."""

    box: Boxes
    evidence: dict[str, float]
    """What the score is computed from; see `entrack.config.Weights`."""
    sigma: NDArray[np.float64] | None = None
    entropy: float | None = None
    wider: float = 0.0
    """How much wider than high the action would have made the box: a logarithm."""


@dataclass
class Target:
    """What is remembered of one target from frame to frame."""

    box: Boxes
    first: Boxes
    template: cf.Features
    weights: cf.Spectrum
    origin: Origin
    search: Search
    colours: Colours | None = None
    """None where the configuration leaves them to the trunk."""
    likeness: Likeness | None = None
    """None where the size is searched."""
    aspect: Aspect | None = None
    """None where the box is told as it is."""
    parts: Parts | None = None
    """What the finer map had in the last box; None where the score does not care, or where another
    place is worked at now."""
    known: object = None
    """What the policy's f1 remembers of the first frame."""
    looks: list[Look] = field(default_factory=list[Look])
    """What was seen in the last frame, at every size that was looked at."""
    state: State | None = None
    look: Look | None = None
    places: list[Window] = field(default_factory=list[Window])
    """Where else it was looked for in the last frame, if it was lost or doubted, …"""
    patches: list[Image] = field(default_factory=list[Image])
    """… what was seen there …"""
    elsewhere: list[Maps] = field(default_factory=list[Maps])
    """… and what the trunk made of it."""
    unlearned: Image | None = None
    """The last frame at the new box, of which X' of eq. 14 is made together with the next Z."""
    waited: int = 0
    """Frames since the last such."""
    turn: int = 0
    """Frames until other sizes than the last are looked at, see `ScaleConfig.every`."""

    @property
    def told(self) -> Boxes:
        """The box that is reported: while the target is searched, the last one that was sure."""
        box = self.search.held if self.search.active else self.box
        return self.aspect.stretch(box) if self.aspect else box.copy()

    def coloured(self, look: Look) -> Look:
        """The same with M weighed by colours, where they count."""
        if self.colours is None:
            return look
        size = self.box[2:] / look.window.box[2:]
        return replace(look, response=self.colours.weigh(look.response, look.patch, size))

    def colours_in(self, look: Look, box: Boxes) -> Seen | None:
        """The colours in a box, as far as it was in the window that was looked at."""
        if self.colours is None:
            return None
        return self.colours.see(look.patch, look.window.to_patch(box) / look.window.size)

    def recalled(self, past: Past, seen: Seen | None) -> dict[str, float]:
        """What the score is computed from that takes a memory: of what has happened, of colours."""
        evidence = past.evidence
        if self.colours and seen:
            evidence["colour"] = self.colours.change(seen)
            evidence["swap"] = past.swap(self.colours.strange(seen))
        return evidence

    def learn(self, seen: Seen | None, wider: float, score: float) -> None:
        """Remember how the new box looks: its colours, its features, its aspect.

        `wider` is that of the `Answer`.
        """
        assert self.look is not None
        maps, window = self.look.maps, self.look.window
        if self.colours and seen:
            self.colours = self.colours.learn(seen, score)
        if self.likeness:
            self.likeness = self.likeness.learn(maps, self.box, window)
        if self.aspect:
            self.aspect = self.aspect.then(maps, self.box, window, wider)

    def slipped(self, before: Boxes) -> float | None:
        """By how many sizes the box has left what was in it; None if that is not known."""
        assert self.look is not None
        parts, look, centre = self.parts, self.look, boxes_.centre(self.box)
        self.parts = Parts.of(look.fine, self.box, look.window)
        return parts.slip(look.fine, before, look.window, centre) if parts else None

    def restart(self, place: Boxes | None) -> None:
        """Work elsewhere from now on; see `Search.restart`."""
        self.box, self.parts = self.search.restart(place), None

    def resize(self, ratio: NDArray[np.float64]) -> None:
        """Follow a change of the frame's size: `ratio` (4,)."""
        self.box, self.first = self.box * ratio, self.first * ratio
        self.search.held, self.search.step = self.search.held * ratio, self.search.step * ratio[:2]
        if self.search.left is not None:
            self.search.left = self.search.left * ratio
        if self.search.challenger is not None:
            self.search.challenger = self.search.challenger * ratio
