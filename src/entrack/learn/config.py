"""Everything that decides what a policy becomes. Presets are TOML files of these fields."""

from typing import Literal

from pydantic import ConfigDict, Field, model_validator
from pydantic.dataclasses import dataclass

from entrack.config import Config, PolicyConfig
from entrack.learn.env import EpisodeConfig
from entrack.learn.finish import FinishConfig
from entrack.learn.sac import SACConfig
from entrack.learn.warm import WarmConfig
from entrack.trunks.pairs import PairConfig

_STRICT = ConfigDict(extra="forbid")


@dataclass(frozen=True, config=_STRICT)
class DataConfig:
    """What is learned from."""

    validation: tuple[str, ...] = ()
    """Clips that are never learned from: the policy is checked on them."""
    made: int = Field(default=0, ge=0)
    """Synthetic sequences; with cut-outs of real things where `--cutouts` gives some."""
    made_seed: int = 5000
    """Seed of the first of them."""
    made_share: float = Field(default=0.3, ge=0, le=1)
    """Share of the episodes that are played in them."""


@dataclass(frozen=True, config=_STRICT)
class BankConfig:
    """The looks that the warm start learns from."""

    looks: int = Field(default=100_000, ge=100)
    components: int = Field(default=128, ge=8, le=256)
    """Principal components of Z that are kept."""
    stills: float = Field(default=0.25, ge=0, le=1)
    """Share of pairs from stills, where there are some …"""
    made: float = Field(default=0.35, ge=0, le=1)
    """… and from synthetic sequences; the rest are annotated clips."""
    near: PairConfig = Field(
        default_factory=lambda: PairConfig(aspect=0.06, shift=0.07, zoom=0.06, frames=180)
    )
    """Half of the looks are off by as little as a tracker is that follows well …"""
    far: PairConfig = Field(
        default_factory=lambda: PairConfig(aspect=0.25, shift=0.3, zoom=0.22, frames=180)
    )
    """… and half by as much as one that has nearly lost its target."""


@dataclass(frozen=True, config=_STRICT)
class TrainConfig:
    """A run of `entrack train`."""

    name: str = "default"
    seed: int = Field(default=0, ge=0)
    """The same seed gives the same model on the same machine."""
    start_seed: int | None = Field(default=None, ge=0)
    """Seed of the looks and the warm start; None takes `seed`."""
    threads: int = Field(default=2, ge=1)
    """Of the learner."""
    data: DataConfig = Field(default_factory=DataConfig)
    tracker: Config = Field(default_factory=lambda: Config(policy=PolicyConfig()))
    """The tracker that learns, and that is shipped with what it has learned."""
    bank: BankConfig = Field(default_factory=BankConfig)
    warm: WarmConfig | None = None
    """Behaviour cloning before the first action (row 23); None starts from nothing."""
    joint: bool = False
    """μ and σ of a linear policy both see [z, m] (row 10)."""
    episode: EpisodeConfig = Field(default_factory=EpisodeConfig)
    sac: SACConfig = Field(default_factory=SACConfig)
    rounds: int = Field(default=100, ge=0)
    """Rounds of episodes and updates; N_epoch in the paper, whose rounds are one episode."""
    episodes: int = Field(default=16, ge=1)
    """Episodes a round."""
    updates: int = Field(default=100, ge=0)
    """Updates a round; N_iter."""
    lag: Literal[0, 1] = 1
    """With 1, a round is played with the policy of the round before, while the learner learns."""
    capacity: int = Field(default=40_000, ge=10)
    """States in the replay buffer."""
    fresh: bool = False
    """Empty the buffer before every round (algorithm, line 5; row 16)."""
    critic_first: int = Field(default=0, ge=0)
    """Rounds in which the policy stays as it is, until the critic knows something."""
    check_every: int = Field(default=10, ge=1)
    """Rounds between two looks at the validation clips."""
    finish: FinishConfig | None = None
    """The last step; None leaves score and σ as they are."""

    @model_validator(mode="after")
    def _box_is_the_action_s(self) -> "TrainConfig":
        if self.tracker.aspect:
            raise ValueError("a tracker that learns works with the box it tells: use finish.aspect")
        return self

    @property
    def first_seed(self) -> int:
        """Seed of the looks and the warm start."""
        return self.seed if self.start_seed is None else self.start_seed
