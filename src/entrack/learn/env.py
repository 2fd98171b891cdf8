"""Tracking as an environment (§3.2): the state is what the tracker sees, the action moves its box.

`Clip` is the paper's Markov decision process on one clip, stepping the tracker itself; on top of it
stands `TrackingEnv` for Gymnasium, registered as `entrack/Track-v0`.
"""

from collections.abc import Callable
from collections.abc import Sequence as SequenceOf
from typing import Any, Literal

import gymnasium
import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from entrack.box import Boxes, area, centre, clip, from_centre, iou, to_corners
from entrack.datasets.sequence import Sequence
from entrack.errors import EntrackError
from entrack.learn.episode import Episode
from entrack.state import State
from entrack.tracker import Tracker


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class EpisodeConfig:
    """What an episode is."""

    frames: tuple[int, int] = (32, 64)
    """Fewest and most frames of a clip …"""
    whole: bool = False
    """… unless an episode is the whole video, up to the most frames, as in the paper (row 17)."""
    stride: int = Field(default=3, ge=1)
    """Largest step from frame to frame; drawn once a clip."""
    jitter: float = Field(default=0.05, ge=0)
    """Standard deviation of the first box's place and size, in box sizes."""
    tau: float = Field(default=0.5, ge=0, lt=1)
    """τ of eq. 8 (Table 1: 0.5)."""
    miss: float = -1.0
    """The reward below τ (eq. 8); with τ 0 and this 0, the reward is the overlap itself."""
    lost: float = Field(default=0.0, ge=0, lt=1)
    """The target counts as lost at an IoU of no more than this (row 22) …"""
    patience: int = Field(default=1, ge=1)
    """… in so many frames on end."""
    oracle: float = Field(default=0.0, ge=0, le=1)
    """Share of episodes whose template is X_t = g(G_t, I_t), as in §3.2.5 (row 18)."""


def reward(overlap: float, tau: float, miss: float) -> float:
    """Eq. 8: the overlap where it is above τ, else `miss`, the paper's −1.

    >>> reward(0.7, 0.5, -1), reward(0.4, 0.5, -1)
    (0.7, -1)
    """
    return overlap if overlap > tau else miss


def usable(sequence: Sequence) -> bool:
    """Whether some two frames on end of a sequence show the target with a box."""
    return len(starts(sequence)) > 0


def starts(sequence: Sequence, frames: int = 2) -> NDArray[np.intp]:
    """Frames that an episode may start in: the target is there, and in the next frame too."""
    boxes = sequence.boxes
    good = np.isfinite(boxes).all(axis=1) & (boxes[:, 2:] >= 4).all(axis=1) & ~sequence.absent
    room = np.arange(len(boxes)) <= max(0, len(boxes) - frames)
    return np.flatnonzero(good[:-1] & good[1:] & room[:-1])


class Clip:
    """One episode: a clip, and the tracker in it.

    The tracker is stepped by its own `observe` and `move`, so an agent sees what it will see later.
    """

    def __init__(
        self, tracker: Tracker, sequence: Sequence, config: EpisodeConfig, rng: np.random.Generator
    ) -> None:
        self.tracker, self.config = tracker, config
        whole, (fewest, most) = config.whole, config.frames
        wanted = most if whole else int(rng.integers(fewest, most + 1))

        possible = starts(sequence, 2 if whole else min(wanted, len(sequence)))
        if not len(possible):
            possible = starts(sequence)
        if not len(possible):
            raise EntrackError(f"{sequence.name} has no two frames on end that show the target")
        first = int(possible[0] if whole else rng.choice(possible))
        room = len(sequence) - first
        stride = 1 if whole else int(rng.integers(1, 1 + max(1, min(config.stride, room // 16))))
        self.rows = range(first, len(sequence), stride)[:wanted]
        self.sequence = sequence
        self.oracle = rng.random() < config.oracle
        box = sequence.boxes[first]
        if config.jitter and not whole:
            shift, grow = rng.normal(0, config.jitter, 2), rng.normal(0, config.jitter, 2)
            box = from_centre(centre(box) + shift * box[2:], box[2:] * np.exp(grow))
        frame = sequence.frames[first]
        if area(clip(box, frame.shape[1], frame.shape[0])) < 0.25 * area(box):
            box = sequence.boxes[first]
        tracker.init(frame, box)
        self.at, self.misses = 0, 0
        self.state = self._observe()

    def _observe(self) -> State:
        """See the next frame; s_t."""
        self.at += 1
        frame = self.sequence.frames[self.rows[self.at]]
        if self.oracle and np.isfinite(self.truth).all():
            self.tracker.teach(frame, self.truth)
        [state] = self.tracker.observe(frame)
        assert state is not None, "an episode needs a model with a policy"
        return state

    @property
    def truth(self) -> Boxes:
        """G_t (4,) of the frame that is seen; NaN where the target is absent."""
        row = self.rows[self.at]
        return np.full(4, np.nan) if self.sequence.absent[row] else self.sequence.boxes[row]

    @property
    def best(self) -> NDArray[np.float64]:
        """The action (4,) that would hit G_t."""
        box = self.tracker.boxes[0]
        return (to_corners(self.truth) - to_corners(box)) / np.tile(box[2:], 2)

    def step(self, action: NDArray[np.floating[Any]]) -> tuple[float, float, bool, bool]:
        """Move the box; return reward (eq. 8), IoU, terminated and truncated."""
        [box] = self.tracker.move([action])
        overlap = float(iou(box, self.truth))
        absent = np.isnan(overlap)
        missed = not absent and overlap <= self.config.lost
        self.misses = self.misses + 1 if missed else 0
        gain = 0.0 if absent else reward(overlap, self.config.tau, self.config.miss)
        terminated = self.misses >= self.config.patience
        truncated = not terminated and self.at + 1 == len(self.rows)
        if not terminated and not truncated:
            self.state = self._observe()
        return gain, overlap, terminated, truncated


def play(
    tracker: Tracker, sequence: Sequence, config: EpisodeConfig, rng: np.random.Generator,
    sample: bool = True, keep_features: bool = False,
) -> Episode:  # fmt: skip
    """Track one clip with the tracker's own policy, sampling its actions, and keep everything.

    With `keep_features` the episode's z is Z itself: f1 is still to be learned from it (row 9).
    """
    assert tracker.policy is not None
    game = Clip(tracker, sequence, config, rng)
    states: list[State] = []
    rows: list[tuple[float, ...]] = []
    terminated = truncated = False
    while not (terminated or truncated):
        states.append(_kept(game, keep_features))
        action = tracker.policy(game.state).action(rng if sample else None)
        best = game.best
        gain, overlap, terminated, truncated = game.step(action)
        rows.append((*action, *best, gain, overlap))
    states.append(states[-1])  # what follows the end is never used
    table = np.array(rows, np.float32)
    z, m, held = (np.stack(part) for part in zip(*states, strict=True))
    return Episode(
        z.astype(np.float16),
        m,
        held,
        table[:, :4],
        table[:, 4:8],
        table[:, 8],
        table[:, 9],
        terminated,
    )


def _kept(game: Clip, features: bool) -> State:
    look = game.tracker.looks[0]
    return game.state._replace(z=look.features) if features and look else game.state


class TrackingEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """Follow a target through clips of a dataset.

    Observation: s = (z, m) of eq. 6 as one float32 vector, and the box's shape in the window.
    Action: (4,) in [−1, 1], the movement of the left, top, right and bottom side, times the
    policy's `reach`, in box sizes (eq. 7). Reward: eq. 8. Terminated: the target is lost.
    Truncated: the clip is over.

    Parameters
    ----------
    data
        `"FORMAT:DIR"`, or sequences.
    model
        A shipped model's name or a model folder, which must have a policy: its trunk, filter and f1
        make the state.
    episode
        What an episode is.
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(
        self,
        data: str | SequenceOf[Sequence],
        model: Any = "default",
        episode: EpisodeConfig | None = None,
        render_mode: Literal["rgb_array"] | None = None,
        make: Callable[[], Tracker] | None = None,
    ) -> None:
        import entrack
        from entrack.datasets import open_dataset

        self.tracker = make() if make else entrack.load(model)
        if self.tracker.policy is None:
            raise EntrackError(f"model {model} has no policy, so no state for an agent")
        opened = open_dataset(data) if isinstance(data, str) else data
        self.sequences = [s for s in opened if usable(s)]
        if not self.sequences:
            raise EntrackError("the data hold no two frames on end that show a target with a box")
        self.episode = episode or EpisodeConfig()
        self.render_mode = render_mode
        self.reach = self.tracker.policy.config.reach
        self.action_space = gymnasium.spaces.Box(-1, 1, (4,), np.float32)
        game = Clip(self.tracker, self.sequences[0], self.episode, np.random.default_rng(0))
        size = (len(game.state.vector),)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, size, np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start a clip drawn at random, or of `options["sequence"]`, an index."""
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(len(self.sequences)))
        index = int((options or {}).get("sequence", drawn))
        self.game = Clip(self.tracker, self.sequences[index], self.episode, self.np_random)
        return self._seen(), {"sequence": self.game.sequence.name, "box": self.tracker.boxes[0]}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Move the box, see the next frame."""
        moved = np.asarray(action, np.float64) * self.reach
        gain, overlap, terminated, truncated = self.game.step(moved)
        info = {"iou": overlap, "box": self.tracker.boxes[0]}
        return self._seen(), float(gain), terminated, truncated, info

    def _seen(self) -> NDArray[np.float32]:
        return self.game.state.vector.astype(np.float32)

    def render(self) -> Any:
        """The frame that is seen with the box on it, RGB uint8 (H, W, 3)."""
        import cv2

        row = self.game.rows[self.game.at]
        image = self.game.sequence.frames[row][..., ::-1].copy()
        x0, y0, x1, y1 = (round(side) for side in to_corners(self.tracker.boxes[0]).tolist())
        return cv2.rectangle(image, (x0, y0), (x1, y1), (255, 140, 0), 2)
