"""Eqs. 10–13 for the paper's networks, which are all linear, by hand: the same update, cheaper.

The paper's buffer holds one video, often of a few frames, while a batch has 100 rows: here every
state is projected once an update, and gradients are summed by state before they meet Z and m.
`SAC.update` computes the same with autograd; a test holds them together.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from entrack.learn.networks import Actor, LinearActor
from entrack.learn.replay import Replay
from entrack.learn.sac import SAC, SACConfig
from entrack.policy import LOG_STD

Array = NDArray[np.float32]


class _Group:
    """Parameters of one optimiser, and what Adam remembers of them, as slices of flat arrays.

    The torch tensors are views of these, so checkpoints and `weights_of` see every step.
    """

    def __init__(self, parameters: Sequence[nn.Parameter], adam: torch.optim.Adam) -> None:
        sizes = [p.numel() for p in parameters]
        ends = np.cumsum(sizes)
        self.lr = float(adam.param_groups[0]["lr"])
        self.values, self.grads, self.first, self.second, self._a, self._b = np.zeros(
            (6, ends[-1]), np.float32
        )
        self.step = np.zeros((), np.float32)
        self.parts: list[Array] = []
        """The parameters, one after the other, in their own shapes …"""
        self.slopes: list[Array] = []
        """… and their gradients."""
        for p, size, end in zip(parameters, sizes, ends, strict=True):
            rows, shape = slice(end - size, end), tuple(p.shape)
            slots: dict[str, Any] = adam.state.get(p, {})
            self.values[rows] = p.detach().numpy().ravel()
            if slots:
                self.first[rows] = slots["exp_avg"].numpy().ravel()
                self.second[rows] = slots["exp_avg_sq"].numpy().ravel()
                self.step[...] = slots["step"].item()
            p.data = torch.from_numpy(self.values[rows].reshape(shape))
            adam.state[p] = {
                "step": torch.from_numpy(self.step),
                "exp_avg": torch.from_numpy(self.first[rows].reshape(shape)),
                "exp_avg_sq": torch.from_numpy(self.second[rows].reshape(shape)),
            }
            self.parts.append(self.values[rows].reshape(shape))
            self.slopes.append(self.grads[rows].reshape(shape))

    def descend(self) -> None:
        """One step of Adam with torch's defaults: β .9 and .999, ε 1e-8."""
        self.step += 1
        t, a, b = float(self.step), self._a, self._b
        self.first *= np.float32(0.9)
        self.first += np.multiply(self.grads, np.float32(0.1), out=a)
        self.second *= np.float32(0.999)
        np.multiply(self.grads, self.grads, out=a)
        self.second += np.multiply(a, np.float32(0.001), out=a)
        np.sqrt(self.second, out=a)
        a *= np.float32(1 / math.sqrt(1 - 0.999**t))
        a += np.float32(1e-8)
        np.divide(self.first, a, out=b)
        b *= np.float32(self.lr / (1 - 0.9**t))
        self.values -= b


class LinearSAC(SAC):
    """Soft actor-critic whose f1, μ, σ, Q and V are linear (§3.2.8)."""

    actor: LinearActor

    def __init__(self, actor: LinearActor, config: SACConfig) -> None:
        super().__init__(actor, config)
        self._version = -1
        self._pi: _Group | None = None

    def learn(self, replay: Replay, rng: np.random.Generator, act: bool = True) -> dict[str, float]:
        """See `SAC.learn`."""
        if self._pi is None:
            self._tie()
        rows, after = replay.sample(self.config.batch, rng)
        noise = rng.standard_normal((self.config.batch, 4)).astype(np.float32)
        return self._update(replay, rows, after, noise, act)

    def _tie(self) -> None:
        """Move all parameters into flat arrays; done late, when a checkpoint has been read."""
        self._pi = _Group(list(self.actor.parameters()), self.optimise_pi)
        self._q = _Group(list(self.q.parameters()), self.optimise_q)
        self._v = _Group(list(self.v.parameters()), self.optimise_v)
        self._goal = [p.detach().numpy() for p in self.goal_v.parameters()]

    def _project(self, replay: Replay, needed: NDArray[np.intp]) -> Array:
        """S of the states that are needed (U, 5508): z = f1(Z), and m."""
        assert self._pi is not None
        if self._version != replay.version:
            self._version = replay.version
            held = replay.arrays["z"][: replay.size]
            self._z = held.astype(np.float32).reshape(len(held), held.shape[1], -1)
            self._m = replay.arrays["m"][: replay.size].astype(np.float32)
            self._all, self._shown = np.arange(len(held)), np.arange(0)
        cells = self._z.shape[2]
        if needed is not self._shown:
            self._shown = needed
            self._s = np.empty((len(needed), cells + self._m.shape[1]), np.float32)
            self._s[:, cells:] = self._m[needed]
        weight, bias = self._pi.parts[:2]
        flat = weight.ravel()
        for row, state in enumerate(needed):
            self._s[row, :cells] = flat @ self._z[state]
        self._s[:, :cells] += bias
        return self._s

    def _update(
        self, replay: Replay, rows: NDArray[np.intp], after: NDArray[np.intp], noise: Array,
        act: bool,
    ) -> dict[str, float]:  # fmt: skip
        """One step of eqs. 10–13, in the order of `SAC.update`."""
        assert self._pi is not None
        c, n, reach = self.config, len(rows), self.actor.reach
        if self._version == replay.version and len(self._all) <= 2 * n:
            needed, now, then = self._all, rows, after
        else:
            needed, both = np.unique(np.concatenate([rows, after]), return_inverse=True)
            now, then = both[:n], both[n:]
        s = self._project(replay, needed)
        of = np.zeros((len(needed), n), np.float32)  # which rows of the batch show which state
        of[now, np.arange(n)] = 1
        a, r = replay.arrays["action"][rows], replay.arrays["reward"][rows]
        best = replay.arrays["best"][rows].astype(np.float32)
        p = replay.arrays["terminated"][rows].astype(np.float32)

        w1, b1, w2, b2 = self._q.parts
        w, size = np.stack([w1[0], w2[0]]), s.shape[1]
        # eq. 10: κq = r + γ (1 − p) V_ψ'(s')
        goal_w, goal_b = self._goal
        kappa_q = r + c.gamma * (1 - p) * (s @ goal_w[0] + goal_b)[then]
        q = (s @ w[:, :size].T)[now] + a @ w[:, size:].T + np.concatenate([b1, b2])
        gap_q = q - kappa_q[:, None]
        slope = gap_q * np.float32(2 / n)
        by_state, by_action = (of @ slope).T @ s, slope.T @ a
        for k in range(2):
            weight, bias = self._q.slopes[2 * k : 2 * k + 2]
            weight[0, :size], weight[0, size:] = by_state[k], by_action[k]
            bias[...] = slope[:, k].sum()
        self._q.descend()

        # ã ~ π(· | s), log π(ã | s)
        _, _, mean_w, mean_b, std_w, std_b = self._pi.parts
        cells = replay.arrays["z"].shape[2] * replay.arrays["z"].shape[3]
        seen_mean = s if self.actor.joint else s[:, :cells]
        seen_std = s if self.actor.joint else s[:, cells:]
        raw = seen_std @ std_w.T + std_b
        log_std = np.clip(raw, *LOG_STD)[now]
        spread = np.exp(log_std) * noise
        mean = (seen_mean @ mean_w.T + mean_b)[now]
        u = mean + spread
        tanh = np.tanh(u)
        fresh = reach * tanh
        # log(1 − tanh² u) = 2 (log 2 − u − softplus(−2u)), as in `squashed`.
        stretch = 2 * (math.log(2) - u - np.logaddexp(0, -2 * u)) + math.log(reach)
        log_pi = (-0.5 * noise**2 - log_std - 0.5 * math.log(2 * math.pi) - stretch).sum(1)

        # eq. 11: κv = min_i Q_i(s, ã) − α log π(ã | s)
        w = np.stack([w1[0], w2[0]])
        q_fresh = (s @ w[:, :size].T)[now] + fresh @ w[:, size:].T + np.concatenate([b1, b2])
        kappa_v = q_fresh.min(1) - c.alpha * log_pi
        v_w, v_b = self._v.parts
        gap_v = (s @ v_w[0] + v_b)[now] - kappa_v
        slope_v = gap_v.astype(np.float32) * np.float32(2 / n)
        self._v.slopes[0][0] = (of @ slope_v) @ s
        self._v.slopes[1][...] = slope_v.sum()
        self._v.descend()

        # eq. 12, whose sign is flipped in print: minimise α log π − Q
        first = c.policy_q == "first"
        which = np.zeros(n, np.intp) if first else q_fresh.argmin(1)
        value = q_fresh[np.arange(n), which]
        loss_pi = float((c.alpha * log_pi - value).mean())
        slope_u = (2 * c.alpha * tanh - w[which, size:] * reach * (1 - tanh**2)) / n
        slope_mean, slope_std = slope_u, slope_u * spread - c.alpha / n
        if c.imitate:
            loss, slope = self._imitate(mean, best)
            loss_pi, slope_mean = loss_pi + loss, slope_mean + slope
        if act:
            inside = ((raw >= LOG_STD[0]) & (raw <= LOG_STD[1]))[now]
            self._descend_pi(
                s, needed, of @ slope_mean.astype("f4"), of @ (slope_std * inside).astype("f4")
            )

        # eq. 13: ψ' ← ρ ψ' + (1 − ρ) ψ
        for goal, value in zip(self._goal, self._v.parts, strict=True):
            goal += np.float32(1 - c.rho) * (value - goal)
        return {
            "loss_q": float((gap_q**2).sum() / n), "loss_v": float((gap_v**2).mean()),
            "loss_pi": loss_pi,
            "entropy": -float(log_pi.mean()), "alpha": c.alpha, "value": float(q_fresh.mean()),
        }  # fmt: skip

    def _imitate(self, mean: Array, best: NDArray[np.float32]) -> tuple[float, NDArray[np.float64]]:
        """`SAC._imitation` with its weight, and its slope along the mean before the tanh (N, 4)."""
        reach, beta = self.actor.reach, 0.1
        tanh = np.tanh(mean)
        with np.errstate(invalid="ignore"):
            known = np.all(np.abs(best) < reach, axis=1)
        gap = np.where(known[:, None], reach * tanh - best, 0)
        weight = self.config.imitate / max(1, 4 * int(known.sum()))
        huber = np.where(np.abs(gap) < beta, gap**2 / (2 * beta), np.abs(gap) - beta / 2)
        slope: NDArray[np.float64] = np.clip(gap / beta, -1, 1) * reach * (1 - tanh**2)
        return weight * float(huber.sum()), weight * slope

    def _descend_pi(self, s: Array, needed: NDArray[np.intp], mean: Array, std: Array) -> None:
        """From slopes along μ and log σ of each state (U, 4) to those of weights, and a step."""
        assert self._pi is not None
        f1_w, f1_b, mean_w, mean_b, std_w, std_b = self._pi.slopes
        _, _, at_mean, _, at_std, _ = self._pi.parts
        cells = self._z.shape[2]
        mean_w[...] = mean.T @ (s if self.actor.joint else s[:, :cells])
        std_w[...] = std.T @ (s if self.actor.joint else s[:, cells:])
        mean_b[...], std_b[...] = mean.sum(0), std.sum(0)
        z = mean @ at_mean[:, :cells]
        if self.actor.joint:
            z += std @ at_std[:, :cells]
        total = np.zeros(self._z.shape[1], np.float32)
        for row, state in enumerate(needed):
            total += self._z[state] @ z[row]
        f1_w[...], f1_b[...] = total.reshape(f1_w.shape), z.sum()
        self._pi.descend()


def learner(actor: Actor, config: SACConfig) -> SAC:
    """The cheaper update, where the networks are linear and α is given."""
    plain = not (config.hidden or config.alpha_auto)
    if plain and isinstance(actor, LinearActor):
        return LinearSAC(actor, config)
    return SAC(actor, config)
