"""The policy π(a | s): a Gaussian over the box's four sides, squashed by tanh (§3.2.2, §3.2.5).

Plain numpy, from `policy.safetensors`. An action a = reach · tanh(u), u ~ N(μ, σ), moves the left,
top, right and bottom side in units of the box's own size (eq. 7).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from entrack.config import PolicyConfig
from entrack.errors import EntrackError
from entrack.state import F1, Array, Conditioned, Linear, State, Weights, f2

LOG_STD = (-6.0, 1.0)
"""Where log σ is cut off."""


@dataclass(frozen=True)
class Gaussian:
    """π(· | s) for one state."""

    mean: NDArray[np.float64]
    """μ (4,), before the tanh."""
    log_std: NDArray[np.float64]
    """log σ (4,), before the tanh."""
    reach: float

    def action(self, rng: np.random.Generator | None = None) -> NDArray[np.float64]:
        """Its mean action (4,), or with `rng` a sample."""
        u = self.mean
        if rng is not None:
            u = u + np.exp(self.log_std) * rng.standard_normal(4)
        return self.reach * np.tanh(u)

    @property
    def sigma(self) -> NDArray[np.float64]:
        """Standard deviation (4,) of the action, to first order at its mean."""
        return np.exp(self.log_std) * self.reach * (1 - np.tanh(self.mean) ** 2)

    @property
    def entropy(self) -> float:
        """Entropy of the action in nats, to first order at its mean."""
        return float(np.log(self.sigma).sum() + 2 * math.log(2 * math.pi * math.e))


class Head(Protocol):
    """From s to μ and log σ before the tanh."""

    side: int
    """Side of m: see `entrack.state.f2`."""

    def __call__(self, state: State) -> tuple[Array, Array]:
        """Return μ (4,) and log σ (4,)."""
        ...


class LinearHead:
    """The paper's prediction and randomness modules (§3.2.8): μ of z alone, σ of m alone.

    Or both of [z, m] (row 10), if their weights are as wide.
    """

    side = 72

    def __init__(self, weights: Weights, reach: float) -> None:
        self.w = weights
        self.joint = weights["mean.weight"].shape[1] == weights["log_std.weight"].shape[1]

    def __call__(self, state: State) -> tuple[Array, Array]:
        """See `Head`."""
        w, z, m = self.w, state.z.ravel(), state.m
        if self.joint:
            z = m = np.concatenate([z, m])
        mean = w["mean.weight"] @ z + w["mean.bias"]
        return mean, w["log_std.weight"] @ m + w["log_std.bias"]


class AttentionHead:
    """Reads the box where z and m say that the target is.

    Every cell of z proposes the four sides and says how sure it is of them; a softmax over the
    cells, to which the response M is added, weighs the proposals.
    """

    side = 18

    def __init__(self, weights: Weights, reach: float) -> None:
        self.w, self.reach = weights, reach

    def __call__(self, state: State) -> tuple[Array, Array]:
        """See `Head`."""
        c, n, _ = state.z.shape
        out = self.w["head.weight"] @ state.z.reshape(c, n * n) + self.w["head.bias"][:, None]
        heat = out[0] + self.w["head.beta"] * state.m
        attention = np.exp(heat - heat.max())
        attention /= attention.sum()
        along = (np.arange(n, dtype=np.float32) + 0.5) / n - 0.5
        x, y = np.tile(along, n), np.repeat(along, n)
        w, h = state.held[:2]
        growth = np.exp(out[1:5])
        # Where each cell lies, in sizes of the last box from its centre, and from there the sides.
        sides = np.stack([x / w, y / h, x / w, y / h]) + growth * OUTWARDS[:, None]
        offset = (sides @ attention - OUTWARDS) / self.reach
        mean = np.arctanh(np.clip(offset, -0.999, 0.999))
        return mean, out[5:9] @ attention


OUTWARDS = np.array([-0.5, -0.5, 0.5, 0.5], np.float32)

F1S: dict[str, Callable[[Weights], F1]] = {"linear": Linear, "conditioned": Conditioned}
HEADS: dict[str, Callable[[Weights, float], Head]] = {
    "linear": LinearHead,
    "conditioned": AttentionHead,
}


class Policy:
    """State and policy of a model, from one dictionary of weights."""

    def __init__(self, config: PolicyConfig, weights: Weights) -> None:
        self.config, self.weights = config, weights
        self.f1 = F1S[config.f1](weights)
        self.head = HEADS[config.f1](weights, config.reach)

    def state(self, features: Array, response: Array, held: Array, target: object) -> State:
        """S = (f1(Z), f2(M)), eqs. 4–6."""
        z = self.f1(features, response, held, target)
        return State(z, f2(response, self.head.side), held)

    def __call__(self, state: State) -> Gaussian:
        """π(· | s)."""
        mean, log_std = self.head(state)
        log_std = np.clip(log_std, *LOG_STD)
        return Gaussian(mean.astype(np.float64), log_std.astype(np.float64), self.config.reach)


def load_policy(path: Path, config: PolicyConfig, threads: int = 1) -> Policy:
    """Read `policy.safetensors`; the conditioned f1 runs on `threads` threads of OpenVINO."""
    from safetensors import SafetensorError
    from safetensors.numpy import (
        load_file,  # pyright: ignore[reportUnknownVariableType]
    )

    try:
        weights = {name: w.astype(np.float32) for name, w in load_file(path).items()}
        if not all(np.isfinite(w).all() for w in weights.values()):
            raise EntrackError(f"{path} holds weights that are no numbers")
        policy = Policy(config, weights)
        _try(policy, weights)
    except (SafetensorError, KeyError, ValueError, TypeError, IndexError) as error:
        if isinstance(error, EntrackError):
            raise
        raise EntrackError(f"{path} holds no {config.f1} policy: {error}") from error
    if isinstance(policy.f1, Conditioned):
        from entrack.fast import CompiledConditioned

        policy.f1 = CompiledConditioned(policy.f1, threads)
    return policy


def _try(policy: Policy, weights: Weights) -> None:
    """Act once on nothing: weights that do not fit one another are found out here, not later."""
    linear = policy.config.f1 == "linear"
    n = 18
    if isinstance(policy.head, LinearHead):
        pooled = LinearHead.side**2 if policy.head.joint else 0
        n = math.isqrt(weights["mean.weight"].shape[-1] - pooled)
    channels = weights["f1.weight" if linear else "f1.match.weight"].shape[-1]
    nothing = np.zeros((channels, n, n), np.float32)
    known = policy.f1.remember(nothing, np.array([0.25, 0.25, 0.5, 0.5], np.float32))
    last = np.array([0.5, 0.5, 0, 0], np.float32)
    mean, log_std = policy.head(policy.state(nothing, nothing[0], last, known))
    if mean.shape != (4,) or log_std.shape != (4,):
        raise ValueError(f"actions of {mean.shape} numbers, expected (4,)")
