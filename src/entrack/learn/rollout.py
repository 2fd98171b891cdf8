"""Episodes played by workers.

Each is a file, made from a seed and the file of a policy, so any can be made again.
"""

import hashlib
import time
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from entrack.config import Config, PolicyConfig
from entrack.datasets.sequence import Sequence
from entrack.files import unfinished
from entrack.learn.env import EpisodeConfig, play
from entrack.learn.episode import Episode
from entrack.learn.store import kept
from entrack.policy import Policy, load_policy
from entrack.state import F1
from entrack.tracker import Tracker
from entrack.trunk import Trunk, load_trunk


@dataclass(frozen=True)
class Rollout:
    """One episode, by its number: the work of one unit."""

    number: int
    path: Path
    """Where the episode goes."""
    policy: Path
    """Weights to play with; the worker waits until the learner has written them."""
    stop: Path
    """A file that ends the waiting: the learner has given up."""
    clips: Path
    names: tuple[str, ...]
    """Clips to choose from, or the one to play."""
    trunk: Path
    tracker: Config
    episode: EpisodeConfig
    seed: tuple[int, ...]
    sample: bool = True
    features: bool = False
    """Keep Z for an f1 that is still learned."""


@lru_cache(1)
def _trunk(path: Path) -> Trunk:
    return load_trunk(path, threads=1)


_f1: dict[str, F1] = {}
"""The f1 of the last policy, by its weights."""


@lru_cache(2)
def _policy(path: Path, config: PolicyConfig) -> Policy:
    """A round's policy.

    With f1 of the one before where that is the same, as after a warm start: to compile it anew
    takes as long as four frames.
    """
    policy = load_policy(path, config)
    weights = sorted((k, w) for k, w in policy.weights.items() if k.startswith("f1."))
    key = hashlib.sha256(b"".join(w.tobytes() for _, w in weights)).hexdigest()
    if key not in _f1:
        _f1.clear()
        _f1[key] = policy.f1
    policy.f1 = _f1[key]
    return policy


@lru_cache(512)
def _clip(folder: Path, name: str) -> Sequence:
    return kept(folder, [name])[0]


def roll_out(unit: Rollout, report: Any = None) -> None:
    """Play an episode and write it, unless it is there."""
    if unit.path.exists():
        return
    while not unit.policy.exists():
        if unit.stop.exists():
            return
        time.sleep(0.02)
    rng = np.random.default_rng(unit.seed)
    sequence = _clip(unit.clips, unit.names[int(rng.integers(len(unit.names)))])
    assert unit.tracker.policy is not None
    policy = _policy(unit.policy, unit.tracker.policy)
    tracker = Tracker(unit.tracker, _trunk(unit.trunk), policy)
    episode = play(tracker, sequence, unit.episode, rng, unit.sample, unit.features)
    with unfinished(unit.path).open("wb") as file:
        np.savez(file, **episode._asdict())
    unfinished(unit.path).replace(unit.path)


def read_episode(path: Path) -> Episode:
    """What `roll_out` wrote."""
    with np.load(path) as table:
        parts: dict[str, Any] = {name: table[name] for name in Episode._fields}
        parts["terminated"] = bool(parts["terminated"])
    return Episode(**parts)
