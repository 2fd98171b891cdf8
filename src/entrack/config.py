"""Every choice that a tracker makes, as frozen data. A preset is a TOML file of these fields."""

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, model_validator
from pydantic.dataclasses import dataclass

from entrack.errors import EntrackError
from entrack.files import read_bytes

T = TypeVar("T")
_LARGEST = 1_000_000  # bytes of a configuration
_STRICT = ConfigDict(extra="forbid")


@dataclass(frozen=True, config=_STRICT)
class WindowConfig:
    """The search window: the first half of g in eq. 4."""

    context: float = Field(default=3.0, gt=1, le=10)
    """Side of the window in units of the target's size (rows 2 and 24 of the decisions)."""
    shape: Literal["square", "box"] = "square"
    """`square`: context · √(wh), nothing is warped; `box`: context × the box, as in the paper."""
    border: Literal["replicate", "mean"] = "replicate"
    """What lies outside the frame: its edge pixels, or its mean colour."""
    size: int = Field(default=288, ge=64, le=1024, multiple_of=16)
    """Side of the patch that the trunk sees, pixels."""


@dataclass(frozen=True, config=_STRICT)
class FilterConfig:
    """The correlation filter, eqs. 1–3."""

    label_sigma: float = Field(default=0.1, gt=0, le=1)
    """Standard deviation of the label Y, in units of the target's size."""
    regularisation: float = Field(default=0.01, ge=0)
    """λ of eq. 1 (Table 1: 0.01), in units of the template's mean energy."""
    hann: bool = True
    """Taper template and candidate with a cosine window."""


@dataclass(frozen=True, config=_STRICT)
class ScaleConfig:
    """The scale search around the last size."""

    steps: int = Field(default=3, ge=1, le=9)
    """Sizes looked at in each frame, an odd number; 1 keeps the size fixed."""
    factor: float = Field(default=1.03, gt=1, le=1.5)
    """Ratio of neighbouring sizes."""
    penalty: float = Field(default=0.985, gt=0, le=1)
    """What the response of a changed size is multiplied by, once for each step away."""
    rate: float = Field(default=0.6, gt=0, le=1)
    """Share of the found change of size that is followed."""
    between: bool = False
    """The found size is where a parabola through the logarithms of all sizes' responses is highest,
    no further than the outermost size; otherwise the size that answers most, after penalties."""
    every: int = Field(default=1, ge=1)
    """Frames from one search to the next; in between, only the last size is looked at, which saves
    passes of the trunk. Several targets take turns."""


@dataclass(frozen=True, config=_STRICT)
class LikenessConfig:
    """How the box is set right by what is most like it, see `entrack.likeness`."""

    span: float = Field(default=1.2, gt=1, le=2)
    """A box larger by this factor is compared with one smaller by it; no frame changes more."""
    gain: float = Field(default=0.6, ge=0)
    """Logarithm of the change of size, for a difference of 1 between their cosines, in Z and in the
    finer map …"""
    bias: float = Field(default=0.055, ge=-0.5, le=0.5)
    """… and where there is no difference: a larger box has more in it that the target has not."""
    step: float = Field(default=0.08, gt=0, le=0.5)
    """A box so many sizes further on is compared with one so many sizes back, on each axis; the
    first box is moved and grown as much, to see how its features change."""
    pull: float = Field(default=0.1, ge=0)
    """Sizes by which the centre is moved, for a difference of 1 between these cosines …"""
    share: float = Field(default=0.8, ge=0, le=1)
    """… and share of the move that explains, by those changes, what is seen."""
    rate: float = Field(default=0.01, ge=0, le=1)
    """How fast it is learned anew what the inside of the box looks like."""


@dataclass(frozen=True, config=_STRICT)
class AspectConfig:
    """How the aspect ratio of the box that is told is found, see `entrack.aspect`."""

    action: float = Field(default=0.6, ge=0)
    """Logarithm of its change, for an action that would change it by a logarithm of 1, …"""
    alike: float = Field(default=5.4, ge=0)
    """… for a difference of 1 between the cosines of a wider and of a narrower box, …"""
    parts: float = Field(default=0.6, ge=0)
    """… and for parts of the first box that are wider apart by a logarithm of 1."""
    rate: float = Field(default=0.3, gt=0, le=1)
    """Share of a frame in the running mean of all."""
    slack: float = Field(default=0.15, ge=0)
    """Logarithm up to which the mean is left out of account."""


@dataclass(frozen=True, config=_STRICT)
class UpdateConfig:
    """The template's running mean, eq. 14."""

    rate: float = Field(default=0.01, ge=0, le=1)
    """θ (Table 1: 0.01)."""
    min_score: float = Field(default=0.0, ge=0, le=1)
    """The template is left alone in frames with a lower score."""
    every: int = Field(default=1, ge=1)
    """Frames from one update to the next: 1 is eq. 14; more save passes of the trunk. The rate of
    an update is 1 − (1 − θ)^every, so that the template forgets as fast."""
    seen: Literal["again", "shifted"] = "again"
    """`again`: the trunk looks at the new box to make X', as in eq. 14; `shifted`: X' is sampled
    from the features of the search, which saves that pass."""


@dataclass(frozen=True, config=_STRICT)
class ColourConfig:
    """How the target's colours count, see `entrack.colour`."""

    power: float = Field(default=1.0, ge=0, le=10)
    """How much M is lowered where the target's colours are not: by their chance there, as a share
    of the greatest in the window, to this power."""
    bins: Literal[8, 16, 32] = 16
    """Levels that are told apart in each of blue, green and red."""
    rate: float = Field(default=0.04, ge=0, le=1)
    """How fast the colours of the target, which are averaged with those of the first frame, and
    those around it are learned anew."""


@dataclass(frozen=True, config=_STRICT)
class Weights:
    """Weights of what the tracker saw: `bias` + Σ weight · evidence. 0 leaves a signal out."""

    bias: float = 0.0
    peak: float = 0.0
    """The response's height at its peak."""
    psr: float = 0.0
    """The logarithm of its peak-to-sidelobe ratio."""
    first: float = 0.0
    """The height at the new box of the response to the first frame's filter, which sees the target
    alone and never learns."""
    unseen: float = 0.0
    """By how much of .2 `first` is below that: 1 where nothing like the target is seen."""
    rival: float = 0.0
    """That response's highest peak elsewhere in units of `first`: something looks like the target.
    """
    same: float = 0.0
    """Cosine of the features in the new box and in the first."""
    colour: float = 0.0
    """The logarithm of how much the colours in the new box differ from those in the first, which is
    0 to 1; with `[colour]` only."""
    leap: float = 0.0
    """The logarithm of the greatest leap so far: how far the box was from where that has gone which
    was in it, see `likeness.Parts.slip`, in sizes, times `rival`; up to .1. It is forgotten by a
    hundredth a frame, for what the tracker may have gone over to looks like the target from then
    on. Without `[likeness]`, how far from where the target's last steps led."""
    unrest: float = 0.0
    """How far the target is from where it is expected in these frames, a running mean in sizes up
    to .2: what leaps for a restless target is no leap."""
    swap: float = 0.0
    """It has leapt, and its tint is another: the logarithm of the greatest leap times how unlike
    the first frames' the box's tint is, 0 to 1, see `Colours.strange`; 0 without a leap. With
    `[colour]` only."""
    off: float = 0.0
    """How far the box is off by the first frame's features: the square of that in units of .1
    sizes, up to 1. With `[likeness]` only."""
    sigma: float = 0.0
    """The mean logarithm of the policy's σ, in units of the box's size."""
    lost: float = 0.0
    """1 while the target is searched and its box is held, when nothing else counts but …"""
    gone: float = 0.0
    """… the logarithm of the number of frames for which it has been."""

    @property
    def compares(self) -> bool:
        """Whether the target's first look counts, which takes time to compare with."""
        return any((self.first, self.unseen, self.rival, self.same))

    @property
    def recalls(self) -> bool:
        """Whether frames before the last one count."""
        return any((self.leap, self.unrest, self.swap))

    @property
    def leaps(self) -> bool:
        """Whether it counts that the box has leapt, which takes time to see."""
        return any((self.leap, self.swap))

    def total(self, evidence: Mapping[str, float]) -> float:
        """`bias` + Σ weight · evidence."""
        return self.bias + sum(getattr(self, name) * seen for name, seen in evidence.items())


@dataclass(frozen=True, config=_STRICT)
class ScoreConfig(Weights):
    """Score = logistic(bias + Σ weight · evidence).

    A weight that a `[score]` does not name is 0: weights are fitted together, and no other belongs
    to them. A configuration without `[score]` has `UNFITTED`.
    """

    lost_below: float = Field(default=0.2, ge=0, le=1)
    """The target counts as lost when the score falls below this …"""
    found_above: float = Field(default=0.4, ge=0, le=1)
    """… and as found again only when it rises above this."""

    def chance(self, evidence: Mapping[str, float]) -> float:
        """The score; 0 where the evidence is no number."""
        return _logistic(self.total(evidence))

    def identity(self, evidence: Mapping[str, float]) -> float:
        """`total`, if the box sat right: how much says that it is the target at all."""
        return self.total({**evidence, "off": 0.0})

    def known(self, evidence: Mapping[str, float]) -> float:
        """The score that goes with `identity`."""
        return _logistic(self.identity(evidence))


def _logistic(total: float) -> float:
    return 1 / (1 + math.exp(-max(total, -700.0))) if math.isfinite(total) else 0.0


UNFITTED = ScoreConfig(bias=-6.0, peak=6.0, psr=2.0)
"""A rough score of the response alone, for a tracker whose score was never fitted."""


@dataclass(frozen=True, config=_STRICT)
class RecoveryConfig:
    """What the tracker does when it is in doubt; without this, it only says so.

    Sizes are √(width × height) of the last box that it was sure of.
    """

    below: float = Field(default=0.07, ge=0, le=1)
    """It searches when the score falls below this; to say lost, `score.lost_below`, is cheaper …"""
    patience: int = Field(default=3, ge=1, le=30)
    """… for so many frames in a row: a target that is small and fast is doubted now and then …"""
    found_above: float = Field(default=0.25, ge=0, le=1)
    """… and works where it has found something from this on."""
    leeway: float = Field(default=0.2, gt=0)
    """Sizes by which a target moves otherwise than expected without being doubted; more, if it has
    done so before."""
    jump: float = Field(default=0.2, ge=0, le=1)
    """How much the response counts where the target would have to jump to; 1 never doubts it."""
    sure_above: float = Field(default=0.5, ge=0, le=1)
    """Score from which on a box is remembered as the place to come back to, and held."""
    confirm: int = Field(default=2, ge=1, le=30)
    """Frames in a row with that until the search ends."""
    looks: int = Field(default=4, ge=0, le=64)
    """Places looked at in each frame of a search, besides the box that is held and where it was
    lost."""
    glances: int = Field(default=0, ge=0, le=64)
    """Places looked at in a frame in which it does not search, but doubts: is something else more
    like the target than what it follows? With `[colour]` only."""
    wary_below: float = Field(default=0.75, ge=0, le=1)
    """It doubts when the score has fallen below this, or is below `sure_above`, for `patience`
    frames."""
    lead: float = Field(default=0.5, ge=0)
    """By how much the logit of its score has to be higher than that of what is followed …"""
    wins: int = Field(default=3, ge=1, le=30)
    """… and in how many frames in a row, until it is followed instead."""
    watch: int = Field(default=60, ge=0)
    """Frames for which others are compared with that one, too, however high its score."""
    growth: float = Field(default=0.15, ge=0)
    """Sizes by which the search reaches further in each frame since the box that is held."""
    reach: float = Field(default=8.0, ge=0)
    """Sizes that it reaches to at most."""
    stride: float = Field(default=1.3, gt=0)
    """Sizes between neighbouring places."""


@dataclass(frozen=True, config=_STRICT)
class PolicyConfig:
    """The learned policy (§3.2.2, §3.2.5): what it sees, and how far it may move the box."""

    f1: Literal["linear", "conditioned"] = "conditioned"
    """`linear`: a 1×1 convolution, as in the paper; `conditioned`: a network that compares Z with
    the target in the first frame (row 9)."""
    reach: float = Field(default=1.5, gt=0, le=4)
    """Furthest that an action moves a side of the box, in units of the box's own size."""
    search: float = Field(default=0.0, ge=0, le=1)
    """Share of the change of size that is the scale search's, or that of likeness; the rest is the
    action's (row 20)."""
    keep_aspect: bool = False
    """The action changes width and height by the same factor."""
    act: Literal["mean", "sample"] = "mean"
    """What is taken of the policy at test time (row 13)."""
    seed: int = Field(default=0, ge=0)
    """Of the samples."""


@dataclass(frozen=True, config=_STRICT)
class LimitsConfig:
    """What no action may do (row 20)."""

    smallest: float = Field(default=0.2, gt=0, le=1)
    """Least size, in units of the first."""
    largest: float = Field(default=5.0, ge=1)
    """Largest size, in units of the first."""


@dataclass(frozen=True, config=_STRICT)
class Config:
    """A tracker's configuration."""

    window: WindowConfig = Field(default_factory=WindowConfig)
    filter: FilterConfig = Field(default_factory=FilterConfig)
    scale: ScaleConfig = Field(default_factory=ScaleConfig)
    likeness: LikenessConfig | None = None
    """None leaves the size to the scale search; with it, `scale.steps` is 1."""
    aspect: AspectConfig | None = None
    """None tells the box as it is worked with."""
    update: UpdateConfig = Field(default_factory=UpdateConfig)
    score: ScoreConfig = UNFITTED
    colour: ColourConfig | None = None
    """None leaves colours to the trunk."""
    limits: LimitsConfig = Field(default_factory=LimitsConfig)
    spread: Weights | None = None
    """σ of the sides in units of the box's size is exp(bias + Σ weight · evidence); without this, σ
    is the policy's."""
    recovery: RecoveryConfig | None = None
    """None keeps one look a frame around the last box, whether or not the target is there."""
    policy: PolicyConfig | None = None
    """None leaves the box to the response's peak and the scale search: the filter alone."""

    @model_validator(mode="after")
    def _one_size(self) -> "Config":
        if self.likeness and self.scale.steps != 1:
            raise ValueError("the size comes from one look or from a search: set scale.steps to 1")
        return self

    @model_validator(mode="after")
    def _one_aspect(self) -> "Config":
        if self.aspect and self.policy and not self.policy.keep_aspect:
            raise ValueError("aspect stretches boxes that keep theirs: set policy.keep_aspect")
        return self

    @model_validator(mode="after")
    def _tint(self) -> "Config":
        if self.recovery and self.recovery.glances and not self.colour:
            raise ValueError("recovery.glances compares tints: add [colour], or set it to 0")
        return self


def parse(kind: type[T], values: dict[str, Any], source: str) -> T:
    """Make a configuration of `values`, or say which key of `source` is wrong."""
    try:
        return TypeAdapter(kind).validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise EntrackError(f"{source}: {key}: {first['msg']}") from error


def read(kind: type[T], path: Path) -> T:
    """Read a TOML file as a configuration of `kind`."""
    return parse(kind, read_toml(path), str(path))


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file as it is, with errors that a user understands."""
    if not path.is_file():
        raise EntrackError(f"no configuration file {path}")
    try:
        return tomllib.loads(read_bytes(path, _LARGEST).decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise EntrackError(f"{path} is not a TOML file: {error}") from error
