"""The last step of a training: fit score and σ of what was learned, and say what to do in doubt."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from entrack.calibrate import configured, fit_tracker
from entrack.config import AspectConfig, Config, RecoveryConfig, Weights
from entrack.datasets.sequence import Sequence
from entrack.datasets.synthetic import hard_plan, hard_sequence
from entrack.tracker import Tracker


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class FinishConfig:
    """What score and σ are fitted to besides the validation clips, and how the model ships."""

    made: int = Field(default=24, ge=0)
    """Synthetic sequences with occlusions, exits and look-alikes."""
    seed: int = Field(default=9000, ge=60)
    """Seed of the first of them; those below 60 are for tests."""
    frames: int = Field(default=150, ge=2)
    """Frames of each sequence and clip."""
    min_score: float = Field(default=0.3, ge=0, le=1)
    """See `UpdateConfig`; while a policy learns, it sees what its own mistakes lead to."""
    aspect: AspectConfig | None = Field(default_factory=AspectConfig)
    """See `Config`, for a policy that keeps the aspect; while it learns, a box is the action's."""
    recovery: RecoveryConfig | None = Field(default_factory=RecoveryConfig)
    """See `Config`."""


def finish(tracker: Tracker, clips: list[Sequence], config: FinishConfig) -> Config:
    """The configuration of a tracker that knows how sure it is.

    Raises
    ------
    EntrackError
        If there is nothing to learn from: it never loses its target, or always.
    """

    def datasets() -> Iterator[Iterable[Sequence]]:
        yield clips
        yield (hard_sequence(name, plan) for name, plan in hard_plan(config.made, config.seed))

    update = replace(tracker.config.update, min_score=config.min_score)
    policy = tracker.config.policy
    aspect = config.aspect if policy and policy.keep_aspect else None
    wanted = replace(tracker.config, update=update, aspect=aspect, recovery=config.recovery)
    found = fit_tracker(configured(tracker, wanted), datasets, config.frames)
    score = replace(wanted.score, **found.weights)
    return replace(wanted, score=score, spread=Weights(**found.spread))
