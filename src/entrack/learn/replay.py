"""The replay buffer B: transitions (s, a, r, s', p) in a ring of arrays (§3.2.5)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from entrack.learn.episode import Episode
from entrack.learn.networks import States, as_states

Features = NDArray[np.float32]


class Batch(NamedTuple):
    """Transitions drawn at random.

    A state that was drawn several times is there once: a buffer of one short video has few.
    """

    state: States
    now: NDArray[np.intp]
    """(N,): which of `state` each transition starts from."""
    action: NDArray[np.float32]
    best: NDArray[np.float32]
    reward: NDArray[np.float32]
    after: States | None
    """None where the critic's features are kept."""
    then: NDArray[np.intp]
    """(N,): which of `after` each transition leads to."""
    terminated: NDArray[np.float32]
    seen: tuple[Features, Features] | None = None
    """What the critic sees of s and of s' (N, k), where it is kept."""


class Replay:
    """A ring of at most `capacity` states; the oldest episodes make room for new ones.

    A state and the one after it lie side by side, so each is kept once: z in float16.

    Parameters
    ----------
    capacity
        In states.
    see
        What the critic sees of states (N, k); None where that changes with what is learned.
    """

    def __init__(self, capacity: int, see: Callable[[States], Features] | None = None) -> None:
        self.capacity, self.see = capacity, see
        self.arrays: dict[str, NDArray[np.generic]] = {}
        self.next, self.size = 0, 0
        self.version = 0
        """Changes with what is held."""
        self._usable: NDArray[np.intp] | None = None

    def add(self, episode: Episode) -> None:
        """Keep an episode, row by row; its last state is only ever the state after."""
        steps = len(episode.action)
        if steps == 0:
            return
        if steps + 1 > self.capacity:
            raise ValueError(f"an episode of {steps} steps in a buffer of {self.capacity}")
        end = np.zeros(steps + 1, bool)
        end[steps - 1] = episode.terminated
        usable = np.arange(steps + 1) < steps
        rows = {
            "z": episode.z, "m": episode.m, "held": episode.held,
            "action": _padded(episode.action), "best": _padded(episode.best),
            "reward": _padded(episode.reward), "terminated": end, "usable": usable,
        }  # fmt: skip
        if self.see:
            rows["seen"] = self.see(as_states(episode._asdict()))
        if not self.arrays:
            self.arrays = {
                name: np.zeros((self.capacity, *a.shape[1:]), a.dtype) for name, a in rows.items()
            }
        where = (self.next + np.arange(steps + 1)) % self.capacity
        for name, a in rows.items():
            self.arrays[name][where] = a
        # What lies behind may be the rest of an episode whose beginning was overwritten: its first
        # transition is whole, so nothing else has to go.
        self.next = int((where[-1] + 1) % self.capacity)
        self.size = min(self.capacity, self.size + steps + 1)
        self._changed()

    def clear(self) -> None:
        """Forget everything (algorithm, line 5)."""
        self.next, self.size = 0, 0
        if self.arrays:
            self.arrays["usable"][:] = False
        self._changed()

    def _changed(self) -> None:
        self.version += 1
        self._usable = None

    def __len__(self) -> int:
        """How many transitions may be drawn."""
        return int(self.arrays["usable"].sum()) if self.arrays else 0

    def sample(
        self, count: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Places of `count` transitions, drawn uniformly with replacement, and of what follows."""
        # By age, so that a buffer filled anew from the same episodes draws the same.
        oldest = self.next if self.size == self.capacity else 0
        if self._usable is None:
            self._usable = np.flatnonzero(np.roll(self.arrays["usable"], -oldest))
        rows = (self._usable[rng.integers(len(self._usable), size=count)] + oldest) % self.capacity
        return rows, (rows + 1) % self.capacity

    def draw(self, count: int, rng: np.random.Generator) -> Batch:
        """Draw `count` transitions uniformly, with replacement."""
        rows, after = self.sample(count, rng)
        a = self.arrays
        state, now = np.unique(rows, return_inverse=True)
        following, then = np.unique(after, return_inverse=True)
        return Batch(
            as_states(a, state),
            now,
            a["action"][rows].astype(np.float32),
            a["best"][rows].astype(np.float32),
            a["reward"][rows].astype(np.float32),
            None if self.see else as_states(a, following),
            then,
            a["terminated"][rows].astype(np.float32),
            (a["seen"][rows].astype(np.float32), a["seen"][after].astype(np.float32))
            if self.see
            else None,
        )


def _padded(a: NDArray[np.float32]) -> NDArray[np.float32]:
    """One more row, for the state in which no action was taken."""
    return np.concatenate([a, np.zeros((1, *a.shape[1:]), a.dtype)])
